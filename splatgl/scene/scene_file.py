"""`Scene`: a scene.toml, or the same from arguments; masks and transfer functions by name.

volume = "head.nii.gz"          # beside the scene file, or the name of a built-in scene
threshold = 0.0
clip = ["x>0.3", "z>=30mm"]     # what is kept; crop = "10:90,:,:" in voxels; mask = "brain.nii.gz", or several
annotate = ["scale", "title=A"] # as --annotate
[load]                          # as LoadOptions
[transfer]                      # preset = "…", or points, colormap, window, scale, unit, gradient, shading
[camera]                        # size, azimuth, elevation, fov, zoom | eye, look_at, up | orthographic, height
[settings]                      # as Settings
[[mesh]]                        # file, color, opacity, radius, visible
[vectors]                       # show ("magnitude", "direction"), streamlines, arrows, colormap
surfaces = 0.5                  # segmentations as surfaces, smoothed by that
[[layer]]                       # more: volume, threshold, opacity, visible, clip, crop, mask, surfaces, [layer.load], …
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.annotations.annotate import check
from splatgl.data.color import srgb_of_name
from splatgl.data.mask import OUTSIDE, parse_mask
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import error_prefix, expected
from splatgl.fileio import load_table, toml_value
from splatgl.options import (
    BASIC,
    CLIPPING,
    FLAG,
    LAYERS,
    TRANSFER,
    Kind,
    check_options,
    declared,
    instance,
    interval,
    names_of,
    non_default,
    number,
    option,
    refuse_unknown,
)
from splatgl.readers import load
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import FAINT, LOOK, VECTORS, MeshFile, Vectors, is_mesh, split_look, stage
from splatgl.scene.view import ViewOptions, seen_along_z
from splatgl.splat.colormaps import base_name
from splatgl.splat.label_detection import MASK, mark_kind
from splatgl.splat.presets import (
    default_transfer,
    is_preset,
    label_transfer,
    logarithmic_transfer,
    preset,
    preset_named,
)
from splatgl.splat.segment_surfaces import SMOOTHING, check_strength
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.splat.extract import Progress
    from splatgl.splat.splats import Splats


def mask_anywhere(mask: Any) -> Any:
    """A mask by its absolute path; one in memory, or at an address, as it is."""
    if not isinstance(mask, str) or is_address(mask):
        return mask
    return mask_moved(mask, lambda file: str(Path(file).resolve()))


def mask_moved(mask: str, move: Callable[[str], str]) -> str:
    """A mask with another name of its file."""
    file, labels, outside = parse_mask(mask)
    parts = [move(file), ",".join(map(str, labels)), OUTSIDE * outside]
    return ":".join(part for part in parts if part)


def check_masked(source: str, volume: Volume, transfer: Transfer) -> None:
    """InputError for masks that keep nothing that can be seen."""
    from splatgl.splat.opaque_bounds import Opaque

    if volume.masks and Opaque(volume, transfer).nothing:
        fix = "set the points to the values that matter, or take another mask"
        raise expected(source, "voxels with an opacity that its masks keep", "none", fix)


# extraction and cameras are imported once there is a volume: bad input is told at once

# types of the keys of a scene file that are no options
TABLES: dict[str, type] = {
    **{name: dict for name in ("load", "transfer", "camera", "settings", "vectors")},
    **{name: list for name in ("layer", "mesh", "annotate")},
    "volume": str,
}
# keys of a transfer function that are of channels: pairs of a channel and a colour, or a window
OF_CHANNELS = ("color_of", "window_of")
# keys of a transfer function that say nothing of labels
OF_AMOUNTS = frozenset(("points", "colormap", "window", "scale", "gradient"))
# keys of a layer that are no options; options of a scene and its layers with values that TOML holds
LAYER = ("volume", "load", "transfer")
PLAIN = ("threshold", "opacity", "visible", "clip", "crop", "mask", "surfaces", "annotate")


def read_channel_color(text: str) -> tuple[str, str]:
    """Channel and #rrggbb of CHANNEL=COLOR. Raises ValueError for other text."""
    name, _, color = text.rpartition("=")
    if not name:
        raise ValueError
    return name, "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color))


def read_channel_window(text: str) -> tuple[str, tuple[float, float]]:
    """Channel and window of CHANNEL=LOW,HIGH. Raises ValueError for other text."""
    name, _, window = text.rpartition("=")
    if not name:
        raise ValueError
    low, high = interval().check(interval().read(window))
    return name, (low, high)


def read_labels(text: str) -> tuple[tuple[int, float], ...]:
    """Labels and factors of their opacities of N or N:A, separated by commas; () of "all". Raises ValueError."""
    pairs = [part.partition(":") for part in text.split(",")] if text != "all" else []
    return tuple((int(number), float(factor or 1)) for number, _, factor in pairs)


@dataclass(frozen=True)
class TransferChoice:
    """Options of a transfer function beside its fields: what it is made from."""

    preset: str = option(
        "", instance("a name", str), "ct-bone, mr-angio, mip, …: splatgl presets lists all", group=TRANSFER, level=BASIC
    )
    only_labels: tuple[tuple[int, float], ...] = option(
        (),
        Kind("labels N or N:A, separated by commas, or all", tuple, read_labels, "N[:A],N…"),
        "labels of a segmentation to show, or all. A: a factor of their opacity",
        group=TRANSFER,
    )
    color_of: tuple[tuple[str, str], ...] = option(
        (),
        Kind("a colour #rrggbb, #rgb or of a name in CSS", tuple, read_channel_color, "CHANNEL=COLOR"),
        "colour of a channel, #rrggbb or a CSS name (repeatable)",
        group=TRANSFER,
        repeat=True,
    )
    window_of: tuple[tuple[str, tuple[float, float]], ...] = option(
        (),
        Kind("LOW below HIGH", tuple, read_channel_window, "CHANNEL=LOW,HIGH"),
        "values of a channel that its colours span, from clear to opaque (repeatable)",
        group=TRANSFER,
        repeat=True,
    )


def _several(value: Any) -> tuple[Any, ...]:
    """One value or several as a tuple, () for ""."""
    if isinstance(value, list | tuple):
        return tuple(value)
    return () if isinstance(value, str) and not value else (value,)


def _clip(value: Any) -> tuple[Any, ...]:
    return (value,) if isinstance(value, str) or not isinstance(value, Iterable) else tuple(value)


@dataclass(frozen=True)
class SceneFile:
    """Description of a picture: files and options. clip, mask, surfaces that are None in a layer are the scene's.

    volume: a built-in scene, file or address, or the name of the volume `held` in memory. layers: further volumes;
    their views and settings are ignored. annotate: names as of --annotate.
    """

    volume: str
    load: Mapping[str, Any] = field(default_factory=dict)
    transfer: Mapping[str, Any] = field(default_factory=dict)
    view: ViewOptions = field(default_factory=ViewOptions)
    settings: Settings = field(default_factory=Settings)
    threshold: float = option(
        0.0, number(metavar="T"), "draw voxels of a higher opacity only (default 0)", group=TRANSFER
    )
    opacity: float = option(1.0, number("a factor from 0 to 1", 0, 1))
    visible: bool = option(True, FLAG)
    clip: tuple[Any, ...] | None = option(
        None,
        Kind("conditions", _clip, metavar="CONDITION"),
        "keep a part, such as x>0.3, z<=30mm or x+y>1. By shares of the volume's box, by lengths, or by a point and a "
        "normal; repeatable",
        group=CLIPPING,
        level=BASIC,
        repeat=True,
    )
    crop: str = option(
        "",
        instance("A:B,C:D,E:F, voxels along x, y and z", str, metavar="A:B,C:D,E:F"),
        "keep these voxels along x, y, z, and fit the view to them",
        group=CLIPPING,
    )
    mask: tuple[Any, ...] | None = option(
        None,
        Kind("FILE[:N,N…][:outside], or several", _several, metavar="FILE[:N,N…][:outside]"),
        "keep voxels inside a mask file. N,N…: inside these labels of it; outside: outside of them; repeatable",
        group=CLIPPING,
        level=BASIC,
        repeat=True,
    )
    surfaces: float | None = option(
        None,
        Kind("a strength of smoothing from 0 to 1", check_strength, float, "S"),
        f"draw segmentations as smooth closed surfaces, smoothed by 0 to 1 (default {SMOOTHING:g})",
        group=LAYERS,
        bare=SMOOTHING,
    )
    layers: tuple[SceneFile, ...] = option(
        (),
        Kind("an opacity from 0 to 1", tuple, lambda text: SceneFile.read(text), "FILE[:LOOK[:OPACITY]]"),
        "another volume. LOOK: a preset or a colour map; OPACITY: a factor from 0 to 1; repeatable",
        group=LAYERS,
        level=BASIC,
        flag="--layer",
        repeat=True,
    )
    meshes: tuple[MeshFile, ...] = option(
        (),
        Kind("an opacity from 0 to 1", tuple, MeshFile.read, "FILE[:COLOUR[:OPACITY]]"),
        "a surface (.stl, .vtp, .obj, …) or lines (.trk, .tck). COLOUR: or MAP=ARRAY for values; repeatable",
        group=LAYERS,
        level=BASIC,
        flag="--mesh",
        repeat=True,
    )
    annotate: tuple[str, ...] = ()
    vectors: Vectors = field(default_factory=Vectors)
    held: Volume | None = None

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def read(cls, text: str) -> SceneFile:
        """The layer of FILE[:LOOK[:OPACITY]]; LOOK: a preset or a colour map. Raises ValueError for other text."""
        source, look, opacity = split_look(text, lambda name: not name or bool(LOOK.fullmatch(name)))
        return cls(
            source, transfer={"preset" if is_preset(look) else "colormap": look} if look else {}, opacity=opacity
        )

    @classmethod
    def from_toml(cls, path: Path) -> SceneFile:
        """Reads a scene file. Raises InputError for a missing file, bad TOML, and unknown keys."""
        table = load_table(path, "a scene")
        scene = cls._of_table(path, str(path), table, TABLES)
        camera = table.get("camera", {})
        refuse_unknown(f"{path} [camera]", camera, names_of(ViewOptions))
        with error_prefix(f"{path} [camera]"):
            view = ViewOptions(**camera)
        with error_prefix(f"{path} [settings]"):
            settings = Settings().but(**table.get("settings", {}))
        layers = []
        for place, layer in enumerate(table.get("layer", []), 1):
            what = f"{path} [[layer]] {place}"
            if not isinstance(layer, dict):
                raise expected(what, "a table", repr(layer))
            layers.append(cls._of_table(path, what, layer, LAYER))
        tables = enumerate(table.get("mesh", []), 1)
        meshes = [MeshFile.of_table(path.parent, f"{path} [[mesh]] {place}", mesh) for place, mesh in tables]
        with error_prefix(str(path)):
            annotate = check(table.get("annotate", []))
        with error_prefix(f"{path} [vectors]"):
            refuse_unknown("vectors", lines := table.get("vectors", {}), declared(Vectors))
            vectors = Vectors(**lines)
        scene = replace(scene, view=view, settings=settings, annotate=annotate, vectors=vectors)
        return replace(scene, layers=tuple(layers), meshes=tuple(meshes))

    @classmethod
    def _of_table(cls, path: Path, what: str, table: Mapping[str, Any], tables: Collection[str]) -> SceneFile:
        """The scene of the options in a table, or one of its layers. tables: further keys."""
        plain = [name for name in PLAIN if name != "annotate"]
        refuse_unknown(what, table, sorted([*plain, *tables]))
        for key in tables:
            if not isinstance(table.get(key, TABLES[key]()), TABLES[key]):
                raise expected(f"{what}: {key}", TABLES[key].__name__, repr(table[key]))
        if "volume" not in table:
            raise expected(what, "the key volume", ", ".join(table) or "an empty file")
        source, reading = table["volume"], dict(table.get("load", {}))
        if source not in SCENES and not is_address(source):
            source = str(path.parent / source)
        if isinstance(reading.get("color"), str):
            reading["color"] = str(path.parent / reading["color"])
        with error_prefix(f"{what} [load]"):
            refuse_unknown("load", reading, declared(LoadOptions))
            LoadOptions(**reading)
        for key, this in (("clip", "conditions"), ("mask", "FILE[:N,N…][:outside], or several")):
            if not all(isinstance(text, str) and text for text in _several(table.get(key, ()))):
                raise expected(f"{what}: {key}", f"{this}, each in quotes", repr(table[key])[:80])
        with error_prefix(what):
            scene = cls(
                source, reading, table.get("transfer", {}), **{key: table[key] for key in plain if key in table}
            )
        if scene.mask is None:
            return scene
        folder = path.parent
        masks = [mask if is_address(mask) else mask_moved(mask, lambda file: str(folder / file)) for mask in scene.mask]
        return replace(scene, mask=tuple(masks))

    def with_options(self, **given: Any) -> SceneFile:
        """The scene with options of the command line or keywords: of reading, transfer function, view, settings and of
        the scene itself; with further layers and meshes. Raises InputError for their values.
        """
        own = {name: given[name] for name in declared(SceneFile) if name in given}
        layers = (*self.layers, *own.pop("layers", ()))
        transfer = {name: given[name] for name in names_of(TransferChoice, Transfer) if name in given}
        if "labels" in given:
            layers = (*layers, SceneFile(given["labels"], transfer={"only_labels": transfer.pop("only_labels", ())}))
        meshes = (*self.meshes, *map(MeshFile.of, _several(own.pop("meshes", ()))))
        if given.get("clip_meshes"):
            alone = is_mesh(self.volume) and self.volume not in [mesh.file for mesh in meshes]
            meshes = tuple(replace(mesh, clip=True) for mesh in [MeshFile(self.volume)] * alone + [*meshes])
        settings = {name: given[name] for name in names_of(Settings) if name in given}
        return replace(
            self,
            **own,
            layers=layers,
            meshes=meshes,
            load={**self.load, **{name: given[name] for name in declared(LoadOptions) if name in given}},
            transfer={**self.transfer, **transfer},
            view=replace(self.view, **{name: given[name] for name in names_of(ViewOptions) if name in given}),
            vectors=replace(self.vectors, **{VECTORS[name]: given[name] for name in VECTORS if name in given}),
            settings=self.settings.but(**settings),
        )

    def to_toml(self, folder: Path) -> str:
        """TOML text which `from_toml`, reading it from a file in `folder`, parses to the same scene.

        Paths are relative if below `folder`, else absolute. Raises InputError for values that TOML cannot represent.
        """
        if self.held is not None:
            raise expected("scene", "a volume in a file, which a scene file can name", "an array in memory")
        camera = {name: getattr(self.view, name) for name in declared(self.view) if name in non_default(self.view)}
        tables = {"camera": {**camera, "size": self.view.size}, "settings": self.settings.given}
        lines = self._lines(folder, "", {**tables, "vectors": non_default(self.vectors)})
        for layer in self.layers:
            lines += ["", "[[layer]]", *layer._lines(folder, "layer.", {})]
        for mesh in self.meshes:
            lines += mesh.lines(_relative(mesh.file, folder))
        return "\n".join(lines) + "\n"

    def _lines(self, folder: Path, prefix: str, more: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Lines of what `_of_table` reads, and of more tables."""
        known = self.volume in SCENES and not self.load
        reading = dict(self.load)
        if isinstance(reading.get("color"), str):
            reading["color"] = _relative(reading["color"], folder)
        lines = [f"volume = {toml_value('volume', self.volume if known else _relative(self.volume, folder))}"]
        given = {name: value for name, value in non_default(self).items() if name in PLAIN}
        if self.mask is not None:
            given["mask"] = [_mask_in(mask, folder) for mask in self.mask]
        lines += [f"{name} = {toml_value(name, value)}" for name, value in given.items()]
        for name, table in {"load": reading, "transfer": self.transfer, **more}.items():
            rows = [
                f"{key} = {toml_value(f'{name} {key}', value)}" for key, value in table.items() if value is not None
            ]
            lines += ["", f"[{prefix}{name}]", *rows] if rows else []
        return lines

    def anywhere(self) -> SceneFile:
        """The same scene with absolute paths, for processes in other folders."""
        reading = {name: _absolute(value) if name == "color" else value for name, value in self.load.items()}
        known = self.volume in SCENES and not self.load
        volume = self.volume if known else _absolute(self.volume)
        layers = tuple(each.anywhere() for each in self.layers)
        meshes = tuple(mesh if mesh.held else replace(mesh, file=_absolute(mesh.file)) for mesh in self.meshes)
        mask = None if self.mask is None else tuple(map(mask_anywhere, self.mask))
        return replace(self, volume=volume, load=reading, layers=layers, meshes=meshes, mask=mask)

    def refuse_more(self, drawn: Container[str] = ()) -> None:
        """InputError for what a command leaves out that draws the volume and, beside it, the options `drawn` alone."""
        more = [
            ("layers", "layers", len(self.layers) or None),
            ("meshes", "meshes", len(self.meshes) or None),
            ("surfaces", "surfaces", None if self.surfaces is None else f"{self.surfaces:g}"),
            ("streamlines", "vectors", "streamlines or arrows" if self.vectors.drawn else None),
        ]
        for name, what, got in more:
            if got is not None and name not in drawn:
                raise expected(what, "none", got, "splatgl render draws them")

    @property
    def files(self) -> tuple[str, ...]:
        """What it names: its volume, colours, masks and meshes, and those of its layers."""
        color = self.load.get("color")
        masks = [parse_mask(each)[0] for each in self.mask or () if isinstance(each, str)]
        meshes = [mesh.file for mesh in self.meshes if mesh.held is None]
        below = [file for layer in self.layers for file in layer.files]
        return (self.volume, *([color] if color else []), *masks, *meshes, *below)

    def open(self) -> Volume:
        """The volume: a built-in scene, or a file through its reader; masked; a flat stack with the view of it."""
        if self.held is not None:
            return self._placed(self.held)
        if self.volume in SCENES and not self.load:
            return self._masked(SCENES[self.volume]())
        if is_mesh(self.volume):
            if self.load:
                raise expected("options", "none of volumes for a mesh", ", ".join(self.load), "leave them out")
            return stage(self.volume)
        return self._placed(load(self.volume, **self.load))

    def _masked(self, volume: Volume) -> Volume:
        for mask in self.mask or ():
            volume = volume.masked(mask)
        return volume

    def _placed(self, volume: Volume) -> Volume:
        """What is drawn of a volume; a flat stack with the view of it, unless the view says what is up."""
        volume, view = self._masked(self.vectors.values(volume)), self.view
        volume = self._decided(volume)
        if view.eye is not None or view.up is not None:
            return volume
        return seen_along_z(volume, told=view.azimuth is None and view.elevation is None)

    def _decided(self, volume: Volume) -> Volume:
        """The volume as labels or amounts; what is given of the transfer function decides, too."""
        if self.transfer.keys() & {"preset", "only_labels"}:
            return volume
        found = mark_kind(volume)
        if self.surfaces is not None and found.hints.values == MASK:
            # of two values, of which one is a segment
            return found.of_values("labels")
        if self.transfer.keys() & OF_AMOUNTS and volume.labels is None:
            return replace(found.of_values("amounts") if found.labels is not None else found, notes=volume.notes)
        return found

    def cut(self, volume: Volume) -> SceneFile:
        """The scene with the planes of `clip` and `crop` in its settings, and a view fitted to what crop leaves."""
        if not (self.clip or self.crop):
            return self
        from splatgl.splat.clipping import Box, Part, clip_corners, crop_planes, parse_planes

        around = crop_planes(self.crop, volume) if self.crop else ()
        found = parse_planes(self.clip or (), Box.of([volume]))
        settings = self.settings.but(clip=(*self.settings.clip, *found, *around))
        view = self.view.fitted(Part(clip_corners(around, volume.corners), volume.frame)) if around else self.view
        return replace(self, clip=None, crop="", settings=settings, view=view)

    def splats(
        self, volume: Volume, transfer: Transfer, progress: Progress | None = None, moving: bool = False
    ) -> Splats:
        """The splats of the scene, classified as its settings say. moving: whether pictures are motion-blurred."""
        from splatgl.splat.resolve import extract_for_settings

        return extract_for_settings(volume, transfer, self.settings, self.threshold, progress, moving)

    def blended(self) -> SceneFile:
        """The scene with the blend of its preset, where its settings have none."""
        name = self.transfer.get("preset")
        blend = preset_named(name).blend if isinstance(name, str) and "blend" not in self.settings.given else None
        return self if blend is None else replace(self, settings=self.settings.but(blend=blend))

    def transfer_for(self, volume: Volume) -> Transfer:
        """The transfer function: the data's own or a preset's, overridden by what is given; faint around lines."""
        if self.vectors.drawn and not self.transfer.keys() & {"preset", "points", "only_labels"}:
            plain = replace(self, vectors=Vectors(), opacity=self.opacity * FAINT)
            return plain.transfer_for(volume)
        asked = {key: value for key, value in self.transfer.items() if key not in OF_CHANNELS}
        name = asked.pop("preset", None)
        if "only_labels" in asked:
            refuse_unknown("transfer of labels", asked, ("only_labels", "unit", "shading"))
            base = label_transfer(volume, [(int(n), float(f)) for n, f in asked.pop("only_labels")] or None)
            return replace(base, **asked).weakened(self.opacity)
        if "points" in asked and name is None:
            found = Transfer.from_table(asked)
        else:
            base = preset(name, volume) if name else default_transfer(volume)
            refuse_unknown("transfer", asked, declared(Transfer))
            if base.labels and asked.keys() & OF_AMOUNTS:
                given = ", ".join(sorted(asked.keys() & OF_AMOUNTS))
                raise expected("labels", "none of the options of amounts", given, "--values amounts draws amounts")
            if asked.get("scale") == "log" and "points" not in asked:
                base = logarithmic_transfer(base, volume)
            # a surface's colours are the light part of a map over its own window; over another, they are the whole map
            colors = base_name(base.colormap) if "window" in asked else base.colormap
            found = replace(base, **{"colormap": colors, **asked})
        return found.weakened(self.opacity)


def _absolute(name: str) -> str:
    """A file's absolute path; an address as it is."""
    return name if is_address(name) else str(Path(name).resolve())


def _relative(path: str, folder: Path) -> str:
    """A file's path in a scene in `folder`: relative if below it, else absolute; an address as it is."""
    if is_address(path):
        return path
    place = Path(path).resolve()
    near = place.relative_to(folder.resolve()).as_posix() if place.is_relative_to(folder.resolve()) else str(place)
    # a file may have the name of a built-in scene
    return f"./{near}" if near in SCENES else near


def _mask_in(mask: Any, folder: Path) -> str:
    """A mask in a scene in `folder`. Raises InputError for one in memory."""
    if not isinstance(mask, str):
        raise expected("scene", "masks in files, which a scene file can name", "one in memory")
    return mask if is_address(mask) else mask_moved(mask, lambda file: _relative(file, folder))

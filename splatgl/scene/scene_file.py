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

from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.annotations.annotate import check
from splatgl.data.mask import OUTSIDE, parse_mask
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import load_table, toml_value
from splatgl.readers import load
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import FAINT, HeldMesh, MeshFile, Vectors, is_mesh, stage
from splatgl.scene.view import Fitted, ViewOptions, seen_along_z, typed
from splatgl.splat.colormaps import whole
from splatgl.splat.label_detection import MASK, decided
from splatgl.splat.presets import default_transfer, label_transfer, logarithmic, preset, preset_named
from splatgl.splat.segment_surfaces import strength_of
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.data.mesh import Mesh
    from splatgl.splat.extract import Progress
    from splatgl.splat.splats import Splats


def mask_table(folder: Path, what: str, given: Any) -> tuple[str, ...] | None:
    """The masks of a scene file in a folder. Raises InputError for what is neither text nor a list of it."""
    if given is None:
        return None
    every = given if isinstance(given, list) else [given] if given else []
    if not all(isinstance(each, str) and each for each in every):
        raise expected(f"{what}: mask", "FILE[:N,N…][:outside], or several, each in quotes", repr(given)[:80])
    return tuple(each if is_address(each) else mask_moved(each, lambda file: str(folder / file)) for each in every)


def mask_anywhere(mask: Any) -> Any:
    """A mask by its absolute path; one in memory, or at an address, as it is."""
    if not isinstance(mask, str) or is_address(mask):
        return mask
    return mask_moved(mask, lambda file: str(Path(file).resolve()))


def mask_moved(mask: str, moved: Callable[[str], str]) -> str:
    """A mask whose file's name is replaced by what `moved` makes of it."""
    file, labels, outside = parse_mask(mask)
    told = [moved(file), ",".join(map(str, labels)), OUTSIDE * outside]
    return ":".join(part for part in told if part)


def check_masked(source: str, volume: Volume, transfer: Transfer) -> None:
    """InputError for masks that keep nothing that can be seen."""
    from splatgl.splat.opaque_bounds import Opaque

    if volume.masks and Opaque(volume, transfer).nothing:
        fix = "set the points to the values that matter, or take another mask"
        raise expected(source, "voxels with an opacity that its masks keep", "none", fix)


# extraction and cameras are imported once there is a volume: bad input is told at once

# the types of a scene file's keys
KEYS: dict[str, tuple[type, ...]] = {
    "volume": (str,),
    "threshold": (int, float),
    "load": (dict,),
    "transfer": (dict,),
    "camera": (dict,),
    "settings": (dict,),
    "opacity": (int, float),
    "visible": (bool,),
    "clip": (list,),
    "crop": (str,),
    "mask": (str, list),
    "surfaces": (int, float),
    "annotate": (list,),
    "layer": (list,),
    "mesh": (list,),
    "vectors": (dict,),
}
# keys of a transfer function that are of channels: pairs of a channel and a colour, or a window
OF_CHANNELS = ("color_of", "window_of")
# keys of a transfer function that say nothing of labels
OF_AMOUNTS = frozenset(("points", "colormap", "window", "scale", "gradient"))
# the keys of a layer
LAYER = ("volume", "threshold", "load", "transfer", "opacity", "visible", "clip", "crop", "mask", "surfaces")


@dataclass(frozen=True)
class SceneFile:
    """A complete description of an image to render. opacity: factor of the transfer function's opacities. visible:
    whether its volume is drawn. clip: conditions of what is kept; of a layer None, those of the scene. crop: its part
    in voxels, which the view is fitted to. mask: files of what is kept; of a layer None, those of the scene. surfaces:
    smoothing of segmentations that are drawn as surfaces; None: as boxes; of a layer None, that of the scene. layers:
    more volumes in it, of which view and settings are not read. meshes: triangles in it. annotate: what is laid over
    it, as --annotate names it. vectors: how those of its volume are drawn.
    """

    volume: str
    load: Mapping[str, Any] = field(default_factory=dict)
    transfer: Mapping[str, Any] = field(default_factory=dict)
    view: ViewOptions = field(default_factory=ViewOptions)
    settings: Settings = field(default_factory=Settings)
    threshold: float = 0.0
    opacity: float = 1.0
    visible: bool = True
    clip: tuple[str, ...] | None = None
    crop: str = ""
    mask: tuple[Any, ...] | None = None
    surfaces: float | None = None
    layers: tuple[SceneFile, ...] = ()
    meshes: tuple[MeshFile | Mesh, ...] = ()
    annotate: tuple[str, ...] = ()
    vectors: Vectors = field(default_factory=Vectors)

    @classmethod
    def from_toml(cls, path: Path) -> SceneFile:
        """Reads a scene file. Raises InputError for a missing file, bad TOML, and unknown keys."""
        table = load_table(path, "a scene")
        scene = cls._of_table(path, str(path), table, set(KEYS))
        camera = table.get("camera", {})
        _check_keys(f"{path} [camera]", camera, {f.name for f in fields(ViewOptions)})
        with _named(f"{path} [camera]"):
            view = ViewOptions(**{k: typed(k, v) for k, v in camera.items()})
        with _named(f"{path} [settings]"):
            settings = Settings().but(**table.get("settings", {}))
        layers = []
        for number, layer in enumerate(table.get("layer", []), 1):
            what = f"{path} [[layer]] {number}"
            if not isinstance(layer, dict):
                raise expected(what, "a table", repr(layer))
            layers.append(cls._of_table(path, what, layer, set(LAYER)))
        tables = enumerate(table.get("mesh", []), 1)
        meshes = [MeshFile.of_table(path.parent, f"{path} [[mesh]] {number}", each) for number, each in tables]
        with _named(str(path)):
            annotate = check(table.get("annotate", []))
        with _named(f"{path} [vectors]"):
            vectors = Vectors.of_table(table.get("vectors", {}))
        found = replace(scene, view=view, settings=settings, annotate=annotate, vectors=vectors)
        return replace(found, layers=tuple(layers), meshes=tuple(meshes))

    @classmethod
    def _of_table(cls, path: Path, what: str, table: Mapping[str, Any], known: set[str]) -> SceneFile:
        """The source, transfer function, threshold and opacity of a scene, or of one of its layers."""
        _check_keys(what, table, known)
        for key in known & table.keys():
            if not isinstance(table[key], KEYS[key]) or isinstance(table[key], bool) != (bool in KEYS[key]):
                raise expected(f"{what}: {key}", " or ".join(k.__name__ for k in KEYS[key]), repr(table[key]))
        if "volume" not in table:
            raise expected(what, "the key volume", ", ".join(table) or "an empty file")
        source = table["volume"]
        if source not in SCENES and not is_address(source):
            source = str(path.parent / source)
        reading = dict(table.get("load", {}))
        if isinstance(reading.get("color"), str):
            reading["color"] = str(path.parent / reading["color"])
        with _named(f"{what} [load]"):
            _check_keys("load", reading, {f.name for f in fields(LoadOptions)})
            LoadOptions(**reading)
        if not 0 <= table.get("opacity", 1) <= 1:
            raise expected(f"{what}: opacity", "a factor from 0 to 1", table["opacity"])
        clip = tuple(table["clip"]) if "clip" in table else None
        if not all(isinstance(each, str) for each in clip or ()):
            raise expected(f"{what}: clip", "conditions, each in quotes", repr(table["clip"])[:80])
        scene = cls(source, reading, table.get("transfer", {}), clip=clip, crop=table.get("crop", ""))
        masks = mask_table(path.parent, what, table.get("mask"))
        with _named(what):
            smoothing = strength_of(table["surfaces"]) if "surfaces" in table else None
        scene = replace(scene, mask=masks, visible=table.get("visible", True), surfaces=smoothing)
        return replace(scene, threshold=float(table.get("threshold", 0.0)), opacity=float(table.get("opacity", 1.0)))

    def to_toml(self, folder: Path) -> str:
        """TOML text which `from_toml`, reading it from a file in `folder`, parses to the same scene.

        Paths are relative if below `folder`, else absolute. Raises InputError for values that TOML cannot represent.
        """
        camera = {**_told(self.view), "size": self.view.size}
        lines = self._lines(
            folder, "", {"camera": camera, "settings": self.settings.given, "vectors": self.vectors.told}
        )
        for layer in self.layers:
            lines += ["", "[[layer]]", *layer._lines(folder, "layer.", {})]
        for mesh in self.meshes:
            file = mesh if isinstance(mesh, MeshFile) else HeldMesh(mesh.name, held=mesh)
            lines += file.lines(_relative(file.file, folder))
        return "\n".join(lines) + "\n"

    def _lines(self, folder: Path, prefix: str, more: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Lines of what `_of_table` reads, and of more tables."""
        known = self.volume in SCENES and not self.load
        reading = dict(self.load)
        if isinstance(reading.get("color"), str):
            reading["color"] = _relative(reading["color"], folder)
        lines = [f"volume = {toml_value('volume', self.volume if known else _relative(self.volume, folder))}"]
        for name, value, default in (("threshold", self.threshold, 0.0), ("opacity", self.opacity, 1.0)):
            if value != default:
                lines.append(f"{name} = {toml_value(name, float(value))}")
        lines += [] if self.visible else ["visible = false"]
        lines += [] if self.surfaces is None else [f"surfaces = {toml_value('surfaces', float(self.surfaces))}"]
        lines += [] if self.clip is None else [f"clip = {toml_value('clip', self.clip)}"]
        masks = None if self.mask is None else [_mask_in(each, folder) for each in self.mask]
        lines += [] if masks is None else [f"mask = {toml_value('mask', masks)}"]
        for name, told in (("crop", self.crop), ("annotate", self.annotate)):
            lines += [f"{name} = {toml_value(name, told)}"] if told else []
        for name, table in {"load": reading, "transfer": self.transfer, **more}.items():
            given = {key: value for key, value in table.items() if value is not None}
            lines += ["", f"[{prefix}{name}]"] if given else []
            lines += [f"{key} = {toml_value(f'{name} {key}', value)}" for key, value in given.items()]
        return lines

    def anywhere(self) -> SceneFile:
        """The same scene with absolute paths, for processes in other folders."""
        reading = {name: _absolute(value) if name == "color" else value for name, value in self.load.items()}
        known = self.volume in SCENES and not self.load
        volume = self.volume if known else _absolute(self.volume)
        layers = tuple(each.anywhere() for each in self.layers)
        meshes = tuple(
            replace(each, file=_absolute(each.file)) if isinstance(each, MeshFile) else each for each in self.meshes
        )
        mask = None if self.mask is None else tuple(map(mask_anywhere, self.mask))
        return replace(self, volume=volume, load=reading, layers=layers, meshes=meshes, mask=mask)

    def refuse_more(self, drawn: Container[str] = ()) -> None:
        """InputError for what a command leaves out that draws the volume and, beside it, the options `drawn` alone."""
        more = [
            ("layer", "layers", len(self.layers) or None),
            ("mesh", "meshes", len(self.meshes) or None),
            ("surfaces", "surfaces", None if self.surfaces is None else f"{self.surfaces:g}"),
            ("streamlines", "vectors", "streamlines or arrows" if self.vectors.drawn else None),
        ]
        for option, what, got in more:
            if got is not None and option not in drawn:
                raise expected(what, "none", got, "splatgl render draws them")

    @property
    def files(self) -> tuple[str, ...]:
        """What it names: its volume, colours, masks and meshes, and those of its layers."""
        color = self.load.get("color")
        masks = [parse_mask(each)[0] for each in self.mask or () if isinstance(each, str)]
        meshes = [each.file for each in self.meshes if isinstance(each, MeshFile)]
        below = [file for layer in self.layers for file in layer.files]
        return (self.volume, *([color] if color else []), *masks, *meshes, *below)

    def open(self) -> Volume:
        """The volume: a built-in scene, or a file through its reader; masked; a flat stack with the view of it."""
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
        found = decided(volume)
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
        from splatgl.splat.clipping import Box, Part, crop_planes, left, planes_of

        around = crop_planes(self.crop, volume) if self.crop else ()
        found = planes_of(self.clip or (), Box.of([volume]))
        settings = self.settings.but(clip=(*self.settings.clip, *found, *around))
        view = Fitted.of(self.view, Part(left(around, volume.corners), volume.frame)) if around else self.view
        return replace(self, clip=None, crop="", settings=settings, view=view)

    def splats(
        self, volume: Volume, transfer: Transfer, progress: Progress | None = None, moving: bool = False
    ) -> Splats:
        """The splats of the scene, classified as its settings say. moving: whether pictures are motion-blurred."""
        from splatgl.splat.resolve import extracted

        return extracted(volume, transfer, self.settings, self.threshold, progress, moving)

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
            _check_keys("transfer of labels", asked, {"only_labels", "unit", "shading"})
            base = label_transfer(volume, [(int(n), float(f)) for n, f in asked.pop("only_labels")] or None)
            return replace(base, **asked).weakened(self.opacity)
        if "points" in asked and name is None:
            found = Transfer.from_table(asked)
        else:
            base = preset(name, volume) if name else default_transfer(volume)
            _check_keys("transfer", asked, {f.name for f in fields(Transfer)})
            if base.labels and asked.keys() & OF_AMOUNTS:
                given = ", ".join(sorted(asked.keys() & OF_AMOUNTS))
                raise expected("labels", "none of the options of amounts", given, "--values amounts draws amounts")
            if asked.get("scale") == "log" and "points" not in asked:
                base = logarithmic(base, volume)
            # a surface's colours are the light part of a map over its own window; over another, they are the whole map
            colors = whole(base.colormap) if "window" in asked else base.colormap
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


def _told(record: ViewOptions) -> dict[str, Any]:
    """The fields that differ from their defaults."""
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    return {f.name: values[f.name] for f in fields(record) if values[f.name] != f.default}


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Adds the location of an invalid value to its error."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{what}: {error}") from error


def _check_keys(what: str, table: Mapping[str, Any], known: set[str]) -> None:
    unknown = [key for key in table if key not in known]
    if unknown:
        raise expected(what, f"keys {', '.join(sorted(known))}", ", ".join(unknown))

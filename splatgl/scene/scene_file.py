"""`SceneFile`: description of a picture, from a scene.toml or the options of a command.

volume = "head.nii.gz"          # beside the scene file, or the name of a built-in scene
threshold = 0.0
clip = ["x>0.3", "z>=30mm"]     # parts to keep; crop = "10:90,:,:" in voxels; mask = "brain.nii.gz", or several
uncut = "seg.nrrd:3"            # part that clip and crop leave whole; or labels of a segmentation, "3,7"
scissors = ["0,0 1,0 1,0.5"]    # as --scissors; [[scissors]]: outline, keep, and a view: eye, look_at, up, fov | height
annotate = ["scale", "title=A"] # as --annotate; slices = ["z=1:9:2"] and slice_planes = ["y@0.5"] as --slice…
[load]                          # as LoadOptions
[transfer]                      # preset, curve = "band:50%,90%", colors = "60:red,1e3:#fda", level_width, of Transfer
[camera]                        # size, view | azimuth, elevation, fov, zoom | eye, look_at, up | orthographic, height
                                # dpi, width
[settings]                      # as Settings
[animation]                     # turntable, spin, axis, frames, hold, fps | ease, path, [[animation.keyframe]]
[[mesh]]                        # file, title, color, opacity, radius, visible
[[measure]]                     # points: two, or three of an angle; name; annotate = ["measures"] draws them
[vectors]                       # show ("magnitude", "direction"), streamlines, arrows, colormap
surfaces = 0.5                  # segmentations as surfaces, with this strength of smoothing
[[layer]]                       # volume, title, threshold, opacity, visible, clip, crop, mask, surfaces, …
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.annotations.annotate import check, parse_annotations
from splatgl.annotations.canvas import Measure
from splatgl.data.affine import World
from splatgl.data.color import CLEAR
from splatgl.data.mask import OUTSIDE, parse_mask
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Hints, Label, Volume
from splatgl.errors import error_prefix, expected
from splatgl.fileio import load_table, toml_rows, toml_value
from splatgl.geometry.scissors import FORM, Scissors
from splatgl.geometry.slices import SLICE_PLANES, SLICES
from splatgl.options import (
    HelpGroup,
    ValueKind,
    check_options,
    checked,
    declared,
    names_of,
    no_effect,
    non_default,
    option,
    reject_unknown,
)
from splatgl.readers import find_labels, load_source
from splatgl.readers.label_table import read_label_table
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.meshes import (
    LOOK,
    VECTORS,
    MeshFile,
    Vectors,
    clipped_meshes,
    is_mesh,
    reject_volume_options,
    split_look,
    stage,
)
from splatgl.scene.transfer_choice import (
    AMOUNT_KEYS,
    CHANNEL_KEYS,
    FAINTLY,
    LABEL,
    LABEL_KEYS,
    NAME_KEYS,
    REPLACES,
    SeriesLook,
    TransferChoice,
    base_transfer,
    default_colors,
    faint_share,
    is_backdrop,
    notes_on_looks,
    place_files,
    plain_values,
    read_nodes,
    reject_both,
    several,
    transfer_notes,
    with_window,
)
from splatgl.scene.view import FIT_OF_0_3, ViewOptions, orient_stack
from splatgl.splat.segment_surfaces import SMOOTHING, check_strength
from splatgl.splat.settings import Settings
from splatgl.transfer.colormaps import base_name, labels_of
from splatgl.transfer.label_detection import MASK, as_segmentation, mark_kind
from splatgl.transfer.presets import (
    SOLID,
    constant_note,
    is_preset,
    label_transfer,
    logarithmic_transfer,
    over_window,
    projection_transfer,
    with_preset_blend,
)
from splatgl.transfer.statistics import without_outlier_values
from splatgl.transfer.transfer import Transfer

# types of the keys of a scene file that are not options
TABLES: dict[str, type] = {
    **{name: dict for name in ("load", "transfer", "camera", "settings", "vectors", "animation")},
    **{name: list for name in ("layer", "mesh", "measure", "annotate", "scissors", "slices", "slice_planes")},
    **{"volume": str, "label_fill": object},
}
# keys of the animation; those of keyframes
TRACK = ("ease", "path", "keyframe")
ANIMATION = ("turntable", "spin", "axis", "frames", "hold", "fps", *TRACK)
# options of voxels, which clouds of points do not have
OF_VOXELS = ("threshold", "mask", "uncut", "scissors", "slices", "slice_planes")
# keys of a layer that are not options; options of a scene and its layers with values that TOML can hold
LAYER = ("volume", "load", "transfer")
PLAIN = ("title", "threshold", "opacity", "visible", "clip", "crop", "mask", "uncut", "surfaces")
PICTURE = ("annotate", "slices", "slice_planes", "label_fill")


def _annotations(value: Any) -> tuple[str, ...]:
    return parse_annotations(value) if isinstance(value, str) else check(value)


def _measures(value: Any) -> tuple[Measure, ...]:
    single = isinstance(value, str | Measure)
    return tuple(Measure.of(each) for each in ([value] if single else value))


def _clip(value: Any) -> tuple[Any, ...]:
    return (value,) if isinstance(value, str) or not isinstance(value, Iterable) else tuple(value)


def _uncut(value: Any) -> str | Volume | Scissors:
    """The text of labels, a number or several, or of a mask; or a mask in memory."""
    if isinstance(value, str | Volume | Scissors):
        return value
    return ",".join(str(LABEL.check(number)) for number in (value if isinstance(value, Iterable) else (value,)))


def _scissors(value: Any) -> tuple[Scissors, ...]:
    one = isinstance(value, str | Mapping | Scissors)
    return tuple(map(Scissors.of, [value] if one else value))


_clipping = partial(option, group=HelpGroup.CLIPPING)
_layers = partial(option, group=HelpGroup.LAYERS)
_LAYER = ValueKind(
    "an opacity from 0 to 1", tuple, lambda text: SceneFile.read(text), "FILE[:LOOK[:OPACITY]]", hint="Any"
)
# opacity of labels on slices, within their outlines
FILL = 0.4
# options of reading in the text of a layer
OF_LAYER = re.compile(r":(array|channel|field|level|series|time|well)=([^:]+)")


@dataclass(frozen=True)
class SceneFile:
    """Description of a picture: files and options. A layer whose clip, mask or surfaces is None takes the scene's.

    volume: a built-in scene, file or address, or the name of the volume `held` in memory. layers: further volumes;
    their views and settings are ignored. title: its name in lists and legends; "": the file's. annotate: names as for
    --annotate.
    animation: how movies move, by the keys ANIMATION.
    world: frame and unit that the volume is converted to, if its file states others: those of a series. look: of a
    series, instead of that of the volume's own values.
    """

    volume: str
    load: Mapping[str, Any] = field(default_factory=dict)
    transfer: Mapping[str, Any] = field(default_factory=dict)
    view: ViewOptions = field(default_factory=ViewOptions)
    settings: Settings = field(default_factory=Settings)
    threshold: float = option(
        0.0, ValueKind.number(metavar="T"), "draw voxels of a higher opacity only (default 0)", group=HelpGroup.TRANSFER
    )
    opacity: float = option(1.0, ValueKind.number("a factor from 0 to 1", 0, 1))
    visible: bool = option(True, ValueKind.flag())
    title: str = option("", ValueKind.instance("a name", str))
    clip: tuple[Any, ...] | None = _clipping(
        None,
        ValueKind("conditions", _clip, metavar="CONDITION", hint="str | Sequence[Any]"),
        "keep a part, such as x>0.3, z<=30mm or x+y>1. By shares of the volume's box, by lengths, or by a point and a "
        "normal; repeatable",
        level="basic",
        repeat=True,
    )
    crop: str = _clipping(
        "",
        ValueKind.instance("A:B,C:D,E:F, voxels along x, y and z", str, metavar="A:B,C:D,E:F"),
        "keep a range of voxels along x, y and z, and fit the view to it",
    )
    mask: tuple[Any, ...] | None = _clipping(
        None,
        ValueKind("FILE[:N,N…][:outside], or several", several, metavar="FILE[:N,N…][:outside]", hint="Any"),
        "keep voxels inside a mask file. N,N…: inside its labels N; outside: outside of them; repeatable",
        level="basic",
        repeat=True,
    )
    uncut: str | Volume | Scissors = _clipping(
        "",
        ValueKind(
            "labels, or FILE[:N,N…][:outside]", _uncut, metavar="N,N…|FILE[:N,N…]", hint="str | int | Sequence[int]"
        ),
        "exclude segments from --clip and --crop. Labels of the rendered segmentation, or of a file",
    )
    scissors: tuple[Scissors, ...] = _clipping(
        (),
        ValueKind("an outline", _scissors, Scissors, '"X,Y X,Y X,Y…[:keep]"', written=FORM, hint="Any"),
        "remove the part inside an outline in the picture. Corners are fractions of its width and height; keep: "
        "keep only that part; repeatable",
        repeat=True,
    )
    surfaces: float | None = _layers(
        None,
        ValueKind("a strength of smoothing from 0 to 1", check_strength, float, "S", hint="float"),
        f"draw segmentations as smooth closed surfaces, smoothed by 0 to 1 (default {SMOOTHING:g})",
        bare=SMOOTHING,
    )
    layers: tuple[SceneFile, ...] = _layers(
        (),
        _LAYER,
        "another volume. LOOK: a preset or a colour map; OPACITY: a factor from 0 to 1; repeatable. "
        "FILE:series=2:time=0 takes options of reading: channel, array, level, well and field, too",
        level="basic",
        flag="--layer",
        repeat=True,
    )
    meshes: tuple[MeshFile, ...] = _layers(
        (),
        ValueKind("an opacity from 0 to 1", tuple, MeshFile.read, "FILE[:COLOUR[:OPACITY]]", hint="Any"),
        "a surface (.stl, .vtp, .obj, …) or lines (.trk, .tck). COLOUR: or MAP=ARRAY for values; repeatable",
        level="basic",
        flag="--mesh",
        repeat=True,
    )
    annotate: tuple[str, ...] = option(
        (),
        ValueKind("names", _annotations, metavar="NAMES", hint="str | Sequence[str] | None"),
        "scale, colorbar, legend, axes, directions, box, …. Or title=TEXT, time=TEXT, "
        "scale=20um:bottom-left:4px:white; several are separated by commas",
        group=HelpGroup.PICTURE,
        level="basic",
    )
    slices: tuple[str, ...] = field(default=(), metadata={"option": SLICES})
    slice_planes: tuple[str, ...] = field(default=(), metadata={"option": SLICE_PLANES})
    label_fill: float = _layers(
        FILL,
        ValueKind.number("an opacity from 0 to 1", 0, 1, metavar="A"),
        f"opacity of labels on slices within their outlines: 0 draws outlines alone, 1 fills them (default {FILL:g})",
    )
    vectors: Vectors = field(default_factory=Vectors)
    animation: Mapping[str, Any] = field(default_factory=dict)
    measures: tuple[Measure, ...] = option(
        (),
        ValueKind(
            "two points, or three for an angle, NAME= before them",
            _measures,
            Measure.read,
            "X,Y,Z:X,Y,Z",
            hint="Any",
        ),
        "distance between two points, or angle at the second of three; world units, with a name before =; repeatable",
        group=HelpGroup.PICTURE,
        flag="--measure",
        repeat=True,
    )
    held: Volume | None = None
    world: World = World()
    look: SeriesLook | None = None

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def read(cls, text: str) -> SceneFile:
        """Returns the layer of FILE[:OPTION=VALUE…][:LOOK[:OPACITY]]; OPTION: of reading, such as series; LOOK: a
        preset or colour map. Raises ValueError otherwise.
        """
        load = {name: declared(LoadOptions)[name].kind.read(value) for name, value in OF_LAYER.findall(text)}
        source, look, opacity = split_look(OF_LAYER.sub("", text), lambda name: not name or bool(LOOK.fullmatch(name)))
        transfer = {"preset" if is_preset(look) else "colormap": look} if look else {}
        return cls(source, load, transfer, opacity=opacity)

    @classmethod
    def of(cls, layer: Any) -> SceneFile:
        """Returns the scene of a Layer, or of anything that `Volume.of` accepts, in memory; text is read."""
        from splatgl.planning.scene import Layer

        if isinstance(layer, SceneFile):
            return layer
        if isinstance(layer, str | Path):
            return checked(replace(_LAYER, check=cls.read), "layers", str(layer))
        if not isinstance(layer, Layer):
            volume = Volume.of(layer)
            return cls(volume.name or "array", held=volume)
        assert layer.transfer is not None
        clip = None if layer.clip is None else _clip(layer.clip)
        look: dict[str, Any] = {name: getattr(layer, name) for name in ("threshold", "surfaces", "visible", "opacity")}
        look |= {"uncut": "" if layer.uncut is None else layer.uncut, "mask": () if layer.volume.masks else None}
        return cls(layer.volume.name or "layer", transfer=layer.transfer.fields, clip=clip, held=layer.volume, **look)

    @classmethod
    def from_toml(cls, path: Path) -> SceneFile:
        """Reads a scene file. Raises InputError for a missing file, bad TOML, and unknown keys."""
        table = load_table(path, "a scene")
        scene = cls._of_table(str(path), table, TABLES)
        camera, vector_keys = table.get("camera", {}), table.get("vectors", {})
        reject_unknown(f"{path} [camera]", camera, names_of(ViewOptions))
        with error_prefix(f"{path} [camera]"):
            view = ViewOptions(**camera)
        with error_prefix(f"{path} [settings]"):
            settings = Settings().replace(**table.get("settings", {}))
        layers, meshes = [], []
        for place, layer in enumerate(table.get("layer", []), 1):
            source = f"{path} [[layer]] {place}"
            if not isinstance(layer, dict):
                raise expected(source, "a table", repr(layer))
            layers.append(cls._of_table(source, layer, LAYER))
        for place, mesh in enumerate(table.get("mesh", []), 1):
            meshes.append(MeshFile.of_table(f"{path} [[mesh]] {place}", mesh))
        with error_prefix(f"{path} [vectors]"):
            reject_unknown("vectors", vector_keys, declared(Vectors))
            vectors = Vectors(**vector_keys)
        animation = table.get("animation", {})
        reject_unknown(f"{path} [animation]", animation, ANIMATION)
        rows = enumerate(table.get("measure", []), 1)
        measures = tuple(Measure.of_table(f"{path} [[measure]] {place}", row) for place, row in rows)
        parts = {"layers": tuple(layers), "meshes": tuple(meshes), "vectors": vectors, "animation": animation}
        scene = replace(scene, view=view, settings=settings, measures=measures, **parts)
        return scene.with_paths(lambda file: str(path.parent / file))

    @classmethod
    def _of_table(cls, source: str, table: Mapping[str, Any], tables: Collection[str]) -> SceneFile:
        """Returns the scene, or one of the layers, from the options in a table. tables: further keys."""
        reject_unknown(source, table, sorted([*PLAIN, *tables]))
        for key in tables:
            if not isinstance(table.get(key, TABLES[key]()), TABLES[key]):
                raise expected(f"{source}: {key}", TABLES[key].__name__, repr(table[key]))
        if "volume" not in table:
            raise expected(source, "the key volume", ", ".join(table) or "an empty file")
        with error_prefix(f"{source} [load]"):
            reject_unknown("load", table.get("load", {}), declared(LoadOptions))
            LoadOptions(**table.get("load", {}))
        for key, form in (("clip", "conditions"), ("mask", "FILE[:N,N…][:outside], or several")):
            if not all(isinstance(text, str) and text for text in several(table.get(key, ()))):
                raise expected(f"{source}: {key}", f"{form}, each in quotes", repr(table[key])[:80])
        with error_prefix(source):
            options = {name: table[name] for name in (*PLAIN, *PICTURE, "scissors") if name in table}
            return cls(table["volume"], table.get("load", {}), table.get("transfer", {}), **options)

    def with_paths(self, move: Callable[[str], str]) -> SceneFile:
        """Returns the scene with `move` applied to all files; addresses, built-in scenes and values in memory stay."""

        def place(name: str) -> str:
            return name if is_address(name) else move(name)

        def place_mask(mask: Any) -> Any:
            if not isinstance(mask, str) or is_address(mask):
                return mask
            file, labels, outside = parse_mask(mask)
            return ":".join(filter(None, (file and move(file), ",".join(map(str, labels)), OUTSIDE * outside)))

        reading = {name: place(str(value)) if name == "color" else value for name, value in self.load.items()}
        return replace(
            self,
            volume=self.volume if self.volume in SCENES and not self.load else place(self.volume),
            load=reading,
            transfer=place_files(self.transfer, place),
            mask=None if self.mask is None else tuple(map(place_mask, self.mask)),
            uncut=place_mask(self.uncut),
            layers=tuple(layer.with_paths(move) for layer in self.layers),
            meshes=tuple(mesh if mesh.held else replace(mesh, file=place(mesh.file)) for mesh in self.meshes),
        )

    def with_absolute_paths(self) -> SceneFile:
        """Returns the scene with absolute paths, for processes in other folders."""
        return self.with_paths(lambda file: str(Path(file).resolve()))

    def with_options(self, **options: Any) -> SceneFile:
        """Returns the scene with options of the command line or keywords: of reading, the transfer function, the view,
        the settings and the scene itself. Layers and meshes are added. Raises InputError for bad values.
        """
        scene_options = {name: options[name] for name in declared(SceneFile) if name in options}
        layers = (*self.layers, *map(SceneFile.of, several(scene_options.pop("layers", ()))))
        if scene_options.get("measures") is not None:
            names = _annotations(scene_options.get("annotate", self.annotate))
            scene_options["annotate"] = names if "measures" in names else (*names, "measures")
        transfer = {name: options[name] for name in names_of(Transfer) if name in options}
        for name, choice in declared(TransferChoice).items():
            if options.get(name) is not None:
                transfer[name] = checked(choice.kind, name, options[name])
        reading = {**self.load, **{name: options[name] for name in declared(LoadOptions) if name in options}}
        if "labels" in options:
            chosen = {name: transfer.pop(name, ()) for name in LABEL_KEYS if name in transfer or name == "only_labels"}
            layers = (*layers, replace(self._find_labels(options["labels"], reading), transfer=chosen))
        meshes = (*self.meshes, *map(MeshFile.of, several(scene_options.pop("meshes", ()))))
        meshes = clipped_meshes(self.volume, meshes, options)
        if is_mesh(self.volume):
            of_volumes = ("crop", "uncut", "threshold", "surfaces", *VECTORS)
            of_first = [*transfer, *(name for name in of_volumes if options.get(name))]
            is_clipped = any(mesh.clip for mesh in meshes)
            # an array has no truth value
            given = [name for name in ("mask", "scissors", "clip") if options.get(name) is not None]
            of_all = [name for name in given if several(options[name])] if not layers else []
            reject_volume_options(self.volume, of_first + [name for name in of_all if name != "clip" or not is_clipped])
        base = Settings.paper() if options.get("paper") else self.settings
        base = Settings.like(options["like"], **base.given) if options.get("like") else base
        fit = {"fit": FIT_OF_0_3} if options.get("like") and options.get("fit") is None else {}
        settings = {name: options[name] for name in names_of(Settings) if name in options}
        return replace(
            self.with_transfer(transfer),
            **scene_options,
            layers=layers,
            meshes=meshes,
            load=reading,
            view=self.view.changed(**fit, **{name: options[name] for name in names_of(ViewOptions) if name in options}),
            vectors=replace(self.vectors, **{VECTORS[name]: options[name] for name in VECTORS if name in options}),
            settings=replace(base, **settings),
        )

    def with_transfer(self, keys: Mapping[str, Any]) -> SceneFile:
        """Returns the scene with keys of its transfer function, which replace those that say the same, or all looks."""
        replaced = {name for given in keys for name in REPLACES.get(given, ())}
        if declared(Transfer).keys() <= keys.keys():
            replaced = self.transfer.keys() - {*CHANNEL_KEYS, *NAME_KEYS}
        kept = {name: value for name, value in self.transfer.items() if name not in replaced}
        return replace(self, transfer={**kept, **keys})

    def _find_labels(self, name: Any, reading: dict[str, Any]) -> SceneFile:
        """Returns the labels in memory or in a file, or those of that name beside the image in a Zarr store. An array
        without a grid, of as many samples as the volume in memory, has that volume's grid.
        """
        of_labels = {"values": "labels"}
        if not isinstance(name, str | Path):
            labels = Volume.of(name, values="labels")
            if self.held is not None and isinstance(name, np.ndarray) and labels.shape == self.held.shape:
                labels = replace(self.held, samples=labels.samples, color=None, vectors=None, coarser=(), channels=())
                labels = replace(labels, masks=(), hints=Hints(), name="labels").of_values("labels")
            return SceneFile(labels.name or "labels", held=labels)
        name = str(name)
        if self.volume in SCENES or is_address(self.volume) or is_address(name) or Path(name).exists():
            return SceneFile(name, of_labels)
        array = find_labels(Path(self.volume), LoadOptions(**reading), name)
        time = {key: reading[key] for key in ("time",) if key in reading}
        return SceneFile(*(name, of_labels) if array is None else (self.volume, {"array": array, **time, **of_labels}))

    def to_toml(self, folder: Path | None = None) -> str:
        """Returns the scene as TOML text for a file in `folder`; paths below `folder` are relative, others absolute.

        Raises InputError for values that TOML cannot hold.
        """
        root = folder and folder.resolve()

        def relative(file: str) -> str:
            path = Path(file).resolve()
            location = path.relative_to(root).as_posix() if root and path.is_relative_to(root) else str(path)
            # a file may have the name of a built-in scene
            return f"./{location}" if location in SCENES else location

        scene = self.with_paths(relative)
        camera = {name: getattr(self.view, name) for name in declared(self.view) if name in non_default(self.view)}
        settings = {name: CLEAR if value is None else value for name, value in self.settings.given.items()}
        tables = {"camera": {**camera, "size": self.view.size}, "settings": settings}
        animation = {name: value for name, value in self.animation.items() if name != "keyframe"}
        lines = scene._lines("", {**tables, "vectors": non_default(self.vectors), "animation": animation})
        for row in self.animation.get("keyframe", ()):
            lines += toml_rows("[[animation.keyframe]]", row)
        for scissors in scene.scissors:
            lines += toml_rows("[[scissors]]", scissors.table)
        for layer in scene.layers:
            lines += ["", "[[layer]]", *layer._lines("layer.", {})]
        for mesh in scene.meshes:
            lines += mesh.lines()
        for measure in scene.measures:
            lines += toml_rows("[[measure]]", non_default(measure))
        return "\n".join(lines) + "\n"

    def _lines(self, prefix: str, extra_tables: Mapping[str, Mapping[str, Any]]) -> list[str]:
        """Returns the lines that `_of_table` reads, and the lines of extra tables."""
        if self.held is not None:
            raise expected("scene", "a volume in a file, which a scene file can name", "an array in memory")
        if not all(isinstance(mask, str) for mask in (*(self.mask or ()), self.uncut)):
            raise expected("scene", "masks in files, which a scene file can name", "one in memory")
        plain = {key: value for key, value in non_default(self).items() if key in (*PLAIN, *PICTURE)}
        values = {"volume": self.volume, **plain}
        lines = [f"{name} = {toml_value(name, value)}" for name, value in values.items()]
        for name, table in {"load": self.load, "transfer": self.transfer, **extra_tables}.items():
            rows = {key: toml_value(f"{name} {key}", value) for key, value in plain_values(table).items()}
            lines += ["", f"[{prefix}{name}]"] if rows else []
            lines += [f"{key} = {text}" for key, text in rows.items()]
        return lines

    def require_one_volume(self, this: str = "none", fix: str = "splatgl render draws them") -> None:
        """Raises InputError for layers, meshes, surfaces and vectors, which only some commands draw. this, fix: what is
        expected, and what to do.
        """
        others = {
            "layers": len(self.layers) or None,
            "meshes": len(self.meshes) + is_mesh(self.volume) or None,
            "surfaces": None if self.surfaces is None else f"{self.surfaces:g}",
            "streamlines or arrows": "some" if self.vectors.has_lines else None,
            "scissors": len(self.scissors) or None,
            "uncut": self.uncut or None,
            "slices": ", ".join(self.slices) or None,
            "slice_planes": ", ".join(self.slice_planes) or None,
        }
        for name, value in others.items():
            if value is not None:
                raise expected(name, this, value, fix)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of all files: volume, colours, names, masks, meshes, and those of layers."""
        color = self.load.get("color")
        masks = [parse_mask(mask)[0] for mask in (*(self.mask or ()), self.uncut) if isinstance(mask, str)]
        meshes = [mesh.file for mesh in self.meshes if mesh.held is None]
        layer_files = [file for layer in self.layers for file in layer.files]
        return (self.volume, *filter(None, (color, self.transfer.get("names"), *masks)), *meshes, *layer_files)

    def open(self) -> Volume:
        """Returns the masked volume of a built-in scene, a file or memory; a flat stack gets its view direction."""
        volume = self._open().placed(*self.world)
        if self.look is not None and self.look.slices is not None:
            volume = replace(volume, hints=replace(volume.hints, slices=self.look.slices))
        if self.title and not volume.channels:
            volume = replace(volume, name=self.title)
        faint, unused = [FAINTLY] * is_backdrop(self, volume), self._unused_notes(volume)
        of_looks = (*transfer_notes(self.transfer, volume), *unused, *faint)
        constant = "" if is_mesh(self.volume) else constant_note(volume)
        notes = (*self.view.notes(volume), *of_looks, *[constant] * bool(constant))
        return replace(volume, notes=(*volume.notes, *notes)) if notes else volume

    def _unused_notes(self, volume: Volume) -> list[str]:
        """Returns notes on options without effect. Raises InputError for options of voxels beside a cloud of points."""
        of_scene = [name for name in OF_VOXELS if getattr(self, name) not in (None, "", (), 0.0)]
        notes = notes_on_looks(self.transfer, volume, self.settings, of_scene)
        if self.label_fill != FILL and not self.layers:
            notes += no_effect(["label_fill"], "no labels are drawn over the volume")
        if not (self.clip or self.crop or self.settings.clip):
            of_meshes = ["caps" if mesh.caps else "clip_meshes" for mesh in self.meshes if mesh.clip]
            notes += no_effect([*["uncut"] * bool(self.uncut), *dict.fromkeys(of_meshes)], "neither clip nor crop cuts")
        return notes

    def _open(self) -> Volume:
        if self.held is not None:
            return self._prepare(self.held)
        if self.volume in SCENES and not self.load:
            return self._mask(load_source(self.volume))
        if self.volume in SCENES and not Path(self.volume).exists():
            raise expected("options", "none of reading for a built-in scene", ", ".join(self.load), "leave them out")
        if is_mesh(self.volume):
            if self.load:
                raise expected("options", "none of volumes for a mesh", ", ".join(self.load), "leave them out")
            reject_volume_options(self.volume, ["scissors"] if self.scissors and not self.layers else [])
            return stage([MeshFile(self.volume).open()], Path(self.volume).name)
        return self._prepare(load_source(self.volume, **self.load))

    def _mask(self, volume: Volume) -> Volume:
        for mask in self.mask or ():
            volume = volume.masked(mask)
        return volume

    def _prepare(self, volume: Volume) -> Volume:
        """Returns the volume with vectors and masks; a microscope's stack has its orientation, unless the view sets eye
        or up.
        """
        volume, view = self._mask(self.vectors.values(volume)), self.view
        volume = without_outlier_values(volume)
        volume = self._with_names(self._with_kind(volume))
        if view.eye is not None or view.up is not None:
            return volume
        return orient_stack(volume, has_note=view.azimuth is None and view.elevation is None)

    def _with_kind(self, volume: Volume) -> Volume:
        """Returns the volume as labels or amounts; options of the transfer function decide, too."""
        # () of only_labels are all
        keys = self.transfer.keys()
        named = [name for name in LABEL_KEYS if name in keys and (name == "only_labels" or self.transfer[name])]
        if named:
            volume = volume.rounded() or volume
        elif "preset" in self.transfer:
            return volume
        marked = mark_kind(volume if self.look is None else self.look.marked(volume))
        if named:
            return replace(as_segmentation(marked, named[0], self.volume), notes=volume.notes)
        if self.surfaces is not None and marked.hints.values == MASK:
            return as_segmentation(marked, "surfaces", self.volume)
        if self.transfer.keys() & AMOUNT_KEYS and volume.labels is None:
            return replace(marked.of_values("amounts") if marked.labels is not None else marked, notes=volume.notes)
        return marked

    def _with_names(self, volume: Volume) -> Volume:
        """Returns the volume with the names and colours that the transfer function gives its segments: those of a
        table, and before them single names. Raises InputError for other numbers.
        """
        pairs, file = self.transfer.get("name_of", ()), self.transfer.get("names")
        try:
            names = {int(number): str(name) for number, name in pairs}
        except (TypeError, ValueError):
            raise expected("name_of", "a number and a name for each segment", repr(pairs)[:80]) from None
        listed = read_label_table(Path(checked(declared(TransferChoice)["names"].kind, "names", file))) if file else {}
        if not (names or listed):
            return volume
        tables = [labels_of(part) for part in (volume, *volume.channels)]
        known = {label.number for table in tables for label in table}
        some = f"some of {', '.join(map(str, sorted(known)[:20]))}{', …' * (len(known) > 20)}"
        if names.keys() - known:
            raise expected("name_of", some, min(names.keys() - known))
        if listed and not listed.keys() & known:
            raise expected("names", some, f"other numbers in {file}")

        def named(label: Label) -> Label:
            row = listed.get(label.number, label)
            return replace(label, name=names.get(label.number, row.name), color=row.color or label.color)

        whole, *channels = (
            replace(part, labels=tuple(map(named, table)))
            for part, table in zip((volume, *volume.channels), tables, strict=True)
        )
        return replace(whole, channels=tuple(channels))

    def cut(self, volume: Volume) -> SceneFile:
        """Returns the scene with the planes of `clip` and `crop` in its settings and a view fitted to the crop. Raises
        InputError for a crop of points, which have no voxels to count.
        """
        if not (self.clip or self.crop):
            return self
        if self.crop and volume.points is not None:
            raise expected("crop", "voxels along x, y and z", f"{len(volume.points):,} points", "cut them with clip")
        from splatgl.geometry.camera import FittedPoints
        from splatgl.geometry.clipping import ClipUnits, clip_corners, crop_planes, parse_planes

        sides = crop_planes(self.crop, volume) if self.crop else ()
        planes = parse_planes(self.clip or (), ClipUnits.of([volume]))
        settings = replace(self.settings, clip=(*self.settings.clip, *planes, *sides))
        view = self.view.fitted(FittedPoints(clip_corners(sides, volume.corners), volume.frame)) if sides else self.view
        return replace(self, clip=None, crop="", settings=settings, view=view)

    def with_preset_blend(self) -> SceneFile:
        """Returns the scene with the blend of its preset, unless the settings specify one."""
        name = self.transfer.get("preset")
        return replace(self, settings=with_preset_blend(self.settings, name)) if isinstance(name, str) else self

    def transfer_for(self, volume: Volume) -> Transfer:
        """Returns the transfer function: the default or a preset, overridden by options; faint around lines, labels."""
        base = self.stated_transfer(volume)
        return base.weakened(self.opacity * faint_share(self, volume, base))

    def stated_transfer(self, volume: Volume) -> Transfer:
        """Returns the transfer function without the scene's opacity."""
        if self.look is not None and self.look.transfer is not None and volume.labels is None:
            return replace(self.look.transfer, unit=self.transfer.get("unit", self.look.transfer.unit))
        chosen = {key: value for key, value in self.transfer.items() if key not in (*CHANNEL_KEYS, *NAME_KEYS)}
        keys = with_window(chosen)
        name = keys.pop("preset", None)
        if volume.labels is not None and "labels" not in keys and keys.keys() & AMOUNT_KEYS:
            conflicts = ", ".join(sorted(chosen.keys() & AMOUNT_KEYS))
            raise expected("labels", "none of the options of amounts", conflicts, "--values amounts draws amounts")
        if "only_labels" in keys:
            keys |= {"preset": name} if name is not None else {}
            reject_unknown("transfer of labels", keys, ("only_labels", "unit", "shading"))
            only = [(int(n), float(f)) for n, f in keys.pop("only_labels")] or None
            base = label_transfer(volume, only, is_part=self.look is not None)
            return replace(base, **keys)
        if "points" in keys and name is None and not keys.keys() & {"colors", "file"}:
            reject_both(keys)
            return Transfer.from_table({**default_colors(keys, volume), **keys})
        return self._changed_transfer(name, keys, volume)

    def _changed_transfer(self, name: str | None, keys: dict[str, Any], volume: Volume) -> Transfer:
        """Returns the transfer function of a preset, of maxima or the default, changed by keys of a table."""
        base = base_transfer(name, keys, volume)
        if self.settings.shows_value and name is None and len(base.points) == 1:
            # a constant volume, which is a fog in other blends
            base = replace(base, points=[(value, SOLID) for value, opacity in base.points if opacity])
        reject_unknown("transfer", keys, (*declared(Transfer), "curve", "colors"))
        if base.labels and keys.keys() & AMOUNT_KEYS:
            conflicts = ", ".join(sorted(keys.keys() & AMOUNT_KEYS))
            raise expected("labels", "none of the options of amounts", conflicts, "--values amounts draws amounts")
        if self.settings.join == "max" and name is None and not keys.get("curve"):
            base = projection_transfer(base, volume)
            if "window" in keys and keys.get("scale") != "log":
                base = over_window(base, *keys["window"])
        if keys.get("scale") == "log" and "points" not in keys:
            base = logarithmic_transfer(base, volume)
        if keys.get("curve"):
            low, high = base.color_range
            base = replace(base, window=(low, high) if low < high else None)
        keys = read_nodes(keys, volume, base.scale)
        if keys.get("iso") and not (name or "points" in keys):
            # only the surfaces are drawn, as by other programs
            base = replace(base, points=[(value, 0.0) for value, _ in base.points], shading=True)
        # a surface has the light part of a map over its default window, and the whole map over other windows
        colors = base_name(base.colormap) if "window" in keys else base.colormap
        return replace(base, **{"colormap": colors, **keys})

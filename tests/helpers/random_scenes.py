"""Random scene files: their sources, written and in memory, and a table of options.

World coordinates are those of a patient (LPS, mm). Every source samples one field there, on a grid of its own, in a
frame of its own, beside the origin: a layer that is placed in another frame lies elsewhere.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.data.volume import Label, Volume

Table = dict[str, Any]

# middle of all sources, LPS
CENTRE = np.array([14.0, -21.0, 33.0])
# flips x and y: LPS to RAS and back
TURN = np.diag([-1.0, -1.0, 1.0])
# numbers, names and colours of segments
SEGMENTS = ((1, "liver", "#cc6644"), (2, "spleen", "#4477cc"), (5, "aorta", "#44bb66"))
# share of the pixels, and longest picture, that annotations need
SMALL, ANNOTATED = (32, 24), (72, 64)


@dataclass(frozen=True)
class Source:
    """A file of a scene. kind: of KINDS. volume: in memory; None: only as it is read from the file."""

    file: str
    kind: str
    volume: Volume | None = None

    def open(self, folder: Path, load: Mapping[str, Any]) -> Volume:
        """The volume in memory, or of the file."""
        return self.volume if self.volume is not None and not load else sg.load(folder / self.file, **load)


@dataclass
class Draft:
    """A scene that is being made. table: of its TOML file; sources: by file, meshes apart; kind: of the first."""

    rng: np.random.Generator
    folder: Path
    seed: int
    table: Table = field(default_factory=dict)
    sources: dict[str, Source] = field(default_factory=dict)
    kind: str = ""
    # frames of its sources: what states none lies as in LPS
    frames: tuple[str | None, ...] = ("LPS", "RAS")

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def one(self, *values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def between(self, low: float, high: float) -> float:
        return round(float(self.rng.uniform(low, high)), 2)

    def name(self, stem: str, suffix: str) -> str:
        return f"{stem}{len(self.sources)}{suffix}"

    def has(self, *names: str) -> bool:
        """Whether the scene has one of the options, by their names in OPTIONS."""
        return bool(set(names) & set(option_names(self.table)))


# --- sources ----------------------------------------------------------------------------------------------------------


def grid(draft: Draft, frame: str | None) -> dict[str, Any]:
    """Spacing, origin, direction and shape of a grid around CENTRE, in a frame."""
    rng = draft.rng
    shape = tuple(int(n) for n in rng.integers(8, 13, 3))
    spacing = np.round(rng.uniform(1.0, 1.4, 3) * (1, 1, draft.one(1.0, 1.5)), 2)
    kind = draft.one("straight", "mirrored", "turned", "sheared")
    direction = np.eye(3)
    if kind == "mirrored":
        direction = np.diag(rng.choice([-1.0, 1.0], 3))
    elif kind == "turned":
        direction = np.round(np.linalg.qr(rng.normal(size=(3, 3)))[0], 6)
    elif kind == "sheared":
        direction[0, 1:] = np.round(rng.uniform(-0.35, 0.35, 2), 2)
    turn = TURN if frame == "RAS" else np.eye(3)
    middle = CENTRE + np.round(rng.uniform(-1.5, 1.5, 3), 1)
    origin = middle - direction @ (spacing * (np.array(shape[::-1]) - 1) / 2)
    return {
        "shape": shape,
        "spacing": tuple(spacing.tolist()),
        "origin": tuple(np.round(turn @ origin, 4).tolist()),
        "direction": turn @ direction,
        "frame": frame,
    }


def places(placed: Mapping[str, Any]) -> np.ndarray:
    """World points [D, H, W, 3] of the voxels of a grid, relative to CENTRE, LPS."""
    z, y, x = np.indices(placed["shape"])
    world = np.stack([x, y, z], axis=-1) * placed["spacing"] @ placed["direction"].T + placed["origin"]
    return (world @ TURN if placed["frame"] == "RAS" else world) - CENTRE


def density(at: np.ndarray, draft: Draft) -> np.ndarray:
    """A field [D, H, W] from 0 to about 1: three blobs of unlike size, on one side of the body."""
    rng = np.random.default_rng(draft.seed)
    total = np.zeros(at.shape[:3])
    for size in (4.5, 3.0, 2.0):
        middle = rng.uniform(-3.5, 3.5, 3)
        total = np.maximum(total, np.exp(-(((at - middle) / size) ** 2).sum(axis=-1)))
    return total


def _volume(draft: Draft, samples: np.ndarray, placed: Mapping[str, Any], **more: Any) -> Volume:
    rest = {name: value for name, value in placed.items() if name != "shape"}
    return Volume(samples, **{"unit": "mm", **rest, **more})


def _saved(draft: Draft, volume: Volume, kind: str, stem: str) -> Source:
    """Writes a volume: in RAS sometimes as NIfTI, whose grid is rounded, so that memory holds what is read; behind the
    first sometimes in another unit.
    """
    volume = volume.placed(None, other_unit(draft))
    is_nifti = volume.frame == "RAS" and not volume.labels and volume.vectors is None and draft.chance(0.4)
    file = draft.name(stem, ".nii.gz" if is_nifti else ".nrrd")
    volume.save(draft.folder / file)
    return Source(file, kind, None if is_nifti else replace(volume, name=file.partition(".")[0]))


def other_unit(draft: Draft) -> str:
    """The unit of a source: of the first mm, of others sometimes um."""
    rng = np.random.default_rng((draft.seed, len(draft.sources)))
    return "um" if draft.sources and rng.random() < 0.3 else "mm"


def amounts(draft: Draft) -> Source:
    placed = grid(draft, draft.one(*draft.frames))
    values = density(places(placed), draft)
    samples = np.float32(values * 100) if draft.chance(0.5) else np.int16(np.rint(values * 1200 - 300))
    return _saved(draft, _volume(draft, samples, placed), "amounts", "amounts")


def labels(draft: Draft) -> Source:
    placed = grid(draft, draft.one(*draft.frames))
    at = places(placed)
    level = density(at, draft)
    samples = np.where(level > 0.35, np.where(at[..., 0] > 0, 1, 2), 0).astype(np.uint8)
    samples[level > 0.75] = 5
    table = tuple(Label(*row) for row in SEGMENTS)
    return _saved(draft, _volume(draft, samples, placed, labels=table), "labels", "labels")


def mask(draft: Draft) -> Source:
    placed = grid(draft, draft.one(*draft.frames))
    at = places(placed)
    samples = np.uint8(density(at, draft) > 0.2) * np.where(at[..., 1] > -1, np.uint8(1), np.uint8(3))
    return _saved(draft, _volume(draft, samples, placed), "mask", "mask")


def vectors(draft: Draft) -> Source:
    placed = grid(draft, draft.one(*draft.frames))
    at = places(placed)
    values = density(at, draft)
    flow = np.float32(np.stack([-at[..., 1], at[..., 0], 2 + 0 * at[..., 2]], axis=-1) * values[..., None])
    flow = flow @ np.float32(TURN) if placed["frame"] == "RAS" else flow
    # files of vectors hold nothing else: the samples are their lengths
    return _saved(draft, _volume(draft, np.linalg.norm(flow, axis=-1), placed, vectors=flow), "vectors", "flow")


def channels(draft: Draft) -> Source:
    """Two channels of a microscope."""
    placed = {**grid(draft, None), "direction": np.eye(3)}
    values = density(places(placed), draft)
    both = [np.uint16(part * 4000) for part in (values, values[:, ::-1])]
    parts = tuple(_volume(draft, part, placed, name=name) for part, name in zip(both, ("one", "two"), strict=True))
    file = draft.name("cells", ".zarr")
    _volume(draft, both[0], placed, channels=parts).save(draft.folder / file)
    return Source(file, "channels")


def times(draft: Draft) -> Source:
    """Three time points."""
    import nibabel

    placed = grid(draft, "RAS")
    values = density(places(placed), draft)
    steps = np.float32(np.stack([values * 100, values[:, ::-1] * 60, values * 30]))
    affine = np.eye(4)
    affine[:3] = np.column_stack([placed["direction"] * placed["spacing"], placed["origin"]])
    file = draft.name("times", ".nii.gz")
    nibabel.save(nibabel.Nifti1Image(steps.T, affine), draft.folder / file)
    return Source(file, "times")


def points(draft: Draft) -> Source:
    """A cloud of coloured points."""
    at = draft.rng.uniform(-5, 5, (60, 3)) + CENTRE
    colors = draft.rng.integers(0, 255, (60, 3))
    header = "ply\nformat ascii 1.0\nelement vertex 60\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")) + "end_header\n"
    rows = [f"{x:.3f} {y:.3f} {z:.3f} {r} {g} {b}" for (x, y, z), (r, g, b) in zip(at, colors, strict=True)]
    file = draft.name("points", ".ply")
    (draft.folder / file).write_text(header + "\n".join(rows) + "\n")
    return Source(file, "points")


def write_mesh(draft: Draft) -> str:
    """An octahedron in a frame, as 3D Slicer states it, at one side; returns its file."""
    side = draft.one(*draft.frames)
    corners = np.vstack([np.eye(3), -np.eye(3)]) * draft.rng.uniform(1.5, 4.0, 3) + CENTRE
    corners = (corners + draft.rng.uniform(-4, 4, 3)) @ (TURN if side == "RAS" else np.eye(3))
    faces = [(a, b, c) for a in (0, 3) for b in (1, 4) for c in (2, 5)]
    unit = other_unit(draft)
    corners = corners * (1000 if unit == "um" else 1)
    header = ["ply", "format ascii 1.0", *([f"comment SPACE={side}"] if side else []), f"comment UNIT={unit}"]
    header += ["element vertex 6"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += ["element face 8", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(f"{x:.4f}" for x in corner) for corner in corners]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    file = draft.name("mesh", ".ply")
    (draft.folder / file).write_text("\n".join([*header, *rows]) + "\n")
    draft.sources[file] = Source(file, "mesh")
    return file


# first sources: kind, how often, and how it is made
KINDS: tuple[tuple[str, float, Callable[[Draft], Source]], ...] = (
    ("amounts", 10, amounts),
    ("labels", 3, labels),
    ("channels", 2, channels),
    ("times", 1, times),
    ("points", 1, points),
    ("vectors", 1, vectors),
    ("mesh", 0.5, lambda draft: draft.sources[write_mesh(draft)]),
)


# --- options ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Option:
    """An option of a scene file. name: its key, behind that of its table. chance: share of the scenes that it fits
    which have it. value: made for a draft. fits: whether it goes with what the draft has.
    """

    name: str
    chance: float
    value: Callable[[Draft], Any]
    fits: Callable[[Draft], bool] = lambda draft: True


def _span(draft: Draft) -> tuple[float, float]:
    """Values of the first source from little to all of its matter."""
    source = next(iter(draft.sources.values()))
    samples = np.asarray(source.open(draft.folder, draft.table.get("load", {})).samples)
    return float(samples.min()), float(samples.max())


def _at(draft: Draft, *shares: float) -> list[float]:
    low, high = _span(draft)
    return [round(low + share * (high - low), 1) for share in shares]


def _points(draft: Draft) -> list[list[float]]:
    first, second = _at(draft, draft.between(0.2, 0.4), draft.between(0.6, 0.9))
    return [[first, 0.0], [second, draft.between(0.2, 0.9)]]


def _regions(draft: Draft) -> list[str]:
    low, high, steep = *_at(draft, 0.3, 0.8), round((_span(draft)[1] - _span(draft)[0]) / 4, 1)
    box = f"box:{low},{high},0,{steep}:#ffcc88:0.3"
    return [box, *draft.one([], [f"triangle:{low},{high},0,{steep}:#88aaff:0.5"])]


def _iso(draft: Draft) -> list[Any]:
    low, high = _at(draft, draft.between(0.25, 0.45), draft.between(0.5, 0.8))
    return draft.one([[low, "", 1.0]], [[low, "#ff8844", 0.4], [high, "", 0.8]])


def _unit(draft: Draft) -> float | str:
    length = draft.between(0.5, 4)
    return length if length < 2.5 else "extent"


def _clip(draft: Draft) -> list[str]:
    x, _, z = (round(place) for place in _own(draft, CENTRE))
    shares = (["x>0.4"], ["y<0.6", "x>0.2"], ["x+y>0.7"], ["z>0.5"])
    if draft.kind == "points":
        return draft.one(*shares)
    return draft.one(*shares, [f"z<={z + 1}mm"], [f"x>={x - 1}mm"])


def _eye(draft: Draft) -> list[float]:
    """An eye 40 mm away, in the frame of the first source."""
    away = draft.rng.normal(size=3)
    return np.round(_own(draft, CENTRE + 40 * away / np.linalg.norm(away)), 2).tolist()


def _own(draft: Draft, point: np.ndarray) -> np.ndarray:
    source = next(iter(draft.sources.values()))
    is_ras = source.kind != "mesh" and source.open(draft.folder, draft.table.get("load", {})).frame == "RAS"
    return point @ TURN if is_ras else point


def _of(*kinds: str) -> Callable[[Draft], bool]:
    return lambda draft: draft.kind in kinds


def _plain(draft: Draft) -> bool:
    """Whether opacities are still the default ones, of amounts."""
    stated = ("transfer.points", "transfer.preset", "transfer.curve", "transfer.iso", "transfer.regions")
    return draft.kind in AMOUNTS and not draft.has(*stated)


AMOUNTS = ("amounts", "times", "vectors")
VOXELS = (*AMOUNTS, "labels", "channels")
BLENDS = ("xray", "mip", "minip", "mean", "attenuated-mip")
COLORMAPS = ("hot", "bone", "viridis", "spectrum")
PRESETS = ("mri", "microscopy", "surface", "field", "mr-angio", "ct-bone")


def _has_segments(draft: Draft) -> bool:
    return draft.kind == "labels" and not draft.has("load.values")


def _has_channels(draft: Draft) -> bool:
    return draft.table.get("load", {}).get("channel") == "all"


def _mask(draft: Draft) -> list[str]:
    source = mask(draft)
    draft.sources[source.file] = source
    return [source.file + draft.one("", ":1", ":1,3", ":3:outside")]


# how a layer looks, and the first source; each names the key of its table
LOOK = (
    Option("load.time", 0.6, lambda draft: draft.one(1, 2), _of("times")),
    Option("load.channel", 1, lambda draft: draft.one("all", "all", 0, 1), _of("channels")),
    Option("load.values", 0.1, lambda draft: "amounts", _of("labels")),
    Option("transfer.points", 0.45, _points, _plain),
    Option("transfer.preset", 0.25, lambda draft: draft.one(*PRESETS), _plain),
    Option("transfer.curve", 0.3, lambda draft: draft.one("ramp:40%,95%", "band:50%,90%:0.4", "tent", "step"), _plain),
    Option("transfer.iso", 0.5, _iso, lambda draft: draft.kind in AMOUNTS and not draft.has("transfer.preset")),
    Option("transfer.regions", 0.3, _regions, _plain),
    Option("transfer.colormap", 0.3, lambda draft: draft.one(*COLORMAPS), _of(*AMOUNTS)),
    Option(
        "transfer.colors",
        0.3,
        lambda draft: "40%:red,80%:#ffeecc,99%:white",
        lambda draft: draft.kind in AMOUNTS and not draft.has("transfer.colormap"),
    ),
    Option(
        "transfer.window",
        0.25,
        lambda draft: _at(draft, 0.2, draft.between(0.6, 1)),
        lambda draft: draft.kind in AMOUNTS and not draft.has("transfer.colors"),
    ),
    Option(
        "transfer.level_width",
        0.15,
        lambda draft: [*_at(draft, 0.5), round((_span(draft)[1] - _span(draft)[0]) / 2, 1)],
        lambda draft: draft.kind in AMOUNTS and not draft.has("transfer.colors", "transfer.window"),
    ),
    Option(
        "transfer.gradient",
        0.15,
        lambda draft: [[0.0, 0.2], [round((_span(draft)[1] - _span(draft)[0]) / 8, 1), 1.0]],
        lambda draft: draft.kind in AMOUNTS and not draft.has("transfer.iso"),
    ),
    Option("transfer.unit", 0.25, _unit, _of(*AMOUNTS, "labels")),
    Option("transfer.shading", 0.15, lambda draft: draft.one(True, False), _of(*AMOUNTS, "labels")),
    Option("transfer.only_labels", 0.4, lambda draft: draft.one([[1, 1.0]], [[1, 0.3], [5, 0.6]]), _has_segments),
    Option("transfer.name_of", 0.2, lambda draft: [[5, "vessel"]], _has_segments),
    Option("transfer.color_of", 0.3, lambda draft: [["0", "#ff8800"]], _has_channels),
    Option("transfer.window_of", 0.3, lambda draft: [["1", [400.0, 3000.0]]], _has_channels),
    Option(
        "threshold",
        0.15,
        lambda draft: draft.one(0.01, 0.1),
        lambda draft: (
            draft.kind in (*AMOUNTS, "labels", "points") and not draft.has("transfer.iso", "transfer.regions")
        ),
    ),
    Option("opacity", 0.15, lambda draft: draft.between(0.2, 0.9)),
    Option("title", 0.06, lambda draft: draft.one("a", "bone & air")),
    Option("clip", 0.3, _clip),
    Option("crop", 0.15, lambda draft: draft.one("2:8,:,:", "1:7,2:,:6", ":,3:7,:"), _of(*VOXELS)),
    Option("mask", 0.2, _mask, _of(*VOXELS)),
    Option("uncut", 0.3, lambda draft: "1,5", lambda draft: _has_segments(draft) and draft.has("clip")),
    Option("surfaces", 0.2, lambda draft: draft.one(0.5, 0.2), _has_segments),
    Option("visible", 0.06, lambda draft: False),
)


def _has_voxels(draft: Draft) -> bool:
    return draft.kind in VOXELS and all("points" not in layer["volume"] for layer in draft.table.get("layer", ()))


def _keeps_no_order(draft: Draft) -> bool:
    ordered = ("mesh", "slice_planes", "surfaces", "layer.surfaces", "vectors.streamlines", "vectors.arrows")
    return draft.kind != "mesh" and not draft.has(*ordered, "transfer.iso", "layer.transfer.iso")


def _of_any_class(draft: Draft) -> bool:
    """Whether voxels may be classified before or after reconstruction."""
    post = ("transfer.iso", "transfer.regions", "transfer.gradient")
    others = (*post, *(f"layer.{name}" for name in post))
    kinds = {source.kind for source in draft.sources.values()} - {"mask", "mesh"}
    return kinds <= {*AMOUNTS} and not draft.has(*others, "threshold", "layer.threshold")


def _has_no_angles(draft: Draft) -> bool:
    return not draft.has("camera.azimuth", "camera.elevation")


def _look_at(draft: Draft) -> list[float]:
    return np.round(_own(draft, CENTRE), 2).tolist()


def _has_flow(draft: Draft) -> bool:
    return draft.kind == "vectors" and not draft.has("vectors.show")


SCENE = (
    Option("vectors.show", 0.3, lambda draft: draft.one("magnitude", "direction"), _of("vectors")),
    Option("vectors.streamlines", 0.4, lambda draft: 6, _has_flow),
    Option("vectors.arrows", 0.3, lambda draft: 8, _has_flow),
    Option("slice_planes", 0.12, lambda draft: draft.one(["z=50%"], ["y@0.5", "x=40%"]), _has_voxels),
    Option("slices", 0.06, lambda draft: draft.one(["z=50%"], ["z=2:6:2", "x=50%"]), _has_voxels),
    Option("scissors", 0.12, lambda draft: draft.one(["0.2,0.1 0.9,0.2 0.6,0.6"], ["0.3,0.3 0.8,0.3 0.5,0.9:keep"])),
    Option("annotate", 0.1, lambda draft: draft.one(["scale"], ["box", "title=A"], ["colorbar", "axes"])),
    Option("camera.azimuth", 0.3, lambda draft: draft.between(-170, 170)),
    Option("camera.elevation", 0.3, lambda draft: draft.between(-80, 80)),
    Option("camera.fov", 0.15, lambda draft: draft.between(15, 60)),
    Option("camera.view", 0.2, lambda draft: draft.one("left", "superior", "isometric", "front"), _has_no_angles),
    Option("camera.orthographic", 0.2, lambda draft: True),
    Option("camera.eye", 0.3, _eye, lambda draft: _has_no_angles(draft) and not draft.has("camera.view")),
    Option("camera.zoom", 0.2, lambda draft: draft.between(0.8, 1.4), lambda draft: not draft.has("camera.eye")),
    Option("camera.fit", 0.2, lambda draft: draft.one("all", "visible", "0.3")),
    Option("camera.look_at", 0.7, _look_at, lambda draft: draft.has("camera.eye")),
    Option("camera.up", 0.15, lambda draft: draft.one([0.1, 0.2, 0.9], [0.0, -1.0, 0.2])),
    Option("settings.blend", 0.25, lambda draft: draft.one(*BLENDS), _keeps_no_order),
    Option("settings.background", 0.2, lambda draft: draft.one("black", "white", "#203040")),
    Option("settings.light", 0.2, lambda draft: draft.one("matte", "glossy", "flat")),
    Option("settings.shading", 0.15, lambda draft: draft.one("on", "off")),
    Option("settings.antialias", 0.15, lambda draft: draft.one("off", "supersample")),
    Option("settings.classification", 0.15, lambda draft: draft.one("pre", "post"), _of_any_class),
    Option("settings.tolerance", 0.1, lambda draft: draft.one(0.02, 0.001)),
    Option("settings.technique", 0.1, lambda draft: draft.one("quads", "tiles")),
    Option("settings.ambient_occlusion", 0.06, lambda draft: 0.5),
    Option("settings.shadows", 0.06, lambda draft: 0.5),
    Option("settings.kernel", 0.1, lambda draft: draft.one("gaussian", "b-spline", "crawfis-max")),
)  # fmt: skip

# of meshes
MESH = (
    Option("color", 0.6, lambda draft: draft.one("red", "#30a0ff")),
    Option("opacity", 0.5, lambda draft: draft.between(0.2, 0.9)),
    Option("clip", 0.3, lambda draft: True),
    Option("caps", 0.15, lambda draft: "plain"),
    Option("visible", 0.1, lambda draft: False),
    Option("title", 0.1, lambda draft: "a mesh"),
)
TABLES = ("load", "transfer", "camera", "settings", "vectors")


def _fill(draft: Draft, options: tuple[Option, ...]) -> None:
    for option in options:
        if option.fits(draft) and draft.chance(option.chance):
            table, _, key = option.name.rpartition(".")
            (draft.table.setdefault(table, {}) if table else draft.table)[key] = option.value(draft)


def _layer(draft: Draft, make: Callable[[Draft], Source]) -> Table:
    """The table of a layer, whose options refer to it alone."""
    source = make(draft)
    table = {"volume": source.file}
    own = Draft(draft.rng, draft.folder, draft.seed, table, {source.file: source}, source.kind, draft.frames)
    own.sources |= {file: known for file, known in draft.sources.items() if file != source.file}
    _fill(own, LOOK)
    draft.sources |= own.sources
    return own.table


def make_scene(folder: Path, seed: int) -> Draft:
    """A random scene, of which scene.toml is written in the folder."""
    draft = Draft(np.random.default_rng(seed), folder, seed)
    weights = np.array([weight for _, weight, _ in KINDS])
    _, _, make = KINDS[int(draft.rng.choice(len(KINDS), p=weights / weights.sum()))]
    if make in (channels, points) or (make is not times and draft.chance(0.3)):
        draft.frames = ("LPS", None)
    source = make(draft)
    draft.kind, draft.sources[source.file], draft.table = source.kind, source, {"volume": source.file}
    if draft.kind != "mesh":
        _fill(draft, LOOK)
    others = [amounts, labels] * 2 + [points, channels] * (None in draft.frames)
    count = int(draft.rng.choice(3, p=(0.5, 0.35, 0.15)))
    layers = [_layer(draft, draft.one(*others)) for _ in range(count)]
    draft.table |= {"layer": layers} if layers else {}
    meshes = [_mesh(draft) for _ in range(int(draft.rng.choice(3, p=(0.7, 0.22, 0.08))))]
    draft.table |= {"mesh": meshes} if meshes else {}
    _fill(draft, SCENE)
    draft.table.setdefault("camera", {})["size"] = [*(ANNOTATED if draft.has("annotate", "slices") else SMALL)]
    (folder / "scene.toml").write_text(to_toml(draft.table), encoding="utf-8")
    return draft


def make_plain_scene(folder: Path, options: Mapping[str, Any], *makes: Callable[[Draft], Source]) -> Draft:
    """A scene of sources, the first one and layers, with options. options: the table of the scene; "layer": options of
    each layer.
    """
    draft = Draft(np.random.default_rng(1), folder, 1)
    for make in makes:
        source = make(draft)
        draft.sources[source.file] = source
    first, *others = draft.sources.values()
    rows = [{"volume": other.file, **options.get("layer", {})} for other in others if other.kind != "mesh"]
    meshes = [{"file": other.file} for other in others if other.kind == "mesh"]
    tables = {name: value for name, value in (("layer", rows), ("mesh", meshes)) if value}
    camera = {"size": [*SMALL], **options.get("camera", {})}
    draft.kind, draft.table = first.kind, {"volume": first.file, **options, "camera": camera}
    draft.table = {name: value for name, value in draft.table.items() if name != "layer"} | tables
    (folder / "scene.toml").write_text(to_toml(draft.table), encoding="utf-8")
    return draft


def _mesh(draft: Draft) -> Table:
    own = Draft(draft.rng, draft.folder, draft.seed, {"file": write_mesh(draft)}, frames=draft.frames)
    _fill(own, MESH)
    return own.table


def traits(draft: Draft) -> set[str]:
    """Names of a scene's options, and of the kinds of its sources: "a layer of points"."""
    names = set(option_names(draft.table)) | {f"a volume of {draft.kind}"}
    is_fitted = draft.table["camera"].get("fit", "all") != "all"
    names |= {"a fitted series"} if draft.kind == "times" and "load.time" not in names and is_fitted else set()
    return names | {f"a layer of {draft.sources[row['volume']].kind}" for row in draft.table.get("layer", ())}


def option_names(table: Mapping[str, Any]) -> list[str]:
    """Names of the options of a scene, as in OPTIONS; those of layers and meshes behind "layer." and "mesh."."""
    names = list[str]()
    for key, value in table.items():
        if key in TABLES:
            names += [f"{key}.{name}" for name in value]
        elif key in ("layer", "mesh"):
            names += [key, *(f"{key}.{name}" for row in value for name in option_names(row))]
        else:
            names.append(key)
    return list(dict.fromkeys(names))


def to_toml(table: Mapping[str, Any], prefix: str = "") -> str:
    """TOML of a scene: plain keys first, then its tables, then those of layers and meshes."""
    tables = [key for key in table if key in TABLES]
    rows = [key for key in table if key in ("layer", "mesh")]
    lines = [f"{key} = {json.dumps(value)}" for key, value in table.items() if key not in (*tables, *rows)]
    for key in tables:
        lines += [f"[{prefix}{key}]", *(f"{name} = {json.dumps(value)}" for name, value in table[key].items())]
    for key in rows:
        for row in table[key]:
            lines += [f"[[{key}]]", to_toml(row, f"{key}.")]
    return "\n".join(lines) + "\n" * (not prefix)

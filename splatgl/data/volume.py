"""`Volume`: samples on an affine grid, slabs and boxes with a halo, fewer voxels; data in files is read in parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import numpy as np

from splatgl.coercion import public
from splatgl.data.times import Times
from splatgl.errors import InputError, expected, list_names
from splatgl.options import keywords_of, with_keywords

if TYPE_CHECKING:
    from pathlib import Path

    from splatgl.data.affine import World
    from splatgl.data.points import Points
    from splatgl.keywords import ArrayKeywords


Triple = tuple[float, float, float]
Places = tuple[int, int, int]
# limits in world units: float64 holds the fourth powers of these and of far larger distances
LEAST_LENGTH, MOST_LENGTH = 1e-40, 1e40
# most voxels whose combined mask is cached, 1 byte each
MAX_CACHED = 2**28
# most samples whose range a line of text states
MOST_SCANNED = 2**24
# most names in such a line
MOST_NAMES = 8
# largest distance of labels from whole numbers: scaled integers are off by half the scale
NEARLY_WHOLE = 0.2
# maximum ratio of a voxel's sides: float32 holds its square, and distances in either
MOST_OBLONG = 1e9


@dataclass(frozen=True)
class Hints:
    """View and transfer function hints of a file or scene; plain values, all optional.

    window: (low, high) sample values spanned by the colours. points: (value, opacity) pairs, the
    opacity per `unit` world lengths (None: the mean spacing). preset: a transfer preset's name.
    The view is either an orbit (azimuth, elevation in degrees) or an eye and a target in world
    units; fov is the full vertical angle in degrees; orthographic: parallel rays, unless a fov is
    set. color: "#rrggbb" of a channel at its brightest; inverted: which its low values are.
    stack: whether the samples are planes of a microscope, or other pictures. values: "labels", "mask" or "amounts",
    their meaning. slices: of a step of a series, the default transfer function and the window of its slices.
    """

    window: tuple[float, float] | None = None
    points: tuple[tuple[float, float], ...] | None = None
    unit: float | None = None
    preset: str | None = None
    colormap: str | None = None
    color: str | None = None
    inverted: bool = False
    shading: bool | None = None
    azimuth: float | None = None
    elevation: float | None = None
    eye: Triple | None = None
    target: Triple | None = None
    up: Triple | None = None
    fov: float | None = None
    orthographic: bool = False
    stack: bool = False
    values: str | None = None
    slices: Any = None


# lengths per side of a cube as large as a volume's box
PER_EXTENT = 100


class Lengths(NamedTuple):
    """World lengths that opacities may refer to. spacing: |det A|^(1/3), the mean spacing; extent: cube root of the
    box's volume by PER_EXTENT, whatever its samples: the mean spacing of 100³ of them.
    """

    spacing: float
    extent: float

    @classmethod
    def of(cls, matrix: np.ndarray, shape: Sequence[int]) -> Lengths:
        """The lengths of a grid of a world-from-index matrix [3, 3]."""
        spacing = float(np.exp(np.linalg.slogdet(matrix)[1] / 3))
        return cls(spacing, spacing * math.prod(shape) ** (1 / 3) / PER_EXTENT)


@public
@dataclass(frozen=True)
class Label:
    """A segment: number of its voxels, name, colour "#rrggbb" (None: any), factor of opacity, hidden by default.

    Raises InputError for arguments of another kind.
    """

    number: int
    name: str = ""
    color: str | None = None
    opacity: float = 1.0
    hidden: bool = False


@dataclass(frozen=True)
class AxisCoordinate:
    """A file's coordinate along an axis of the world: offset + slope · position, in its unit, under its name."""

    name: str
    unit: str = ""
    slope: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Slab:
    """Planes start ≤ z < stop of a volume, with up to `halo` extra planes on either side.

    samples: [stop-start+before+after, H, W]; its plane `before` is the volume's plane `start`.
    """

    start: int
    stop: int
    before: int
    samples: np.ndarray


def _field(help: str) -> Any:
    """A field that is None by default, with a line of help."""
    return field(default=None, metadata={"help": help})


@dataclass(frozen=True)
class ArrayOptions:
    """Options for an array; None: as the array itself states.

    spacing, origin: (x, y, z) in world units. unit: of length. array: name or number, where x holds several arrays.
    values: the meaning of samples, "labels" or "amounts".
    """

    spacing: Triple | None = _field("lengths of a voxel along x, y, z, world units")
    origin: Triple | None = _field("position (x, y, z) of the first voxel's centre, world units")
    unit: str | None = _field("unit of lengths, such as 'mm'")
    name: str | None = _field("name of the volume")
    array: str | int | None = _field("name or number of the array, where the object holds several")
    values: str | None = _field("meaning of samples: 'labels', 'amounts'")

    @property
    def given(self) -> dict[str, Any]:
        """The options that are fields of `Volume` and not None."""
        options = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("array", "values")}
        return {name: value for name, value in options.items() if value is not None}

    def no_array(self, what: str) -> None:
        """Raises InputError if `array` was given for an object that holds one array."""
        if self.array is not None:
            raise expected("array", f"no value, as {what} is one array", repr(self.array), "leave it out")


@public
@dataclass(frozen=True, eq=False)
class Volume:
    """Samples on an affine grid: world = direction · diag(spacing) · (x, y, z) + origin.

    samples: [D, H, W] (z, y, x), any real dtype: an array, possibly memory-mapped, or an object with shape, dtype and
    slices (of Zarr, HDF5, Dask), which is read in parts.
    spacing, origin: (x, y, z) in world units. direction: [3, 3], its columns the unit axes of x, y, z.
    unit: name of the world's unit of length ("mm", "um", ""), stated in any spelling. frame: "LPS", "RAS" or None.
    color: uint8 [D, H, W, 3] sRGB, also read in parts, or None. vectors: [D, H, W, 3] along world x, y, z, or None.
    coarser: the further levels of a multiscale image, with fewer voxels, finer first.
    labels: table of the segments that samples number (empty: the file has none); None: samples are amounts.
    channels: all channels that were read, with names, if the file has several; samples are the first channel's.
    times: time points of the file, of which this is the one number `time`; time_step: seconds between two; moments:
    their times, where the file states them.
    axes: the file's coordinates along x, y and z of the world, where these are scaled or have names; () else.
    quantity, value_unit: names of what samples measure, and of its unit ("HU", "K"), as the file states them.
    masks: a Mask or Scissors each, which restrict it; see `masked`.
    points: drawn instead of the samples, which are then empty, with the opacity of the value 1.
    notes: lines for the user on what the reader left out or assumed.
    Raises InputError for samples that are not 3-D real numbers and for an impossible grid.

    ```python
    import numpy as np

    volume = sg.Volume(np.random.default_rng(1).random((8, 16, 16)), spacing=(0.5, 0.5, 2.0), unit="mm")
    print(volume, volume.extent)
    ```
    """

    samples: Any
    spacing: Triple = (1.0, 1.0, 1.0)
    origin: Triple = (0.0, 0.0, 0.0)
    direction: np.ndarray = field(default_factory=lambda: np.eye(3))
    unit: str = ""
    name: str = ""
    frame: str | None = None
    color: Any = None
    vectors: np.ndarray | None = None
    hints: Hints = field(default_factory=Hints)
    coarser: tuple[Volume, ...] = ()
    labels: tuple[Label, ...] | None = None
    notes: tuple[str, ...] = ()
    channels: tuple[Volume, ...] = ()
    times: int = 1
    time_step: float | None = None
    time: int = 0
    moments: Times | None = None
    axes: tuple[AxisCoordinate, ...] = ()
    value_unit: str = ""
    quantity: str = ""
    masks: tuple[Any, ...] = ()
    points: Points | None = None
    whole: Lengths | None = None

    def __post_init__(self) -> None:
        parts = all(hasattr(self.samples, name) for name in ("shape", "dtype", "__getitem__"))
        samples = self.samples if parts else np.asarray(self.samples)
        if len(samples.shape) != 3 or samples.dtype.kind not in "buif":
            raise expected("samples", "a 3-D array [z, y, x] of real numbers", f"{samples.dtype} {samples.shape}")
        if min(samples.shape) < 1:
            raise expected("samples", "at least one voxel along each axis", f"shape {samples.shape}")
        for name, array in (("color", self.color), ("vectors", self.vectors)):
            if array is not None and getattr(array, "shape", None) != (*samples.shape, 3):
                got = getattr(array, "shape", None) or f"a {type(array).__name__}"
                raise expected(name, f"shape {(*samples.shape, 3)}", got)
        if self.color is not None and self.color.dtype != np.uint8:
            raise expected("color", "uint8, sRGB", self.color.dtype)
        if self.frame not in (None, "LPS", "RAS"):
            raise expected("frame", "LPS, RAS or None", repr(self.frame))
        from splatgl.data.affine import unit_name

        object.__setattr__(self, "samples", samples)
        object.__setattr__(self, "unit", unit_name(str(self.unit or "")))
        object.__setattr__(self, "spacing", _spacing(self.spacing))
        object.__setattr__(self, "origin", triple(self.origin, "origin"))
        direction = np.array(self.direction, dtype=np.float64)
        if direction.shape != (3, 3) or not np.isfinite(direction).all() or abs(np.linalg.det(direction)) < 1e-9:
            raise expected("direction", "an invertible 3×3 matrix", np.asarray(self.direction).tolist())
        object.__setattr__(self, "direction", direction)
        if self.coarser:
            levels = (level if level.whole else replace(level, whole=self.lengths) for level in self.coarser)
            object.__setattr__(self, "coarser", tuple(levels))

    @classmethod
    @with_keywords(keywords_of(ArrayOptions))
    def of(cls, x: Any, **options: Unpack[ArrayKeywords]) -> Volume:
        """The volume in an array or image of another library, with its grid, unit and name; a view where possible.

        x: numpy arrays and lists [z, y, x]; arrays of dask, zarr and h5py, which are read in parts; DataArrays of
        xarray; images of SimpleITK, nibabel and VTK or PyVista; Image layers of napari. options: spacing, origin
        (x, y, z), unit, name replace those of x; array: name or number of the array to take, where x holds several.
        Raises InputError for objects that make no volume.
        """
        from splatgl.data.arrays import volume_of

        return volume_of(x, **options)

    def of_values(self, values: str) -> Volume:
        """The same samples as "labels", in the colours of its table if it has one, or as "amounts"; channels too.
        Raises InputError for labels that are no whole numbers.
        """
        volume = self.rounded() if values == "labels" else self
        if volume is None:
            raise fraction_error(self)

        def marked(level: Volume) -> Volume:
            labels = (level.labels or ()) if values == "labels" else None
            return replace(level, labels=labels, hints=replace(level.hints, values=values))

        channels = tuple(channel.of_values(values) for channel in self.channels)
        return replace(marked(volume), coarser=tuple(map(marked, volume.coarser)), channels=channels)

    def rounded(self, most: float = NEARLY_WHOLE) -> Volume | None:
        """The volume with whole numbers in place of samples that are at most so far from them; itself if all are whole,
        None if one is farther off. Coarser levels too; channels stay.
        """
        off = 0.0
        for block in self.slabs(16, halo=0) if np.dtype(self.samples.dtype).kind == "f" else ():
            with np.errstate(invalid="ignore"):
                distances = np.abs(block.samples - np.rint(block.samples))
            off = max(off, float(distances[np.isfinite(distances)].max(initial=0.0)))
            if off > most:
                return None
        return replace(_round_samples(self), coarser=tuple(map(_round_samples, self.coarser))) if off else self

    def masked(self, mask: Any, labels: Sequence[int] = (), outside: bool = False) -> Volume:
        """The same samples, visible only where a mask is not 0, or has one of `labels`.

        mask: a Volume on any grid in the same world; an array [D, H, W] on this grid; a file, or "FILE:3,7:outside" as
        on the command line; Scissors with a camera. A voxel is kept if its centre lies in a kept voxel of the mask.
        outside: keeps the others instead. Several masks keep what all of them keep. Raises InputError if nothing is
        left.
        """
        from splatgl.data.mask import apply_mask, make_mask

        return apply_mask(self, make_mask(mask, self, labels, outside))

    @property
    def lengths(self) -> Lengths:
        """Lengths that opacities may refer to: of the whole volume that this is a part or coarser level of."""
        return self.whole or Lengths.of(self.world_from_index, self.shape)

    @property
    def shortest(self) -> float:
        """Mean spacings, as of `lengths`, along the axis of the fewest samples."""
        return min(self.shape) * (Lengths.of(self.world_from_index, self.shape).spacing / self.lengths.spacing)

    @property
    def world(self) -> World:
        """Frame and unit of the volume's coordinates."""
        from splatgl.data.affine import World

        return World(self.frame, self.unit)

    def placed(self, frame: str | None = None, unit: str = "") -> Volume:
        """The volume in another frame and unit of length, with its channels and levels; a frame or unit that is unknown
        on either side stays.
        """
        change = self.world.change(frame, unit)
        if change is None:
            return self
        x, y, z = (change.factors * self.origin).tolist()
        vectors, points, hints = self.vectors, self.points, self.hints
        axes = zip(self.axes, change.factors.tolist(), strict=bool(self.axes))
        placed = replace(
            self,
            spacing=triple(np.multiply(self.spacing, change.length), "spacing"),
            origin=(x, y, z),
            direction=change.turn[:, None] * self.direction,
            frame=change.world.frame,
            unit=change.world.unit,
            vectors=None if vectors is None else vectors * change.turn.astype(vectors.dtype),
            axes=tuple(replace(axis, slope=axis.slope / factor) for axis, factor in axes),
            hints=replace(hints, unit=hints.unit and hints.unit * change.length),
            whole=self.whole and Lengths(*(length * change.length for length in self.whole)),
            points=points and replace(points, places=points.places * change.factors, size=points.size * change.length),
        )
        return with_parts(placed, lambda part: part.placed(frame, unit))

    def kept(self, low: Places, high: Places) -> np.ndarray:
        """bool: whether all masks keep each voxel low ≤ (z, y, x) < high; True without masks."""
        if self.masks and self.count <= MAX_CACHED:
            return np.asarray(self._cached_mask[tuple(map(slice, low, high))])
        return self._combine_masks(low, high)

    def mask_shares(self, low: Places, high: Places) -> np.ndarray:
        """uint8: the minimum of all masks, 0 to 255, for each voxel low ≤ (z, y, x) < high."""
        shares = np.full([b - a for a, b in zip(low, high, strict=True)], 255, np.uint8)
        for mask in self.masks:
            np.minimum(shares, mask.shares(self, low, high), out=shares)
        return shares

    @cached_property
    def _cached_mask(self) -> np.ndarray:
        return self._combine_masks((0, 0, 0), self.shape)

    def _combine_masks(self, low: Places, high: Places) -> np.ndarray:
        inside = np.ones([b - a for a, b in zip(low, high, strict=True)], bool)
        for mask in self.masks:
            inside &= mask.keeps(self, low, high)
        return inside

    def save(self, path: str | Path, images: str | Path | None = None) -> tuple[str, ...]:
        """Writes the volume, or nothing: .nii, .nii.gz, .nrrd, .mha, .ome.tif, .zarr (with levels), .npy, and labels as
        .dcm, of the patient of the DICOM `images` that they were drawn on (a file or folder).

        Returns a line for each thing that the format cannot hold. Large samples are read in slabs. Raises InputError
        for another name and for contents that the format has no place for.
        """
        from splatgl.writers import save

        return save(self, path, images=images)

    def to_pyvista(self) -> Any:
        """A pyvista.ImageData with the samples in its points, colours and vectors too. InputError without PyVista."""
        from splatgl.integrations.vtk.image_data import image_data

        return image_data(self)

    def to_xarray(self) -> Any:
        """A DataArray [z, y, x], or [channel, z, y, x], with coordinates, unit and name; samples that are read in parts
        stay on disk. Raises InputError for a turned grid.
        """
        from splatgl.integrations.exchange import to_xarray

        return to_xarray(self)

    def to_dask(self) -> Any:
        """A Dask array [z, y, x] of the samples, of which nothing is read yet."""
        from splatgl.integrations.exchange import to_dask

        return to_dask(self)

    def to_simpleitk(self) -> Any:
        """An image of SimpleITK in LPS and millimetres, of the first channel. Raises InputError for a sheared grid."""
        from splatgl.integrations.exchange import to_simpleitk

        return to_simpleitk(self)

    def to_nibabel(self) -> Any:
        """A NIfTI image of nibabel in RAS and millimetres, of the first channel."""
        from splatgl.integrations.exchange import to_nibabel

        return to_nibabel(self)

    def __repr__(self) -> str:
        """One line of what `facts` lists."""
        (_, size), *more = self.facts
        return f"<Volume {self.name!r}: {', '.join([size, *(f'{name} {text}' for name, text in more)])}>"

    def _repr_html_(self) -> str:
        """A small picture beside the table of `facts`, for notebooks."""
        return str(import_module("splatgl.viewer.thumbnails").volume_html(self))

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Names and texts: voxels and type; range of the values, if few are in memory; grid; what else there is."""
        unit = f" {self.unit}" if self.unit else ""
        size = (n * step for n, step in zip(self.shape[::-1], self.spacing, strict=True))
        if self.points is not None:
            return [("points", f"{len(self.points):,} points"), *([("frame", self.frame)] if self.frame else [])]
        labels, ends = [label.name or str(label.number) for label in self.labels or ()], self.value_range
        listed = {
            "voxels": f"{times(self.shape[::-1])} {np.dtype(self.samples.dtype).name}",
            self.quantity or "values": f"{ends[0]:g} … {ends[1]:g} {self.value_unit}".strip() if ends else "",
            "spacing": f"{times(self.spacing)}{unit}",
            "size": f"{times(size)}{unit}",
            "frame": self.frame or "",
            "channels": some([channel.name or str(n) for n, channel in enumerate(self.channels)]),
            "labels": some(labels),
            "times": f"{self.times}" if self.times > 1 else "",
            "levels": f"{1 + len(self.coarser)}" if self.coarser else "",
            "with": " and ".join([*["colours"] * (self.color is not None), *["vectors"] * (self.vectors is not None)]),
            "masked": f"by {some([mask.name or 'an array' for mask in self.masks])}" if self.masks else "",
        }
        return [(name, text) for name, text in listed.items() if text]

    @property
    def value_range(self) -> tuple[float, float] | None:
        """The minimum and maximum finite value; None of many samples or files in parts, and if none is finite."""
        if not isinstance(self.samples, np.ndarray) or self.count > MOST_SCANNED:
            return None
        values = self.samples
        with np.errstate(invalid="ignore", over="ignore"):
            if not np.isfinite(values.max() - values.min() if values.dtype.kind == "f" else 0):
                values = values[np.isfinite(values)]
        return (float(values.min()), float(values.max())) if values.size else None

    def time_text(self, number: int) -> str:
        """The time of a time point by the file, else by the time between two, else its number."""
        known = self._known_times
        return known.text(number) if known and number < len(known.values) else str(number)

    def time_number(self, text: str) -> int:
        """The time point of a time, such as "1.5 s". Raises InputError if there is none."""
        if self._known_times is None:
            raise expected("time", "a number, as the file states no times", repr(text))
        return self._known_times.number(text)

    @property
    def _known_times(self) -> Times | None:
        steps = None if self.time_step is None else Times(tuple(n * self.time_step for n in range(self.times)), "s")
        return self.moments or steps

    @property
    def shape(self) -> tuple[int, int, int]:
        """(D, H, W): the number of voxels along z, y, x."""
        d, h, w = self.samples.shape
        return int(d), int(h), int(w)

    @property
    def count(self) -> int:
        """The number of voxels."""
        return math.prod(self.shape)

    @property
    def world_from_index(self) -> np.ndarray:
        """A [3, 3] = direction · diag(spacing); a voxel (x, y, z) lies at A @ (x, y, z) + origin."""
        return self.direction * np.asarray(self.spacing)

    @property
    def center(self) -> np.ndarray:
        """Centre of the box of samples, world (x, y, z)."""
        d, h, w = self.shape
        return np.asarray(self.world_from_index @ (np.array([w, h, d]) - 1) / 2 + self.origin)

    @property
    def corners(self) -> np.ndarray:
        """The box's eight corners [8, 3] in world units, half a voxel beyond the outer samples."""
        d, h, w = self.shape
        grid = np.array([[x, y, z] for z in (-0.5, d - 0.5) for y in (-0.5, h - 0.5) for x in (-0.5, w - 0.5)])
        return np.asarray(grid @ self.world_from_index.T + self.origin)

    @property
    def outline(self) -> np.ndarray:
        """Points whose hull contains the volume: its corners."""
        return self.corners

    def slabs(self, depth: int, halo: int = 1) -> Iterator[Slab]:
        """Slabs of at most `depth` planes along z; only a slab's planes are read."""
        planes = self.shape[0]
        for start in range(0, planes, depth):
            stop = min(start + depth, planes)
            first, last = max(start - halo, 0), min(stop + halo, planes)
            yield Slab(start, stop, start - first, np.asarray(self.samples[first:last]))

    def share_missing(self) -> float:
        """Share of the samples that are not finite, 0 to 1; reads them all."""
        if np.dtype(self.samples.dtype).kind != "f":
            return 0.0
        return 1.0 - sum(int(np.isfinite(slab.samples).sum()) for slab in self.slabs(1, halo=0)) / max(self.count, 1)

    def extent(self, low: Places, high: Places, halo: int) -> np.ndarray | None:
        """Range of the finite samples of `box`: two numbers, none if none is finite; None if not known yet."""
        first, last = self.around(low, high, halo)
        known = getattr(self.samples, "extent", None)
        return known(first, last) if known else None

    def box(self, low: Places, high: Places, halo: int) -> tuple[np.ndarray, Places]:
        """The samples of voxels low ≤ (z, y, x) < high, and up to `halo` more on each side; index of the first."""
        first, last = self.around(low, high, halo)
        return np.asarray(self.samples[tuple(map(slice, first, last))]), first

    def part(self, low: Places, high: Places) -> Volume:
        """The voxels low ≤ (z, y, x) < high as a volume, without vectors and coarser levels."""
        box = tuple(map(slice, low, high))
        color = None if self.color is None else np.asarray(self.color[box])
        x, y, z = (self.world_from_index @ np.array(low[::-1]) + self.origin).tolist()
        samples = np.asarray(self.samples[box])
        alone: dict[str, Any] = {"coarser": (), "channels": (), "whole": self.lengths}
        return replace(self, samples=samples, color=color, vectors=None, origin=(x, y, z), **alone)

    def around(self, low: Places, high: Places, halo: int) -> tuple[Places, Places]:
        """The ends of a box of voxels with up to `halo` more on each side."""
        z, y, x = (max(start - halo, 0) for start in low)
        d, h, w = (min(stop + halo, size) for stop, size in zip(high, self.shape, strict=True))
        return (z, y, x), (d, h, w)


def times(lengths: Iterable[float]) -> str:
    """Lengths along x, y, z as text."""
    return "×".join(f"{length:g}" for length in lengths)


def some(names: Sequence[str]) -> str:
    """The first names, and the number of all if there are more."""
    return list_names(names, MOST_NAMES) + f" ({len(names)})" * (len(names) > MOST_NAMES)


def _round_samples(volume: Volume) -> Volume:
    from splatgl.data.arrays import ConvertedArray

    stored: Any = volume.samples
    is_array = isinstance(stored, np.ndarray)
    whole = np.rint(stored) if is_array else ConvertedArray(stored, stored.shape, np.dtype(stored.dtype), np.rint)
    return replace(volume, samples=whole)


def fraction_error(volume: Volume) -> InputError:
    """The error for labels that are no whole numbers."""
    for block in volume.slabs(16, halo=0):
        values = block.samples[np.isfinite(block.samples)]
        worst = values[np.abs(values - np.rint(values)).argmax()] if values.size else 0
        if worst != np.rint(worst):
            break
    got = f"values such as {worst:.6g}"
    return expected(volume.name or "labels", "whole numbers, each of a segment", got, "draw amounts with --layer")


def with_parts(volume: Volume, change: Callable[[Volume], Volume]) -> Volume:
    """The volume with changed channels and coarser levels."""
    channels, coarser = (tuple(map(change, volumes)) for volumes in (volume.channels, volume.coarser))
    return replace(volume, channels=channels, coarser=coarser)


# least side of the box of an empty volume, as a share of its longest side
FLAT = 1e-3


def empty_volume(low: np.ndarray, high: np.ndarray, solid: float = 0.0, **more: Any) -> Volume:
    """Empty volume that only gives a bounding box, to place the camera. solid: opacity of the value 1; more: fields of
    `Volume`.
    """
    side = np.maximum(high - low, FLAT * max(float((high - low).max()), 1e-30))
    # two samples along each axis, cells of half a side
    (a, b, c), (x, y, z) = (side / 2).tolist(), ((low + high) / 2 - side / 4).tolist()
    hints = Hints(points=((0.0, 0.0), (1.0, solid)), window=(0.0, 1.0))
    return Volume(np.zeros((2, 2, 2), np.uint8), (a, b, c), (x, y, z), hints=hints, **more)


def zyx_index(index: np.ndarray) -> Places:
    """(z, y, x) of a grid index (x, y, z)."""
    x, y, z = index.tolist()
    return z, y, x


def triple(value: Any, what: str) -> Triple:
    """Three floats (x, y, z). Raises InputError for any other number of them, and for numbers beyond MOST_LENGTH."""
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (3,) or not (np.abs(numbers) <= MOST_LENGTH).all():
        got = value.tolist() if isinstance(value, np.ndarray) else value
        raise expected(what, f"three finite numbers (x, y, z) up to {MOST_LENGTH:g}", got)
    return float(numbers[0]), float(numbers[1]), float(numbers[2])


def _spacing(value: Sequence[float]) -> Triple:
    spacing = triple(value, "spacing")
    if min(spacing) < LEAST_LENGTH:
        fix = "turn an axis by `direction` instead" if min(spacing) < 0 else ""
        raise expected("spacing", f"three positive numbers (x, y, z) from {LEAST_LENGTH:g} on", value, fix)
    if max(spacing) > MOST_OBLONG * min(spacing):
        raise expected("spacing", f"three numbers (x, y, z) within a factor of {MOST_OBLONG:g}", value)
    return spacing


# axes with fewer samples are not halved
FEWEST = 4


def halve_volume(volume: Volume, labels: bool = False) -> Volume:
    """The volume of means over 2×2×2 voxels, float32; short axes stay. A block with a non-finite voxel is non-finite.

    labels: whether samples number segments, as a volume with a table always does: then each block gets its most
    frequent number, in its type; of equally frequent ones a segment's. Colours are weighted by the samples' height
    above the minimum, so that empty voxels do not contribute.
    """
    steps = [2 if count >= FEWEST else 1 for count in volume.shape]
    samples = halve_samples(volume.samples, steps, labels or volume.labels is not None)
    colors = None if volume.color is None else np.empty((*samples.shape, 3), np.uint8)
    if colors is not None:
        lowest = min(float(np.nanmin(slab.samples)) for slab in volume.slabs(8, halo=0))
        for z in range(len(colors)):
            planes = np.asarray(volume.samples[z * steps[0] : (z + 1) * steps[0]])
            weight = planes.astype(np.float32) - (lowest - 1e-3)
            shade = volume.color[z * steps[0] : (z + 1) * steps[0]].astype(np.float32)
            total = np.maximum(_mean(weight, steps), 1e-6)
            for channel in range(3):
                colors[z, ..., channel] = np.rint(_mean(shade[..., channel] * weight, steps) / total)

    # centre of the first block, in voxels: between its samples
    middle = (np.array(steps[::-1]) - 1) / 2
    origin = np.asarray(volume.origin) + volume.world_from_index @ middle
    spacing = np.asarray(volume.spacing) * steps[::-1]
    return replace(
        volume,
        samples=samples,
        color=colors,
        vectors=None,
        spacing=triple(spacing, "spacing"),
        origin=triple(origin, "origin"),
        whole=volume.lengths,
    )


def subsample(volume: Volume, step: int) -> Volume:
    """Every `step`-th voxel along each axis, plane by plane: of a mapped file, only these are read."""
    color = volume.color
    planes = [np.asarray(volume.samples[z])[::step, ::step] for z in range(0, volume.shape[0], step)]
    x, y, z = volume.spacing
    return replace(
        volume,
        samples=np.stack(planes),
        color=None if color is None else np.asarray(color[::step, ::step, ::step]),
        vectors=None,
        spacing=(x * step, y * step, z * step),
        whole=volume.lengths,
    )


def halve_samples(samples: Any, steps: Sequence[int], labels: bool) -> np.ndarray:
    """[D', H', W'] means of blocks of samples [D, H, W], float32; of labels the most frequent numbers, in their type.

    steps (z, y, x): voxels of a block, 2 or 1. One layer of blocks is read at a time.
    """
    shape = [-(-count // step) for count, step in zip(samples.shape, steps, strict=True)]
    halved = np.empty(shape, samples.dtype if labels else np.float32)
    for z in range(shape[0]):
        planes = np.asarray(samples[z * steps[0] : (z + 1) * steps[0]])
        halved[z] = _majority(planes, steps) if labels else _mean(planes.astype(np.float32, copy=False), steps)
    return halved


def _mean(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """[H', W'] means of blocks of planes [d, H, W]; the last of an odd count has double weight."""
    mean = _pad_odd(planes, steps).sum(axis=0, dtype=np.float32) / len(planes)
    mean = mean if steps[1] == 1 else (mean[::2] + mean[1::2]) / 2
    return np.asarray(mean if steps[2] == 1 else (mean[:, ::2] + mean[:, 1::2]) / 2)


def _pad_odd(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """Planes [d, H, W] with the last row and column of an odd count twice."""
    odd = [(0, -count % step) for count, step in zip(planes.shape[1:], steps[1:], strict=True)]
    return np.pad(planes, [(0, 0), *odd], mode="edge") if any(map(any, odd)) else planes


def _majority(planes: np.ndarray, steps: Sequence[int]) -> np.ndarray:
    """[H', W'] most frequent numbers of blocks of planes [d, H, W]; the last of an odd count counts twice."""
    padded, (_, down, right) = _pad_odd(planes, steps), steps
    corners = [plane[y::down, x::right] for plane in padded for y in range(down) for x in range(right)]
    winner, best = corners[0], np.zeros(corners[0].shape, np.int8)
    for corner in corners:
        # of equally frequent numbers, not the background
        votes = 2 * sum((other == corner).astype(np.int8) for other in corners) + (corner != 0)
        winner, best = np.where(votes > best, corner, winner), np.maximum(votes, best)
    return np.asarray(winner)

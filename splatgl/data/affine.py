"""Units, spacing and direction of affine grids, from coordinates of axes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from splatgl.data.times import plain_unit
from splatgl.data.volume import AxisCoordinate, Triple, Volume, triple
from splatgl.errors import expected
from splatgl.fileio import WHOLE_BYTES, budget, byte_count, held_within_budget

# deviation from even steps, in steps, that is not resampled: coordinates are often written with few digits
_NEARLY_EVEN = 0.01
# most voxels of a resampled grid: so many per sample, or the absolute number, within the share of the memory budget
# of so many bytes per voxel
_MOST_FINER, _FREE_VOXELS, _VOXEL_BYTES = 8, 2**25, 32
# most planes along an axis
_MOST_PLANES = 2**31
# samples of uneven axes whose resampled values are compared with them
_MOST_COMPARED = 2**22

# kinds of axes by their names, lower case
_NAMES = {
    "x": ("x", "lon", "longitude", "rlon", "easting", "column", "col", "west_east", "nav_lon"),
    "y": ("y", "lat", "latitude", "rlat", "northing", "row", "south_north", "nav_lat"),
    "z": (
        *("z", "lev", "level", "plev", "pressure", "pressure_level", "isobaric", "isobaricinhpa", "model_level"),
        *("depth", "deptht", "depthu", "depthv", "depthw", "height", "altitude", "alt", "elevation", "bottom_top"),
        *("hybrid", "s_rho", "s_w", "plane", "slice"),
    ),
    "time": ("t", "time", "times", "time_counter", "valid_time", "forecast_time", "frame", "frames"),
    "c": ("c", "channel", "channels"),
}

# kinds by CF's standard names; those that end in "coordinate" are vertical
_STANDARD = {
    **dict.fromkeys(("longitude", "grid_longitude", "projection_x_coordinate"), "x"),
    **dict.fromkeys(("latitude", "grid_latitude", "projection_y_coordinate"), "y"),
    **dict.fromkeys(("air_pressure", "sea_water_pressure", "depth", "altitude", "height", "model_level_number"), "z"),
    "time": "time",
}

_PRESSURES = ("pa", "hpa", "kpa", "mbar", "millibar", "millibars", "mb", "bar", "dbar", "decibar")
_DEGREES = "°"


@dataclass(frozen=True)
class Coordinate:
    """An axis: name; number of samples; their coordinates [N] or None; unit; whether it points down."""

    name: str
    size: int
    places: np.ndarray | None = None
    unit: str = ""
    is_down: bool = False

    @classmethod
    def of(cls, name: str, places: np.ndarray, attributes: Mapping[str, Any]) -> Coordinate:
        """The axis by its attributes units, positive and standard_name."""
        unit = unit_name(str(attributes.get("units") or attributes.get("unit") or ""))
        unit = _DEGREES if unit.lower().startswith("degree") or unit.lower() in ("deg", _DEGREES) else unit
        positive, standard = (str(attributes.get(key) or "").strip().lower() for key in ("positive", "standard_name"))
        is_down = positive == "down"
        if positive not in ("up", "down") and axis_kind(name, attributes) == "z":
            heights = ("atmosphere_sigma", "atmosphere_hybrid_sigma")
            down = standard == "depth" or "pressure" in standard or standard.startswith(heights)
            short = name.lower()
            is_down = down or unit.lower() in _PRESSURES or (short.startswith("depth") and unit in ("m", "km"))
        if unit == _DEGREES and places.ndim == 1 and not _is_monotonic(places):
            # across 360°
            places = np.unwrap(places, period=360)
        return cls(name, len(places), places, unit, is_down)


@dataclass(frozen=True)
class CoordinateGrid:
    """matrix: world-from-index [3, 3]; origin (x, y, z); unit of length. between: fractional sample indices of the
    resampled planes along z, y, x, or None; at: fractional plane indices of the samples. notes: on resampled axes, in
    one line, and on scaled ones. axes: as of a volume.
    """

    matrix: np.ndarray
    origin: list[float]
    unit: str
    between: tuple[np.ndarray | None, ...]
    at: tuple[np.ndarray | None, ...]
    notes: tuple[str, ...]
    axes: tuple[AxisCoordinate, ...] = ()

    def resampled(self, samples: Any) -> Any:
        """The samples [z, y, x, …] at the planes; read in parts if they take more than WHOLE_BYTES."""
        if all(places is None for places in self.between):
            return samples
        resampled = Resampled(samples, [*self.between, *[None] * (len(samples.shape) - 3)])
        size = byte_count(resampled.shape, resampled.dtype)
        return resampled if size > held_within_budget(WHOLE_BYTES) else resampled[()]

    def volume(self, samples: Any, what: str, **more: Any) -> Volume:
        """The volume of samples [z, y, x] on this grid. what: the grid's name in messages; more: fields of `Volume`."""
        # an impossible grid is refused before its planes are made
        spacing_and_direction(self.matrix, what)
        resampled, notes = self.resampled(samples), list(self.notes)
        if resampled is not samples:
            notes[0] += f"; {self._describe_error(samples, resampled)}"
        notes += more.pop("notes", ())
        return volume_on_grid(
            resampled, self.matrix, self.origin, what, notes=tuple(notes), unit=self.unit, axes=self.axes, **more
        )

    def _describe_error(self, samples: Any, resampled: Any) -> str:
        """The error of resampled values, linear between planes, at the samples' own places; of large ones in a box
        around the middle.
        """
        # 1. the whole of uneven axes, as much of the others as fits
        sizes, most = list(samples.shape), _MOST_COMPARED
        for axis in sorted(range(3), key=lambda axis: self.at[axis] is None):
            sizes[axis] = min(sizes[axis], max(most, 1))
            most //= sizes[axis]
        low = [(count - size) // 2 for count, size in zip(samples.shape, sizes, strict=True)]
        stored = np.asarray(samples[tuple(slice(a, a + size) for a, size in zip(low, sizes, strict=True))], np.float64)
        # 2. the values between the planes around them
        places = [
            np.arange(a, a + size, dtype=float) if at is None else at[a : a + size]
            for a, size, at in zip(low, sizes, self.at, strict=True)
        ]
        back = interpolate_grid(resampled, places, np.float64)
        return describe_error(back, stored, "" if stored.size == math.prod(samples.shape) else " in its middle")


def describe_error(resampled: np.ndarray, stored: np.ndarray, where: str = "") -> str:
    """RMSE of resampled values at a grid's own points in per cent of the range of its values, as text."""
    finite = np.isfinite(resampled) & np.isfinite(stored)
    if not finite.any():
        return f"the error at its own points{where} is not known: none of them has a value"
    span = float(np.ptp(stored[finite]))
    rmse = float(np.sqrt(np.mean((resampled[finite] - stored[finite]) ** 2))) / span if span else 0.0
    # less is rounding
    return f"RMSE at its own points{where} {100 * rmse * (rmse > 1e-6):.2g} % of the range"


def volume_on_grid(samples: Any, matrix: np.ndarray, origin: Any, what: str, **more: Any) -> Volume:
    """The volume of samples on the grid of a world-from-index matrix [3, 3] and an origin; see
    `CoordinateGrid.volume`.
    """
    spacing, direction = spacing_and_direction(matrix, what)
    return Volume(samples, spacing, triple(origin, what), direction, **more)


def axis_kind(name: str, attributes: Mapping[str, Any]) -> str:
    """The kind of an axis: x, y, z, time, c or "", by CF's attributes, else by its name."""
    axis, units = str(attributes.get("axis") or "").strip().lower(), str(attributes.get("units") or "").strip().lower()
    standard = str(attributes.get("standard_name") or "").strip().lower()
    if axis in ("x", "y", "z", "t"):
        return "time" if axis == "t" else axis
    if standard in _STANDARD:
        return _STANDARD[standard]
    if standard.endswith("_coordinate") or attributes.get("positive") or units in _PRESSURES:
        return "z"
    if " since " in units:
        return "time"
    if units.startswith(("degree_n", "degrees_n", "degreen", "degreesn")):
        return "y"
    if units.startswith(("degree_e", "degrees_e", "degreee", "degreese")):
        return "x"
    return next((kind for kind, names in _NAMES.items() if name.lower() in names), "")


def make_lattice(axes: Sequence[Coordinate], of: str = "", even: bool = False) -> CoordinateGrid:
    """The grid of axes z, y, x: axes that point down run down, uneven coordinates are resampled at their least step,
    as far as memory permits, and axes of different units are scaled. of: name of the samples. even: assume even
    coordinates of step 1.

    Raises InputError for coordinates that neither rise nor fall throughout.
    """
    notes: list[str] = []
    starts, steps = list[float](), list[float]()
    between, at = list[np.ndarray | None](), list[np.ndarray | None]()
    every = [np.arange(axis.size) if axis.places is None else np.asarray(axis.places, np.float64) for axis in axes]
    counts = _plane_counts(every)
    for axis, places, count in zip(axes, every, counts, strict=True):
        what = f"{axis.name} of {of}" if of else f"coordinate {axis.name}"
        start, step, planes, note = _regular_steps(places, what, axis, 0 if even else count)
        sign = -1.0 if axis.is_down else 1.0
        starts.append(sign * start)
        steps.append(sign * step)
        between.append(planes)
        at.append(None if planes is None else np.abs(places - places[0]) / abs(step))
        notes += [note] * bool(note)
    notes = ["; ".join(notes)] * bool(notes)
    factors, unit = [1.0] * 3, ""
    if not even:
        counts = [axis.size if planes is None else len(planes) for axis, planes in zip(axes, between, strict=True)]
        factors, unit, scaled = _unit_factors(axes, (np.abs(steps) * counts).tolist())
        notes += scaled
    scaled_steps = [step * factor for step, factor in zip(steps, factors, strict=True)]
    known = [abs(step) for step in scaled_steps if np.isfinite(step)] or [1.0]
    scaled_steps = [step if np.isfinite(step) else min(known) for step in scaled_steps]
    origin = [0.0] * 3 if even else [start * factor for start, factor in zip(starts, factors, strict=True)]
    matrix, named = np.diag(scaled_steps[::-1]), list[AxisCoordinate]()
    if not even and any(axis.places is not None for axis in axes):
        slopes = ((-1.0 if axis.is_down else 1.0) / factor for axis, factor in zip(axes, factors, strict=True))
        short = (axis.name.rsplit("/", 1)[-1] for axis in axes)
        named = [AxisCoordinate(name, axis.unit, slope) for name, axis, slope in zip(short, axes, slopes, strict=True)]
    return CoordinateGrid(matrix, origin[::-1], unit, tuple(between), tuple(at), tuple(notes), tuple(named[::-1]))


def _plane_counts(every: Sequence[np.ndarray]) -> list[int]:
    """The number of planes along each axis of coordinates [N]: of uneven ones at their least step, fewer if these are
    too many for memory.
    """
    own = [len(places) for places in every]
    counts = list(own)
    for axis, places in enumerate(every):
        if _is_monotonic(places) and not _is_even(places):
            least = float(np.abs(np.diff(places)).min())
            # hundredths of a step are rounding
            counts[axis] = math.ceil(min(abs(float(places[-1] - places[0])) / least - 0.01, _MOST_PLANES)) + 1
    most = min(max(_MOST_FINER * math.prod(own), _FREE_VOXELS), budget() // _VOXEL_BYTES)
    # the largest number of planes per sample that fits, by bisection
    low, high = 1.0, max(count / size for count, size in zip(counts, own, strict=True))

    def limit(finer: float) -> list[int]:
        return [max(min(count, int(finer * size)), size) for count, size in zip(counts, own, strict=True)]

    if math.prod(counts) > most:
        for _ in range(48):
            middle = (low + high) / 2
            low, high = (middle, high) if math.prod(limit(middle)) <= most else (low, middle)
        return limit(low)
    return counts


def _regular_steps(
    places: np.ndarray, what: str, axis: Coordinate, count: int
) -> tuple[float, float, np.ndarray | None, str]:
    """First coordinate, step, fractional indices of `count` planes of uneven coordinates or None, and a note.
    count: 0 assumes even coordinates of step 1.
    """
    if not count and not (np.isfinite(places).all() and _is_monotonic(places)):
        return 0.0, 1.0, None, ""
    if not places.size or not np.isfinite(places).all():
        raise expected(what, "finite coordinates", "NaN or infinity" if places.size else "none")
    if len(places) == 1:
        return float(places[0]), float("nan") if count else 1.0, None, ""
    apart = np.diff(places)
    if not _is_monotonic(places):
        got = f"steps from {apart.min():.6g} to {apart.max():.6g}"
        raise expected(what, "coordinates that rise or fall throughout", got, "give spacing=(x, y, z)")
    span = float(places[-1] - places[0])
    sizes = f"{np.abs(apart).min():.4g} to {np.abs(apart).max():.4g} {axis.unit}".strip()
    if not count:
        note = "" if _is_even(places) else f"{axis.name}: steps of {sizes} are rendered as uniform"
        return 0.0, float(np.sign(span)), None, note
    if _is_even(places):
        return float(places[0]), span / (len(places) - 1), None, ""
    planes = np.interp(np.linspace(0, abs(span), count), np.abs(places - places[0]), np.arange(len(places)))
    step = span / (count - 1)
    note = f"{axis.name}: {len(places)} samples in steps of {sizes}, resampled every {abs(step):.4g} {axis.unit}"
    return float(places[0]), step, planes, note.strip()


def _unit_factors(axes: Sequence[Coordinate], extents: Sequence[float]) -> tuple[list[float], str, list[str]]:
    """World lengths per unit along z, y, x, the world's unit, and notes. Lengths are converted to the unit of x; where
    units differ, y is drawn as long as x, and z half as high.
    """
    units = [axis.unit if axis.places is not None else "samples" for axis in axes]
    if all(axis.places is None for axis in axes):
        units = [""] * 3
    if not any(unit == _DEGREES or unit.lower() in _PRESSURES for unit in units):
        # an unknown unit is taken for that of the other axes
        first = next((unit for unit in reversed(units) if unit and unit != "samples"), "")
        units = [unit or first for unit in units]
    kinds = ["length" if unit in METRES else unit for unit in units]
    # relative to x: equal units are not scaled, to the last digit
    scales = [METRES.get(unit, 1.0) / METRES.get(units[2], 1.0) for unit in units]
    drawn = {kinds[2]: 1.0}
    reach = [extents[2]]
    notes = []
    for n, share in ((1, 1.0), (0, 0.5)):
        if kinds[n] not in drawn:
            size = extents[n] * scales[n]
            drawn[kinds[n]] = share * max(reach) / size if size > 0 and np.isfinite(size * max(reach)) else 1.0
            unit_z, other = (
                f"{unit or 'unit'} of {axis.name}" for unit, axis in ((units[n], axes[n]), (units[2], axes[2]))
            )
            factor = drawn[kinds[n]] * scales[n]
            notes.append(
                f"1 {unit_z} is rendered as {factor:.4g} {other}, chosen for the picture; --spacing changes it"
            )
        reach.append(extents[n] * scales[n] * drawn[kinds[n]])
    factors = [drawn[kind] * scale for kind, scale in zip(kinds, scales, strict=True)]
    is_known = all(axis.unit in METRES for axis in axes)
    return factors, axes[2].unit if is_known else "", notes


def _is_monotonic(places: np.ndarray) -> bool:
    apart = np.diff(places)
    return bool((apart > 0).all() or (apart < 0).all())


def _is_even(places: np.ndarray) -> bool:
    """Whether coordinates are nearly those of even steps between the same ends, or as near as float32 permits."""
    even, step = np.linspace(places[0], places[-1], len(places)), (places[-1] - places[0]) / max(len(places) - 1, 1)
    return bool(np.abs(places - even).max() <= max(_NEARLY_EVEN * abs(step), 1e-6 * float(np.abs(places).max())))


def interpolate_planes(planes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Planes [D, …] at fractional indices: linear, the nearer value beside NaN; an index of NaN gives NaN, float32."""
    empty = np.isnan(places)
    result = np.zeros((len(places), *planes.shape[1:]), np.float32 if empty.any() else planes.dtype)
    for n, place in enumerate(np.where(empty, 0.0, places)):
        first, share = int(place), place % 1
        near, far = planes[first], planes[min(first + 1, len(planes) - 1)]
        mixed = near + share * (far.astype(np.float64) - near) if share else near
        mixed = np.where(np.isfinite(mixed), mixed, near if share < 0.5 else far) if planes.dtype.kind == "f" else mixed
        result[n] = mixed if result.dtype.kind == "f" else np.rint(mixed)
    if empty.any():
        result[empty] = np.nan
    return result


def interpolate_grid(samples: Any, places: Sequence[np.ndarray], dtype: Any = None) -> np.ndarray:
    """Samples at all combinations of fractional indices along each axis, see `interpolate_planes`; only the box around
    them is read. dtype: of the samples before, None: their own.
    """
    first = [int(at.min()) if len(at) else 0 for at in places]
    ends = (int(np.ceil(at.max())) + 1 if len(at) else 0 for at in places)
    block = np.asarray(samples[tuple(map(slice, first, ends))], dtype)
    for axis, (at, low) in enumerate(zip(places, first, strict=True)):
        if len(at) != block.shape[axis] or (at - low != np.arange(len(at))).any():
            block = np.moveaxis(interpolate_planes(np.moveaxis(block, axis, 0), at - low), 0, axis)
    return block


class Resampled:
    """Samples [z, y, x] at other planes, computed when they are read: linear; whole numbers take the nearest plane."""

    def __init__(self, samples: Any, between: Sequence[np.ndarray | None]) -> None:
        self.samples, self.dtype = samples, np.dtype(samples.dtype)
        rounds = self.dtype.kind in "bui"
        sizes = zip(between, samples.shape, strict=True)
        self.places = [
            np.arange(float(n)) if indices is None else np.rint(indices) if rounds else indices for indices, n in sizes
        ]
        self.shape = tuple(map(len, self.places))

    def __getitem__(self, key: Any) -> np.ndarray:
        keys = key if isinstance(key, tuple) else (key,)
        keys = keys[: keys.index(Ellipsis)] if Ellipsis in keys else keys
        wanted = [places[entry] for places, entry in zip(self.places, keys, strict=False)] + self.places[len(keys) :]
        block = interpolate_grid(self.samples, [np.atleast_1d(places) for places in wanted])
        return block[tuple(0 if np.ndim(places) == 0 else slice(None) for places in wanted)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All samples."""
        return np.asarray(self[()], dtype)


# metres per unit of length, by the short name used in `Volume.unit`
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "in": 0.0254, "Å": 1e-10}

_SPELLINGS = {
    "nm": ("nanometer", "nanometre"),
    "um": ("µm", "micron", "micrometer", "micrometre"),
    "mm": ("millimeter", "millimetre"),
    "cm": ("centimeter", "centimetre"),
    "m": ("meter", "metre"),
    "km": ("kilometer", "kilometre"),
    "in": ("inch", "inches"),
    "Å": ("angstrom", "ångström", "ångstrom", "Å"),
    "": ("unknown", "none", "pixel", "voxel", "?", "???"),
}


_SHORT = {
    plain_unit(spelling + plural): short
    for short, spellings in _SPELLINGS.items()
    for spelling in spellings
    for plural in ("", "s")
}


# units of pure numbers, and of unknown ones
NO_UNITS = ("1", "none", "unknown", "dimensionless", "unitless", "n/a", "us")


def unit_name(text: str) -> str:
    """The short name of a unit of length ("millimeter" → "mm"), "" for none; other names are returned as they are."""
    return _SHORT.get(plain_unit(text), text.strip())


def metres_in(unit: str) -> float | None:
    """Metres in a unit of length of any spelling; None for other units."""
    return METRES.get(unit_name(unit))


class World(NamedTuple):
    """Frame (LPS, RAS or None) and unit of length of coordinates; None and "" where none is stated."""

    frame: str | None = None
    unit: str = ""

    @classmethod
    def shared(cls, worlds: Iterable[World]) -> World:
        """The first frame and the first unit of length that one of several worlds states."""
        listed = list(worlds)
        frames, units = (world.frame for world in listed), (world.unit for world in listed if world.unit in METRES)
        return cls(next(filter(None, frames), None), next(units, ""))

    def change(self, frame: str | None, unit: str) -> Change | None:
        """The change of coordinates to a frame and unit, of which one that is unknown on either side stays; None if
        nothing changes.
        """
        short = unit_name(unit)
        other = short if self.unit in METRES and short in METRES else self.unit
        is_turned = {self.frame, frame} == {"LPS", "RAS"}
        if not is_turned and other == self.unit:
            return None
        length = METRES[self.unit] / METRES[other] if other != self.unit else 1.0
        turn = np.array([-1.0, -1.0, 1.0]) if is_turned else np.ones(3)
        return Change(World(frame if is_turned else self.frame, other), turn, length)

    def factors(self, other: World) -> np.ndarray:
        """Factors [3] of coordinates (x, y, z), which make them those of another world."""
        change = self.change(*other)
        return np.ones(3) if change is None else change.factors


@dataclass(frozen=True, eq=False)
class Change:
    """A change of coordinates. world: of the results; turn [3]: −1 for axes that change their direction, else 1;
    length: factor of lengths.
    """

    world: World
    turn: np.ndarray
    length: float

    @property
    def factors(self) -> np.ndarray:
        """Factors [3] of coordinates (x, y, z)."""
        return self.turn * self.length


def curved_notes(coordinates: Mapping[str, Mapping[str, Any]], is_placed: bool) -> tuple[str, ...]:
    """A note on coordinates of curved grids, along two axes at once, which are not used. coordinates: attributes by
    name; is_placed: whether x and y have coordinates of their own.
    """
    curved = [name for name, about in coordinates.items() if axis_kind(name, about) in ("x", "y")]
    note = f"x and y are numbers of samples: coordinates in two dimensions ({', '.join(curved[:4])}) are not used"
    return () if is_placed or not curved else (note,)


def shared_unit(units: Sequence[str]) -> tuple[str, np.ndarray]:
    """The unit of the first axis, and what each axis' unit is in it; an unknown unit is that of the others. "" and ones
    for units that differ and are not all lengths.
    """
    first = next((unit for unit in units if unit), "")
    filled = [unit or first for unit in units]
    if all(unit in METRES for unit in filled):
        return filled[0], np.array([METRES[unit] / METRES[filled[0]] for unit in filled])
    return first if len(set(filled)) == 1 else "", np.ones(len(filled))


def value_unit_name(unit: object) -> str:
    """The unit of values that a file states: a short text; "" for none and for pure numbers."""
    text = str(unit or "").strip()
    return text if 0 < len(text) <= 24 and text.lower() not in NO_UNITS and text.isprintable() else ""


def spacing_and_direction(matrix: np.ndarray, what: str) -> tuple[Triple, np.ndarray]:
    """Spacing and direction [3, 3] of world-from-index [3, 3], whose columns are the steps along x, y, z."""
    spacing = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(spacing).all() or spacing.min() <= 0:
        raise expected(what, "a finite step along each axis", matrix.tolist())
    return triple(spacing, what), matrix / spacing

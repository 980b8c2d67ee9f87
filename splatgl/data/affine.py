"""Units, spacing and direction of affine grids, from coordinates of axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.volume import Triple, Volume, triple
from splatgl.errors import expected
from splatgl.fileio import WHOLE_BYTES, byte_count

# deviation from even steps, in steps: coordinates are often written with few digits
_MOST_UNEVEN = 1e-3
# the same of axes that can be resampled: smaller deviations are not worth it
_NEARLY_EVEN = 0.01
# most resampled planes per plane of an uneven axis: ocean levels are from 1 m to 200 m apart
_MOST_PLANES = 8

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
        return cls(name, len(places), places, unit, is_down)


@dataclass(frozen=True)
class Lattice:
    """matrix: world-from-index [3, 3]; origin (x, y, z); unit of length. between: fractional sample indices of the
    resampled planes along z, y, x, or None. notes: on resampled axes and on scaled ones.
    """

    matrix: np.ndarray
    origin: list[float]
    unit: str
    between: tuple[np.ndarray | None, ...]
    notes: tuple[str, ...]

    def resampled(self, samples: Any) -> Any:
        """The samples [z, y, x] at the planes; read in parts if they take more than WHOLE_BYTES."""
        if all(places is None for places in self.between):
            return samples
        resampled = Resampled(samples, self.between)
        return resampled if byte_count(resampled.shape, resampled.dtype) > WHOLE_BYTES else resampled[()]

    def volume(self, samples: Any, what: str, **more: Any) -> Volume:
        """The volume of samples [z, y, x] on this grid. what: the grid's name in messages; more: fields of `Volume`."""
        notes, unit = self.notes, self.unit
        return volume_on_grid(self.resampled(samples), self.matrix, self.origin, what, notes=notes, unit=unit, **more)


def volume_on_grid(samples: Any, matrix: np.ndarray, origin: Any, what: str, **more: Any) -> Volume:
    """The volume of samples on the grid of a world-from-index matrix [3, 3] and an origin; see `Lattice.volume`."""
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


def even_steps(places: np.ndarray, what: str, fix: str) -> tuple[float, float]:
    """(first coordinate, step) of samples at `places` [N]; the step is NaN for one sample, negative for falling ones.

    Raises InputError, which ends with `fix`, for steps that differ by more than _MOST_UNEVEN, or float32 rounding.
    """
    coordinates = _check_finite(places, what)
    if coordinates.size == 1:
        return float(coordinates[0]), float("nan")
    step = (coordinates[-1] - coordinates[0]) / (coordinates.size - 1)
    if step == 0 or _unevenness(coordinates) > max(_MOST_UNEVEN * abs(step), 1e-6 * np.abs(coordinates).max()):
        steps = np.diff(coordinates)
        raise expected(what, "even steps", f"steps from {steps.min():.6g} to {steps.max():.6g}", fix)
    return float(coordinates[0]), float(step)


def make_lattice(axes: Sequence[Coordinate], of: str = "", even: bool = False) -> Lattice:
    """The grid of axes z, y, x: axes that point down run down, uneven coordinates are resampled at their least step,
    and axes of different units are scaled. of: name of the samples. even: assume even coordinates of step 1.

    Raises InputError for coordinates that neither rise nor fall throughout.
    """
    notes: list[str] = []
    starts, steps, between = [], [], list[np.ndarray | None]()
    for axis in axes:
        what = f"{axis.name} of {of}" if of else f"coordinate {axis.name}"
        places = np.arange(axis.size) if axis.places is None else np.asarray(axis.places, np.float64)
        start, step, planes, note = _regular_steps(places, what, axis, even)
        sign = -1.0 if axis.is_down else 1.0
        starts.append(sign * start)
        steps.append(sign * step)
        between.append(planes)
        notes += [note] * bool(note)
    factors, unit = [1.0] * 3, ""
    if not even:
        counts = [axis.size if planes is None else len(planes) for axis, planes in zip(axes, between, strict=True)]
        factors, unit, scaled = _unit_factors(
            axes, [abs(step) * count for step, count in zip(steps, counts, strict=True)]
        )
        notes += scaled
    scaled_steps = [step * factor for step, factor in zip(steps, factors, strict=True)]
    known = [abs(step) for step in scaled_steps if np.isfinite(step)] or [1.0]
    scaled_steps = [step if np.isfinite(step) else min(known) for step in scaled_steps]
    origin = [0.0] * 3 if even else [start * factor for start, factor in zip(starts, factors, strict=True)]
    return Lattice(np.diag(scaled_steps[::-1]), origin[::-1], unit, tuple(between), tuple(notes))


def _regular_steps(
    places: np.ndarray, what: str, axis: Coordinate, even: bool
) -> tuple[float, float, np.ndarray | None, str]:
    """First coordinate, step, fractional indices of resampled planes of uneven coordinates or None, and a note."""
    if even and not (np.isfinite(places).all() and _is_monotonic(places)):
        return 0.0, 1.0, None, ""
    places = _check_finite(places, what)
    if len(places) == 1:
        return float(places[0]), 1.0 if even else float("nan"), None, ""
    apart = np.diff(places)
    if not _is_monotonic(places):
        got = f"steps from {apart.min():.6g} to {apart.max():.6g}"
        raise expected(what, "coordinates that rise or fall throughout", got, "give spacing=(x, y, z)")
    step = float((places[-1] - places[0]) / (len(places) - 1))
    is_even = _unevenness(places) <= max(_NEARLY_EVEN * abs(step), 1e-6 * float(np.abs(places).max()))
    sizes = f"{np.abs(apart).min():.4g} to {np.abs(apart).max():.4g} {axis.unit}".strip()
    if even:
        return 0.0, float(np.sign(step)), None, "" if is_even else f"{axis.name}: steps of {sizes} are drawn as even"
    if is_even:
        return float(places[0]), step, None, ""
    span = float(places[-1] - places[0])
    count = min(round(abs(span) / float(np.abs(apart).min())) + 1, _MOST_PLANES * len(places))
    distances = np.linspace(0, abs(span), count)
    planes = np.interp(distances, np.abs(places - places[0]), np.arange(len(places)))
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
    scales = [METRES.get(unit, 1.0) for unit in units]
    drawn = {kinds[2]: 1.0 / scales[2]}
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
            notes.append(f"1 {unit_z} is drawn as {factor:.4g} {other}, chosen for the picture: --spacing sets another")
        reach.append(extents[n] * scales[n] * drawn[kinds[n]])
    factors = [drawn[kind] * scale for kind, scale in zip(kinds, scales, strict=True)]
    is_known = all(axis.unit in METRES for axis in axes)
    return factors, axes[2].unit if is_known else "", notes


def _check_finite(places: np.ndarray, what: str) -> np.ndarray:
    coordinates = np.asarray(places, np.float64).ravel()
    if not coordinates.size or not np.isfinite(coordinates).all():
        raise expected(what, "finite coordinates", "none" if not coordinates.size else "NaN or infinity")
    return coordinates


def _is_monotonic(places: np.ndarray) -> bool:
    apart = np.diff(places)
    return bool((apart > 0).all() or (apart < 0).all())


def _unevenness(places: np.ndarray) -> float:
    """Largest distance of coordinates from even ones between the same ends."""
    return float(np.abs(places - np.linspace(places[0], places[-1], len(places))).max())


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


class Resampled:
    """Samples [z, y, x] at other planes, computed when they are read: linear; whole numbers take the nearest plane."""

    def __init__(self, samples: Any, between: Sequence[np.ndarray | None]) -> None:
        self.samples, self.dtype = samples, np.dtype(samples.dtype)
        whole = self.dtype.kind in "bui"
        sizes = zip(between, samples.shape, strict=True)
        self.places = [
            np.arange(float(n)) if indices is None else np.rint(indices) if whole else indices for indices, n in sizes
        ]
        self.shape = tuple(map(len, self.places))

    def __getitem__(self, key: Any) -> np.ndarray:
        keys = key if isinstance(key, tuple) else (key,)
        keys = keys[: keys.index(Ellipsis)] if Ellipsis in keys else keys
        wanted = [places[entry] for places, entry in zip(self.places, keys, strict=False)] + self.places[len(keys) :]
        box, within = [], []
        for places in map(np.atleast_1d, wanted):
            low = int(places.min()) if len(places) else 0
            box.append(slice(low, int(np.ceil(places.max())) + 1 if len(places) else 0))
            within.append(places - low)
        block = np.asarray(self.samples[tuple(box)])
        for axis, places in enumerate(within):
            if len(places) != block.shape[axis] or (places != np.arange(len(places))).any():
                block = np.moveaxis(interpolate_planes(np.moveaxis(block, axis, 0), places), 0, axis)
        return block[tuple(0 if np.ndim(places) == 0 else slice(None) for places in wanted)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All samples."""
        return np.asarray(self[()], dtype)


# metres per unit of length, by the short name used in `Volume.unit`
METRES = {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3, "in": 0.0254, "Å": 1e-10}

_SPELLINGS = {
    "nm": ("nanometer", "nanometre"),
    "um": ("µm", "μm", "micron", "microns", "micrometer", "micrometre", r"\u00b5m"),
    "mm": ("millimeter", "millimetre"),
    "cm": ("centimeter", "centimetre"),
    "m": ("meter", "metre"),
    "km": ("kilometer", "kilometre"),
    "in": ("inch",),
    "Å": ("angstrom", "ångström"),
    "": ("unknown", "none", "pixel", "pixels", "voxel", "?", "???"),
}
_SHORT = {spelling: short for short, spellings in _SPELLINGS.items() for spelling in spellings}


# units of pure numbers, and of unknown ones
NO_UNITS = ("1", "none", "unknown", "dimensionless", "unitless", "n/a", "us")


def unit_name(text: str) -> str:
    """The short name of a unit of length ("millimeter" → "mm"), "" for none; other names are returned as they are."""
    text = text.strip()
    return _SHORT.get(text.lower(), text)


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

"""Units, spacing and direction of affine grids, from coordinates of axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from splatgl.data.volume import Triple, triple
from splatgl.errors import expected
from splatgl.fileio import WHOLE_BYTES, byte_count

# deviation from even steps, in steps: coordinates are often written with few digits
_MOST_UNEVEN = 1e-3
# the same of axes that can be resampled: what is less is not worth it
_NEARLY_EVEN = 0.01
# most planes that stand for one of an uneven axis: levels of the ocean are from 1 m to 200 m apart
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
    """An axis: name; number of samples; their places [N], None where none are told; unit; whether it points down."""

    name: str
    size: int
    places: np.ndarray | None = None
    unit: str = ""
    is_down: bool = False

    @classmethod
    def of(cls, name: str, places: np.ndarray, told: Mapping[str, Any]) -> Coordinate:
        """As attributes tell it. told: units, positive, standard_name."""
        unit = unit_name(str(told.get("units") or told.get("unit") or ""))
        unit = _DEGREES if unit.lower().startswith("degree") or unit.lower() in ("deg", _DEGREES) else unit
        positive, standard = (str(told.get(key) or "").strip().lower() for key in ("positive", "standard_name"))
        is_down = positive == "down"
        if positive not in ("up", "down") and axis_kind(name, told) == "z":
            heights = ("atmosphere_sigma", "atmosphere_hybrid_sigma")
            down = standard == "depth" or "pressure" in standard or standard.startswith(heights)
            short = name.lower()
            is_down = down or unit.lower() in _PRESSURES or (short.startswith("depth") and unit in ("m", "km"))
        return cls(name, len(places), places, unit, is_down)


@dataclass(frozen=True)
class Lattice:
    """matrix: world-from-index [3, 3]; origin (x, y, z); unit of length. between: of z, y, x, the places of the planes
    among the samples, None for as they are. notes: what is resampled, and what is drawn in an aspect.
    """

    matrix: np.ndarray
    origin: list[float]
    unit: str
    between: tuple[np.ndarray | None, ...]
    notes: tuple[str, ...]

    def resampled(self, samples: Any) -> Any:
        """The samples [z, y, x] at the planes; read in parts where they are many."""
        if all(places is None for places in self.between):
            return samples
        found = Resampled(samples, self.between)
        return found if byte_count(found.shape, found.dtype) > WHOLE_BYTES else found[()]


def axis_kind(name: str, told: Mapping[str, Any]) -> str:
    """What an axis is: x, y, z, time, c or "", by CF's attributes, else by its name."""
    axis, units = str(told.get("axis") or "").strip().lower(), str(told.get("units") or "").strip().lower()
    standard = str(told.get("standard_name") or "").strip().lower()
    if axis in ("x", "y", "z", "t"):
        return "time" if axis == "t" else axis
    if standard in _STANDARD:
        return _STANDARD[standard]
    if standard.endswith("_coordinate") or told.get("positive") or units in _PRESSURES:
        return "z"
    if " since " in units:
        return "time"
    if units.startswith(("degree_n", "degrees_n", "degreen", "degreesn")):
        return "y"
    if units.startswith(("degree_e", "degrees_e", "degreee", "degreese")):
        return "x"
    return next((kind for kind, names in _NAMES.items() if name.lower() in names), "")


def even_steps(places: np.ndarray, what: str, fix: str) -> tuple[float, float]:
    """(first place, step) of samples at `places` [N]; the step of one sample is NaN, that of falling ones negative.

    Raises InputError, which ends with `fix`, unless each lies within _MOST_UNEVEN steps, or a rounding of float32, of
    its even place.
    """
    found = _check_finite(places, what)
    if found.size == 1:
        return float(found[0]), float("nan")
    step = (found[-1] - found[0]) / (found.size - 1)
    if step == 0 or _unevenness(found) > max(_MOST_UNEVEN * abs(step), 1e-6 * np.abs(found).max()):
        steps = np.diff(found)
        raise expected(what, "even steps", f"steps from {steps.min():.6g} to {steps.max():.6g}", fix)
    return float(found[0]), float(step)


def make_lattice(axes: Sequence[Coordinate], of: str = "", even: bool = False) -> Lattice:
    """The grid of axes z, y, x: what points down runs down, uneven places are resampled at their least step, and axes
    whose units are unlike get an aspect. of: the name of the samples. even: places are taken for even, of step 1.

    Raises InputError for places that neither rise nor fall throughout.
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
        factors, unit, told = _unit_factors(
            axes, [abs(step) * count for step, count in zip(steps, counts, strict=True)]
        )
        notes += told
    drawn = [step * factor for step, factor in zip(steps, factors, strict=True)]
    known = [abs(step) for step in drawn if np.isfinite(step)] or [1.0]
    drawn = [step if np.isfinite(step) else min(known) for step in drawn]
    origin = [0.0] * 3 if even else [start * factor for start, factor in zip(starts, factors, strict=True)]
    return Lattice(np.diag(drawn[::-1]), origin[::-1], unit, tuple(between), tuple(notes))


def _regular_steps(
    places: np.ndarray, what: str, axis: Coordinate, even: bool
) -> tuple[float, float, np.ndarray | None, str]:
    """First place, step, planes among the places where these are uneven, and what is told of it."""
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
    drawn = np.linspace(0, abs(span), count)
    planes = np.interp(drawn, np.abs(places - places[0]), np.arange(len(places)))
    step = span / (count - 1)
    note = f"{axis.name}: {len(places)} samples in steps of {sizes}, resampled every {abs(step):.4g} {axis.unit}"
    return float(places[0]), step, planes, note.strip()


def _unit_factors(axes: Sequence[Coordinate], extents: Sequence[float]) -> tuple[list[float], str, list[str]]:
    """World lengths per unit along z, y, x, the world's unit, and what is told: lengths are converted to that along x,
    and where units are unlike, y is drawn as long as x, and z half as high.
    """
    units = [axis.unit if axis.places is not None else "samples" for axis in axes]
    if all(axis.places is None for axis in axes):
        units = [""] * 3
    if not any(unit == _DEGREES or unit.lower() in _PRESSURES for unit in units):
        # what is not told is as the others are
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
            one, other = (
                f"{unit or 'unit'} of {axis.name}" for unit, axis in ((units[n], axes[n]), (units[2], axes[2]))
            )
            factor = drawn[kinds[n]] * scales[n]
            notes.append(f"1 {one} is drawn as {factor:.4g} {other}, chosen for the picture: --spacing sets another")
        reach.append(extents[n] * scales[n] * drawn[kinds[n]])
    factors = [drawn[kind] * scale for kind, scale in zip(kinds, scales, strict=True)]
    is_known = all(axis.unit in METRES for axis in axes)
    return factors, axes[2].unit if is_known else "", notes


def _check_finite(places: np.ndarray, what: str) -> np.ndarray:
    found = np.asarray(places, np.float64).ravel()
    if not found.size or not np.isfinite(found).all():
        raise expected(what, "finite coordinates", "none" if not found.size else "others")
    return found


def _is_monotonic(places: np.ndarray) -> bool:
    apart = np.diff(places)
    return bool((apart > 0).all() or (apart < 0).all())


def _unevenness(places: np.ndarray) -> float:
    """How far places are from even ones between the same ends."""
    return float(np.abs(places - np.linspace(places[0], places[-1], len(places))).max())


def interpolate_planes(planes: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Planes [D, …] at places among the given ones, linear between two; NaN where the place is, which makes float32.

    Beside a value that is not there, the nearer plane's.
    """
    empty = np.isnan(places)
    found = np.zeros((len(places), *planes.shape[1:]), np.float32 if empty.any() else planes.dtype)
    for n, place in enumerate(np.where(empty, 0.0, places)):
        first, share = int(place), place % 1
        near, far = planes[first], planes[min(first + 1, len(planes) - 1)]
        mixed = near + share * (far.astype(np.float64) - near) if share else near
        mixed = np.where(np.isfinite(mixed), mixed, near if share < 0.5 else far) if planes.dtype.kind == "f" else mixed
        found[n] = mixed if found.dtype.kind == "f" else np.rint(mixed)
    if empty.any():
        found[empty] = np.nan
    return found


class Resampled:
    """Samples [z, y, x] at other planes, computed where they are read: linear, of whole numbers the nearest."""

    def __init__(self, samples: Any, between: Sequence[np.ndarray | None]) -> None:
        self.samples, self.dtype = samples, np.dtype(samples.dtype)
        whole = self.dtype.kind in "bui"
        sizes = zip(between, samples.shape, strict=True)
        self.places = [np.arange(float(n)) if each is None else np.rint(each) if whole else each for each, n in sizes]
        self.shape = tuple(map(len, self.places))

    def __getitem__(self, key: Any) -> np.ndarray:
        given = key if isinstance(key, tuple) else (key,)
        given = given[: given.index(Ellipsis)] if Ellipsis in given else given
        asked = [places[each] for places, each in zip(self.places, given, strict=False)] + self.places[len(given) :]
        box, within = [], []
        for places in map(np.atleast_1d, asked):
            low = int(places.min()) if len(places) else 0
            box.append(slice(low, int(np.ceil(places.max())) + 1 if len(places) else 0))
            within.append(places - low)
        found = np.asarray(self.samples[tuple(box)])
        for axis, places in enumerate(within):
            if len(places) != found.shape[axis] or (places != np.arange(len(places))).any():
                found = np.moveaxis(interpolate_planes(np.moveaxis(found, axis, 0), places), 0, axis)
        return found[tuple(0 if np.ndim(each) == 0 else slice(None) for each in asked)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All of them."""
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


# of pure numbers, and of what is not known
NO_UNITS = ("1", "none", "unknown", "dimensionless", "unitless", "n/a", "us")


def unit_name(text: str) -> str:
    """The short name of a unit of length ("millimeter" → "mm"), "" for none; unknown names are kept."""
    text = text.strip()
    return _SHORT.get(text.lower(), text)


def value_unit_name(unit: object) -> str:
    """The unit of values that a file states, "" for none: a short text, and no pure number."""
    text = str(unit or "").strip()
    return text if 0 < len(text) <= 24 and text.lower() not in NO_UNITS and text.isprintable() else ""


def spacing_and_direction(matrix: np.ndarray, what: str) -> tuple[Triple, np.ndarray]:
    """Spacing and direction [3, 3] of world-from-index [3, 3], whose columns are the steps along x, y, z."""
    spacing = np.linalg.norm(matrix, axis=0)
    if not np.isfinite(spacing).all() or spacing.min() <= 0:
        raise expected(what, "a finite step along each axis", matrix.tolist())
    return triple(spacing, what), matrix / spacing

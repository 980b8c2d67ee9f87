"""Reconstruction kernels, their footprints, tables and polynomials.

A kernel h(x) = g(|x|) lives on the unit lattice; g, the footprint F(d) = ∫ g(√(d²+t²)) dt and the
partial integral P_d(t) = ∫₀ᵗ g(√(d²+u²)) du all have closed forms.  [M98 §2]

Just inside a knot a footprint behaves as a half-integer power of the distance to it, so each interval
between two knots is tabulated over √(knot − d), where it is smooth.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import import_module
from itertools import pairwise
from typing import Protocol

import numpy as np

from splatgl.coercion import public
from splatgl.errors import expected


class Kernel(Protocol):
    """A radial kernel of unit volume; lengths are in voxels, g = 0 for r ≥ radius."""

    @property
    def name(self) -> str:
        """Identifier of the kernel, as settings have it."""
        ...

    @property
    def radius(self) -> float:
        """Radius R in voxels; g is 0 beyond it."""
        ...

    @property
    def knots(self) -> tuple[float, ...]:
        """Radii at which g is not smooth, ascending; the last is the radius."""
        ...

    def value(self, r: np.ndarray) -> np.ndarray:
        """g(r), any shape."""
        ...

    def partial(self, d: np.ndarray, t: np.ndarray) -> np.ndarray:
        """P_d(t) = ∫₀ᵗ g(√(d²+u²)) du for |t| within the chord √(R²−d²); odd in t; 0 for d ≥ R."""
        ...

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """F(d), the integral of the kernel along a line at distance d ≥ 0; 0 for d ≥ R."""
        ...


@dataclass(frozen=True)
class Gaussian:
    """exp(−k r²) cut at `radius` [M98 §4.2: "truncated at 2.0"].

    k = 2, 1.38² and 1.38 all give the errors of its Fig. 9; of these 2 has the smallest step at the cut.
    """

    k: float = 2.0
    radius: float = 2.0
    name: str = "gaussian"

    @property
    def knots(self) -> tuple[float, ...]:
        """The radius alone: g is smooth up to the cut."""
        return (self.radius,)

    @cached_property
    def scale(self) -> float:
        """1 / volume of the unnormalised kernel."""
        k, r = self.k, self.radius
        volume = (np.pi / k) ** 1.5 * _erf(np.array(np.sqrt(k) * r)) - 2 * np.pi * r * np.exp(-k * r * r) / k
        return 1.0 / float(volume)

    def value(self, r: np.ndarray) -> np.ndarray:
        """g(r), any shape; 0 for r ≥ R."""
        r = np.asarray(r, dtype=np.float64)
        return np.where(r < self.radius, self.scale * np.exp(-self.k * r * r), 0.0)

    def partial(self, d: np.ndarray, t: np.ndarray) -> np.ndarray:
        """P_d(t) by the error function; t within the chord, 0 for d ≥ R."""
        d = np.asarray(d, dtype=np.float64)
        line = np.sqrt(np.pi / self.k) / 2 * np.exp(-self.k * d * d)
        return np.where(d < self.radius, self.scale * line * _erf(np.sqrt(self.k) * np.asarray(t)), 0.0)

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """F(d), d ≥ 0, any shape; 0 for d ≥ R."""
        d = np.minimum(d, self.radius)
        return 2 * self.partial(d, half_chord(self.radius, d))


@public
@dataclass(frozen=True)
class PiecewiseCubic:
    """g as cubics in r between knots: pieces[i] = (c0, c1, c2, c3) holds up to knots[i]."""

    name: str
    knots: tuple[float, ...]
    pieces: tuple[tuple[float, float, float, float], ...]

    @classmethod
    def of_family(cls, name: str, b: float = 1 / 3, c: float = 1 / 3) -> PiecewiseCubic:
        """The cubic of Mitchell and Netravali (1988) with parameters B and C, as a function of the radius: B-spline (1,
        0), Mitchell's (⅓, ⅓). Of members with B + 2C = 1 the volume before normalisation is 2πB/3: Catmull-Rom's (0, ½)
        is 0, which `register_kernel` refuses.
        """
        near = (6 - 2 * b, 0.0, -18 + 12 * b + 6 * c, 12 - 9 * b - 6 * c)
        far = (8 * b + 24 * c, -12 * b - 48 * c, 6 * b + 30 * c, -b - 6 * c)
        pieces = tuple((p / 6, q / 6, r / 6, s / 6) for p, q, r, s in (near, far))
        return cls(name, (1.0, 2.0), pieces)

    @property
    def radius(self) -> float:
        """R, the last knot."""
        return self.knots[-1]

    @cached_property
    def scale(self) -> float:
        """1 / volume of the unnormalised kernel, 4π ∫ g r² dr."""
        volume, low = 0.0, 0.0
        for high, piece in zip(self.knots, self.pieces, strict=True):
            volume += sum(c * (high ** (n + 3) - low ** (n + 3)) / (n + 3) for n, c in enumerate(piece))
            low = high
        # rounding leaves a volume of 0 a little beside it
        return 1.0 / (4 * np.pi * volume) if abs(volume) > 1e-12 else 1.0

    def value(self, r: np.ndarray) -> np.ndarray:
        """g(r), any shape; 0 for r ≥ R."""
        r = np.asarray(r, dtype=np.float64)
        found = np.zeros_like(r)
        for knot, (a, b, c, d) in zip(self.knots[::-1], self.pieces[::-1], strict=True):
            found = np.where(r < knot, ((d * r + c) * r + b) * r + a, found)
        return self.scale * found

    def partial(self, d: np.ndarray, t: np.ndarray) -> np.ndarray:
        """P_d(t) as the sum of the pieces' closed forms; odd in t, d and t broadcast."""
        d, t = np.broadcast_arrays(np.asarray(d, dtype=np.float64), np.asarray(t, dtype=np.float64))
        far = np.abs(t)
        total, low = np.zeros(d.shape), np.zeros(d.shape)
        # each piece contributes between the chord of the last knot and its own, cut at |t|
        for knot, piece in zip(self.knots, self.pieces, strict=True):
            high = np.minimum(far, half_chord(knot, d))
            total += _cubic_integral(piece, d, high) - _cubic_integral(piece, d, low)
            low = np.maximum(high, low)
        return self.scale * total * np.sign(t)

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """F(d), d ≥ 0, any shape; 0 for d ≥ R, infinity included."""
        # F(∞) is 0, too
        d = np.minimum(d, self.radius)
        return 2 * self.partial(d, half_chord(self.radius, d))


@dataclass(frozen=True)
class BoxKernel:
    """Box of a voxel, of constant density. It is not radial (see reference/layers.py); the methods describe the
    ball around it.
    """

    name: str = "box"
    radius: float = 3**0.5 / 2

    @property
    def knots(self) -> tuple[float, ...]:
        """The radius alone."""
        return (self.radius,)

    def value(self, r: np.ndarray) -> np.ndarray:
        """1 within the ball."""
        return np.where(np.asarray(r) < self.radius, 1.0, 0.0)

    def partial(self, d: np.ndarray, t: np.ndarray) -> np.ndarray:
        """A length within the ball."""
        return np.where(np.asarray(d) < self.radius, np.asarray(t, np.float64), 0.0)

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """1 within the ball: depths of voxels are those along a ray of one mean spacing."""
        return self.value(d)


BOX = BoxKernel()


def _crawfis_max() -> PiecewiseCubic:
    """The cubic of Crawfis and Max (1993): C² at the knot, lattice ripple 0.12 % rms."""
    r, c2, c3 = 1.556228, 0.067599, 0.282474
    outer = (c2 * r**2 + c3 * r**3, -(2 * c2 * r + 3 * c3 * r**2), c2 + 3 * c3 * r, -c3)
    return PiecewiseCubic("crawfis-max", (0.889392, r), ((0.557526, 0.0, -1.157743, 0.671033), outer))


_erf = np.vectorize(math.erf, otypes=[np.float64])

# largest radius, voxels, and step at the rim; a Gaussian truncated at 3e−4 passes
WIDEST, RIM_STEP = 4.0, 1e-3
# distances at which a footprint is looked at
PROFILE = 400
# the B-spline whose prefiltered coefficients have no limits
FREE = "b-spline-free"
KERNELS: dict[str, Kernel] = {
    "crawfis-max": _crawfis_max(),
    "gaussian": Gaussian(),
    "b-spline": PiecewiseCubic.of_family("b-spline", 1, 0),
    FREE: PiecewiseCubic.of_family(FREE, 1, 0),
}


# names of the kernels that processes have without registering any
BUILT_IN = frozenset(KERNELS)


def kernel(name: str) -> Kernel:
    """The kernel of that name; InputError if unknown."""
    if name not in KERNELS:
        raise expected("kernel", " or ".join(KERNELS), repr(name))
    return KERNELS[name]


def require_built_in(name: str) -> None:
    """Raises InputError for a kernel of this process alone, which workers do not have."""
    if name not in ("auto", *BUILT_IN):
        raise expected("--kernel", "a built-in one, with --workers or --scheduler", name)


@public
def register_kernel(shape: Kernel) -> None:
    """Registers a kernel for `Settings(kernel=shape.name)` and the commands of this process.

    A kernel may be negative somewhere: it draws sums, X-rays of voxels classified before. Raises InputError for a name
    in use or not of lower-case letters, digits and hyphens, and for an invalid kernel: of a volume other than 1, with a
    footprint that is larger than in the middle, wider than WIDEST, or with a step over RIM_STEP at its rim.
    """
    if shape.name in KERNELS or not re.fullmatch(r"[a-z][a-z0-9-]*", shape.name):
        raise expected("kernel", "a new name of lower-case letters, digits and hyphens", repr(shape.name))
    if not 0 < shape.radius <= WIDEST or shape.radius != shape.knots[-1]:
        raise expected(f"kernel {shape.name}", f"a radius of at most {WIDEST:g}, its last knot", shape.radius)
    total = sum(float(4 * np.pi * length * (w * r * r * shape.value(r)).sum()) for r, w, length in _intervals(shape))
    if not abs(total - 1) < 1e-6:
        why = "by distance, a kernel that reproduces squares, as Catmull-Rom, has volume 0" if abs(total) < 1e-6 else ""
        raise expected(f"kernel {shape.name}", "volume 1", f"{total:.6g}", why)
    d = np.linspace(0.0, shape.radius, PROFILE)
    if not np.abs(shape.footprint(d)).max() <= (1 + 1e-6) * float(shape.footprint(np.zeros(()))):
        raise expected(f"kernel {shape.name}", "a footprint that is largest in the middle", "a larger one beside it")
    if not abs(rim_step(shape)) <= RIM_STEP:
        raise expected(f"kernel {shape.name}", f"a step of at most {RIM_STEP:g} at its rim", f"{rim_step(shape):.3g}")
    KERNELS[shape.name] = shape


def import_kernel(text: str) -> str:
    """Registers the kernel of MODULE:NAME, and returns its name. Importing runs the module's code: only options of a
    command and of Python may ask for that, no file that is opened.

    Modules are also looked for in the current folder. Raises InputError for a module or a name that there is not.
    """
    module, _, name = text.partition(":")
    sys.path.insert(0, "")
    try:
        found = getattr(import_module(module), name)
    except Exception as error:
        raise expected(text, "a module and a kernel in it", f"{type(error).__name__}: {error}") from error
    finally:
        sys.path.remove("")
    if not all(hasattr(found, part) for part in ("name", "radius", "knots", "value", "partial", "footprint")):
        raise expected(f"kernel {text}", "a kernel such as PiecewiseCubic", type(found).__name__)
    if KERNELS.get(found.name) != found:
        register_kernel(found)
    return str(found.name)


@lru_cache(maxsize=16)
def has_negative(name: str) -> bool:
    """Whether a kernel is negative somewhere, by more than rounding."""
    shape = kernel(name)
    least = min(float(shape.value(r).min()) for r, _, _ in _intervals(shape))
    return least < -1e-6 * float(shape.value(np.zeros(())))


@lru_cache(maxsize=8)
def unit_rule(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in [0, 1] and weights of Gauss–Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return (nodes + 1) / 2, weights / 2


def _intervals(shape: Kernel) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Yields quadrature nodes, weights of unit sum, and length of each interval between knots."""
    nodes, weights = unit_rule(40)
    for low, knot in pairwise((0.0, *shape.knots)):
        yield low + (knot - low) * nodes, weights, knot - low


def rim_step(shape: Kernel) -> float:
    """A kernel's step at its rim, relative to its maximum."""
    return float(shape.value(np.array(shape.radius * (1 - 1e-9))) / shape.value(np.zeros(())))


def depth_deviation(shape: Kernel) -> float:
    """Standard deviation of the kernel's mass along an axis, in voxels."""
    parts = (
        4 * np.pi / 3 * length * (weights * r**4 * shape.value(r)).sum() for r, weights, length in _intervals(shape)
    )
    return float(np.sqrt(sum(map(float, parts))))


def spectrum(shape: Kernel) -> tuple[float, float, float, float]:
    """Coefficients of q² to q⁸ of the root of the kernel's Fourier transform at q periods per voxel, up to 1."""
    q = np.linspace(0.0, 1.0, 65)[1:]
    transform = np.zeros_like(q)
    for r, weights, length in _intervals(shape):
        shells = 4 * np.pi * length * weights * r**2 * shape.value(r)
        transform += np.sinc(2 * q[:, None] * r) @ shells
    powers = q[:, None] ** np.array([2, 4, 6, 8])
    fitted = np.linalg.lstsq(powers, np.sqrt(np.maximum(transform, 0.0)) - 1, rcond=None)[0]
    first, second, third, fourth = fitted.tolist()
    return first, second, third, fourth


def footprint_table(shape: Kernel, size: int = 256) -> np.ndarray:
    """F/F(0) at the texel centres of a size × size texture over [−R, R]², float64 in [0, 1]."""
    across = ((np.arange(size) + 0.5) / size * 2 - 1) * shape.radius
    d = np.hypot(across[:, None], across[None, :])
    return shape.footprint(d) / shape.footprint(np.zeros(()))


def radial_table(shape: Kernel, size: int = 1024) -> np.ndarray:
    """F/F(0) at `size` squared distances from 0 to R², and the step to the next: float64 [1, size, 2].

    F is smooth in d²: linear interpolation of 1024 values is within 1e−5; the last is 0.
    """
    d = np.sqrt(np.linspace(0.0, 1.0, size)) * shape.radius
    value = shape.footprint(d) / shape.footprint(np.zeros(()))
    return np.stack([value, np.diff(value, append=0.0)], axis=-1)[None]


@dataclass(frozen=True)
class Polynomials:
    """F/F(0) over s = D²/R²: inner[0] + inner[1] s + … up to `split`, then u^2.5 (outer[0] + outer[1] u …), u = 1 − s.

    The power 2.5 is the end behaviour of a footprint whose kernel is C¹ at its rim.
    """

    split: float
    inner: tuple[float, ...]
    outer: tuple[float, ...]

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """F/F(0) at s, any shape; 0 for s ≥ 1."""
        u = 1 - np.asarray(s)
        rim = np.maximum(u, 0.0) ** 2.5 * np.polyval(self.outer[::-1], u)
        return np.asarray(np.where(s < self.split, np.polyval(self.inner[::-1], s), rim))


@lru_cache(maxsize=4)
def polynomials(name: str) -> Polynomials | None:
    """Polynomials within a relative 1.1e−4 of the kernel's F, down to F/F(0) = 1e−7; None unless it has two cubics, and
    none below 0.
    """
    shape = kernel(name)
    if not isinstance(shape, PiecewiseCubic) or len(shape.knots) != 2 or has_negative(name):
        return None
    near, far = SPLIT * _CHEBYSHEV, SPLIT + (END - SPLIT) * _CHEBYSHEV
    value = [shape.footprint(np.sqrt(s) * shape.radius) / shape.footprint(np.zeros(())) for s in (near, far)]
    # a kernel that is C² at its rim has a footprint one power smoother
    _, _, c2, c3 = shape.pieces[-1]
    first = int(abs(2 * c2 + 6 * c3 * shape.radius) < 1e-9 * abs(c3))
    powers = 2.5 + np.arange(first, OUTER_TERMS)
    bases = near[:, None] ** range(INNER_TERMS), (1 - far)[:, None] ** powers
    inner, outer = (_fit_minimax(basis / right[:, None]) for basis, right in zip(bases, value, strict=True))
    return Polynomials(SPLIT, tuple(map(float, inner)), (0.0,) * first + tuple(map(float, outer)))


@lru_cache(maxsize=8)
def single_polynomial(name: str) -> tuple[float, ...]:
    """c of (1 − s)³ (c[0] + … + c[5] s⁵) + max(c[8] − s, 0)³ (c[6] + c[7] s), s = D²/R², within 4e−4 of F/F(0) for two
    cubics, and a relative 8e−4 down to F/F(0) = 0.01; c[8] is the first knot's s.

    Enough for the weights of means: an error shifts a mean by the same share of its values' differences.
    """
    shape = kernel(name)
    knot = (shape.knots[0] / shape.radius) ** 2
    s = np.concatenate([knot * _CHEBYSHEV, knot + (1 - knot) * _CHEBYSHEV])
    value = shape.footprint(np.sqrt(s) * shape.radius) / shape.footprint(np.zeros(()))
    outer = ((1 - s) ** 3)[:, None] * s[:, None] ** np.arange(SINGLE_TERMS)
    near = (np.maximum(knot - s, 0.0) ** 3)[:, None] * s[:, None] ** np.arange(NEAR_TERMS)
    # where mass is small, an error weighs more
    share = 1 / np.maximum(value, SINGLE_LEAST)
    coefficients = _fit_minimax(np.concatenate([outer, near], axis=1) * share[:, None], value * share)
    return (*map(float, coefficients), knot)


@lru_cache(maxsize=32)
def single_reach(name: str, tolerance: float) -> float:
    """Share of the radius beyond which a mean may leave out the kernel, as its mass there is small enough."""
    shape = kernel(name)
    tail = next(tail for least, tail in SINGLE_TAILS if tolerance >= least)
    d = np.linspace(0.0, shape.radius, 2000)
    mass = np.cumsum(shape.footprint(d) * d)
    return float(d[np.searchsorted(mass, mass[-1] * (1 - tail))] / shape.radius)


def _fit_minimax(basis: np.ndarray, value: np.ndarray | float = 1.0) -> np.ndarray:
    """Coefficients of a near-minimax fit of `value` in the basis [N, terms]."""
    value, weight = np.broadcast_to(value, len(basis)), np.ones(len(basis))
    for _ in range(REWEIGHTED):
        # Lawson's algorithm: weights grow with the error
        root = np.sqrt(weight)
        coefficients = np.linalg.lstsq(basis * root[:, None], value * root, rcond=None)[0]
        weight *= np.abs(basis @ coefficients - value)
        weight /= weight.max()
    return np.asarray(coefficients)


def half_line_table(shape: Kernel, size: int = 256) -> np.ndarray:
    """Share of a chord's integral ahead of the eye, float64 [size, size].

    Columns: distance of the chord's middle ahead of the eye, in half chords L from −1 to 1; rows: d²/R² from 0 to 1.
    """
    # the last row's chord has length 0: use the limit, from a chord close by
    d = np.sqrt(np.linspace(0.0, 1.0, size).clip(max=1 - 1e-9))[:, None] * shape.radius
    chord = half_chord(shape.radius, d)
    half = shape.partial(d, chord)
    return np.asarray((half + shape.partial(d, chord * np.linspace(-1.0, 1.0, size))) / (2 * half))


def half_line_integral(shape: Kernel, distance: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Integral along a ray that starts at the eye, `along` before the ray's closest point to the kernel's centre."""
    chord = half_chord(shape.radius, distance)
    return shape.partial(distance, chord) + shape.partial(distance, np.clip(along, -chord, chord))


def half_chord(radius: float, d: np.ndarray) -> np.ndarray:
    """√(R² − d²), 0 beyond R."""
    return np.sqrt(np.maximum((radius - np.asarray(d)) * (radius + np.asarray(d)), 0.0))


def _cubic_integral(piece: tuple[float, float, float, float], d: np.ndarray, t: np.ndarray) -> np.ndarray:
    """∫₀ᵗ of the cubic in r = √(d²+u²); d = 0 is the limit (d² asinh(t/d) → 0)."""
    c0, c1, c2, c3 = piece
    r = np.hypot(d, t)
    log = d * d * np.arcsinh(t / np.where(d > 0, d, 1.0)) * (d > 0)
    r1 = (t * r + log) / 2
    r3 = t * r**3 / 4 + 0.75 * d * d * r1
    return c0 * t + c1 * r1 + c2 * (d * d * t + t**3 / 3) + c3 * r3


# terms of the two polynomials, s at which the second begins, and s up to which it is fitted
INNER_TERMS, OUTER_TERMS, SPLIT, END = 8, 7, 0.3, 0.998
# of the single one, of its part before the first knot, and F/F(0) down to which its error is relative
SINGLE_TERMS, NEAR_TERMS, SINGLE_LEAST = 6, 2, 0.03
# share of the kernel's mass that tiles may leave out, from these tolerances on: pictures of bones change by RMSE 0.0008
# and 0.0004, single pixels by 0.06; the last is less than the polynomial's error
SINGLE_TAILS = (8 / 255, 0.03), (4 / 255, 0.01), (0.0, 2e-4)
# iterations of reweighted least squares
REWEIGHTED = 30
# Chebyshev nodes in [0, 1]: least-squares fits there are nearly minimax
_CHEBYSHEV = (1 + np.cos(np.pi * (np.arange(200) + 0.5) / 200)) / 2


# cubics per interval: error 3e−14 of F(0)
CUBICS = 4096


@dataclass(frozen=True, eq=False)
class Tabulated:
    """A kernel whose footprint F(d) is interpolated by cubics; everything else is that of the exact kernel."""

    name: str
    radius: float
    knots: tuple[float, ...]
    value: Callable[[np.ndarray], np.ndarray]
    partial: Callable[[np.ndarray, np.ndarray], np.ndarray]
    tables: tuple[np.ndarray, ...]

    def footprint(self, d: np.ndarray) -> np.ndarray:
        """F(d) from the tables, d ≥ 0, any shape; 0 for d ≥ R."""
        d = np.asarray(d, dtype=np.float64)
        values, low = np.zeros(d.shape), 0.0
        for knot, table in zip(self.knots, self.tables, strict=True):
            inside = (d >= low) & (d < knot)
            place = np.sqrt((knot - d[inside]) / (knot - low)) * CUBICS
            cell = np.minimum(place.astype(np.intp), CUBICS - 1)
            place -= cell
            c = np.take(table, cell, axis=0)
            values[inside] = ((c[..., 3] * place + c[..., 2]) * place + c[..., 1]) * place + c[..., 0]
            low = knot
        return values


@lru_cache(maxsize=16)
def tabulate(name: str) -> Tabulated:
    """The named kernel with a tabulated footprint, cached. Raises InputError for an unknown name."""
    exact = kernel(name)
    tables = tuple(_table(exact, low, knot) for low, knot in pairwise((0.0, *exact.knots)))
    return Tabulated(name, exact.radius, exact.knots, exact.value, exact.partial, tables)


def _table(exact: Kernel, low: float, knot: float) -> np.ndarray:
    """Cubics [CUBICS, 4] through F at the ends and at two points between, in x = √((knot − d)/(knot − low))."""
    thirds = np.arange(3 * CUBICS + 1) / (3 * CUBICS)
    f = exact.footprint(np.clip(knot - thirds * thirds * (knot - low), low, knot))
    # the cubic through four equidistant values, in p ∈ [0, 1) between the outer ones
    values = np.stack([f[0:-1:3], f[1::3], f[2::3], f[3::3]], axis=1)
    return np.asarray(values @ np.linalg.inv(np.vander(np.arange(4) / 3, increasing=True)).T)

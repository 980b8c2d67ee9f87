"""The exact line integral of a kernel, along straight and along curved rays.

In a voxel's perspective space, t = z_v (z − z_v)/z, a stretched axis runs straight along a pixel's ray and an
unstretched one bends: a point of the ray is p₀ + p₁ t + p₂ δ in the kernel's space, with δ = z − z_v = t/(1 − t/z_v).
In axes aligned with p₂ its squared radius has seven parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from splatgl.geometry.view import GridView, dot
from splatgl.splat.kernels import Kernel, half_line_integral, unit_rule

# quadrature points in each smooth interval of the line: error 1e−13 of the integral
QUADRATURE_ORDER = 24
# maximum number of Newton steps, each clamped to its bracket; four to six suffice beyond z_k
STEPS = 60
# relative tolerance of r² at a shell crossing
CLOSE = 1e-14
# tolerance of the closest point's step, relative to the radius; r² is flat there
SETTLED = 1e-9
# nearest depth of a bracket, relative to the voxel's
NEAREST = 1e-3
# curvatures below this count as 0
TINY = 1e-300

Vector = Sequence[np.ndarray]


@dataclass(frozen=True, eq=False)
class CurvedRay:
    """Rays past voxels: r²(t) = across + slant (t − middle)² + (start + straight t + bent δ(t))².

    All arrays have one shape. depth: z_v. reach: the largest |δ| at unit radius.
    """

    across: np.ndarray
    slant: np.ndarray
    middle: np.ndarray
    start: np.ndarray
    straight: np.ndarray
    bent: np.ndarray
    depth: np.ndarray
    reach: float = 1.0

    @classmethod
    def of(cls, p0: Vector, p1: Vector, p2: Vector, depth: np.ndarray, reach: float) -> CurvedRay:
        """The ray p₀ + p₁ t + p₂ δ, of three vectors given as (x, y, z) arrays."""
        bent = np.sqrt(dot(p2, p2))
        start, straight = dot(p0, p2) / bent, dot(p1, p2) / bent
        p0 = [a - start / bent * b for a, b in zip(p0, p2, strict=True)]
        p1 = [a - straight / bent * b for a, b in zip(p1, p2, strict=True)]
        # across p₂ the ray is a straight line
        slant = dot(p1, p1)
        middle = -dot(p0, p1) / np.maximum(slant, TINY)
        across = [a + middle * b for a, b in zip(p0, p1, strict=True)]
        return cls(dot(across, across), slant, middle, start, straight, bent, depth, reach)

    def take(self, index: np.ndarray) -> CurvedRay:
        """The rays at those indices."""
        return replace(self, **{name: array[index] for name, array in vars(self).items() if name != "reach"})

    def integral(self, kernel: Kernel, power: int) -> np.ndarray:
        """∫ g(r(t)) (1 − t/z_v)^−power dt, cut where the ray crosses each knot's shell."""
        closest = self.closest(kernel.radius)
        hit = np.flatnonzero(self.square(closest) < kernel.radius**2)
        total = np.zeros(self.depth.shape)
        total[hit] = self.take(hit)._through(kernel, closest[hit], power)
        return total

    def _through(self, kernel: Kernel, closest: np.ndarray, power: int) -> np.ndarray:
        # from the closest point outwards through each shell, on both sides
        total = np.zeros(closest.shape)
        for side in (-1.0, 1.0):
            start = closest
            for knot in kernel.knots:
                stop = self.crossing(closest, side, knot)
                shell = np.zeros(closest.shape)
                for node, weight in zip(*_RULE, strict=True):
                    t = start + (stop - start) * node
                    value = kernel.value(np.sqrt(self.square(t)))
                    shell += weight * (value / (1 - t / self.depth) ** power if power else value)
                total += shell * np.abs(stop - start)
                start = stop
        return total

    def square(self, t: np.ndarray) -> np.ndarray:
        """r²(t)."""
        along = self.start + self.straight * t + self.bent * t / (1 - t / self.depth)
        from_middle = t - self.middle
        return np.asarray(self.across + self.slant * from_middle * from_middle + along * along)

    def derivatives(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Half the first and second derivative of r² by t."""
        bend = 1 / (1 - t / self.depth)
        along = self.start + self.straight * t + self.bent * t * bend
        rise = self.straight + self.bent * bend * bend
        curve = 2 * self.bent * bend**3 / self.depth
        first = self.slant * (t - self.middle) + along * rise
        return first, self.slant + rise * rise + along * curve

    def limit(self, side: float, radius: float) -> np.ndarray:
        """A t beyond the shell of that radius, all of whose points are within radius · reach in depth."""
        delta = side * radius * self.reach
        return np.asarray(delta / np.maximum(1 + delta / self.depth, NEAREST))

    def closest(self, radius: float) -> np.ndarray:
        """The t of the smallest r, by Newton's method; exact only where r may be below radius."""
        low, high = self.limit(-1.0, radius), self.limit(1.0, radius)
        t = np.zeros(self.depth.shape)
        for _ in range(STEPS):
            first, second = self.derivatives(t)
            last, t = t, np.clip(t - first / np.maximum(second, TINY), low, high)
            if not np.abs(t - last).max(initial=0.0) > SETTLED * radius:
                break
        return t

    def crossing(self, closest: np.ndarray, side: float, knot: float) -> np.ndarray:
        """The t at which r exceeds `knot` on one side of the closest point; `closest` if r is nowhere less."""
        inside, outside = closest, self.limit(side, knot)
        room = knot * knot - self.square(closest)
        meets = room > 0
        # the parabola's crossing, then Newton's method in its bracket
        t = closest + side * np.sqrt(np.maximum(room, 0.0) / np.maximum(self.derivatives(closest)[1], TINY))
        t = np.where(side * (outside - t) > 0, t, (inside + outside) / 2)
        for _ in range(STEPS):
            excess = self.square(t) - knot * knot
            inside, outside = np.where(excess < 0, t, inside), np.where(excess < 0, outside, t)
            with np.errstate(divide="ignore", invalid="ignore"):
                guess = t - excess / (2 * self.derivatives(t)[0])
            bracketed = (side * (guess - inside) >= 0) & (side * (outside - guess) >= 0)
            t = np.where(bracketed, guess, (inside + outside) / 2)
            if not np.abs(np.where(meets, excess, 0.0)).max(initial=0.0) > CLOSE * knot * knot:
                break
        return np.where(meets, t, closest)


_RULE = unit_rule(QUADRATURE_ORDER)


@dataclass(frozen=True, eq=False)
class Integral:
    """value: the line integral along each ray, for unit extinction · s̄.

    peak: the integral along a parallel ray through the splat's centre; value/peak is the footprint's shape.
    """

    value: np.ndarray
    peak: np.ndarray


def row1(view: GridView, voxel: np.ndarray, ray: np.ndarray) -> Integral:
    """The correct value for voxels [3, ...] and rays [2, ...], whose shapes broadcast; arrays [...].

    A perspective ray is z·(w, 1) with slopes w and starts at the eye; an orthographic ray is given by its
    (x, y) and endless.  [M98 Table 1 row 1]
    """
    x, y, z, u, v = (part.ravel() for part in np.broadcast_arrays(*voxel, *ray))
    shape = np.broadcast_shapes(voxel.shape[1:], ray.shape[1:])
    if not view.perspective:
        integral = _parallel(view, (x, y, z), (u, v))
    else:
        integral = _straight(view, (x, y, z), (u, v))
        widened = np.flatnonzero(view.is_widened(z))
        if len(widened):
            some = _bent(view, (x[widened], y[widened], z[widened]), (u[widened], v[widened]))
            integral.value[widened], integral.peak[widened] = some.value, some.peak
    return Integral(integral.value.reshape(shape), integral.peak.reshape(shape))


Triple = tuple[np.ndarray, np.ndarray, np.ndarray]
Pair = tuple[np.ndarray, np.ndarray]


def _straight(view: GridView, voxel: Triple, slope: Pair) -> Integral:
    """Unwidened kernels: F(D)/|A⁻¹d̂|; the integral starts at the eye if the kernel reaches the eye's plane."""
    x, y, z = voxel
    w_x, w_y = slope
    # e = w z_v − c; D = |(A⁻¹e)×(A⁻¹d)|/|A⁻¹d| = |Aᵀ(e×d)|/|A⁻¹d|, without cancellation
    e_x, e_y = w_x * z - x, w_y * z - y
    normal = _apply(view.eye_from_index.T, (e_y, -e_x, e_x * w_y - e_y * w_x))
    direction = _apply(view.index_from_eye, (w_x, w_y, np.ones_like(w_x)))
    speed = _length(direction)
    distance = _length(normal) / speed
    footprint = view.kernel.footprint(distance)
    near = np.flatnonzero(z <= view.reach)
    if len(near):
        centre = _apply(view.index_from_eye, (x[near], y[near], z[near]))
        along = centre[0] * direction[0][near] + centre[1] * direction[1][near] + centre[2] * direction[2][near]
        along /= speed[near]
        footprint[near] = half_line_integral(view.kernel, distance[near], along)
    gain = np.sqrt(1 + w_x * w_x + w_y * w_y) / speed
    return Integral(gain * footprint, gain * view.kernel.footprint(np.zeros(())))


def _parallel(view: GridView, voxel: Triple, ray: Pair) -> Integral:
    """Orthographic: offsets shrink by the same factor at every depth, so that the ray stays straight."""
    shrink = view.shrink(voxel[2])
    gain = shrink[0] * shrink[1]
    offset = [u_x * (ray[0] - voxel[0]) + u_y * (ray[1] - voxel[1]) for u_x, u_y in view.axes.T]
    # across the view the footprint is an ellipse of half axes σ_i R
    squares = sum((o * s / width) ** 2 for o, s, width in zip(offset, shrink, view.widths, strict=True))
    peak = gain / (view.widths[0] * view.widths[1]) * view.kernel.footprint(np.zeros(()))
    value = gain / (view.widths[0] * view.widths[1]) * view.kernel.footprint(np.sqrt(squares))
    return Integral(value, peak)


def _bent(view: GridView, voxel: Triple, slope: Pair) -> Integral:
    """sec_p ∫ Π f_i(z) h(A⁻¹[U f(z) Uᵀ(w z − c); z − z_v]) dz, f_i = g_i z_v/z where widened, else 1."""
    x, y, z = voxel
    w = slope
    shrink, widened = view.shrink(z), view.widened(z)
    p0, p1 = [np.zeros_like(z) for _ in range(3)], [np.zeros_like(z) for _ in range(3)]
    p2 = [np.full_like(z, b) for b in view.index_from_eye[:, 2]]
    for (u_x, u_y), g, wide in zip(view.axes.T, shrink, widened, strict=True):
        # along u: g (e + c t/z_v), straight in t, where widened; e + w δ where not
        e, c, slant = ((a * u_x + b * u_y) for a, b in ((w[0] * z - x, w[1] * z - y), (x, y), w))
        for axis, part in enumerate(view.index_from_eye[:, :2] @ (u_x, u_y)):
            p0[axis] += part * g * e
            p1[axis] += part * np.where(wide, g * c / z, 0.0)
            p2[axis] += part * np.where(wide, 0.0, slant)
    gain = np.sqrt(1 + w[0] * w[0] + w[1] * w[1]) * shrink[0] * shrink[1]
    peak = gain / _length([a + b for a, b in zip(p1, p2, strict=True)]) * view.kernel.footprint(np.zeros(()))
    path = CurvedRay.of(p0, p1, p2, z, view.depth_reach)
    # dz = dt/(1 − t/z_v)², of which each widened axis takes one factor
    value, both_widened = np.zeros_like(z), widened[0]
    for power, index in ((0, np.flatnonzero(both_widened)), (1, np.flatnonzero(~both_widened))):
        if len(index):
            value[index] = gain[index] * path.take(index).integral(view.kernel, power)
    return Integral(value, peak)


def _apply(matrix: np.ndarray, vector: Triple) -> Triple:
    first, second, third = (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2] for row in matrix)
    return first, second, third


def _length(vector: Vector) -> np.ndarray:
    return np.sqrt(dot(vector, vector))

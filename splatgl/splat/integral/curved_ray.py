"""The line integral of a radial kernel along a ray that antialiasing bends, in float64.

Seen in a voxel's perspective space, t = z_v (z − z_v)/z, a stretched axis runs straight along a pixel's
ray and an unstretched one bends: every point of the ray is p₀ + p₁ t + p₂ δ in the kernel's own space,
with δ = z − z_v = t/(1 − t/z_v). In axes aligned with p₂ its squared radius has seven parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.splat.kernel.kernels import Kernel, unit_rule

# quadrature points in each smooth interval of the line: error 1e−13 of the integral
QUADRATURE_ORDER = 24
# most Newton steps, each clamped to its bracket; four to six suffice beyond z_k
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
        """From the three vectors of p₀ + p₁ t + p₂ δ, each given as its (x, y, z) arrays."""
        bent = np.sqrt(_dot(p2, p2))
        start, straight = _dot(p0, p2) / bent, _dot(p1, p2) / bent
        p0 = [a - start / bent * b for a, b in zip(p0, p2, strict=True)]
        p1 = [a - straight / bent * b for a, b in zip(p1, p2, strict=True)]
        # across p₂ the ray is a straight line
        slant = _dot(p1, p1)
        middle = -_dot(p0, p1) / np.maximum(slant, TINY)
        across = [a + middle * b for a, b in zip(p0, p1, strict=True)]
        return cls(_dot(across, across), slant, middle, start, straight, bent, depth, reach)

    def take(self, index: np.ndarray) -> CurvedRay:
        """The rays at those indices."""
        return CurvedRay(
            self.across[index],
            self.slant[index],
            self.middle[index],
            self.start[index],
            self.straight[index],
            self.bent[index],
            self.depth[index],
            self.reach,
        )

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
        """The t of the smallest r, by Newton's method from the straight ray's; only where r may be below radius."""
        low, high = self.limit(-1.0, radius), self.limit(1.0, radius)
        t = np.zeros(self.depth.shape)
        for _ in range(STEPS):
            first, second = self.derivatives(t)
            last, t = t, np.clip(t - first / np.maximum(second, TINY), low, high)
            if not np.abs(t - last).max(initial=0.0) > SETTLED * radius:
                break
        return t

    def crossing(self, closest: np.ndarray, side: float, knot: float) -> np.ndarray:
        """The t at which r grows past `knot` on that side of the closest point (that point, if r is never less)."""
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


def _dot(a: Vector, b: Vector) -> np.ndarray:
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])

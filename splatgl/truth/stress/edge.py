"""The edge of a thick dense block beyond z_k: how far each attenuation form widens it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.settings import choices
from splatgl.splat.splats import Splats
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, block, parallel

LAYERS, DENSE = 40, 0.99
# voxels a pixel
ZOOMS = (1.0, 2.0, 4.0, 8.0, 16.0)
# every named form; auto is one of them
FORMS = tuple(form for form in choices()["attenuation"] if form != "auto")
# pixels on either side of that centred on the edge
REACH = 3
# number of images, each shifted by that fraction of a pixel
SHIFTS = 4
SHAPE_BOUND = 1e-4
CROSSING_BOUND = 1e-3


@dataclass(frozen=True)
class Edge:
    """place [N]: pixels beyond the edge, which is half a voxel outside of the last layer; opacity [N] there."""

    place: np.ndarray
    opacity: np.ndarray

    @property
    def outside(self) -> float:
        """α of the pixel whose centre is one pixel outside, where 0 is right."""
        return float(self.opacity[np.flatnonzero(self.place == 1.0)[0]])

    @property
    def crossing(self) -> float:
        """Where α falls below a half, in pixels beyond the edge; 0 is right."""
        inside = int(np.flatnonzero(self.opacity >= 0.5)[-1])
        drop = self.opacity[inside] - self.opacity[inside + 1]
        share = (self.opacity[inside] - 0.5) / drop
        return float(self.place[inside] + share * (self.place[inside + 1] - self.place[inside]))


Draw = Callable[[Splats, Camera], np.ndarray]


def drawn(m: float, draw: Draw) -> Edge:
    """The edge as `draw` shows it, at m voxels a pixel; parallel rays."""
    splats, width, half = scene(m)
    rows = []
    for shift in range(SHIFTS):
        camera = parallel(m, (2 * REACH + 1, 1), (width - 0.5 + shift / SHIFTS * m, float(half)))
        rows.append(alpha(draw(splats, camera))[0])
    return Edge(_places(), np.stack(rows, axis=1).ravel())


def summed(m: float, form: str) -> Edge:
    """The same by the definition of `opacity`, `optical-depth` or the paper's `a F`, in float64, without rendering."""
    _, width, half = scene(m)
    shape = kernel("crawfis-max")
    tau = -np.log1p(-DENSE)
    x = width - 0.5 + _places() * m
    columns, rows = np.arange(width), np.arange(2 * half + 1) - half
    footprint = shape.footprint(np.hypot((x[:, None, None] - columns[:, None]) / m, rows / m))
    depth = {
        "optical-depth": lambda: tau * footprint / m**2,
        "opacity": lambda: -np.log1p(np.expm1(-tau * footprint) / m**2),
        # the printed form: opacity times footprint times (z_k/z_v)²
        "paper": lambda: -np.log1p(-DENSE * footprint / m**2),
    }[form]()
    return Edge(_places(), -np.expm1(-LAYERS * depth.sum(axis=(1, 2))))


@lru_cache(maxsize=2)
def scene(m: float) -> tuple[Splats, int, int]:
    """(block, voxels along x, half its voxels along y): 40 layers, as wide and high as splats reach."""
    reach = int(np.ceil(1.6 * m)) + 1
    width = int(m * (REACH + 1)) + reach
    return block((width, 2 * reach + 1, LAYERS), DENSE), width, reach


def _places() -> np.ndarray:
    return np.arange((2 * REACH + 1) * SHIFTS) / SHIFTS - REACH


def thick_edge(bench: Bench) -> list[Check]:
    """Checks α outside the edge and where it falls below a half, for every form of attenuation."""
    checks = []
    paper = [summed(m, "paper") for m in ZOOMS]
    for form in FORMS:
        found = [drawn(m, partial(bench.draw, attenuation=form)) for m in ZOOMS]
        if form in ("opacity", "optical-depth"):
            right = [summed(m, form) for m in ZOOMS]
        else:
            right = [drawn(m, partial(bench.truth, attenuation=form)) for m in ZOOMS]
        alphas, old = ([e.outside for e in edges] for edges in (found, paper))
        checks.append(check(f"{form}, α outside", alphas, [e.outside for e in right], SHAPE_BOUND, old))
        halves, old = ([e.crossing for e in edges] for edges in (found, paper))
        checks.append(check(f"{form}, 50 %", halves, [e.crossing for e in right], CROSSING_BOUND, old))
    return checks


CASES = (
    Case(
        "thick-edge",
        "the edge of 40 layers of opacity 0.99, at 1 to 16 voxels a pixel",
        "parallel rays; α one pixel outside, and where α falls below a half (pixels beyond the edge), for every form "
        "of attenuation. A form passes where it is drawn as it is defined; --explain tells how much each errs. The "
        "paper's column: a F/m², in float64",
        "each form's own sum in float64",
        thick_edge,
    ),
)

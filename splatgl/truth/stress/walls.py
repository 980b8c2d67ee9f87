"""Closed walls beyond z_k: effect of each attenuation form on opacity that fills its pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.truth.stress.bench import Bench
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, block, optical_depth

OPACITIES = (0.1, 0.5, 0.99)
# voxels a pixel at the wall
ZOOMS = (1.0, 1.1, 2.0, 4.0, 16.0, 64.0)
# the kernel's ripple on its lattice, stretched by 1.1: 1.08 %; and 0.1 % for the depth of view
WALL_BOUND = 0.012
# of the opacity that the default attenuation draws: no form keeps the optical depth of matter so opaque that more of it
# would only darken what lies beside it
SEEN_BOUND = 1 / 255
# angle between the view and the wall's normal, degrees
SLANT = 50.0
# pixels across a picture: z_k = 56 voxels at 60°
PIXELS = 65
# pixels evaluated on either side of the middle one
AROUND = 1


@dataclass(frozen=True)
class Wall:
    """A sheet one voxel thick, and a view whose middle pixels show only the sheet."""

    zoom: float
    perspective: bool
    slant: float

    @property
    def size(self) -> tuple[int, int, int]:
        """Voxels along x, y, z: all splats of R·m that reach the middle pixels, with a margin."""
        reach = self.zoom * (AROUND + 0.5 + 1.7)
        sec = 1 / np.cos(np.radians(self.slant))
        # the far side of an oblique wall is farther away, with wider pixels
        grow = 1.15 if self.slant else 1.05
        return 2 * int(reach * sec * grow**2 + 4) + 1, 2 * int(reach * grow + 4) + 1, 1

    @property
    def target(self) -> np.ndarray:
        """The point [3] that the view's axis meets, world units."""
        # off voxel centres
        return np.array([self.size[0] // 2 + 0.31, self.size[1] // 2 + 0.17, 0.0])

    def camera(self) -> Camera:
        """The view, `slant` from the wall's normal, `zoom` voxels a pixel at the wall."""
        angle = np.radians(self.slant)
        back = -np.array([np.sin(angle), 0.0, np.cos(angle)])
        if not self.perspective:
            height = self.zoom * PIXELS
            eye = self.target + back * (2 * self.size[0])
            return Camera.orthographic(eye, self.target, (0, -1, 0), height, (PIXELS, PIXELS))
        z_k = PIXELS / (2 * np.tan(np.radians(30.0)))
        return Camera.look_at(self.target + back * z_k * self.zoom, self.target, (0, -1, 0), 60.0, (PIXELS, PIXELS))

    def secants(self) -> np.ndarray:
        """[3, 3]: 1/cos of each middle pixel's ray to the wall's normal."""
        camera = self.camera()
        across, down = (_around(axis) for axis in camera.slopes())
        if not self.perspective:
            return np.full((len(down), len(across)), 1 / np.cos(np.radians(self.slant)))
        x, y = np.meshgrid(across, down)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1)
        to_wall = rays @ camera.eye_from_world[:, 2]
        return np.asarray(np.linalg.norm(rays, axis=-1) / np.abs(to_wall))


def wall(bench: Bench, opacity: float) -> list[Check]:
    """Checks a closed wall's optical depth at each of ZOOMS, straight and oblique; of `auto`, its opacity."""
    checks = []
    for perspective in (True, False):
        for slant in (0.0, SLANT):
            ratios, weak, plain, opaque, paper = [], [], [], [], []
            for m in ZOOMS:
                own = Wall(m, perspective, slant)
                splats, camera = block(own.size, opacity), own.camera()
                right = -np.log1p(-opacity) * own.secants()
                drawn, old, auto = (
                    _around(_around(alpha(picture)).T).T
                    for picture in (
                        bench.draw(splats, camera, attenuation="optical-depth"),
                        bench.draw(splats, camera, attenuation="opacity"),
                        bench.draw(splats, camera),
                    )
                )
                ratios.append(optical_depth(drawn) / right)
                weak.append(optical_depth(old) / right)
                plain.append(auto)
                opaque.append(-np.expm1(-right))
                paper.append(old)
            name = ("perspective" if perspective else "parallel") + (f", {SLANT:g}°" if slant else ", straight")
            checks.append(check(name, ratios, 1.0, WALL_BOUND, weak))
            checks.append(check(f"auto, α, {name}", plain, np.array(opaque), SEEN_BOUND, paper))
    return checks


def printed_form(own: Wall, opacity: float) -> float:
    """α of the middle pixel of a straight wall in parallel rays by the printed form, a F/m²  [M98 Eq. 6]."""
    shape = kernel("crawfis-max")
    x, y = (np.arange(n) - at for n, at in zip(own.size[:2], own.target[:2], strict=True))
    footprint = shape.footprint(np.hypot(x[:, None], y) / max(own.zoom, 1.0))
    return float(-np.expm1(np.log1p(-opacity * footprint / max(own.zoom, 1.0) ** 2).sum()))


def _around(values: np.ndarray) -> np.ndarray:
    """The middle 3 of the first axis."""
    middle = len(values) // 2
    return values[middle - AROUND : middle + AROUND + 1]


def _wall_case(opacity: float) -> Case:
    return Case(
        f"wall-{opacity:g}",
        f"a closed wall one voxel thick of opacity {opacity:g}, at 1 to 64 voxels a pixel",
        f"perspective and parallel, straight on and at {SLANT:g}°, −ln(1−α)/(τ sec θ) in nine pixels, optical-depth; "
        "the paper's column: opacity attenuation, in float32; α: what the default attenuation draws",
        "1: every ray has the wall's whole optical depth; α = 1 − exp(−τ sec θ)",
        lambda bench: wall(bench, opacity),
    )


CASES = tuple(_wall_case(opacity) for opacity in OPACITIES)

"""Volumes of noise on every kind of grid, and views of them: far, near, wide, inside, parallel."""

from __future__ import annotations

import numpy as np

import splatgl as sg
from splatgl.geometry.camera import Bounded
from splatgl.splat.kernels import Gaussian, Kernel, PiecewiseCubic

GRIDS = {
    "cubes": {},
    "turned": {"direction": np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1.0]])},
    "1:2:5": {"spacing": (1.0, 2.0, 5.0)},
    "sheared": {"direction": np.array([[1, 0.4, 0.2], [0, 1, 0.3], [0, 0, 1.4]])},
}


def noise(grid: str = "cubes", size: int = 12, opacity: float = 0.4, seed: int = 3) -> sg.Splats:
    cells = np.random.default_rng(seed).random((size, size, size))
    return sg.extract(
        sg.Volume(cells, **GRIDS[grid]), sg.Transfer([(0.3, 0), (1, opacity)], colormap="hot"), classification="pre"
    )


def close_up(subject: Bounded, azimuth: float, elevation: float, size: tuple[int, int]) -> sg.Camera:
    """The view fitted to the splats themselves, or to a volume's box, whose middle is the picture's."""
    return sg.Camera.around(subject, (azimuth, elevation), 40, size, 1.0, (0, 0, 1), centred=False)


def views(splats: sg.Splats) -> dict[str, sg.Camera]:
    """Far beyond z_k, near, so near that many centres lie beyond the edges, and parallel."""
    out = close_up(splats, 30, 20, (48, 36))
    middle = splats.corners.mean(axis=0)
    span = float(np.linalg.norm(np.ptp(splats.corners, axis=0)))
    close = sg.Camera.look_at(middle - out.forward * span * 0.9, middle + span * 0.2, (0, 0, 1), 30, (40, 60))
    return {
        "far": close_up(splats, 30, 20, (9, 7)),
        "fitted": out,
        "close": close,
        "wide": sg.Camera.look_at(middle - out.forward * span * 0.8, middle, (0, 0, 1), 110, (50, 40)),
        "parallel": out.parallel(splats),
        "parallel, close": out.parallel(splats, height=span * 0.3),
        "parallel, far": out.resized((6, 5)).parallel(splats),
    }


LOOKS = [(0, 1, 0.1), (0, -1, 0.1), (1, 0.2, 0), (-1, 0.3, 0.1), (0.1, 0.2, 1), (0.2, 0.1, -1), (0.3, 0.9, -0.3)]


def inside(splats: sg.Splats, look: tuple[float, ...], fov: float = 40) -> sg.Camera:
    """An eye near the middle, in no special place."""
    eye = splats.corners.mean(axis=0) + 0.13
    scale = np.ptp(splats.corners, axis=0)
    return sg.Camera.look_at(eye, eye + np.array(look) * scale, (0.1, 0.3, 0.9), fov, (60, 40))


def scale(shape: Kernel) -> float:
    """1 / volume of a built-in kernel as the paper states it: pinned numbers are not normalised."""
    assert isinstance(shape, Gaussian | PiecewiseCubic)
    return shape.scale

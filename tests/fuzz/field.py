#!/usr/bin/env python
"""Random pictures against a marched field: `field.py [--count N] [--first SEED] [--technique NAME]`.

Each seed is a volume of any shape (boxes, plates, rods, single planes and voxels; cubes, long and turned voxels), a
transfer function, a kernel, a blend and a camera: inside the box, beside it, outside, parallel, or exactly where a
decision changes (the eye at whole and half multiples of voxels, kernel radii and sheets, looking along an axis or
nearly so). The field that the kept voxels define is marched by `tests/helpers/marcher.py`, sharing no code with the
package. Prints for each kind of camera how far pictures are off it: RMSE of alpha (mean and 90th percentile), and the
share of calm pixels, whose alpha is within 0.1 of that of their neighbours, that are off by more than 0.02 in any
component; then the worst seeds.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

import splatgl as sg
from tests.helpers.marcher import calm, march

Random = np.random.Generator

PLACES = ("inside", "beside", "outside", "parallel", "threshold")
BLENDS = ("composite", "composite", "composite", "composite", "mip", "minip", "mean", "xray")
KERNELS = ("b-spline", "b-spline", "crawfis-max", "gaussian")
# kernel radius and thickness of sheets, voxels
RADIUS, SHEETS = 2.0, (0.849, 0.775)
OFF = 0.02
FINE = 12


@dataclass(frozen=True)
class Found:
    """Of one picture: RMSE of alpha, the largest difference of a component, calm pixels, and those of them off by
    more than OFF.
    """

    seed: int
    rmse: float
    largest: float
    calm: int
    off: int


# --- scenes -----------------------------------------------------------------------------------------------------------


def cells_of(rng: Random) -> np.ndarray:
    """Noise from 0 to 1 in a box of any shape, without the highest frequencies."""
    shape = rng.integers(5, 13, 3)
    kind = rng.random()
    if kind < 0.1:
        shape[rng.integers(3)] = rng.integers(1, 4)
    elif kind < 0.2:
        shape = rng.permutation([rng.integers(1, 4), rng.integers(1, 4), rng.integers(16, 40)])
    elif kind < 0.22:
        shape = np.ones(3, int)
    cells = rng.random(shape)
    for axis in (0, 1, 2) * int(rng.integers(1, 4)):
        cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    return np.asarray((cells - cells.min()) / max(np.ptp(cells), 1e-9)) if cells.size > 1 else np.ones(shape)


def volume_of(rng: Random) -> sg.Volume:
    """Cells on a grid of cubes, long voxels, or turned ones."""
    kind, spacing, direction = rng.random(), np.ones(3), np.eye(3)
    if kind < 0.3:
        spacing = rng.uniform(0.5, 2, 3)
    elif kind < 0.4:
        direction = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return sg.Volume(cells_of(rng), spacing=tuple(spacing), direction=direction, origin=tuple(rng.normal(size=3)))


def transfer_of(rng: Random) -> sg.Transfer:
    """A ramp, or a ramp up and down, of any width and opacity."""
    low, high = np.sort(rng.uniform(0, 1, 2))
    high, peak = max(high, low + 0.15), rng.uniform(0.1, 0.95)
    ramp = [(low, 0), (high, peak)] if rng.random() < 0.7 else [(low, 0), ((low + high) / 2, peak), (high, 0)]
    colormap = ("gray", "hot")[rng.integers(2)]
    return sg.Transfer(ramp, colormap=colormap, window=(0, 1), shading=bool(rng.random() < 0.5))


def special(rng: Random, count: int) -> float:
    """A grid index along an axis: whole and half multiples of voxels, radius and sheets from voxels and faces."""
    steps = [
        0.0,
        0.5,
        1.0,
        2.5,
        *(RADIUS * np.array([0.5, 1, 1.5, 2, 3])),
        *(rng.choice(SHEETS) * np.arange(1, 11) / 2),
    ]
    return float(rng.choice([0.0, -0.5, count - 1.0, count - 0.5]) + rng.choice([-1, 1]) * rng.choice(steps))


def camera_of(rng: Random, volume: sg.Volume, where: str) -> sg.Camera:
    """A camera of a kind of PLACES, of few pixels."""
    count, size = np.array(volume.shape[::-1]), (int(rng.integers(8, 14)), int(rng.integers(8, 12)))
    place, look, up = rng.uniform(0, 1, 3) * (count - 1), rng.normal(size=3), rng.normal(size=3)
    target = rng.uniform(0.2, 0.8, 3) * (count - 1)
    axis = int(rng.integers(3))
    field_of_view = float(rng.choice([25, 40, 70, 100]))
    if where == "beside":
        # up to three voxels outside a face
        place[axis] = rng.choice([-0.5 - rng.uniform(0, 3), count[axis] - 0.5 + rng.uniform(0, 3)])
        look = target - place
    elif where in ("outside", "parallel"):
        away = rng.normal(size=3)
        place = (count - 1) / 2 + away / np.linalg.norm(away) * (np.linalg.norm(count) * rng.uniform(0.8, 2.0) + 3)
        look, field_of_view = target - place, 30.0
    elif where == "threshold":
        place = np.array([special(rng, n) if rng.random() < 0.6 else rng.uniform(-1, n) for n in count])
        place[axis] = special(rng, count[axis])
        look = np.eye(3)[axis] * (-1 if place[axis] > count[axis] / 2 else 1)
        look = look + rng.choice([0.0, 0.0, 1e-7, 1e-4, 0.5]) * rng.normal(size=3)
        up = np.eye(3)[(axis + 1) % 3] if rng.random() < 0.7 else up
    steps = volume.world_from_index
    eye = np.asarray(volume.origin) + steps @ place
    if where == "parallel":
        height = 0.8 * np.linalg.norm(steps @ count)
        return sg.Camera.orthographic(eye, eye + steps @ look, steps @ up, height=height, size=size)
    return sg.Camera.look_at(eye, eye + steps @ look, steps @ up, fov=field_of_view, size=size)


# --- comparison -------------------------------------------------------------------------------------------------------


def compared(seed: int, renderer: sg.Renderer, technique: str) -> tuple[str, Found | None]:
    """The kind of camera of a seed, and what was found; None where all is transparent."""
    rng = np.random.default_rng(seed)
    where, blend, kernel = PLACES[seed % len(PLACES)], str(rng.choice(BLENDS)), str(rng.choice(KERNELS))
    volume, transfer = volume_of(rng), transfer_of(rng)
    camera = camera_of(rng, volume, where)
    options: Any = {"kernel": kernel, "classification": "post" if blend in ("composite", "xray") else "post-all"}
    splats = sg.extract(volume, transfer, **options)
    if not len(splats):
        return where, None
    given: Any = {"blend": blend, "technique": technique, "antialias": "off"}
    drawn = renderer.render(splats, camera, sg.Settings(**given)).pixels.astype(np.float64)
    right = march(splats, camera, blend, fine=FINE)
    # sums of depths have no largest value of their own
    error, quiet = np.abs(drawn - right) / max(right[..., 3].max(), 1.0), calm(right)
    rmse = float(np.sqrt(np.mean(error[..., 3] ** 2)))
    off = int((error.max(axis=-1) > OFF)[quiet].sum())
    return where, Found(seed, rmse, float(error.max()), int(quiet.sum()), off)


def table(found: dict[str, list[Found]]) -> str:
    """A line for each kind of camera."""
    lines = [f"{'camera':<10} {'pictures':>8} {'RMSE':>7} {'90 %':>7} {'calm pixels':>12} {'over ' + str(OFF):>9}"]
    for where in PLACES:
        if some := found[where]:
            rmse = [each.rmse for each in some]
            mean, ninth = np.mean(rmse), np.quantile(rmse, 0.9)
            pixels, off = sum(each.calm for each in some), sum(each.off for each in some)
            lines.append(
                f"{where:<10} {len(some):>8} {mean:>7.4f} {ninth:>7.4f} {pixels:>12} {100 * off / pixels:>7.2f} %"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="pictures (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (default: %(default)s)")
    parser.add_argument("--technique", default="auto", help="auto, tiles or quads (default: %(default)s)")
    args = parser.parse_args()
    found: dict[str, list[Found]] = defaultdict(list)
    with sg.Renderer() as renderer:
        for seed in range(args.first, args.first + args.count):
            where, each = compared(seed, renderer, args.technique)
            if each is not None:
                found[where].append(each)
    print(table(found))
    worst = sorted((each for some in found.values() for each in some), key=lambda each: -each.rmse)[:10]
    print("worst:", ", ".join(f"seed {each.seed} {PLACES[each.seed % len(PLACES)]} {each.rmse:.3f}" for each in worst))


if __name__ == "__main__":
    main()

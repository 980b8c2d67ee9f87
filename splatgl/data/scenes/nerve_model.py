"""Synthetic confocal image of a nerve cell: body, dendrites with spines, axon, blur and noise.  [M98]"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from splatgl.coercion import public
from splatgl.data.volume import Hints, Volume

# voxels along z, y, x
NERVE_SHAPE = (76, 512, 512)
# centre (x, y, z) and half axes of the cell body, in voxels
BODY, BODY_AXES = np.array([240.0, 205.0, 38.0]), np.array([15.0, 20.0, 12.0])
# step length of a branch, and the margin at which branches turn back, in voxels
STEP, MARGIN = 3.0, 14.0
# random walk of directions: drift and jitter (radians a step), and their reduction in depth
WANDER, MEMORY, JITTER, FLATNESS = 0.035, 0.85, 0.05, 0.35
# outward turn of a branch at each step
OUTWARD = 0.02
# radius in voxels at which a dendrite ends, and the power law of forks (Rall: r³ᐟ² is conserved)
THINNEST, RALL = 0.55, 1.5
# minimum steps between forks; maximum radius of branches with spines
UNFORKED, SPINY = 6, 2.6
# half width of a capsule's soft edge in voxels; blur is larger in depth by DEPTH_BLUR
SOFT, DEPTH_BLUR = 1.3, 1.7
# in grey levels of 255: mean and maximum of dark noise, maximum signal; shot noise per root of the signal
DARK, DARKEST, FULL, SHOT = 4.0, 22.0, 235.0, 0.7


@dataclass(frozen=True)
class Sprout:
    """A branch to grow: start, direction, radius, and growth parameters."""

    place: np.ndarray
    heading: np.ndarray
    radius: float
    taper: float
    fork: float
    spines: float


@dataclass(frozen=True)
class Capsule:
    """A straight segment of a branch: its ends, their radii, and its brightness in [0, 1]."""

    start: np.ndarray
    stop: np.ndarray
    radii: tuple[float, float]
    light: float = 1.0


@public
def nerve(seed: int = 11) -> Volume:
    """A nerve cell, 512×512×76 voxels of spacing 1.

    samples uint8: dark noise up to about 20, the cell from 30 to 255. The view is from above, oblique.
    """
    rng = np.random.default_rng(seed)
    light = np.zeros(NERVE_SHAPE, np.float32)
    for capsule in _cell(rng):
        _paint(light, capsule)
    _paint_body(light)
    hints = Hints(
        points=((24.0, 0.0), (80.0, 0.4), (200.0, 0.8)),
        window=(0.0, 190.0),
        colormap="glow",
        shading=False,
        azimuth=0.0,
        elevation=66.0,
        fov=40.0,
    )
    return Volume(_expose(light, rng), name="nerve", hints=hints)


def _cell(rng: np.random.Generator) -> list[Capsule]:
    """All segments of the cell: one long apical dendrite, basal ones all around, and the axon."""
    capsules: list[Capsule] = []
    sprouts = [_from_body(95.0, 4.2, rng)]
    sprouts += [
        _from_body(angle + rng.uniform(-9, 9), rng.uniform(2.2, 3.1), rng) for angle in (28, 150, 200, 238, 318, 352)
    ]
    for sprout in sprouts:
        _grow(sprout, rng, capsules)
    axon = Sprout(BODY + BODY_AXES * _towards(283.0), _towards(283.0), 1.5, 0.9985, 0.012, 0.0)
    _grow(axon, rng, capsules, least=0.5)
    return capsules


def _towards(degrees: float, rise: float = 0.0) -> np.ndarray:
    return _unit(np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), rise]))


def _from_body(degrees: float, radius: float, rng: np.random.Generator) -> Sprout:
    heading = _towards(degrees, rng.uniform(-0.25, 0.25))
    return Sprout(BODY + BODY_AXES * heading * 0.7, heading, radius, 0.991, 0.075, 0.6)


def _grow(sprout: Sprout, rng: np.random.Generator, capsules: list[Capsule], least: float = THINNEST) -> None:
    """Appends the segments of a branch and of all its forks, until they are thin or leave the volume."""
    waiting = [sprout]
    while waiting:
        branch = waiting.pop()
        place, heading, radius = branch.place, branch.heading, branch.radius
        drift, travelled = rng.normal(0.0, 0.02, 3), 0
        while radius > least:
            # a step, mostly straight
            drift = MEMORY * drift + rng.normal(0.0, WANDER, 3) * (1.0, 1.0, FLATNESS)
            jitter = rng.normal(0.0, JITTER, 3) * (1.0, 1.0, FLATNESS)
            heading = _bend(place, heading + drift + jitter + OUTWARD * _unit(place - BODY))
            ahead, thinner = place + STEP * heading, radius * branch.taper
            if not ((ahead > 4.0) & (ahead < np.array(NERVE_SHAPE[::-1]) - 5.0)).all():
                break
            # thicker branches contain more dye
            capsules.append(Capsule(place, ahead, (radius, thinner), 0.6 + 0.3 * min(radius / 3.0, 1.0)))
            if rng.random() < branch.spines and radius < SPINY:
                capsules.extend(_spine(ahead, heading, radius, rng))
            place, radius, travelled = ahead, thinner, travelled + 1

            # a fork: the thinner branch is queued, the other continues
            if travelled > UNFORKED and rng.random() < branch.fork * (1.0 if radius > 1.0 else 0.5):
                side, heading = _fork(heading, rng)
                share = rng.uniform(0.3, 0.5)
                smaller, radius = radius * share ** (1 / RALL), radius * (1 - share) ** (1 / RALL)
                waiting.append(Sprout(place, side, smaller, branch.taper, branch.fork, branch.spines))
                travelled = 0


def _bend(place: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """A unit heading, bent smoothly towards the middle plane near the top and the bottom."""
    middle, reach = NERVE_SHAPE[0] / 2, NERVE_SHAPE[0] / 2 - MARGIN
    heading = heading - np.array([0.0, 0.0, 0.25]) * np.clip((place[2] - middle) / reach, -1, 1) ** 3
    return _unit(heading * (1.0, 1.0, 0.97))


def _fork(heading: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Two headings to opposite sides; the thinner branch turns farther."""
    side = rng.choice((-1.0, 1.0))
    across = np.array([-heading[1], heading[0], rng.normal(0.0, FLATNESS)]) * side
    return _unit(heading + across * rng.uniform(0.5, 1.0)), _unit(heading - across * rng.uniform(0.1, 0.4))


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def _spine(place: np.ndarray, heading: np.ndarray, radius: float, rng: np.random.Generator) -> list[Capsule]:
    """A neck across the branch and a head on it."""
    out = _unit(np.cross(heading, rng.normal(size=3)))
    root, head = place + out * radius * 0.8, place + out * (radius + rng.uniform(1.6, 3.2))
    return [Capsule(root, head, (0.45, 0.45), 0.75), Capsule(head, head + out * 0.3, (0.9, 0.9), 0.9)]


def _paint(light: np.ndarray, capsule: Capsule) -> None:
    """Raises the brightness inside a capsule with a soft edge; only nearby voxels are processed."""
    reach = max(capsule.radii) + SOFT
    margin = np.array([reach, reach, reach + SOFT * DEPTH_BLUR])
    low = np.maximum(np.floor(np.minimum(capsule.start, capsule.stop) - margin), 0).astype(int)
    high = np.minimum(np.ceil(np.maximum(capsule.start, capsule.stop) + margin) + 1, NERVE_SHAPE[::-1]).astype(int)
    x, y, z = (np.arange(low[axis], high[axis], dtype=np.float32) - capsule.start[axis] for axis in range(3))
    z = (z / DEPTH_BLUR**0.5)[:, None, None]
    y = y[:, None]

    # distance from the nearest point on the axis
    along = (capsule.stop - capsule.start) / (1.0, 1.0, DEPTH_BLUR**0.5)
    length = float(along @ along)
    t = np.clip((x * along[0] + y * along[1] + z * along[2]) / length, 0.0, 1.0)
    distance = np.sqrt((x - t * along[0]) ** 2 + (y - t * along[1]) ** 2 + (z - t * along[2]) ** 2)
    radius = capsule.radii[0] + t * (capsule.radii[1] - capsule.radii[0])
    box = light[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
    np.maximum(box, capsule.light * _edge(radius - distance), out=box)


def _paint_body(light: np.ndarray) -> None:
    """The cell body: an ellipsoid with a darker nucleus."""
    low, high = (BODY - BODY_AXES - 6).astype(int), (BODY + BODY_AXES + 7).astype(int)
    x, y, z = (np.arange(low[axis], high[axis]) - BODY[axis] for axis in range(3))
    z, y = z[:, None, None], y[:, None]
    egg = np.sqrt((x / BODY_AXES[0]) ** 2 + (y / BODY_AXES[1]) ** 2 + (z / BODY_AXES[2]) ** 2)
    nucleus = np.sqrt((x - 1.0) ** 2 + (y + 2.0) ** 2 + (z / 0.9) ** 2)
    glow = _edge((1.0 - egg) * BODY_AXES.min()) * (1.0 - 0.35 * _edge(6.0 - nucleus))
    box = light[low[2] : high[2], low[1] : high[1], low[0] : high[0]]
    np.maximum(box, glow, out=box)


def _edge(depth: np.ndarray) -> np.ndarray:
    """Smooth step from 0 at SOFT outside to 1 at SOFT inside."""
    t = np.clip(0.5 + depth / (2.0 * SOFT), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _expose(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """uint8 grey levels: signal with shot noise, and dark noise everywhere."""
    chances = rng.integers(0, 256, light.shape, dtype=np.uint8)
    # dark noise from a table: exponential, as for few photons
    dark = np.minimum(-DARK * np.log((np.arange(256) + 0.5) / 256), DARKEST).astype(np.uint8)
    grey = dark[chances]
    lit = np.flatnonzero(light.ravel() > 0.02)
    signal = FULL * light.ravel()[lit]
    noisy = signal + rng.standard_normal(len(lit)) * (1.0 + SHOT * np.sqrt(signal))
    grey.ravel()[lit] = np.clip(np.rint(noisy + grey.ravel()[lit]), 0, 255).astype(np.uint8)
    return grey

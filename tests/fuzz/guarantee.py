#!/usr/bin/env python
"""Random pictures whose statements are held against all pixels in float64: `guarantee.py [--count N] [--first SEED]`.

Each seed is a small picture of a random field, of threads and plates one voxel wide, or of single bright voxels; drawn
as it is, by an approximate form, or damaged: splats left out, a strip moved, pixels changed. What `sg.check` states
from some pixels is compared with all of them. Prints in how many pictures, by kind, more pixels are off than stated,
and exits with 1 if that is so in more than 5 % of them, or of the pictures of a kind by more than chance (1 in 1000).
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

import splatgl as sg
from splatgl.planning.scene import resolve_scene
from splatgl.reference.check import ALPHA, compare_sample
from splatgl.reference.renderer import reachable

Random = np.random.Generator

SCENES = ("field", "threads", "voxels")
DAMAGES = ("none", "form", "lost", "moved", "changed")
DRAWN = (20, 60, 160, 400)


@dataclass(frozen=True)
class Outcome:
    """Of a picture: its kinds; stated and true shares of pixels off by more than the largest drawn error, and of those
    off by more than the tolerance.
    """

    scene: str
    damage: str
    stated: float
    true: float
    stated_above: float
    true_above: float

    @property
    def wrong(self) -> tuple[bool, bool]:
        """Whether each statement is wrong."""
        return self.true > self.stated, self.true_above > self.stated_above


def cells_of(rng: Random, scene: str) -> np.ndarray:
    """Values from 0 to 1, float64 [D, H, W]."""
    shape = rng.integers(6, 13, 3)
    if scene == "field":
        cells = rng.random(shape)
        for axis in (0, 1, 2) * int(rng.integers(0, 3)):
            cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
        return np.asarray((cells - cells.min()) / np.ptp(cells))
    cells = np.zeros(shape)
    for _ in range(int(rng.integers(1, 5))):
        place: list[Any] = [int(rng.integers(n)) for n in shape]
        if scene == "threads":
            place[int(rng.integers(3))] = slice(None)
        if scene == "threads" and rng.random() < 0.2:
            place[int(rng.integers(3))] = slice(None)
        cells[tuple(place)] = rng.uniform(0.5, 1)
    return cells


def changed(rng: Random, pixels: np.ndarray) -> np.ndarray:
    """Pixels with errors in a random share of them, or at the edges."""
    some = rng.random(pixels.shape[:2]) < rng.choice([0.002, 0.01, 0.03, 0.1])
    if rng.random() < 0.3:
        some = np.abs(np.diff(pixels[..., 3], axis=1, prepend=0)) > 0.05
    size = rng.choice([1e-3, 1e-2, 0.1]) * rng.exponential(size=pixels.shape[:2])
    return np.asarray(pixels + (some * size)[..., None]).astype(np.float32)


def outcome(renderer: sg.Renderer, seed: int) -> Outcome:
    """What is stated of the picture of a seed, and what is true."""
    rng = np.random.default_rng(seed)
    scene, damage = str(rng.choice(SCENES)), str(rng.choice(DAMAGES))
    volume = sg.Volume(cells_of(rng, scene))
    transfer = sg.Transfer([(0.3, 0.0), (1.0, float(rng.choice([0.05, 0.4, 0.95])))], colormap="hot", window=(0, 1))
    pre = damage == "form" or rng.random() < 0.3
    blend = str(rng.choice(["composite", "composite", "xray", "mip"])) if damage != "form" else "composite"
    after = "post-all" if blend == "mip" else "post"
    splats = sg.extract(volume, transfer, classification="pre" if pre and blend != "mip" else after)
    zoom, size = float(rng.choice([0.5, 1.0, 2.0])), (int(rng.integers(20, 48)), int(rng.integers(20, 40)))
    camera = sg.Camera.orbit(volume, rng.uniform(-180, 180), rng.uniform(-80, 80), size=size, zoom=zoom)
    background = (None, (1.0, 1.0, 1.0))[rng.integers(2)]
    settings = sg.Settings(background=background, blend=blend)  # type: ignore[arg-type]
    if damage == "form":
        settings = settings.replace(align=str(rng.choice(["ray", "grid"])), target="rgba8", compositing="splats")
    right = sg.reference.render(splats, camera, settings).pixels
    drawn = splats.part(rng.random(len(splats)) > 0.05) if damage == "lost" else splats
    pixels = renderer.render(drawn, camera, settings, verify_bound=False).pixels.copy()
    if damage == "moved":
        rows = slice(*np.sort(rng.integers(0, size[1], 2)))
        pixels[rows] = np.roll(pixels[rows], 1, axis=1)
    image = sg.Image(changed(rng, pixels) if damage == "changed" else pixels)
    flat = right.reshape(-1, 4)
    reached = reachable(resolve_scene(splats, camera, settings))
    empty = np.zeros(4) if background is None or blend == "xray" else np.ones(4)
    assert np.abs(right[~reached] - empty).max(initial=0.0) < 1e-12, f"seed {seed}: matter in what no splat reaches"
    known = reached if rng.random() < 0.8 else None
    count = int(rng.choice(DRAWN))
    checked: Any = compare_sample(image, settings, count, lambda some: flat[some], known)[0].info["checked"]
    error = np.abs(image.pixels - right).max(axis=2)
    allowed = settings.tolerance * (float(image.pixels.max()) if settings.blend == "xray" else 1.0)
    true, above = float((error > checked["largest"]).mean()), float((error > allowed).mean())
    return Outcome(scene, damage, checked["share"], true, checked["share_above_tolerance"], above)


def chance(wrong: int, count: int) -> float:
    """Probability of so many wrong statements or more, if each is wrong with probability ALPHA."""
    number = np.arange(count)
    binomial = np.append(0.0, np.cumsum(np.log((count - number) / (number + 1))))
    number = np.arange(count + 1)
    terms = np.exp(binomial + number * np.log(ALPHA) + (count - number) * np.log1p(-ALPHA))
    return float(terms[wrong:].sum())


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2000, help="how many pictures (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="first seed (default: %(default)s)")
    chosen = parser.parse_args(arguments)
    kinds: dict[str, list[Outcome]] = defaultdict(list)
    with sg.Renderer() as renderer:
        for seed in range(chosen.first, chosen.first + chosen.count):
            each = outcome(renderer, seed)
            for kind in ("all", each.scene, each.damage):
                kinds[kind].append(each)
    failed = False
    print(f"{'pictures':<10} {'number':>7} {'wrong':>7} {'above tolerance wrong':>22}")
    for kind, some in kinds.items():
        wrong = np.sum([each.wrong for each in some], axis=0)
        print(f"{kind:<10} {len(some):>7} {wrong[0] / len(some):>7.2%} {wrong[1] / len(some):>22.2%}")
        failed |= max(wrong) > ALPHA * len(some) if kind == "all" else chance(max(wrong), len(some)) < 1e-3
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

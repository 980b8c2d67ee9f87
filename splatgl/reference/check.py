"""Compares a random sample of an image's pixels with the float64 reference, and infers bounds for all pixels.

Each of n draws takes one pixel of its own stratum; all strata have the weight W/n, W the sum of the weights of all
pixels, none below 1. Of a set of pixels of weight at least u W the draws meet none with probability Π (1 − uₕ) ≤
(1 − u)ⁿ, since the mean of the shares uₕ of the strata is u. With u = 1 − αⁿ⁻¹ this is α. Suppose that u W pixels or
more were off by more than the largest error drawn: then none of them was drawn. So, with confidence 1 − α, fewer are.

How many exceed a limit that is known before is Σ of independent events with mean n u, for which P(Σ ≤ c) is at most
that of the binomial distribution with the same mean, if c ≤ n u − 1 (Hoeffding 1956): the limit of Clopper and Pearson.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Any, Self
from zlib import crc32

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import light_of_display, srgb_from_linear
from splatgl.data.image import Accuracy, Image, aliasing_note
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.planning.bricks import Bricks
from splatgl.planning.scene import ResolvedScene, Scene, join_pictures, resolve_scene
from splatgl.reference.field import kept_field_integral
from splatgl.reference.renderer import reachable, reachable_of, render_pixels, render_pixels_of
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats

# probability that a statement is wrong
ALPHA = 0.05
# pixels that are drawn by default; of a volume in bricks, of which each extracts a column
PIXELS, BRICK_PIXELS = 60, 10
# pixels that measure how many a time allows, and the most that are then drawn
PILOT, MOST = 16, 1 << 14
# share of additional weight, distributed like the differences of neighbouring pixels
EDGES = 1 / 3
# limits of classes: additional weights, and brightnesses over the largest
WEIGHTS, BRIGHTNESSES = (0.25, 1.0, 4.0), (0.01, 0.25, 0.5)
# squares along each axis of the picture by which pixels are sorted, a power of two
TILES = 64
# a pixel that differs by less from the background counts as background
UNSEEN = 1e-6
# maximum number of pixels marched through the field, and rays along the sides of an antialiased pixel
FIELD_PIXELS, FIELD_SAMPLES = 64, 4

Drawn = Callable[[np.ndarray], np.ndarray]


@public
def check(
    image: Image | Any,
    splats: Scene | Splats | Any,
    camera: Camera | Any,
    settings: Settings | Any | None = None,
    amount: int | float | None = None,
    field: bool = False,
) -> Image:
    """Adds `info["checked"]` to an image of `Renderer.render`: errors of randomly drawn pixels against the float64
    reference, and what follows for all pixels.

    amount: number of pixels to draw (default PIXELS; 0: none), all if the picture has no more, or seconds, a float.
    field: also compares some of the pixels that show matter with the exact integral of the field, whose values are
    reconstructed and classified at every point of a ray: `info["checked"]["field"]`. Raises InputError as
    `resolve_scene` and `check_input`.
    """
    return _check(image, resolve_scene(splats, camera, settings or Settings()), amount, field)


def _check(image: Image, scene: ResolvedScene, amount: int | float | None, field: bool) -> Image:
    """`check` of a picture of a resolved scene."""
    check_input(scene, amount, field)
    if amount == 0:
        return image
    settings, draw = scene.settings, partial(render_pixels, scene)
    amount = PIXELS if amount is None else amount
    image, drawn = compare_sample(image, settings, amount, draw, reachable(scene))
    if field and len(drawn):
        shown = drawn[_is_visible(image.pixels, settings).ravel()[drawn]]
        shown = shown if len(shown) else drawn
        pixels = shown[np.linspace(0, len(shown) - 1, min(FIELD_PIXELS, len(shown))).astype(int)]
        samples, of = 1 if settings.antialias == "off" else FIELD_SAMPLES, scene.layers[0]
        exact = kept_field_integral(of.splats, scene.camera, pixels, samples, of.settings)
        off = image.pixels.reshape(-1, 4)[pixels] - exact
        errors = {"largest": float(np.abs(off).max()), "rmse": float(np.sqrt((off**2).mean()))}
        checked = image.info["checked"]
        assert isinstance(checked, dict)
        checked["field"] = {"pixels": len(pixels), **errors}
    return image


def check_input(scene: ResolvedScene, amount: int | float | None, field: bool) -> None:
    """Raises InputError for what `check` cannot compare with a picture of this scene: a field of no pixels, and that of
    voxels classified before reconstruction.
    """
    if amount is not None and not amount >= field:
        raise expected("--check", "pixels or seconds" + " of at least 1, with --field" * field, amount)
    if field and not scene.is_single:
        raise expected("--field", "a picture of one volume", "layers or meshes")
    if field and (why := scene.layers[0].why_before):
        got = f"voxels classified before ({why})"
        raise expected("--field", "values classified after reconstruction", got)


def compare(image: Image, amount: int | float | None = None, field: bool = False) -> Image:
    """Adds `info["checked"]` to a picture by what was drawn, also of bricks, under its annotations; as `check`."""
    if image.drawn is None:
        return image
    plain, scene = replace(image, pixels=image.drawn), image.plan.resolved
    if scene.bricks:
        return replace(image, info=_check_bricks(plain, scene, amount).info)
    return replace(image, info=_check(plain, scene, amount, field).info)


def accuracy_of(image: Image) -> Accuracy:
    """The error of a picture by its provenance, and by pixels, which are compared now unless they were before."""
    info = image.info
    known = [info.get(name) for name in ("error_bound", "tolerance")]
    bound, tolerance = (float(value) if isinstance(value, int | float) else None for value in known)
    met, level = info.get("tolerance_met"), info.get("level")
    checked = info.get("checked")
    checked = checked if isinstance(checked, dict) else compare(image).info.get("checked")
    # annotations scale sums
    brightest = float(image.pixels.max()) / float(str(info.get("scale", 1.0))) if image.is_sum else None
    return Accuracy(
        bound,
        tolerance,
        met if isinstance(met, bool) else None,
        checked if isinstance(checked, dict) else None,
        brightest,
        level if isinstance(level, int) else 0,
        aliasing_note(info),
    )


def check_bricks(
    image: Image, bricks: Bricks, camera: Camera, settings: Settings, amount: int | float | None = None
) -> Image:
    """Like `check`, for an image of `Renderer.render_bricks`; by default of BRICK_PIXELS pixels."""
    return _check_bricks(image, ResolvedScene((), camera, settings, bricks=((bricks, settings),)), amount)


def _check_bricks(image: Image, scene: ResolvedScene, amount: int | float | None) -> Image:
    """`check_bricks` of a volume, or of layers whose pictures are joined."""
    (_, settings), *others = scene.bricks

    def draw(wanted: np.ndarray) -> np.ndarray:
        pixels = [render_pixels_of(bricks, scene.camera, look, wanted) for bricks, look in scene.bricks]
        return join_pictures(pixels, scene.settings) if others else pixels[0]

    reached = None
    if amount != 0:
        reached = np.any([reachable_of(bricks, scene.camera, look) for bricks, look in scene.bricks], axis=0)
    amount = BRICK_PIXELS if amount is None else amount
    return compare_sample(image, scene.settings if others else settings, amount, draw, reached)[0]


def compare_sample(
    image: Image, settings: Settings, amount: int | float, draw: Drawn, reached: np.ndarray | None = None
) -> tuple[Image, np.ndarray]:
    """The image with `info["checked"]`, and the indices of the drawn pixels, ascending; the same image if there are
    none. draw: returns the exact pixels [P, 4] of ascending indices [P]. reached: bool [H, W], pixels to draw from,
    None for all; the others, which are exactly the background, are all compared with it.
    """
    if not amount:
        return image, np.zeros(0, np.int64)
    height, width = image.pixels.shape[:2]
    reached = np.ones((height, width), bool) if reached is None or not reached.any() else reached
    flat, sampling = image.pixels.reshape(-1, 4), Sampling.of(image.pixels, reached)
    count = min(amount if isinstance(amount, int) else _pixels_in_budget(sampling, draw, amount), len(sampling.order))
    wanted, times = sampling.draw(count)
    # of the others only those that are not the background
    nothing = _empty(settings)
    wrong = np.flatnonzero(~reached.ravel() & (flat != nothing.astype(flat.dtype)).any(axis=1))
    places, exact = np.append(wanted, wrong), np.concatenate([draw(wanted), np.tile(nothing, (len(wrong), 1))])
    square = (flat[places] - exact) ** 2
    error = np.sqrt(square.max(axis=1))
    allowed = settings.tolerance * settings.brightest(flat)
    drawn_above, above = int(times[error[: len(wanted)] > allowed].sum()), int((error[len(wanted) :] > allowed).sum())
    is_whole = count == len(sampling.order)
    part = times / (1.0 if is_whole else sampling.weights[wanted])
    part = np.append(part * (len(sampling.order) / part.sum()), np.ones(len(wrong)))
    worst = int(places[error.argmax()])
    above += drawn_above if is_whole else sampling.most_above(drawn_above, count)
    checked: dict[str, object] = {
        "pixels": count,
        "empty": len(flat) - len(sampling.order),
        "seed": sampling.seed,
        "largest": float(error.max()),
        "worst": [worst % width, worst // width],
        "rmse": float(np.sqrt(part @ square.mean(axis=1) / len(flat))),
        "confidence": 1.0 if is_whole else 1 - ALPHA,
        "share": 0.0 if is_whole else sampling.most_above(0, count) / len(flat),
        "share_above_tolerance": above / len(flat),
    }
    if isinstance(amount, float):
        checked["seconds"] = amount
    return replace(image, info={**image.info, "checked": checked}), wanted


def _empty(settings: Settings) -> np.ndarray:
    """[4]: the pixel that no splat reaches."""
    if settings.backdrop is None:
        return np.zeros(4)
    if not settings.mixes_display:
        return np.array([*settings.backdrop, 1.0])
    return light_of_display(np.array([*srgb_from_linear(np.array(settings.backdrop)), 1.0], np.float32))


def _pixels_in_budget(sampling: Sampling, draw: Drawn, seconds: float) -> int:
    """The number of pixels that fit the time, from a pilot sample, so that it does not depend on their errors."""
    stamps = [time.perf_counter()]
    # the first one fills caches, the second one shows what any number takes
    for count in (1, 1, PILOT):
        draw(sampling.draw(count, is_pilot=True)[0])
        stamps.append(time.perf_counter())
    _, fixed, pilot = np.diff(stamps)
    each = max((pilot - fixed) / (PILOT - 1), 1e-6)
    return int(np.clip((seconds - (stamps[-1] - stamps[0]) - fixed) / each, PILOT, MOST))


@dataclass(frozen=True, eq=False)
class Sampling:
    """Strata of some of a picture's pixels. weights [all pixels]: relative probabilities, at least 1. order [N]: the
    pixels, those of a stratum together: by weight, brightness and tile. seed: of the draws, a checksum of the picture.
    """

    weights: np.ndarray
    order: np.ndarray
    seed: int

    @classmethod
    def of(cls, pixels: np.ndarray, among: np.ndarray) -> Self:
        """Of pixels [H, W, 4], of which those `among` [H, W] are drawn: densest where neighbours differ, at most about
        once a pixel.
        """
        some = np.flatnonzero(among)
        differ, bright = (values.ravel()[some] for values in (_differences(pixels), _largest(pixels)))
        mean = float(differ.mean(dtype=np.float64)) or 1.0
        extra = np.minimum(differ * (EDGES / mean), len(some) / PIXELS)
        keys = [_rank(extra, WEIGHTS), _rank(bright, np.array(BRIGHTNESSES) * bright.max())]
        key = keys[0] << 14 | keys[1] << 12 | _tiles(*among.shape).ravel()[some]
        weights = np.ones(among.size)
        weights[some] += extra
        return cls(weights, some[np.argsort(key, kind="stable")], crc32(pixels.tobytes()))

    def draw(self, count: int, is_pilot: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Ascending indices of pixels, one of each of `count` strata, and how often each was drawn; all pixels, if
        there are no more.
        """
        if count >= len(self.order):
            return np.sort(self.order), np.ones(len(self.order), np.int64)
        total = np.cumsum(self.weights[self.order])
        random = np.random.default_rng((self.seed, int(is_pilot))).random(count)
        place = np.searchsorted(total, (np.arange(count) + random) * (total[-1] / count), side="right")
        drawn, times = np.unique(self.order[np.minimum(place, len(total) - 1)], return_counts=True)
        return drawn, times

    def most_above(self, above: int, drawn: int) -> int:
        """Upper limit of the number of pixels that are off by more than a limit, which `above` of `drawn` exceed."""
        weight = share_limit(above, drawn) * float(self.weights[self.order].sum())
        return min(ceil(weight) - 1, len(self.order))


def share_limit(above: int, drawn: int) -> float:
    """Upper limit of a probability, of which `above` of `drawn` trials came true, by Clopper and Pearson; 1 where
    Hoeffding's inequality is not known to hold.
    """
    if above >= max(drawn - 1, 1):
        return 1.0
    number = np.arange(above)
    binomial = np.append(0.0, np.cumsum(np.log((drawn - number) / (number + 1))))
    low, high = above / drawn, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        terms = binomial + np.arange(above + 1) * np.log(middle) + (drawn - np.arange(above + 1)) * np.log1p(-middle)
        low, high = (middle, high) if np.exp(terms).sum() > ALPHA else (low, middle)
    return high


def _differences(pixels: np.ndarray) -> np.ndarray:
    """[H, W]: largest differences of pixels [H, W, 4] from the four neighbours, over channels."""
    result = np.zeros(pixels.shape[:2], np.float32)
    for axis in (0, 1):
        step = np.moveaxis(_largest(np.diff(pixels, axis=axis)), axis, 0)
        for beside in (np.moveaxis(result, axis, 0)[1:], np.moveaxis(result, axis, 0)[:-1]):
            np.maximum(beside, step, out=beside)
    return result


def _largest(pixels: np.ndarray) -> np.ndarray:
    """[H, W]: largest absolute channels of pixels [H, W, 4]."""
    return np.asarray(np.maximum.reduce([np.abs(pixels[..., n]) for n in range(4)]))


def _rank(values: np.ndarray, limits: Sequence[float] | np.ndarray) -> np.ndarray:
    """uint16: how many limits values exceed."""
    return np.asarray(np.sum([values > limit for limit in limits], axis=0, dtype=np.uint16))


def _tiles(height: int, width: int) -> np.ndarray:
    """uint16 [H, W]: the tile of each pixel, so that near ones have near numbers: by interleaved bits (Morton 1966)."""
    bits = np.arange(TILES)
    spread = sum(((bits >> n & 1) << 2 * n for n in range(TILES.bit_length() - 1)), np.zeros(TILES, np.int64))
    down, across = (spread[np.arange(size) * TILES // size].astype(np.uint16) for size in (height, width))
    tiles: np.ndarray = down[:, None] << 1 | across
    return tiles


def _is_visible(pixels: np.ndarray, settings: Settings) -> np.ndarray:
    """bool [H, W]: which pixels show more than the background."""
    if settings.backdrop is None:
        return np.asarray(pixels[..., 3] > 0)
    off = [np.abs(pixels[..., n] - np.float64(color)) > UNSEEN for n, color in enumerate(settings.backdrop)]
    return np.asarray(off[0] | off[1] | off[2])

"""Classifies differences: shift, flip, gamma, premultiplication, offset, noise, missing object, …

Candidate changes are applied to the reference: a result close to the actual image names the difference.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.comparison.metrics import Comparison
from splatgl.data.color import linear_from_srgb, srgb_from_linear

# pixels examined along the longer side: more pixels do not change the classification
EXAMINED = 512
# a change explains the difference if at most this fraction of its RMS remains
EXPLAINED = 0.25
# up to this many differing pixels are only counted, not classified
FEW_PIXELS = 4
# an offset is a few levels in nearly all pixels, within rounding of half a level
OFFSET_LIMIT, OFFSET_SHARE, HALF_LEVEL = 8 / 255, 0.8, 0.5 / 255
# a region is at most half the image, with a tenth of its box changed and nearly all squared differences inside
REGION_SHARE, REGION_FILL, REGION_SQUARES = 0.5, 0.1, 0.95
# an object is missing if the opacity, or else the detail, falls by these fractions
LESS_OPACITY, LESS_DETAIL = 0.3, 0.4
# noise: many differences, with little correlation between neighbours
ALIKE, MANY = 0.3, 0.01


@dataclass(frozen=True)
class DifferenceKind:
    """name: a short category for sorting. text: a description with the numbers."""

    name: str
    text: str


# squares of the largest floats overflow to infinity; no change explains them
@np.errstate(over="ignore", invalid="ignore")
def classify_difference(actual: np.ndarray, right: np.ndarray, comparison: Comparison) -> DifferenceKind:
    """The kind of change between two different images, linear premultiplied [H, W, 4] of one size."""
    a, b = (np.asarray(p, np.float32) for p in (actual, right))
    if comparison.peak != 1:
        a, b = a / np.float32(comparison.peak), b / np.float32(comparison.peak)
    if not a.any() and b.any():
        return DifferenceKind("empty", "empty: every pixel is 0")
    return (
        _few_pixels(a, b, comparison)
        or _offset(a, b)
        or _global_change(a, b)
        or _noise(a, b)
        or _region(a, b, comparison)
        or DifferenceKind("changed", "changed in no way that has a name")
    )


def _few_pixels(a: np.ndarray, b: np.ndarray, comparison: Comparison) -> DifferenceKind | None:
    count = round(comparison.share_over * comparison.pixels)
    if comparison.box is None or not 0 < count <= FEW_PIXELS or not _mostly_in(a, b, comparison.box):
        return None
    return DifferenceKind("pixels", "one wrong pixel" if count == 1 else f"{count} wrong pixels")


def _mostly_in(a: np.ndarray, b: np.ndarray, box: tuple[int, int, int, int]) -> bool:
    left, top, right, bottom = box
    inside = slice(top, bottom), slice(left, right)
    return _squares(a[inside] - b[inside]) >= REGION_SQUARES * _squares(a - b)


def _squares(d: np.ndarray) -> float:
    return float(np.vdot(d, d))


def _offset(a: np.ndarray, b: np.ndarray) -> DifferenceKind | None:
    """A constant small offset, in sRGB samples or in linear light."""
    a, b = _thin(a), _thin(b)
    visible = (b[..., 3] > 0) & (a[..., 3] > 0)
    # an offset changes nearly all pixels
    if not visible.any() or np.mean((a != b).any(axis=-1)[visible]) < OFFSET_SHARE:
        return None
    straight = [p[visible][:, :3] / p[visible][:, 3:] for p in (a, b)]
    encoded = [srgb_from_linear(np.clip(c, 0, 1)) for c in straight]
    for space, (x, y) in (("sRGB", encoded), ("linear light", straight)):
        d = x.astype(np.float64) - y
        middle = float(np.median(d))
        alike = np.mean(np.abs(d - middle) <= max(abs(middle) / 4, 1e-6))
        if HALF_LEVEL / 2 < abs(middle) <= OFFSET_LIMIT and alike >= OFFSET_SHARE:
            return DifferenceKind("offset", f"offset by {255 * middle:+.2g}/255 everywhere ({space})")
    return None


def _thin(p: np.ndarray) -> np.ndarray:
    step = max(1, -(-max(p.shape[:2]) // EXAMINED))
    return p[::step, ::step]


def _global_change(a: np.ndarray, b: np.ndarray) -> DifferenceKind | None:
    """The best global change, if it explains the difference."""
    x, y = _thin(a), _thin(b)
    whole, left = _squares(x - y), []
    if whole:
        left = [(_squares(x - _thin(flipped)) / whole, kind) for kind, flipped in _flips(b)]
        factor = float(np.vdot(x[..., :3], y[..., :3])) / (_squares(y[..., :3]) or 1.0)
        # what a change leaves in the pixels that differ is the least that it leaves in all
        differ = (x != y).any(axis=-1)
        few = x[differ][None], y[differ][None]
        likely = {kind.text for kind, z in _changes(few[1], factor) if _squares(few[0] - z) <= EXPLAINED**2 * whole}
        changes = _changes(y, factor) if likely else ()
        left += [(_squares(x - changed) / whole, kind) for kind, changed in changes if kind.text in likely]
    shift = _shift(a, b)
    ratio, kind = min([*left, *([shift] if shift else [])], key=lambda pair: pair[0], default=(1.0, None))
    return kind if ratio <= EXPLAINED**2 else None


def _flips(b: np.ndarray) -> Iterator[tuple[DifferenceKind, np.ndarray]]:
    """Yields candidate moves of all pixels with their results on the reference."""
    yield DifferenceKind("flipped", "flipped upside down"), b[::-1]
    yield DifferenceKind("flipped", "flipped left to right"), b[:, ::-1]
    yield DifferenceKind("flipped", "turned by 180°"), b[::-1, ::-1]
    if b.shape[0] == b.shape[1]:
        yield DifferenceKind("flipped", "rows and columns swapped"), b.transpose(1, 0, 2)


def _changes(b: np.ndarray, factor: float) -> Iterator[tuple[DifferenceKind, np.ndarray]]:
    """Yields candidate changes of each pixel with their results on the reference. factor: of its colours."""
    alpha = b[..., 3:]
    color = _divide_alpha(b[..., :3], alpha)
    encoded = srgb_from_linear(color)
    for text, changed in (
        ("gamma: sRGB applied twice, or linear light taken for sRGB's (too light)", encoded * alpha),
        ("gamma: sRGB never applied, or undone twice (too dark)", linear_from_srgb(color) * alpha),
    ):
        yield DifferenceKind("gamma", text), _with_alpha(changed, alpha)
    for text, changed in (
        ("premultiplication: colour multiplied by alpha twice", b[..., :3] * alpha),
        ("premultiplication: colour not multiplied by alpha", color),
        ("premultiplication: sRGB samples multiplied by alpha", linear_from_srgb(encoded * alpha) * alpha),
        ("premultiplication: sRGB samples divided by alpha", linear_from_srgb(_divide_alpha(encoded, alpha)) * alpha),
    ):
        yield DifferenceKind("premultiplication", text), _with_alpha(changed, alpha)
    yield DifferenceKind("alpha", "alpha is lost: over black"), _with_alpha(b[..., :3], np.ones_like(alpha))
    yield DifferenceKind("alpha", "alpha is lost: its colour stayed"), _with_alpha(color, np.ones_like(alpha))
    yield DifferenceKind("channels", "red and blue swapped"), b[..., [2, 1, 0, 3]]
    yield DifferenceKind("brightness", f"colours times {factor:.3g}"), _with_alpha(b[..., :3] * factor, alpha)


def _divide_alpha(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Colour divided by alpha, 0 for zero alpha, clamped to [0, 1]."""
    return np.clip(np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0), 0, 1)


def _with_alpha(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    return np.concatenate([color, alpha], axis=-1).astype(np.float32)


def _shift(a: np.ndarray, b: np.ndarray) -> tuple[float, DifferenceKind] | None:
    """A shift by whole pixels, from the peak of the phase correlation in the image centre."""
    height, width = a.shape[:2]
    top, left = max(0, (height - EXAMINED) // 2), max(0, (width - EXAMINED) // 2)
    middle = slice(top, top + EXAMINED), slice(left, left + EXAMINED)
    x, y = (p[middle].sum(axis=-1) for p in (a, b))
    spectrum = np.fft.rfft2(x - x.mean()) * np.conj(np.fft.rfft2(y - y.mean()))
    peak = np.fft.irfft2(spectrum / np.maximum(np.abs(spectrum), np.finfo(np.float32).tiny), x.shape)
    place = np.unravel_index(int(peak.argmax()), x.shape)
    down, across = (int(i) if i <= n // 2 else int(i) - n for i, n in zip(place, x.shape, strict=True))
    if (down, across) == (0, 0):
        return None
    # only the overlap after the shift
    moved, still = _overlap(a[middle], down, across), _overlap(b[middle], -down, -across)
    whole = _squares(moved - _overlap(b[middle], down, across))
    if whole == 0:
        return None
    parts = [_pixels(across, "right", "left"), _pixels(down, "down", "up")]
    text = f"shifted by {' and '.join(part for part in parts if part)}"
    return _squares(moved - still) / whole, DifferenceKind("shifted", text)


def _overlap(p: np.ndarray, down: int, across: int) -> np.ndarray:
    height, width = p.shape[:2]
    return p[max(down, 0) : height + min(down, 0), max(across, 0) : width + min(across, 0)]


def _pixels(count: int, positive: str, negative: str) -> str:
    noun = "pixel" if abs(count) == 1 else "pixels"
    return f"{abs(count)} {noun} {positive if count > 0 else negative}" if count else ""


def _region(a: np.ndarray, b: np.ndarray, comparison: Comparison) -> DifferenceKind | None:
    """A local change: an object is missing, added, or different."""
    if comparison.box is None:
        return None
    left, top, right, bottom = comparison.box
    area, whole = (right - left) * (bottom - top), a.shape[0] * a.shape[1]
    fill = comparison.share_over * comparison.pixels / area
    if area > REGION_SHARE * whole or fill < REGION_FILL or not _mostly_in(a, b, comparison.box):
        return None
    size = f"{right - left}×{bottom - top} pixels"
    inside = slice(top, bottom), slice(left, right)
    now, before = (float(p[inside][..., 3].mean()) for p in (a, b))
    less = _change(now, before, LESS_OPACITY)
    if not less:
        less = _change(_detail(a[inside]), _detail(b[inside]), LESS_DETAIL)
        # a painted-over area also has less detail, but a stronger edge
        if less * (_edge(a, comparison.box) - _edge(b, comparison.box)) < 0:
            less = 0
    if less < 0:
        return DifferenceKind("missing", f"an object is missing ({size})")
    if less > 0:
        return DifferenceKind("extra", f"an extra object ({size})")
    return DifferenceKind("region", f"a part is changed ({size})")


def _change(now: float, before: float, share: float) -> int:
    """−1 if less than before by the fraction, 1 if more, else 0."""
    return int(before < (1 - share) * now) - int(now < (1 - share) * before)


def _edge(p: np.ndarray, box: tuple[int, int, int, int]) -> float:
    """Change from just outside the box to just inside, summed around it."""
    left, top, right, bottom = box
    across = [p[max(row - 1, 0) : row + 1, left:right] for row in (top, bottom)]
    along = [p[top:bottom, max(column - 1, 0) : column + 1] for column in (left, right)]
    steps = [np.diff(side, axis=axis) for axis, sides in enumerate((across, along)) for side in sides]
    return float(sum(np.abs(step).sum() for step in steps))


def _detail(p: np.ndarray) -> float:
    return float(np.abs(np.diff(p, axis=0)).sum() + np.abs(np.diff(p, axis=1)).sum())


def _noise(a: np.ndarray, b: np.ndarray) -> DifferenceKind | None:
    """Many differences, uncorrelated with their neighbours."""
    middle = slice(0, EXAMINED), slice(0, EXAMINED)
    d = (a[middle] - b[middle])[..., :3]
    squares = _squares(d)
    changed = float((np.abs(d).max(axis=-1) > 0).mean())
    if squares == 0 or changed < MANY or min(d.shape[:2]) < 2:
        return None
    alike = max(abs(float(np.vdot(d[1:], d[:-1]))), abs(float(np.vdot(d[:, 1:], d[:, :-1])))) / squares
    return DifferenceKind("noise", f"noise of RMS {np.sqrt(squares / d.size):.3g}") if alike < ALIKE else None

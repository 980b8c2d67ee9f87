"""Classifies differences: shift, flip, gamma, premultiplication, offset, noise, missing object, …

Candidate changes are applied to the reference: a result close to the actual image names the difference.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.comparison.metrics import Comparison, connected_groups
from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.image import bounding_box

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
# a drawing, such as a chart: one opaque colour covers this share of it, and few others cover a share of the rest
GROUND_SHARE, FEW_COLORS, COLORS_SHARE = 0.5, 16, 0.5
# changes belong together if their squares of this many pixels touch; parts of a drawing that are described one by one,
# and the most that are counted
SQUARE, FEW_PARTS, MOST_PARTS = 12, 2, 60
# levels by which ink differs from the ground, and colours from each other
INK = 24
# share of the ink that two parts of one form have in common, and least change of a size
SAME_FORM, OTHER_SIZE = 0.8, 0.04
# share of the ink of a thinner part that the thicker one has, too
ALL_INK = 0.98
# pixels around a changed part in which ink is a part of it, and least share of its pixels that has its colour
NEAR, LEAST_SHARE = 2, 0.02


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
        or _drawing(a, b)
        or _region(a, b, comparison)
        or DifferenceKind("changed", f"{100 * comparison.share_over:.3g} % of the pixels changed, in no single way")
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


# names of kinds of parts of drawings
OF_DRAWINGS = ("drawing", "reshaped", "larger", "smaller", "thicker", "thinner", "recoloured")


def _drawing(a: np.ndarray, b: np.ndarray) -> DifferenceKind | None:
    """Changes of the parts of a chart or another drawing on an even ground: moved, larger, in another colour, …"""
    levels = [np.rint(255 * srgb_from_linear(np.clip(p[..., :3], 0, 1))).astype(np.int16) for p in (a, b)]
    colors, counts = np.unique(_packed(levels[1]), return_counts=True)
    order = np.argsort(-counts)
    few = counts[order[1 : FEW_COLORS + 1]].sum()
    ground, rest = counts[order[0]], counts.sum() - counts[order[0]]
    if min(a[..., 3].min(), b[..., 3].min()) < 1 or ground < GROUND_SHARE * counts.sum() or few < COLORS_SHARE * rest:
        return None
    background = _unpacked(colors[order[0]])
    ink = [np.abs(p - background).max(axis=-1) > INK for p in levels]
    groups = list(_groups(np.abs(levels[0] - levels[1]).max(axis=-1) > 1))
    parts = [
        part for group in groups[:MOST_PARTS] if (part := _changed_part(levels, ink, group, background)) is not None
    ]
    if not parts or len(groups) > MOST_PARTS:
        return None
    if len(parts) <= FEW_PARTS:
        return DifferenceKind(parts[0].name, " and ".join(dict.fromkeys(part.text for part in parts)))
    words = Counter(part.name for part in parts)
    name, most = words.most_common(1)[0]
    text = f"{len(parts)} parts of the drawing: {', '.join(f'{n} {word}' for word, n in words.most_common())}"
    is_text = name in ("larger", "smaller") and most >= len(parts) / 2
    return DifferenceKind("drawing", f"{text}, as by another font size" if is_text else text)


def _packed(levels: np.ndarray) -> np.ndarray:
    """int32 [H, W] of colours [H, W, 3], levels."""
    return np.asarray(levels.astype(np.int32) @ np.array((65536, 256, 1), np.int32))


def _unpacked(color: int) -> np.ndarray:
    return np.array([color >> 16, color >> 8 & 255, color & 255], np.int16)


def _groups(different: np.ndarray) -> Iterator[np.ndarray]:
    """bool [H, W] of the pixels [H, W] of each group of neighbouring squares."""
    height, width = different.shape
    padded = np.pad(different, ((0, -height % SQUARE), (0, -width % SQUARE)))
    squares = padded.reshape(len(padded) // SQUARE, SQUARE, -1, SQUARE).any(axis=(1, 3))
    for places in connected_groups((row, column) for row, column in np.argwhere(squares).tolist()):
        group = np.zeros_like(squares)
        group[tuple(np.transpose(places))] = True
        yield different & group.repeat(SQUARE, 0).repeat(SQUARE, 1)[:height, :width]


def _changed_part(
    levels: list[np.ndarray], ink: list[np.ndarray], group: np.ndarray, background: np.ndarray
) -> DifferenceKind | None:
    """The change of a group of pixels: its name, and a sentence; None where no ink is, or one of many colours."""
    left, top, right, bottom = bounding_box(group)
    box, size = (slice(top, bottom), slice(left, right)), f"{right - left}×{bottom - top} pixels"
    changed = [part & group for part in ink]
    if not any(part.any() for part in changed):
        return None
    common = [_main_color(p[part], background) for p, part in zip(levels, changed, strict=True)]
    known = [color for color in common if color is not None]
    if not known:
        return None
    # rare colours are edges in the other one
    common = [known[0] if color is None and part.any() else color for color, part in zip(common, changed, strict=True)]
    names = [None if code is None else f"#{code:06x}" for code in common]
    if None in names:
        is_new = names[1] is None
        around = tuple(slice(max(side.start - NEAR, 0), side.stop + NEAR) for side in box)
        # where ink of that colour touches the changed part, it has grown or shrunk
        if (_packed(levels[is_new][around]) == common[not is_new]).any():
            name = "larger" if is_new else "smaller"
            return DifferenceKind(name, f"a part in {names[not is_new]} is {name} ({size})")
        name, words = ("extra", "an extra object") if is_new else ("missing", "an object is missing")
        return DifferenceKind(name, f"{words} ({size})")
    now, before = (part[box] for part in ink)
    if _shared(now, before) >= SAME_FORM and np.ptp([_unpacked(color or 0) for color in common], axis=0).max() > INK:
        return DifferenceKind("recoloured", f"a part has the colour {names[0]} instead of {names[1]} ({size})")
    (top, left, tight), (top_before, left_before, tight_before) = (_tight(part) for part in (now, before))
    form = f"a part in {names[0]}"
    by = left - left_before, top - top_before
    if tight.shape == tight_before.shape and any(by) and _shared(tight, tight_before) >= SAME_FORM:
        parts = filter(None, (_pixels(by[0], "right", "left"), _pixels(by[1], "down", "up")))
        return DifferenceKind("moved", f"{form} is moved by {' and '.join(parts)} ({size})")
    both = np.count_nonzero(now & before)
    inks = int(np.count_nonzero(now)), int(np.count_nonzero(before))
    for name, less, more in (("thicker", *inks[::-1]), ("thinner", *inks)):
        if both >= ALL_INK * less and more > less:
            return DifferenceKind(name, f"{form} is {name} ({size})")
    ratio = tight.size / tight_before.size - 1
    if abs(ratio) > OTHER_SIZE:
        name = "larger" if ratio > 0 else "smaller"
        sides = [f"{part.shape[1]}×{part.shape[0]}" for part in (tight, tight_before)]
        return DifferenceKind(name, f"{form} is {name}: {sides[0]} instead of {sides[1]} pixels")
    if _shared(now, before) >= SAME_FORM:
        return None
    return DifferenceKind("reshaped", f"{form} has another form ({size})")


def _main_color(colors: np.ndarray, background: np.ndarray) -> int | None:
    """The packed colour of the ink [N, 3], levels: frequent, and far from the background; None if all are rare."""
    values, counts = np.unique(_packed(colors), return_counts=True)
    if not len(values) or counts.max() < LEAST_SHARE * len(colors):
        return None
    far = [float(np.abs(_unpacked(value) - background).max()) for value in values.tolist()]
    return int(values[(counts * np.square(far)).argmax()])


def _shared(a: np.ndarray, b: np.ndarray) -> float:
    """Share of the pixels of either that both have."""
    return int(np.count_nonzero(a & b)) / max(int(np.count_nonzero(a | b)), 1)


def _tight(ink: np.ndarray) -> tuple[int, int, np.ndarray]:
    """First row and column with ink [H, W], and the ink within its box."""
    left, top, right, bottom = bounding_box(ink)
    return top, left, ink[top:bottom, left:right]

"""The metrics against those who defined them, scikit-image and flip-evaluator; one step of rounding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.comparison import metrics
from splatgl.comparison.metrics import compare, exceeds_threshold
from splatgl.comparison.verdict import Pair
from splatgl.data.color import srgb_from_linear

BASELINES = Path(__file__).parent / "baselines" / "test_scenes"
AGREE = 1e-6
# photographs that come with scikit-image
PHOTOGRAPHS = ("astronaut", "coffee")


def photograph(name: str) -> np.ndarray:
    pictures = pytest.importorskip("skimage.data", reason="scikit-image is in the extra dev")
    return np.asarray(getattr(pictures, name)()[40:240, 150:410])


def pair(name: str) -> tuple[sg.Image, sg.Image]:
    """A picture and the same with noise, a shift of a part, and another exposure."""
    photo = name in PHOTOGRAPHS
    right = sg.Image.from_samples(photograph(name)) if photo else sg.Image.load(BASELINES / f"{name}.png")
    pixels = right.pixels * np.float32(0.97)
    pixels[20:40] = np.roll(pixels[20:40], 2, axis=1)
    pixels += np.random.default_rng(5).normal(0, 0.01, pixels.shape).astype(np.float32)
    pixels = np.clip(pixels, 0, 1)
    if photo:
        pixels[..., 3] = 1
    # as floats, which are compared as they are
    return sg.Image(pixels), sg.Image(right.pixels)


PICTURES = [*PHOTOGRAPHS, "tunnel-composite", "terrain-composite", "nerve-mip"]


@pytest.mark.few(3)
@pytest.mark.parametrize("name", PICTURES)
def test_ssim_and_psnr_are_scikit_images(name: str) -> None:
    theirs = pytest.importorskip("skimage.metrics", reason="scikit-image is in the extra dev")
    a, b = pair(name)
    found = sg.compare(a, b, extra=("ssim",))
    x, y = a.pixels.astype(np.float64), b.pixels.astype(np.float64)
    assert found.ssim == pytest.approx(theirs.structural_similarity(x, y, channel_axis=-1, data_range=1), abs=AGREE)
    assert found.psnr == pytest.approx(theirs.peak_signal_noise_ratio(y, x, data_range=1), abs=AGREE)
    assert 0.3 < found.ssim < 0.999


@pytest.mark.few(2)
@pytest.mark.parametrize("name", PICTURES)
def test_flip_is_flip_evaluators(name: str) -> None:
    """By its usual way: sRGB pictures without alpha, so over black and over white."""
    theirs = pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    a, b = pair(name)
    means = []
    for ground in (0.0, 1.0):
        shown = [
            srgb_from_linear(np.clip(i.pixels[..., :3] + (1 - i.pixels[..., 3:]) * np.float32(ground), 0, 1)).astype(
                np.float32
            )
            for i in (b, a)
        ]
        means.append(theirs.evaluate(shown[0], shown[1], "LDR", applyMagma=False)[1])
    assert sg.compare(a, b, extra=("flip",)).flip == pytest.approx(max(means), abs=AGREE)
    assert max(means) > 0.01


def test_ssim_and_flip_of_a_part() -> None:
    """The means over the mask of the maps that scikit-image and flip-evaluator give."""
    theirs = pytest.importorskip("skimage.metrics", reason="scikit-image is in the extra dev")
    evaluator = pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    a, b = (image.pixels for image in pair("coffee"))
    mask = np.zeros(a.shape[:2], bool)
    mask[30:70, 90:140] = True
    x, y = (np.where(mask[..., None], p, 0) for p in (a, b))
    doubles = [p.astype(np.float64) for p in (x, y)]
    _, ssim = theirs.structural_similarity(*doubles, channel_axis=-1, data_range=1, full=True)
    # windows of 7×7 that hold one of the pixels: their middle is up to 3 away
    assert metrics.ssim(x, y, 1.0, mask) == pytest.approx(ssim[27:73, 87:143].mean(), abs=AGREE)
    found = sg.compare(sg.Image(a), sg.Image(b), extra=("ssim", "flip"), mask=mask)
    assert (found.ssim, found.flip) == (metrics.ssim(x, y, 1.0, mask), metrics.flip(x, y, 1.0, mask))
    x[..., 3] = y[..., 3] = 1
    shown = [srgb_from_linear(p[..., :3]).astype(np.float32) for p in (y, x)]
    errors = evaluator.evaluate(*shown, "LDR", applyMagma=False)[0][..., 0]
    assert metrics.flip(x, y, 1.0, mask) == pytest.approx(errors[mask].mean(dtype=np.float64), abs=AGREE)
    assert errors[mask].mean() > 2 * errors.mean(), "what is outside would thin it"


def test_flip_sees_what_only_alpha_tells() -> None:
    pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    a, b = np.zeros((32, 32, 4), np.float32), np.zeros((32, 32, 4), np.float32)
    b[8:24, 8:24, 3] = 1
    assert metrics.flip(a, b) > 0.1
    assert metrics.flip(b, b) == 0


def test_missing_flip_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "flip_evaluator", None)
    with pytest.raises(sg.InputError, match=r"flip: needs the library flip-evaluator; .*splatgl\[compare\]"):
        metrics.flip(np.ones((8, 8, 4)), np.ones((8, 8, 4)))


def test_ssim_by_hand() -> None:
    """Two constant windows: only the luminance term is left, (2xy + c1) / (x² + y² + c1)."""
    x, y, c1 = 0.5, 0.25, 1e-4
    found = metrics.ssim(np.full((7, 7, 1), x), np.full((7, 7, 1), y))
    assert found == pytest.approx((2 * x * y + c1) / (x * x + y * y + c1), abs=1e-12)
    # scaled with the peak, nothing changes
    assert metrics.ssim(np.full((7, 7, 1), 9 * x), np.full((7, 7, 1), 9 * y), 9) == pytest.approx(found, abs=1e-12)
    with pytest.raises(sg.InputError, match="ssim: expected a picture of at least 7×7 pixels, got 7×6"):
        metrics.ssim(np.zeros((6, 7, 4)), np.zeros((6, 7, 4)))


def slow_unmatched(a: np.ndarray, b: np.ndarray, over: np.ndarray, limit: float) -> int:
    """The definition, pixel by pixel."""
    count = 0
    for row, column in np.argwhere(over):
        around = slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2)
        for x, y in ((a, b), (b, a)):
            near = y[around].reshape(-1, 4)
            if ((x[row, column] < near.min(0) - limit) | (x[row, column] > near.max(0) + limit)).any():
                count += 1
                break
    return count


@pytest.mark.parametrize("height", [7, 38, 39, 40])
def test_ssim_counts_the_windows_at_each_rim(height: int) -> None:
    """Also the single row of windows in the last band: equal pictures but for a pixel in a corner."""
    a = np.random.default_rng(4).random((height, 9, 1))
    for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
        b = a.copy()
        b[row, column] += 0.5
        # in one of the windows
        part = [pixels[:7] if row == 0 else pixels[-7:] for pixels in (a, b)]
        part = [pixels[:, :7] if column == 0 else pixels[:, -7:] for pixels in part]
        lost = 1 - metrics.ssim(*part)
        assert lost > 0.01 and 1 - metrics.ssim(a, b) == pytest.approx(lost / ((height - 6) * 3))


@pytest.mark.parametrize("shape", [(3, 5), (7, 7), (13, 9), (13, 3)])
def test_the_densest_window_may_stand_out_of_the_picture(shape: tuple[int, int], rng: np.random.Generator) -> None:
    """Of pixels that do not touch each other, on lines that are too short to count."""
    for share in (0.1, 0.5, 1.0):
        over = np.zeros(shape, bool)
        over[::2, ::2] = rng.random(over[::2, ::2].shape) < share
        over[-1, -1] = True
        windows = [over[max(y, 0) : y + 7, max(x, 0) : x + 7] for y in range(-6, shape[0]) for x in range(-6, shape[1])]
        assert metrics.densest_share(over) == pytest.approx(max(int(window.sum()) for window in windows) / 49)


@pytest.mark.parametrize("shape", [(70, 9, 4), (33, 40, 4), (1, 5, 4)])
def test_unmatched_is_its_definition(shape: tuple[int, int, int], rng: np.random.Generator) -> None:
    a = (rng.random(shape) > 0.7).astype(np.float32)
    b = np.roll(a, 1, 1)
    b[rng.random(shape[:2]) > 0.9] = 0.5
    over = (np.abs(a - b).max(axis=-1) > 0.01) & (rng.random(shape[:2]) > 0.2)
    assert metrics.count_unmatched(a, b, over, 0.01) == slow_unmatched(a, b, over, 0.01)
    assert metrics.count_unmatched(a, a, np.ones(shape[:2], bool), 0.0) == 0


@pytest.mark.parametrize("threshold", [None, 0.05])
def test_unmatched_is_relative_to_the_peak(threshold: float | None, rng: np.random.Generator) -> None:
    a = np.float32(0.2) * rng.random((30, 20, 4)).astype(np.float32)
    b = a + rng.normal(0, 0.05, a.shape).astype(np.float32)
    over = np.ones(a.shape[:2], bool)
    found = metrics.count_unmatched(a, b, over, threshold)
    assert 10 < found < 590
    assert metrics.count_unmatched(64 * a, 64 * b, over, threshold, 64.0) == found


def test_unmatched_tells_a_moved_edge_from_a_missing_line() -> None:
    edge, moved, line = (np.zeros((20, 20, 4), np.float32) for _ in range(3))
    edge[:, 10:], moved[:, 11:] = 1, 1
    line[:, 5] = 1
    found = sg.compare(sg.Image(moved), sg.Image(edge))
    assert found.share_over == 1 / 20 and found.share_unmatched == 0
    found = sg.compare(sg.Image(edge * 0), sg.Image(line))
    assert found.share_over == found.share_unmatched == 1 / 20


# --- one step of rounding ---------------------------------------------------------------------------------------------


LEVELS = np.arange(256)


def over(a: np.ndarray, b: np.ndarray, peak: float = 1.0) -> np.ndarray:
    """Of pictures from samples, uint8 [H, W, 4]."""
    x, y = (sg.Image.from_samples(samples.astype(np.uint8)).pixels * np.float32(peak) for samples in (a, b))
    return exceeds_threshold(x, y, np.abs(x - y).max(axis=-1), None, peak)


def samples(color: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Each colour with each alpha, [alphas, colours, 4]; green is the colour, red and blue lie between."""
    alpha, color = np.meshgrid(alpha, color, indexing="ij")
    return np.stack([color // 2, color, color // 3, alpha], axis=-1)


@pytest.mark.parametrize("peak", [1.0, 40.0])
@pytest.mark.parametrize("color", [-1, 0, 1])
@pytest.mark.parametrize("alpha", [-1, 0, 1])
def test_one_step_of_color_and_of_alpha_is_rounding(color: int, alpha: int, peak: float) -> None:
    """All 256 × 256 pixels. A colour without alpha is nowhere to be seen, and may be any."""
    right = samples(LEVELS, LEVELS)
    moved = samples(np.clip(LEVELS + color, 0, 255), np.clip(LEVELS + alpha, 0, 255))
    assert not over(moved, right, peak).any()


@pytest.mark.parametrize("steps", [-2, 2])
def test_two_steps_of_an_opaque_color_are_not(steps: int) -> None:
    """In the darks as next to white, where a step is 7 and 30 times as large."""
    right = samples(LEVELS[2:-2], np.array([255]))
    moved = right.copy()
    moved[..., 1] += steps
    assert over(moved, right).all()


@pytest.mark.parametrize("steps", [-2, 2])
def test_two_steps_of_alpha_are_not(steps: int) -> None:
    right = samples(LEVELS, LEVELS[2:-2])
    moved = right.copy()
    moved[..., 3] += steps
    assert over(moved, right).all()


def test_a_step_of_alpha_excuses_no_more_of_a_color_than_its_share() -> None:
    right, moved = samples(np.array([20]), np.array([255])), samples(np.array([23]), np.array([254]))
    assert over(moved, right).all()
    assert not over(samples(np.array([21]), np.array([254])), right).any()


def test_what_eyes_do_not_see_is_none() -> None:
    """Floats may differ in anything below a step in the darks, however thin the matter."""
    rng = np.random.default_rng(7)
    alpha = 10.0 ** rng.uniform(-8, 0, (50, 60, 1))
    b = np.concatenate([alpha * rng.random((50, 60, 3)), alpha], -1).astype(np.float32)
    a = b + rng.uniform(-3e-4, 3e-4, b.shape).astype(np.float32)
    assert not exceeds_threshold(a, b, np.abs(a - b).max(axis=-1), None, 1.0).any()


@pytest.mark.parametrize("kind", ["dark object", "thin haze"])
def test_a_small_faint_object_is_missed_by_no_one(kind: str) -> None:
    """32×32 pixels of 512×512: too few for the mean, and less than a step next to white."""
    right, actual = np.zeros((512, 512, 4), np.uint8), np.zeros((512, 512, 4), np.uint8)
    if kind == "dark object":
        right[..., 3] = actual[..., 3] = 255
    right[100:132, 200:232] = (20, 20, 20, 255) if kind == "dark object" else (255, 255, 255, 2)
    pictures = [sg.Image.from_samples(p) for p in (actual, right)]
    assert compare(*pictures).maximum < 2.28 / 255
    verdict = Pair(*pictures).judge()
    assert not verdict.same and verdict.comparison.box == (200, 100, 232, 132)
    assert verdict.comparison.share_over == (32 / 512) ** 2


# --- levels, and changes in one place ---------------------------------------------------------------------------------


def changed(points: list[tuple[int, int]], ground: tuple[int, ...], off: int, channel: int = 0) -> sg.Verdict:
    """The verdict for drivers on 100×200 samples of which some pixels, (row, column), are `off` in a channel."""
    right = np.tile(np.uint8(ground), (100, 200, 1))
    actual = right.copy()
    for row, column in points:
        actual[row, column, channel] += off
    return sg.judge(*(sg.Image.from_samples(samples) for samples in (actual, right)), noise="driver")


SCATTERED = [(row, 7 * row % 181) for row in range(3, 99, 9)]


@pytest.mark.parametrize("off", [3, 8, 9, 15])
@pytest.mark.parametrize(
    "ground", [(0, 0, 0), (10, 10, 10), (40, 0, 90), (128, 128, 128), (240, 9, 0), (60, 60, 60, 90)]
)
def test_a_level_is_a_step_of_samples(ground: tuple[int, ...], off: int) -> None:
    """In the darks as in bright and translucent pixels: 8 pass and 9 do not, and the number is the difference."""
    for channel in range(len(ground)):
        if (ground[channel] + off) <= 255:
            verdict = changed(SCATTERED, ground, off, channel)
            assert verdict.comparison.levels == off and verdict.same == (off <= 8)
            limited = sg.judge(
                *([sg.Image.from_samples(np.full((9, 9, 3), n, np.uint8)) for n in (off, 0)]), max_levels=8
            )
            assert limited.same == (off <= 8) and (limited.same or limited.broken == f"levels {off} > 8")


def test_levels_of_colors_that_nobody_sees_and_of_rounding_do_not_count() -> None:
    right = np.zeros((9, 9, 4), np.uint8)
    hidden = right.copy()
    hidden[4, 4, :3] = 200
    assert sg.judge(*map(sg.Image.from_samples, (hidden, right)), max_levels=0).same
    # float pixels of less than half a level of alpha
    a, b = np.zeros((9, 9, 4), np.float32), np.zeros((9, 9, 4), np.float32)
    a[4, 4], b[4, 4] = (1e-3, 0, 0, 1e-3), (0, 0, 1e-3, 1e-3)
    assert metrics.largest_level(a, b, 1.0) == pytest.approx(0, abs=0.01)
    # a colour behind which there is next to nothing, and that rounding explains
    a[4, 4], b[4, 4] = (3e-3, 2.7e-3, 0, 3e-3), (2.8e-3, 3e-3, 0, 3e-3)
    assert metrics.largest_level(a, b, 1.0) == 1
    # of X-rays by their scale
    full = np.full((9, 9, 4), 40, np.float32)
    assert metrics.largest_level(full * np.float32(0.9), full, 40.0) == pytest.approx(255 * 0.1, abs=0.01)


def line(length: int, slope: float = 0.0, step: int = 1, along: int = 1) -> list[tuple[int, int]]:
    """Every `step`-th pixel of a line, (row, column); along: the axis of which it is a function."""
    points = [(9 + round(slope * place), 5 + place) for place in range(0, length, step)]
    return points if along else [(column, row) for row, column in points]


def circle(radius: int) -> list[tuple[int, int]]:
    angles = np.linspace(0, 2 * np.pi, 1000)
    return sorted({(50 + round(radius * np.sin(a)), 90 + round(radius * np.cos(a))) for a in angles.tolist()})


IN_ONE_PLACE = {
    "of 192 pixels": line(192),
    "of 90 pixels down": line(90, along=0),
    "diagonal": line(90, 1.0),
    "rising by a third": line(190, 0.37),
    "steep": line(90, 0.81, along=0),
    "dashed": [(row, column) for row, column in line(192) if column % 4 < 2],
    "dashed down": [(row, column) for row, column in line(90, along=0) if row % 4 < 2],
    "dotted": line(192, 0.25, step=3),
    "short": line(9),
    "circle of radius 4": circle(4),
    "circle of radius 12": circle(12),
    "square": [(row, column) for row in range(30, 33) for column in range(30, 33)],
}


@pytest.mark.parametrize("off", [3, 8])
@pytest.mark.parametrize("shape", IN_ONE_PLACE)
def test_a_change_in_one_place_is_no_noise_of_drivers(shape: str, off: int) -> None:
    """On pictures so large that few pixels differ in all: lines and outlines as well as areas."""
    verdict = changed(IN_ONE_PLACE[shape], (90, 120, 40), off)
    assert verdict.comparison.levels == off
    assert "density" in verdict.broken


def test_eight_pixels_in_one_place_and_scattered_noise_pass() -> None:
    assert changed(line(8), (90, 120, 40), 3).same
    rng = np.random.default_rng(4)
    for _ in range(3):
        over = rng.random((512, 512)) < 0.005
        assert metrics.densest_share(over) <= 8 / 49
    assert metrics.densest_share(np.ones((40, 40), bool)) == 1


@pytest.mark.parametrize(("height", "width"), [(7, 7), (8, 39), (38, 9), (39, 8), (40, 7), (71, 8)])
def test_windows_reach_every_rim(height: int, width: int) -> None:
    """SSIM and density against every whole window one by one, also where the last band holds a single row of them."""
    rng = np.random.default_rng(height)
    a, b = rng.random((2, height, width, 1))
    a[-1] += 0.5
    windows = [(a[y : y + 7, x : x + 7], b[y : y + 7, x : x + 7]) for y in range(height - 6) for x in range(width - 6)]

    def of_window(x: np.ndarray, y: np.ndarray) -> float:
        covariance = np.cov(x.ravel(), y.ravel())
        means = 2 * x.mean() * y.mean() + 1e-4, x.mean() ** 2 + y.mean() ** 2 + 1e-4
        return float(means[0] * (2 * covariance[0, 1] + 9e-4) / (means[1] * (np.trace(covariance) + 9e-4)))

    assert metrics.ssim(a, b) == pytest.approx(np.mean([of_window(x, y) for x, y in windows]), abs=1e-9)
    for place in ((0, 0), (height - 2, 0), (0, width - 2), (height - 2, width - 2)):
        over = np.zeros((height, width), bool)
        over[place[0] : place[0] + 2, place[1] : place[1] + 2] = True
        assert metrics.densest_share(over) == 4 / 49

"""Eight ways in which a picture goes wrong: each is caught, named, and to be seen in the report; the guide's table.

SPLATGL_WRITE_TABLE=1 pytest tests/comparison/test_difference_kinds.py     renews the table
"""

from __future__ import annotations

import base64
import io
import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.comparison.pictures import as_image
from splatgl.comparison.reports import Case, build_page, pair_html
from splatgl.comparison.verdict import Criteria, Pair, Tolerance, Verdict, format_metric
from splatgl.data.color import linear_from_srgb, srgb_from_linear

BASELINES = Path(__file__).parent / "baselines" / "test_scenes"
PAGE = Path(__file__).parents[2] / "splatgl" / "docs" / "comparing.md"
RIGHT = sg.Image.load(BASELINES / "terrain-composite.png")
# where the picture has a mountain
ROW, COLUMN = 44, 45
METRICS = ("maximum", "rmse", "psnr", "bias", "share", "unmatched", "ssim", "flip")


def of_samples(change: Callable[[np.ndarray], np.ndarray]) -> sg.Image:
    """The picture with its 8-bit sRGB colour, [H, W, 3] in 0…255, changed; alpha stays."""
    samples = np.rint(RIGHT.straight() * 255)
    color = np.clip(np.rint(change(samples)), 0, 255)
    return sg.Image.from_samples(np.concatenate([color, samples[..., 3:]], axis=-1).astype(np.uint8))


def one_pixel() -> sg.Image:
    pixels = RIGHT.pixels.copy()
    pixels[ROW, COLUMN] = (1, 0, 0, 1)
    return sg.Image(pixels)


def without_object() -> sg.Image:
    pixels = RIGHT.pixels.copy()
    pixels[ROW - 6 : ROW + 6, COLUMN - 8 : COLUMN + 8] = 0
    return sg.Image(pixels)


def noise() -> np.ndarray:
    return np.random.default_rng(8).normal(0, 3, (*RIGHT.pixels.shape[:2], 3))


# what went wrong, in the guide's words: the picture, the name of the kind, and what the message says
WRONG: dict[str, tuple[Callable[[], sg.Image], str, str]] = {
    "shifted by one pixel": (lambda: sg.Image(np.roll(RIGHT.pixels, 1, 1)), "shifted", "shifted by 1 pixel right"),
    "one wrong pixel": (one_pixel, "pixels", "one wrong pixel"),
    "1/255 everywhere": (lambda: of_samples(lambda s: s[..., :3] + 1), "offset", r"offset by \+1/255 everywhere"),
    "a missing object": (without_object, "missing", r"an object is missing \(16×12 pixels\)"),
    "gamma applied twice": (
        lambda: of_samples(lambda s: 255 * srgb_from_linear(s[..., :3] / 255)),
        "gamma",
        "gamma: sRGB applied twice",
    ),
    "premultiplied twice": (
        lambda: sg.Image(np.concatenate([RIGHT.pixels[..., :3] * RIGHT.pixels[..., 3:], RIGHT.pixels[..., 3:]], -1)),
        "premultiplication",
        "premultiplication: colour multiplied by alpha twice",
    ),
    "flipped": (lambda: sg.Image(RIGHT.pixels[::-1]), "flipped", "flipped upside down"),
    "noise of 3/255": (lambda: of_samples(lambda s: s[..., :3] + noise()), "noise", "noise of RMS"),
}


@pytest.mark.parametrize("what", WRONG)
def test_each_is_caught_and_named(what: str) -> None:
    make, kind, message = WRONG[what]
    verdict = Pair(make(), RIGHT, ("new.png", "old.png")).judge()
    assert not verdict.same
    assert verdict.kind is not None and verdict.kind.name == kind
    assert re.match(rf"new\.png: different: {message}", str(verdict))
    assert "worst" in str(verdict) and " > " in str(verdict)


@pytest.mark.parametrize("what", WRONG)
def test_each_is_to_be_seen_in_the_report(what: str) -> None:
    """Both pictures as they are, a difference that reaches the end of its scale, and a place for both in turn."""
    make, _, message = WRONG[what]
    image = make()
    verdict = Pair(image, RIGHT).judge()
    html = build_page([Case(what, "different", verdict.line, pair_html(verdict, Pair(image, RIGHT)))], "Report")
    assert re.search(message, html)
    pictures = [decoded(text) for text in re.findall(r'<img[^>]*src="data:image/png;base64,([^"]+)"', html)]
    assert len(pictures) in (3, 6)
    actual, right, heat = pictures[:3]
    assert (actual == np.rint(image.straight() * 255)).all() and (right == np.rint(RIGHT.straight() * 255)).all()
    assert (heat.any(axis=-1) == (image.pixels != RIGHT.pixels).any(axis=-1)).all(), "black only where both are equal"
    assert (heat.reshape(-1, 3) == (252, 255, 200)).all(axis=1).any(), "the largest difference is the lightest colour"


def decoded(text: str) -> np.ndarray:
    return np.asarray(Pillow.open(io.BytesIO(base64.b64decode(text))))


def test_the_report_in_a_browser(tmp_path: Path) -> None:
    """Its script puts both pictures in one place, and shows them in turn."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("Chromium is not here")
    image = one_pixel()
    html = pair_html(Pair(image, RIGHT).judge(), Pair(image, RIGHT))
    # its keys, pressed by a script: the second case is marked, and what is missing is hidden
    keys = "for (const key of 'jjm') document.body.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));"
    keys += "document.querySelector('button.missing').click();"
    differing = [Case(name, "different", "one wrong pixel", html, accept="cp a.png b.png") for name in "bc"]
    cases = [Case("gone", "missing", "no picture"), *differing]
    page = build_page(cases, "Report").replace("</html>", f"<script>{keys}</script></html>")
    (tmp_path / "r.html").write_text(page, encoding="utf-8")
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", "--dump-dom"]
    # milliseconds on the page's clock: the first turn is after 600
    for elapsed, shown in ((200, "actual"), (900, "expected")):
        look = [*command, f"--virtual-time-budget={elapsed}", (tmp_path / "r.html").as_uri() + "#view=3"]
        page_then = subprocess.run(look, capture_output=True, text=True, check=True, timeout=600).stdout
        assert page_then.count(f"<figcaption>blink: {shown}</figcaption>") == 4
        views = re.findall(r'<div class="view both" style.*?>(.*?)</div>', page_then)
        sources = [re.findall(r'src="([^"]+)"', view) for view in views]
        assert [len(pair) for pair in sources] == [2] * 4 and all(first != second for first, second in sources)
        assert 'data-view="3"' in page_then and "copy commands of <span>1</span> marked" in page_then
        sections = re.findall(r"<section [^>]*>", page_then)
        assert ["current" in section for section in sections] == [False, True, False]
        assert ["hidden" in section for section in sections] == [False, False, True]


def test_the_same_picture_is_the_same() -> None:
    verdict = Pair(RIGHT, sg.Image(RIGHT.pixels.copy())).judge()
    assert verdict.same and verdict.kind is None
    assert verdict.comparison.maximum == 0


@pytest.mark.parametrize("scene", ["tunnel", "nerve", "letter-f"])
def test_names_hold_for_other_pictures(scene: str) -> None:
    """A picture may be its own mirror image (tunnel), or alike everywhere (letter-f): the names still hold."""
    right = sg.Image.load(BASELINES / f"{scene}-composite.png")
    pixels, samples = right.pixels, np.rint(right.straight() * 255)
    encoded = sg.Image.from_samples(
        np.concatenate([np.rint(255 * srgb_from_linear(samples[..., :3] / 255)), samples[..., 3:]], -1).astype(np.uint8)
    )
    brighter = np.concatenate([pixels[..., :3] * np.float32(0.8), pixels[..., 3:]], -1)
    for image, kind in (
        (sg.Image(np.roll(pixels, (-2, 3), (0, 1))), "shifted"),
        (encoded, "gamma"),
        (sg.Image(brighter), "brightness"),
        (sg.Image(np.zeros_like(pixels)), "empty"),
        (sg.Image(pixels[::-1, ::-1]), "flipped"),
    ):
        found = Pair(image, right).judge().kind
        assert found is not None and found.name == kind, (scene, kind, found)


def with_alpha(color: np.ndarray, alpha: np.ndarray) -> sg.Image:
    return sg.Image(np.concatenate([color, np.broadcast_to(alpha, (*color.shape[:2], 1))], -1).astype(np.float32))


def extra_object() -> sg.Image:
    pixels = RIGHT.pixels.copy()
    pixels[2:12, 3:20] = (0.2, 0.3, 0.1, 1)
    return sg.Image(pixels)


def other_part() -> sg.Image:
    pixels = RIGHT.pixels.copy()
    pixels[ROW - 6 : ROW + 6, COLUMN - 8 : COLUMN + 8] *= np.array((0.5, 0.9, 0.2, 1), np.float32)
    return sg.Image(pixels)


COLOR, ALPHA = RIGHT.pixels[..., :3], RIGHT.pixels[..., 3:]
STRAIGHT = np.divide(COLOR, ALPHA, out=np.zeros_like(COLOR), where=ALPHA > 0)
# more ways to go wrong, by the first words of what is said
ALSO: dict[str, Callable[[], sg.Image]] = {
    "gamma: sRGB never applied": lambda: of_samples(lambda s: 255 * linear_from_srgb(s[..., :3] / 255)),
    "premultiplication: colour not multiplied by alpha": lambda: with_alpha(STRAIGHT, ALPHA),
    "alpha is lost: over black": lambda: with_alpha(COLOR, np.ones(1)),
    "alpha is lost: its colour stayed": lambda: with_alpha(STRAIGHT, np.ones(1)),
    "red and blue swapped": lambda: with_alpha(COLOR[..., ::-1], ALPHA),
    "turned by 180°": lambda: sg.Image(RIGHT.pixels[::-1, ::-1]),
    "flipped left to right": lambda: sg.Image(RIGHT.pixels[:, ::-1]),
    "shifted by 2 pixels left and 3 pixels down": lambda: sg.Image(np.roll(RIGHT.pixels, (3, -2), (0, 1))),
    "offset by -1/255 everywhere (sRGB)": lambda: of_samples(lambda s: s[..., :3] - 1),
    "offset by -2/255 everywhere (linear light)": lambda: with_alpha(COLOR - ALPHA * 2 / 255, ALPHA),
    "an extra object (17×10 pixels)": extra_object,
    "a part is changed (16×": other_part,
}


@pytest.mark.parametrize("text", ALSO)
def test_what_else_has_a_name(text: str) -> None:
    assert Pair(ALSO[text](), RIGHT).judge().line.startswith(text)


def test_what_no_change_explains_has_no_name() -> None:
    other = sg.Image.load(BASELINES / "nerve-composite.png")
    assert "of the pixels changed, in no single way" in str(Pair(other, RIGHT).judge())
    # a name explains three quarters of the difference at least
    for share, text in ((0.65, "a part is changed"), (0.9, "flipped upside down")):
        mixed = sg.Image((1 - share) * RIGHT.pixels + share * RIGHT.pixels[::-1])
        assert text in str(Pair(mixed, RIGHT).judge())


def test_objects_in_pictures_without_alpha() -> None:
    """Opaque pictures tell by their detail: what is gone leaves the plain ground, a patch of paint does not."""
    rng = np.random.default_rng(3)
    ground, thing = np.full((72, 96, 4), 0.3, np.float32), rng.random((10, 12, 3)).astype(np.float32)
    ground[..., 3] = 1
    present, painted = ground.copy(), ground.copy()
    present[30:40, 50:62, :3] = thing
    painted[30:40, 50:62, :3] = (1, 0, 0)
    for actual, right, text in (
        (ground, present, "an object is missing (12×10 pixels)"),
        (present, ground, "an extra object (12×10 pixels)"),
        (painted, present, "a part is changed (12×10 pixels)"),
    ):
        assert text in str(Pair(sg.Image(actual), sg.Image(right)).judge())


def test_rows_and_columns_swapped() -> None:
    square = RIGHT.pixels[:72, 12:84]
    assert "rows and columns swapped" in str(Pair(sg.Image(square.transpose(1, 0, 2)), sg.Image(square)).judge())


def test_rounding_of_eight_bits_passes_and_more_does_not() -> None:
    """One pixel in a thousand at the next sRGB step, as from another driver; at two steps it is a difference."""
    rng = np.random.default_rng(4)
    samples = np.rint(RIGHT.straight() * 255).astype(int)
    inside = samples[..., :3] < 250
    for steps, same in ((1, True), (2, False)):
        moved = samples.copy()
        chosen = (rng.random(inside.shape) < 1e-3) & inside & (samples[..., 3:] == 255)
        moved[..., :3] += steps * rng.choice((-1, 1), chosen.shape) * chosen
        moved[ROW, COLUMN, :3] = samples[ROW, COLUMN, :3]
        # a step matters most next to white
        light = np.full_like(moved, 255)
        light[0, 0, :3] -= steps
        verdicts = [
            Pair(sg.Image.from_samples(np.clip(x, 0, 255).astype(np.uint8)), y).judge()
            for x, y in ((moved, RIGHT), (light, sg.Image.from_samples(np.full(moved.shape, 255, np.uint8))))
        ]
        assert verdicts[1].same is same
        if same:
            assert verdicts[0].same, str(verdicts[0])


def test_moved_edges_pass_where_asked() -> None:
    moved = np.roll(RIGHT.pixels, 1, 0)
    only = Criteria(Tolerance.only(unmatched=0.0))
    assert Pair(sg.Image(moved), RIGHT).judge(only).same
    assert not Pair(one_pixel(), RIGHT).judge(only).same
    assert not Pair(without_object(), RIGHT).judge(only).same
    assert not Pair(sg.Image(np.roll(RIGHT.pixels, 2, 0)), RIGHT).judge(only).same


def cell(name: str, verdict: Verdict) -> str:
    check = next(check for check in verdict.checks if check.name == name)
    if name in ("share", "unmatched"):
        return f"{100 * check.value:.2g} %"
    if name == "psnr":
        return f"{check.value:.0f}"
    if name == "ssim":
        return f"{check.value:.4f}"
    # what sums leave of zero is zero
    return format_metric(name, float(f"{check.value:.2g}") if abs(check.value) > 1e-7 else 0.0)


def table() -> str:
    """The guide's table: what each metric says of each kind."""
    lines = [
        "| what went wrong | maximum | RMSE | PSNR, dB | bias | over | unmatched | SSIM | FLIP | named |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for what, (make, kind, _) in WRONG.items():
        verdict = Pair(make(), RIGHT).judge(Criteria(extra=frozenset({"ssim", "flip"})))
        assert verdict.kind is not None and verdict.kind.name == kind
        lines.append(f"| {what} | {' | '.join(cell(name, verdict) for name in METRICS)} | {verdict.kind.name} |")
    return "\n".join(lines)


def test_the_guides_table() -> None:
    """SPLATGL_WRITE_TABLE=1 renews it."""
    pytest.importorskip("flip_evaluator", reason="flip-evaluator is in the extra compare")
    text = PAGE.read_text(encoding="utf-8")
    (old,) = re.findall(r"(?:^\| what went wrong \|.*\n)(?:^\|.*\n)+", text, re.MULTILINE)
    new = table() + "\n"
    if os.environ.get("SPLATGL_WRITE_TABLE"):
        PAGE.write_text(text.replace(old, new), encoding="utf-8")
    else:
        assert old == new


def chart(height: float = 1.0, pad: float = 4, font: int = 10, color: str = "#1f77b4", width: float = 1.5) -> sg.Image:
    matplotlib = pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"font.size": font}):
        figure = Figure(figsize=(4, 3.4), dpi=100)
        axes = figure.add_axes((0.15, 0.25, 0.8, 0.6))
        x = np.linspace(0, 10, 60)
        axes.plot(x, 2 + height * np.sin(x), color=color, lw=width)
        axes.plot(x, 1 + 0.3 * x, color="#ff7f0e")
        axes.set(ylim=(0, 6), title="Growth", ylabel="length")
        axes.set_xlabel("time", labelpad=pad)
        return as_image(figure, "chart")


@pytest.mark.parametrize(
    ("changes", "kind", "told"),
    [
        ({"height": 1.3}, "larger", r"a part in #1f77b4 is larger: 294×92 instead of 294×82 pixels$"),
        ({"pad": 12}, "moved", r"a part in #\w+ is moved by 11 pixels down \("),
        ({"font": 12}, "drawing", r"\d+ parts of the drawing: \d+ larger.*, as by another font size$"),
        ({"color": "#d62728"}, "recoloured", r"a part has the colour #d62728 instead of #1f77b4 \("),
        ({"width": 2.5}, "thicker", r"a part in #1f77b4 is thicker \("),
        (
            {"pad": 12, "width": 2.5},
            "moved",
            r"is moved by 11 pixels down \(.* and a part in #1f77b4 is thicker",
        ),
    ],
)
def test_changes_of_charts_are_named(changes: dict[str, Any], kind: str, told: str) -> None:
    verdict = sg.judge(chart(**changes), chart())
    assert verdict.kind is not None and verdict.kind.name == kind
    assert re.search(told, verdict.kind.text), verdict.kind.text

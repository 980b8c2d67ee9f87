"""Pictures of a difference: nothing that differs is lost on the way into the report."""

from __future__ import annotations

import re

import numpy as np
import pytest

import splatgl as sg
from splatgl.comparison import reports
from splatgl.comparison.reports import html_table, pair_html
from splatgl.comparison.verdict import Pair

# more than LARGEST in both directions, and no multiple of what becomes one pixel
HEIGHT, WIDTH = 1030, 2051


def pair(row: int, column: int) -> tuple[sg.Image, sg.Image]:
    right = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    right[..., 3] = 1
    actual = right.copy()
    actual[row, column, 0] = 0.5
    return sg.Image(actual), sg.Image(right)


@pytest.mark.parametrize(("row", "column"), [(0, 0), (700, 1234), (HEIGHT - 1, WIDTH - 1)])
def test_one_pixel_of_a_large_picture_is_to_be_seen(row: int, column: int) -> None:
    heat = reports.heat_map(reports.shrink(reports.largest_difference(*pair(row, column)), np.max))
    assert reports.shrink(reports.largest_difference(*pair(row, column)), np.max).max() == 0.5
    assert heat.shape == (344, 684, 3)
    assert np.argwhere(heat.any(axis=-1)).tolist() == [[row // 3, column // 3]]
    assert heat.max(axis=(0, 1)).tolist() == [252, 255, 200]


def test_shrunk_is_the_mean_of_its_pixels() -> None:
    pixels = np.random.default_rng(2).random((1200, 2048, 4)).astype(np.float32)
    blocks = pixels.reshape(600, 2, 1024, 2, 4)
    assert np.allclose(reports.shrink(pixels, np.mean), blocks.mean(axis=(1, 3)), rtol=1e-6)
    small = pixels[:9, :1024]
    assert reports.shrink(small, np.mean) is small


def test_heat_rises_from_black_and_what_is_beyond_floats_is_the_lightest() -> None:
    heat = reports.heat_map(np.linspace(0, 3, 200, dtype=np.float32)[None])[0].astype(int)
    assert heat[0].tolist() == [0, 0, 0]
    assert (np.diff(heat @ (0.2126, 0.7152, 0.0722)) >= 0).all(), "never darker"
    huge = [sg.Image(np.full((2, 2, 4), value, np.float32)) for value in (3e38, -3e38)]
    assert (reports.heat_map(reports.largest_difference(*huge)) == (252, 255, 200)).all()


def test_what_is_not_compared_is_not_shown() -> None:
    actual, right = pair(5, 7)
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[5, 7] = False
    assert reports.largest_difference(actual, right).max() == 0.5
    assert reports.largest_difference(actual, right, mask).max() == 0


@pytest.mark.parametrize(
    ("row", "column", "box"),
    [(500, 700, (694, 494, 707, 507)), (0, 0, (0, 0, 7, 7)), (HEIGHT - 1, WIDTH - 1, (2044, 1023, 2051, 1030))],
)
def test_what_is_enlarged_is_the_pixel_and_what_is_around(
    row: int, column: int, box: tuple[int, int, int, int]
) -> None:
    actual, right = pair(row, column)
    assert reports.detail_box(sg.compare(actual, right), right.pixels.shape) == box


def test_a_large_difference_is_enlarged_at_its_worst() -> None:
    actual, right = pair(500, 700)
    actual.pixels[100:900, 100:1900, 1] = 0.2
    assert reports.detail_box(sg.compare(actual, right), right.pixels.shape) == (669, 469, 732, 532)


def test_the_frame_is_around_the_box() -> None:
    """In per cent of the picture, which the page may show at any size."""
    actual, right = pair(515, 500)
    html = pair_html(Pair(actual, right).judge(), Pair(actual, right))
    (frame,) = set(re.findall(r'class="mark" style="([^"]*)"', html))
    left, top, width, height = (float(n) for n in re.findall(r"([\d.]+)%", frame))
    assert (left, top) == pytest.approx((100 * 500 / WIDTH, 50), abs=1e-3)
    assert (width, height) == pytest.approx((100 / WIDTH, 100 / HEIGHT), abs=1e-3)


def test_tables_of_many_columns_name_them_for_narrow_pages() -> None:
    """On narrow pages their cells stand below each other; a number is not parted from its unit."""
    head = ["method", "time", "error", "a", "b", ""]
    wide = html_table(head, [["x", "3 ms", "4 %", "", "<", "z"]], [""])
    narrow = html_table(head[:2], [["x", "3 ms"]], [""])
    assert '<table class="many">' in wide and '<td data-head="time">3\xa0ms<td data-head="error">4\xa0%' in wide
    assert '<td data-head="b">&lt;<td data-head="">z' in wide
    assert narrow == "<table><tr><th>method<th>time<tr><td>x<td>3\xa0ms</table>"


def test_every_picture_has_an_alternative_text() -> None:
    """Of the whole and of the enlarged detail, and of one without a counterpart."""
    actual, right = pair(515, 500)
    both = pair_html(Pair(actual, right).judge(), Pair(actual, right))
    alone = reports.image_html(actual)
    for html, count in ((both, 6), (alone, 1)):
        texts = re.findall(r'<img[^>]* alt="([^"]*)"', html)
        assert len(set(texts)) == html.count("<img") == count and all(texts)
    assert "actual picture" in both and "expected picture (detail)" in both

"""Annotations on paper: letters in points, the sign of micrometres, PDF and SVG."""

from __future__ import annotations

import base64
import io
import re
import struct
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.annotations.annotate import annotated
from splatgl.annotations.bars import length_text
from splatgl.annotations.canvas import WHITE, Canvas, readable, text_size
from splatgl.data.figure import Page, PatchMark
from splatgl.data.image import Image

VOLUME = sg.Volume(np.zeros((9, 9, 9), np.float32), spacing=(10, 10, 10), unit="um", name="cells")
TRANSFER = sg.Transfer([(0, 0), (100, 0.5)], colormap="viridis")
SVG = "{http://www.w3.org/2000/svg}"


def picture(size: tuple[int, int] = (200, 160), dpi: float | None = None, **info: Any) -> Image:
    """A square of orange with half of its light on a clear ground."""
    pixels = np.zeros((size[1], size[0], 4), np.float32)
    pixels[40:80, 60:120] = (0.5, 0.25, 0.0, 0.5)
    return Image(pixels, {"blend": "composite", **info, **({} if dpi is None else {"dpi": dpi})})


def camera(size: tuple[int, int]) -> sg.Camera:
    return sg.Camera.orthographic((40, -460, 40), (40, 40, 40), (0, 0, 1), 100.0, size)


def drawn(*names: str, size: tuple[int, int] = (200, 160), dpi: float | None = None) -> Image:
    return annotated(picture(size, dpi), VOLUME, TRANSFER, camera(size), names)


def density_of(png: bytes) -> tuple[int, int, int]:
    """Numbers of the chunk pHYs."""
    place = png.index(b"pHYs")
    (crc,) = struct.unpack(">I", png[place + 13 : place + 17])
    assert crc == zlib.crc32(png[place : place + 13]) and place < png.index(b"IDAT")
    return struct.unpack(">2IB", png[place + 4 : place + 13])


def test_files_hold_the_dots_per_inch(tmp_path: Path) -> None:
    """300 dots an inch are 11811 a metre; without them there is no chunk."""
    image = picture(dpi=300.0)
    assert density_of(image.encoded(Path("a.png"))) == (11811, 11811, 1)
    assert b"pHYs" not in picture().encoded(Path("a.png"))
    for name in ("a.png", "a.jpg"):
        image.save(tmp_path / name, background=(1.0, 1.0, 1.0))
        assert np.allclose(Pillow.open(tmp_path / name).info["dpi"], 300, atol=0.01)
    tifffile = pytest.importorskip("tifffile", reason="tifffile is in the extra readers")
    tags = tifffile.TiffFile(io.BytesIO(image.encoded(Path("a.tif")))).pages[0].tags
    assert tags["XResolution"].value == (300, 1) and tags["ResolutionUnit"].value == 2


@pytest.mark.parametrize("dpi", [72, 144, 300])
def test_letters_are_8_points_high(dpi: int) -> None:
    """And the bar is as thick, and its label as wide, in proportion."""
    canvas = Canvas.over(np.zeros((600, 800, 4), np.float32), None, dpi)
    assert canvas.em == round(8 * dpi / 72) and canvas.stroke == max(1.25, canvas.em / 10)
    high = [drawn("scale", size=(400 * n, 320 * n), dpi=100 * n).figure for n in (1, 2)]
    texts = [next(mark for mark in figure.over if hasattr(mark, "text")) for figure in high]
    assert texts[1].size == 2 * texts[0].size


def test_micrometres_have_their_sign() -> None:
    assert [length_text(5, unit) for unit in ("um", "µm", "micron", "mm")] == ["5 µm", "5 µm", "5 µm", "5 mm"]
    assert readable("5 μm") == readable("5 µm") == "5 µm" and readable("Ångström ≥ é") == "Angstrom >= e"
    assert text_size("5 µm", 20, 2) == text_size("5 um", 20, 2)


def test_the_sign_is_a_u_with_a_stem() -> None:
    """Below the baseline, at the left of the u, and nowhere else."""
    canvases = [Canvas(np.zeros((60, 90, 4), np.float32), WHITE, font=32) for _ in range(2)]
    for canvas, text in zip(canvases, ("5 µm", "5 um"), strict=True):
        canvas.text(text, 0, 0)
    rows, columns = np.nonzero(np.abs(canvases[0].pixels - canvases[1].pixels).max(axis=2) > 0.01)
    edge = canvases[0].edge
    base, left = edge + round(0.8 * 32), text_size("5 ", 32, edge)[0] - edge
    assert rows.min() >= base - 32 // 6 - edge and rows.max() >= base + 32 // 8
    assert left - edge <= columns.min() and columns.max() < left + 32 / 6 + 2 * edge


def test_no_footnote_where_rays_are_parallel() -> None:
    texts = [mark.text for mark in drawn("scale").figure.over if hasattr(mark, "text")]
    assert texts == ["20 µm"]


def svg_of(image: Image) -> ElementTree.Element:
    pytest.importorskip("matplotlib", reason="Matplotlib is in the extra plots")
    return ElementTree.fromstring(image.encoded(Path("a.svg")))


def test_svg_holds_text_lines_and_the_pixels() -> None:
    """Text is text; the picture's own samples, bit for bit; the page as large as the paper."""
    image = drawn("scale", "colorbar", "axes", "title=Cells & <more> $x$", size=(400, 320), dpi=200.0)
    page = svg_of(image)
    texts = {"".join(each.itertext()) for each in page.iter(f"{SVG}text")}
    assert {"20 µm", "Cells & <more> $x$", "x", "y", "z", "cells", "100"} <= texts
    assert page.get("width") == "144pt" and page.get("height") == "115.2pt"
    pictures = [each.get("{http://www.w3.org/1999/xlink}href") for each in page.iter(f"{SVG}image")]
    samples = [np.asarray(Pillow.open(io.BytesIO(base64.b64decode(each.split(",")[1])))) for each in pictures]
    right = picture((400, 320)).samples8()
    assert any(each.shape == right.shape and np.array_equal(each, right) for each in samples)


def test_the_page_looks_as_the_picture() -> None:
    """Its marks, drawn by Matplotlib as pixels, of which letters and edges alone differ."""
    pytest.importorskip("matplotlib", reason="Matplotlib is in the extra plots")
    image = drawn("scale", "colorbar", "axes", "box", "title=Cells", size=(400, 320), dpi=144.0)
    page, data = Page(400, 320, 144.0), io.BytesIO()
    page.begin(None)
    for mark in (*image.figure.under, PatchMark(image.figure.pixels, (0, 0)), *image.figure.over):
        page.draw(mark)
    page.drawing.savefig(data, format="png", dpi=144.0)
    shown, right = (
        Image.from_samples(samples).over((1.0, 1.0, 1.0)).samples8()[..., :3].astype(float)
        for samples in (np.asarray(Pillow.open(data).convert("RGBA")), image.samples8())
    )
    apart = np.abs(shown - right).mean(axis=2)
    # light of lines mixes in sRGB there; marks in wrong places differ by 12 and 0.08
    assert apart.mean() < 5 and (apart > 60).mean() < 0.04


def test_pdf_holds_text_and_provenance() -> None:
    pytest.importorskip("matplotlib", reason="Matplotlib is in the extra plots")
    data = drawn("scale", dpi=100.0).encoded(Path("a.pdf"))
    assert data.startswith(b"%PDF-") and data == drawn("scale", dpi=100.0).encoded(Path("a.pdf"))
    assert re.search(rb"/MediaBox \[ 0 0 144 115\.2 \]", data) and b"Aileron" in data
    assert rb"(\"blend\": \"composite\")" in data or b"composite" in data


def test_pages_of_pictures_alone_and_of_sums() -> None:
    """Sums are scaled to their maximum, over the background that is given."""
    sums = Image(picture().pixels * 7, {"blend": "xray"})
    page = ElementTree.fromstring(sums.encoded(Path("a.svg"), background=(1.0, 0.0, 0.0)))
    assert "#ff0000" in ElementTree.tostring(page, encoding="unicode")
    assert len(list(page.iter(f"{SVG}image"))) == 1 and not list(page.iter(f"{SVG}text"))
    assert '"scale"' in "".join(page.itertext())

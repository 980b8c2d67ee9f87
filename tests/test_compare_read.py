"""Reading for comparison: every PNG form by the definition of sRGB and alpha, and one precision for both."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.comparison.compare import Picture, alike, read
from splatgl.data.color import linear_from_srgb

RNG = np.random.default_rng(11)


def linear(samples: np.ndarray) -> np.ndarray:
    """The definition: linear light times alpha, in float64."""
    straight = samples.astype(np.float64) / np.iinfo(samples.dtype).max
    return np.concatenate([linear_from_srgb(straight[..., :3]) * straight[..., 3:], straight[..., 3:]], axis=-1)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("opaque", [False, True])
def test_samples_are_straight_srgb(kind: type[np.integer], opaque: bool) -> None:
    samples: np.ndarray = RNG.integers(0, np.iinfo(kind).max + 1, (37, 5, 4)).astype(kind)
    if opaque:
        samples[..., 3] = np.iinfo(kind).max
    assert np.allclose(sg.Image.from_samples(samples).pixels, linear(samples), rtol=3e-7, atol=1e-9)
    if opaque:
        assert (sg.Image.from_samples(samples[..., :3]).pixels == sg.Image.from_samples(samples).pixels).all()
    with pytest.raises(sg.InputError, match="samples: expected uint8 or uint16"):
        sg.Image.from_samples(samples[..., 0])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_every_form_of_png(channels: int, kind: type[np.integer], tmp_path: Path) -> None:
    codecs = pytest.importorskip("imagecodecs", reason="imagecodecs is in the extra readers")
    samples: np.ndarray = RNG.integers(0, np.iinfo(kind).max + 1, (6, 5, channels)).astype(kind)
    (tmp_path / "a.png").write_bytes(codecs.png_encode(samples[..., 0] if channels == 1 else samples))
    found = read(tmp_path / "a.png")
    color = samples[..., :3] if channels > 2 else np.repeat(samples[..., :1], 3, axis=-1)
    alpha = samples[..., -1:] if channels in (2, 4) else np.full_like(samples[..., :1], np.iinfo(kind).max)
    assert np.allclose(found.image.pixels, linear(np.concatenate([color, alpha], -1)), rtol=3e-7, atol=1e-9)
    assert found.mode == ("gray", "gray with alpha", "RGB", "RGBA")[channels - 1]
    assert found.bits == np.iinfo(kind).bits


def test_a_palette_is_what_it_shows(tmp_path: Path) -> None:
    picture = Pillow.new("P", (4, 4))
    picture.putpalette([10, 20, 30, 200, 100, 50])
    picture.save(tmp_path / "a.png")
    picture.save(tmp_path / "b.png", transparency=0)
    assert read(tmp_path / "a.png").mode == "RGB"
    assert read(tmp_path / "b.png").mode == "RGBA"


@pytest.mark.parametrize("bits", [8, 16])
def test_rounded_is_what_a_file_brings_back(bits: int, tmp_path: Path) -> None:
    alpha = RNG.random((9, 8, 1))
    image = sg.Image(np.concatenate([RNG.random((9, 8, 3)) * alpha, alpha], -1).astype(np.float32), {"blend": "xray"})
    image.save(tmp_path / "a.png", bits)
    back = sg.Image.load(tmp_path / "a.png")
    assert (image.rounded(bits).pixels == back.pixels).all()
    assert image.rounded(bits).info["scale"] == back.info["scale"]


def test_the_finer_is_rounded_to_the_coarser() -> None:
    image = sg.Image(np.full((2, 2, 4), 0.4567, np.float32))
    floats, coarse = Picture("a", image), Picture("b", image.rounded(8), "RGBA", 8)
    fine = Picture("c", image.rounded(16), "RGBA", 16)
    for first, second in ((floats, coarse), (coarse, fine), (fine, floats)):
        x, y = alike(first, second)
        assert (x.pixels == y.pixels).all()
    assert (alike(floats, fine)[0].pixels != coarse.image.pixels).all()


def test_text_that_is_no_record_is_no_provenance(tmp_path: Path) -> None:
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    text.add_text("splatgl", "[1, 2]")
    Pillow.new("RGB", (2, 2)).save(tmp_path / "a.png", pnginfo=text)
    assert sg.Image.load(tmp_path / "a.png").info == {}

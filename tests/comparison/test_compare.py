"""Comparison of two pictures: each number against one worked out by hand; and how files are read for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main
from splatgl.comparison.image_regression import ImageRegression
from splatgl.comparison.pictures import Picture, match_formats, read
from splatgl.comparison.verdict import Criteria, Pair, Tolerance
from splatgl.data.color import linear_from_srgb

pytestmark = pytest.mark.usefixtures("shared_programs")


def flat(value: float = 0.25, **info: object) -> sg.Image:
    return sg.Image(np.full((4, 5, 4), value, np.float32), info)


def changed(row: int, column: int, channel: int, by: float) -> sg.Image:
    pixels = flat().pixels.astype(np.float64)
    pixels[row, column, channel] += by
    return sg.Image(pixels)


def test_equal_pictures() -> None:
    found = sg.compare(flat(), flat())
    assert (found.maximum, found.rmse, found.share_over, found.sum_error, found.box) == (0, 0, 0, 0, None)
    assert found.psnr == np.inf


@pytest.mark.parametrize("by", [0.5, -0.5])
def test_one_changed_channel(by: float) -> None:
    found = sg.compare(changed(3, 1, 2, by), flat())
    assert found.maximum == 0.5
    assert found.where == (1, 3)
    assert found.rmse == pytest.approx(0.5 / np.sqrt(80))
    assert found.psnr == pytest.approx(-20 * np.log10(0.5 / np.sqrt(80)))
    assert found.share_over == 1 / 20
    assert found.sum_error == pytest.approx(by / 20)
    assert found.box == (1, 3, 2, 4)
    assert "maximum 0.5 at column 1, row 3" in str(found)


def test_box_and_share_count_from_one_level() -> None:
    pixels = flat().pixels.astype(np.float64)
    pixels[0, 1] += 1.01 / 255
    pixels[2, 3] -= 1.01 / 255
    pixels[3, 4] += 0.99 / 255
    found = sg.compare(sg.Image(pixels), flat())
    assert found.box == (1, 0, 4, 3)
    assert found.share_over == 2 / 20


def test_xrays_are_measured_by_their_largest_sum() -> None:
    found = sg.compare(flat(51.0), flat(50.0, blend="xray"))
    assert found.peak == 50
    assert found.psnr == pytest.approx(20 * np.log10(50))
    assert found.share_over == 1
    assert sg.compare(flat(50.1), flat(50.0, blend="xray")).share_over == 0


def test_nothing_against_something() -> None:
    assert sg.compare(flat(0.0), flat(0.0)).sum_error == 0
    assert sg.compare(flat(1.0), flat(0.0)).sum_error == np.inf
    assert sg.compare(flat(0.0), flat(1.0)).sum_error == -1


def test_what_can_not_be_compared() -> None:
    with pytest.raises(sg.InputError, match="pictures: expected one size, 5×4, got 3×2"):
        sg.compare(sg.Image(np.zeros((2, 3, 4))), flat())
    for bad in (np.nan, np.inf):
        with pytest.raises(sg.InputError, match=r"first picture: expected finite numbers, got .* at column 1, row 3"):
            sg.compare(changed(3, 1, 0, bad), flat())
        with pytest.raises(sg.InputError, match="second picture: expected finite numbers"):
            sg.compare(flat(), changed(3, 1, 0, bad))
    with pytest.raises(sg.InputError, match="pixels \\[H, W, 4\\]"):
        sg.compare(sg.Image(np.zeros((2, 3, 3))), flat())


def test_bias_is_the_signed_mean_of_the_worst_channel() -> None:
    pixels = flat().pixels.astype(np.float64)
    pixels[..., 0] += 0.01
    pixels[..., 2] -= 0.02
    assert sg.compare(sg.Image(pixels), flat()).bias == pytest.approx(-0.02)
    # what goes up here and down there leaves none
    pixels = flat().pixels.astype(np.float64)
    pixels[:2] += 0.1
    pixels[2:] -= 0.1
    assert sg.compare(sg.Image(pixels), flat()).bias == pytest.approx(0, abs=1e-12)


def test_threshold_decides_box_and_share() -> None:
    a = changed(3, 1, 2, 0.1)
    assert sg.compare(a, flat(), threshold=0.09).box == (1, 3, 2, 4)
    assert sg.compare(a, flat(), threshold=0.11).box is None
    assert sg.compare(a, flat(), threshold=0.11).share_over == 0


def test_masked_pixels_do_not_count() -> None:
    mask = np.zeros((4, 5), bool)
    mask[3, :2] = True
    found = sg.compare(changed(3, 1, 2, 0.5), flat(), mask=mask)
    assert (found.share_over, found.pixels, found.where) == (0.5, 2, (1, 3))
    assert found.rmse == pytest.approx(0.5 / np.sqrt(8))
    mask[3, 1] = False
    assert sg.compare(changed(3, 1, 2, np.nan), flat(), mask=mask).maximum == 0


def test_limits_hold_for_less_as_for_more() -> None:
    bias = Tolerance.only(bias=0.01)
    for value in (0.23, 0.27):
        assert not Pair(flat(value), flat()).judge(Criteria(bias)).same
    assert Pair(flat(0.245), flat()).judge(Criteria(bias)).same


def test_limits_of_xrays_are_shares_of_their_largest_sum() -> None:
    right = flat(50.0, blend="xray")
    for limit in (Tolerance.only(maximum=0.02), Tolerance.only(rmse=0.02), Tolerance.only(bias=0.02)):
        assert Pair(flat(50.9), right).judge(Criteria(limit)).same
        assert not Pair(flat(51.1), right).judge(Criteria(limit)).same


@pytest.mark.parametrize("bad", [-1, float("nan"), "1/0"])
def test_limits_are_numbers_from_zero(bad: float) -> None:
    with pytest.raises(
        sg.InputError, match=r"tolerance: maximum: expected a number from 0, or a fraction such as 2/255"
    ):
        Tolerance.only(maximum=bad)


@pytest.mark.filterwarnings("error")
def test_the_largest_floats_are_measured_too() -> None:
    """Their difference is beyond float32: infinite, and said so without a warning."""
    found = Pair(flat(3e38), flat(-3e38)).judge()
    assert (found.comparison.maximum, found.comparison.psnr) == (np.inf, -np.inf)
    assert "of the pixels changed, in no single way" in str(found)


def test_bands_add_up(rng: np.random.Generator) -> None:
    """Heights that are no multiple of a band: the same numbers as at one go."""
    a, b = rng.random((53, 7, 4)).astype(np.float32), rng.random((53, 7, 4)).astype(np.float32)
    found = sg.compare(sg.Image(a), sg.Image(b))
    d = a.astype(np.float64) - b
    assert found.rmse == pytest.approx(np.sqrt(np.mean(d * d)), rel=1e-7)
    assert found.maximum == pytest.approx(np.abs(d).max(), rel=1e-6)
    assert found.sum_error == pytest.approx(d.sum() / b.sum(), rel=1e-5)
    assert abs(found.bias) == pytest.approx(np.abs(d.mean(axis=(0, 1))).max(), rel=1e-5)
    assert found.share_over == np.mean(np.abs(d).max(axis=-1) > 1 / 255)


# --- reading ----------------------------------------------------------------------------------------------------------


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
    assert found.image.bits == np.iinfo(kind).bits


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
    floats, coarse = Picture("a", image), Picture("b", image.rounded(8), "RGBA")
    fine = Picture("c", image.rounded(16), "RGBA")
    for first, second in ((floats, coarse), (coarse, fine), (fine, floats)):
        x, y = match_formats(first, second)
        assert (x.pixels == y.pixels).all()
    assert (match_formats(floats, fine)[0].pixels != coarse.image.pixels).all()


def test_text_that_is_no_record_is_no_provenance(tmp_path: Path) -> None:
    from PIL.PngImagePlugin import PngInfo

    text = PngInfo()
    text.add_text("splatgl", "[1, 2]")
    Pillow.new("RGB", (2, 2)).save(tmp_path / "a.png", pnginfo=text)
    assert sg.Image.load(tmp_path / "a.png").info == {}


def test_python_judges_as_the_command_does() -> None:
    """Noise of drivers, what is ignored, and other sizes; settings of a project alone are refused."""
    right = np.zeros((40, 60, 3), np.uint8)
    right[10:30, 10:50] = 120
    noisy = right.copy()
    noisy[12:28:8, 12:48:9] += 3
    other = right.copy()
    other[:6, :8] = 255
    pictures = [sg.Image.from_samples(each) for each in (right, noisy, other, right[:, :50])]
    same, changed = (sg.judge(pictures[1], pictures[0], noise=noise) for noise in ("driver", "none"))
    assert same.same and not changed.same and "same" in str(same)
    assert not sg.judge(pictures[2], pictures[0], noise="driver").same
    assert sg.judge(pictures[2], pictures[0], ignore=["0,0,8,6"]).same
    narrow = sg.judge(pictures[3], pictures[0], align="center")
    assert not narrow.same and narrow.sizes == "size 50×40, expected 60×40" and "50×40" in str(narrow)
    for wrong in ({"report": "x.html"}, {"nois": "driver"}, {"noise": "much"}, {"max_rmse": -1}):
        with pytest.raises(sg.InputError, match=next(iter(wrong)).replace("_", "[-_]")):
            sg.judge(pictures[0], pictures[0], **wrong)


FORMATS = {"a.png": 8, "b.png": 16, "c.npy": None, "d.tif": None, "e.exr": None}


@pytest.mark.parametrize("blend", ["composite", "xray"])
@pytest.mark.parametrize("name", FORMATS)
def test_a_picture_is_the_same_as_its_own_file(
    name: str, blend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For `judge`, `compare`, the command and pytest's fixture, both ways round."""
    monkeypatch.chdir(tmp_path)
    if name.endswith(".exr"):
        pytest.importorskip("OpenEXR", reason="OpenEXR is in the extra exr")
    alpha = RNG.random((19, 18, 1)).astype(np.float32)
    pixels = np.concatenate([RNG.random((19, 18, 3)).astype(np.float32) * alpha, alpha], -1)
    image = sg.Image(pixels * np.float32(3 if blend == "xray" else 1), {"blend": blend})
    image.save(name, FORMATS[name] or 8)
    back = sg.Image.load(name)
    assert back.bits == FORMATS[name] and image.bits is None
    for pair in ((image, back), (back, image), (image, name), (name, Path(name)), (image, image.rounded())):
        assert sg.judge(*pair).same, sg.judge(*pair)
        assert sg.compare(*pair).maximum == 0
    assert sg.compare(image, back).peak == pytest.approx(3 * alpha.max() if blend == "xray" else 1)
    np.save("floats.npy", image.pixels)
    assert main(["compare", "floats.npy", name]) == 0
    drawn = ImageRegression("t", Path("t.py"), Path("baselines"), "t", "update", [])
    drawn(back, name="x", bits=FORMATS[name])
    ImageRegression("t", Path("t.py"), Path("baselines"), "t", "", [])(image, name="x", bits=FORMATS[name])


@pytest.mark.parametrize("compared", [sg.compare, sg.judge])
def test_what_is_compared_is_coerced(
    compared: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    samples = RNG.integers(0, 256, (9, 8, 3)).astype(np.uint8)
    Pillow.fromarray(samples).save("a.png")
    for like in ("a.png", Path("a.png"), Path("a.png").read_bytes(), samples, Pillow.open("a.png")):
        found = compared(like, sg.Image.from_samples(samples))
        comparison: Any = getattr(found, "comparison", found)
        assert comparison.maximum == 0
    Pillow.fromarray(samples).save("a.gif", save_all=True, append_images=[Pillow.fromarray(255 - samples)])
    for wrong, told in (
        (None, "expected an Image, a file, its bytes, .* got NoneType"),
        ([1, 2], "got int64"),
        (3, "got int64"),
        (samples / 255, "floats need colour and alpha"),
        ("b.png", "b.png: cannot be read: no such file"),
        (Path(), "a directory"),
        ("a.gif", "a.gif: expected one picture, got 2 pages or frames"),
        (b"text", "image of 4 bytes"),
        (samples[:0], r"got uint8 \(0, 8, 3\)"),
    ):
        for pair, which in (((wrong, samples), "first picture: "), ((samples, wrong), "second picture: ")):
            with pytest.raises(sg.InputError, match=told) as error:
                compared(*pair)
            assert "\n" not in str(error.value)
            assert ": expected one" in str(error.value) or "cannot" in str(error.value) or which in str(error.value)


def test_floats_that_differ_by_less_than_a_step_are_no_noise_of_drivers() -> None:
    image = sg.Image(np.full((9, 9, 4), 0.5, np.float32))
    assert "scattered" not in str(sg.judge(sg.Image(image.pixels + np.float32(1e-3)), image))


def test_a_page_that_is_waited_for_is_told() -> None:
    class Page:
        """As of Playwright's asyncio."""

        def screenshot(self) -> asyncio.Future[bytes]:
            loop = asyncio.new_event_loop()
            loop.close()
            return asyncio.Future(loop=loop)

    with pytest.raises(sg.InputError, match=r"give the bytes of await page.screenshot\(\)"):
        sg.compare(Page(), flat())


def test_pointers_of_git_lfs_are_told(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n")
    with pytest.raises(sg.InputError, match="got a pointer of Git LFS; fetch the file with: git lfs pull"):
        sg.judge(tmp_path / "a.png", tmp_path / "a.png")

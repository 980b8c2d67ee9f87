"""Images: exact sRGB, straight alpha, 8 and 16 bits, provenance, whole files or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.data.color import _byte_tables, srgb_bytes, srgb_from_linear

RNG = np.random.default_rng(2)


def picture() -> sg.Image:
    alpha = RNG.random((7, 5, 1))
    return sg.Image(np.concatenate([RNG.random((7, 5, 3)) * alpha, alpha], axis=-1).astype(np.float32), {"a": [1, "é"]})


def test_bytes_of_opaque_pictures_are_looked_up_exactly() -> None:
    """As by the formula, also at the first float of each byte and the last before it."""
    following = np.unique(_byte_tables()[1])[:-1]
    before = np.nextafter(following, np.float32(0))
    some = np.random.default_rng(3).random(70_000, np.float32)
    values = np.concatenate([following, before, some, np.array([0, -0.0, 1], np.float32)])
    assert len(following) == 255 and (srgb_bytes(values) == np.rint(srgb_from_linear(values) * 255)).all()
    pixels = np.dstack([values[:300].reshape(20, 15)] * 3 + [np.ones((20, 15), np.float32)])
    pixels[0, :3, 0] = np.nan, np.inf, -1
    image = sg.Image(pixels)
    assert (image.samples8() == np.rint(image.straight() * 255)).all()


@pytest.mark.parametrize("bits", [8, 16])
def test_png_round_trip(bits: int, tmp_path: Path) -> None:
    image = picture()
    image.save(tmp_path / "a.png", bits)
    back = sg.Image.load(tmp_path / "a.png")
    assert back.info == {"a": [1, "é"]}
    # half a step of alpha and of sRGB, whose slope in linear light is at most 2.4
    assert np.abs(back.pixels - image.pixels).max() < 2.0 / (2**bits - 1)
    assert np.abs(back.pixels - image.pixels).max() > 0


def test_png_is_straight_srgb(tmp_path: Path) -> None:
    pixels = np.zeros((1, 3, 4), np.float32)
    pixels[0, 0] = [0.25, 0.0, 0.0, 0.5]
    pixels[0, 1] = [0.2158605, 1.0, 0.001, 1.0]
    sg.Image(pixels).save(tmp_path / "a.png")
    found = np.asarray(Pillow.open(tmp_path / "a.png"))
    # linear 0.5 is sRGB 0.7354, 0.2158605 is 128/255, 0.001 is 0.01292
    assert found[0].tolist() == [[188, 0, 0, 128], [128, 255, 3, 255], [0, 0, 0, 0]]


def test_background(tmp_path: Path) -> None:
    pixels = np.full((1, 1, 4), 0.5, np.float32)
    sg.Image(pixels).save(tmp_path / "a.png", background=(0.0, 1.0, 0.2))
    back = sg.Image.load(tmp_path / "a.png").pixels[0, 0]
    assert back == pytest.approx([0.5, 1.0, 0.6, 1.0], abs=5e-3)


def test_xray_is_scaled_to_its_maximum(tmp_path: Path) -> None:
    pixels = np.zeros((1, 2, 4), np.float32)
    pixels[0, 0], pixels[0, 1] = 40.0, 10.0
    sg.Image(pixels, {"blend": "xray"}).save(tmp_path / "a.png")
    back = sg.Image.load(tmp_path / "a.png")
    assert back.info["scale"] == pytest.approx(1 / 40)
    assert back.pixels[0, :, 3] == pytest.approx([1, 0.25], abs=3e-3)
    sg.Image(pixels, {"blend": "xray"}).save(tmp_path / "a.npy")
    assert (sg.Image.load(tmp_path / "a.npy").pixels == pixels).all()


def test_unwritable_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "f").touch()
    with pytest.raises(sg.InputError, match="cannot be written"):
        picture().save(tmp_path / "f" / "a.png")
    with pytest.raises(sg.InputError, match=r"a name that ends in \.png or \.npy"):
        picture().save(tmp_path / "a.gif")
    (tmp_path / "d.png").mkdir()
    with pytest.raises(sg.InputError, match="cannot be written"):
        picture().save(tmp_path / "d.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["d.png", "f"]


def test_a_new_folder_is_left_with_a_picture_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    target = tmp_path / "new" / "folder" / "a.png"
    with monkeypatch.context() as patch:
        patch.setattr("os.replace", full)
        with pytest.raises(sg.InputError, match="No space left"):
            picture().save(target)
    assert list(tmp_path.iterdir()) == []
    picture().save(target)
    assert [p for p in tmp_path.rglob("*") if p.is_file()] == [target]


def test_an_old_picture_survives_a_failed_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture().save(tmp_path / "a.png")
    before = (tmp_path / "a.png").read_bytes()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(sg.InputError, match="No space left"):
        picture().save(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1


def test_unreadable(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n nonsense")
    with pytest.raises(sg.InputError, match="cannot be read as a picture"):
        sg.Image.load(tmp_path / "a.png")
    with pytest.raises(sg.InputError, match="cannot be read"):
        sg.Image.load(tmp_path / "none.npy")
    np.save(tmp_path / "b.npy", np.zeros((3, 3)))
    with pytest.raises(sg.InputError, match="expected float pixels"):
        sg.Image.load(tmp_path / "b.npy")


def test_floats_in_tiff_are_those_of_its_own_library(tmp_path: Path) -> None:
    import json

    tifffile = pytest.importorskip("tifffile")
    image = sg.Image(np.random.default_rng(3).random((5, 7, 4)).astype(np.float32) * 3, {"blend": "xray", "n": "é"})
    image.save(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as tiff:
        page = tiff.pages[0]
        assert (page.asarray() == image.pixels).all() and page.dtype == np.float32
        assert [kind.name for kind in page.extrasamples] == ["ASSOCALPHA"]
        assert json.loads(page.description) == image.info
    again = sg.Image.load(tmp_path / "a.tif")
    assert (again.pixels == image.pixels).all() and again.info == image.info
    # of others, as Pillow reads them
    tifffile.imwrite(tmp_path / "b.tif", np.full((4, 4, 3), 255, np.uint8), photometric="rgb")
    assert (sg.Image.load(tmp_path / "b.tif").pixels == 1).all()


def test_floats_in_exr_are_those_of_its_own_library(tmp_path: Path) -> None:
    import json

    library = pytest.importorskip("OpenEXR")
    image = sg.Image(np.random.default_rng(3).random((5, 7, 4)).astype(np.float32) * 3, {"n": "é"})
    image.save(tmp_path / "a.exr")
    part = library.File(str(tmp_path / "a.exr")).parts[0]
    assert (part.channels["RGBA"].pixels == image.pixels).all() and part.channels["RGBA"].pixels.dtype == np.float32
    assert json.loads(part.header["splatgl"]) == image.info
    again = sg.Image.load(tmp_path / "a.exr")
    assert (again.pixels == image.pixels).all() and again.info == image.info
    pixels = np.random.default_rng(4).random((3, 4, 3)).astype(np.float32)
    library.File({}, {"RGB": pixels}).write(str(tmp_path / "b.exr"))
    assert (sg.Image.load(tmp_path / "b.exr").pixels == np.dstack([pixels, np.ones((3, 4))])).all()
    (tmp_path / "c.exr").write_bytes((tmp_path / "a.exr").read_bytes()[:200])
    with pytest.raises(sg.InputError, match=r"c\.exr: cannot be read as a picture"):
        sg.Image.load(tmp_path / "c.exr")


def test_jpeg_is_on_the_background(tmp_path: Path) -> None:
    from PIL import Image as Pillow

    half = np.zeros((16, 16, 4), np.float32)
    half[..., 0] = half[..., 3] = 0.5
    with pytest.raises(
        sg.InputError, match=r"a\.jpg: expected an opaque picture, got transparent pixels; name a background"
    ):
        sg.Image(half).save(tmp_path / "a.jpg")
    assert not (tmp_path / "a.jpg").exists()
    for ground, linear in (((0.0, 0.0, 0.0), (0.5, 0, 0)), ((1.0, 1.0, 1.0), (1.0, 0.5, 0.5))):
        sg.Image(half, {"n": "é"}).save(tmp_path / "a.jpg", background=ground)
        with Pillow.open(tmp_path / "a.jpg") as shown:
            assert shown.mode == "RGB" and b'"n"' in shown.info["comment"]
            wanted = sg.Image(np.array([[[*linear, 1]]], np.float32)).straight()[0, 0, :3] * 255
            assert np.abs(np.asarray(shown, float) - wanted).max() <= 3

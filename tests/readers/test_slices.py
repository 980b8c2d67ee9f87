"""Folders and patterns of slices, and every compression of TIFF, beside what the formats' own libraries read."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError, MissingOption
from splatgl.readers import image_stack, load
from splatgl.readers.chunked import Chunked
from tests.fuzz.seed_files import CUBE
from tests.fuzz.seed_pictures import PICTURES, lsm_file, write_compressed, write_fax

tifffile = pytest.importorskip("tifffile")
imagecodecs = pytest.importorskip("imagecodecs")


def slices(folder: Path, name: str = "s_{}.tif", samples: np.ndarray = CUBE, first: int = 8, **options: Any) -> Path:
    """A folder of slices with numbers from `first` on."""
    from PIL import Image

    folder.mkdir(exist_ok=True)
    for n, plane in enumerate(samples, first):
        path = folder / name.format(n)
        if path.suffix == ".tif":
            tifffile.imwrite(path, plane, **options)
        elif path.suffix in (".jp2", ".jxl"):
            encode = {".jp2": imagecodecs.jpeg2k_encode, ".jxl": imagecodecs.jpegxl_encode}[path.suffix]
            path.write_bytes(encode(plane, level=0 if path.suffix == ".jp2" else None, **options))
        else:
            Image.fromarray(plane).save(path, **options)
    return folder


@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("s_{}.tif", CUBE.astype(np.uint16) * 300),
        ("s_{}.tif", CUBE.astype(np.float32)),
        ("s_{}.tif", CUBE > 90),
        ("s{}.png", CUBE.astype(np.uint16) * 300),
        ("s{}.bmp", CUBE),
        ("s{}.png", CUBE > 90),
        ("s{}.jp2", CUBE.astype(np.uint16) * 300),
        ("s{}.jxl", CUBE),
    ],
)
def test_slices_whole_and_in_parts(
    tmp_path: Path, name: str, samples: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = slices(tmp_path / "a", name, samples)
    whole = load(folder)
    assert whole.samples.dtype == samples.dtype and np.array_equal(whole.samples, samples)
    monkeypatch.setattr(image_stack, "WHOLE_BYTES", 100)
    parts = load(folder)
    assert isinstance(parts.samples, Chunked) and np.array_equal(parts.samples[1:, ::2, 3], samples[1:, ::2, 3])
    # a pattern of names
    assert np.array_equal(load(f"{folder}/{name.format('1?')}").samples[:], samples[2:])


def test_spacing_of_slices(tmp_path: Path) -> None:
    """ImageJ's and OME's metadata, resolutions of tags, and a scanner's log; usual resolutions are told and ignored."""
    imagej = {"imagej": True, "resolution": (2, 4), "metadata": {"unit": "um"}}
    for name, options, spacing, unit, note in (
        ("a", imagej, (0.5, 0.25, 0.5), "um", "slices are as far apart as pixels are wide"),
        (
            "b",
            {"resolution": (50, 50), "resolutionunit": "CENTIMETER"},
            (0.2,) * 3,
            "mm",
            "pixels of 0.2 mm by the tags",
        ),
        (
            "c",
            {"resolution": (300, 300), "resolutionunit": "INCH"},
            (1, 1, 1),
            "",
            "300 dots per inch in the tags are no",
        ),
    ):
        volume = load(slices(tmp_path / name, **options))
        assert volume.spacing == pytest.approx(spacing) and volume.unit == unit, name
        assert note in " ".join(volume.notes)
    folder = slices(tmp_path / "d", "x_rec{}.bmp")
    slices(folder, "x_rec_spr.bmp", CUBE[:1, :3])
    (folder / "x.log").write_text("Pixel Size (um)=4\nImage Pixel Size (um)=9.5\n")
    volume = load(folder)
    assert volume.spacing == (9.5, 9.5, 9.5) and np.array_equal(volume.samples, CUBE)
    assert "2 other files are left out" in volume.notes
    assert load(folder, spacing=(1, 2, 3)).spacing == (1, 2, 3)
    # slices may be reconstructed coarser than projections were taken
    (folder / "x.log").write_text("[Acquisition]\nImage Pixel Size (um)=9.5\n[Reconstruction]\nPixel Size (um)=19.1\n")
    assert load(folder).spacing == (19.1, 19.1, 19.1)
    # their unit, in any coding
    for sign, right in (("µm".encode(), "um"), ("µm".encode("latin-1"), "um"), (b"nm", "nm"), (b"mm", "mm")):
        (folder / "x.log").write_bytes(b"Pixel Size (%b)=9.5\n" % sign)
        assert (load(folder).unit, load(folder).spacing[0]) == (right, 9.5)


def test_a_missing_number_is_told(tmp_path: Path) -> None:
    folder = slices(tmp_path / "a")
    (folder / "s_10.tif").unlink()
    assert "number 10 is missing: the slices around it are rendered as neighbours" in load(folder).notes
    # an even count of every second number is none
    even = slices(tmp_path / "b", "s_{}0.tif")
    assert not any("missing" in note for note in load(even).notes)


def test_stacks_of_two_names_are_not_one(tmp_path: Path) -> None:
    """A mask's slices lie behind the image's; parts of slices, numbered 1a, 1b, 2a, are in one order."""
    folder = slices(slices(tmp_path / "a", "ct_{}.tif"), "mask_{}.tif")
    with pytest.raises(InputError, match=r"got ct_\*\.tif, mask_\*\.tif; name one of these: .*ct_\*\.tif"):
        load(folder)
    assert np.array_equal(load(f"{folder}/mask_*.tif").samples, CUBE)
    mixed = slices(slices(tmp_path / "b", "{}a.tif"), "{}b.tif")
    assert np.array_equal(load(mixed).samples, CUBE.repeat(2, axis=0))


def test_alpha_of_pictures(tmp_path: Path) -> None:
    """Transparent voxels of colours are transparent; grey ones with alpha are grey."""
    from PIL import Image

    alpha = np.where(CUBE > 90, 255, 0).astype(np.uint8)
    for name, mode, parts in (("a", "RGBA", [CUBE, CUBE, CUBE, alpha]), ("b", "LA", [CUBE, alpha])):
        (tmp_path / name).mkdir()
        for n, plane in enumerate(np.stack(parts, -1)):
            Image.fromarray(plane, mode).save(tmp_path / name / f"{n}.png")
        volume = load(tmp_path / name)
        assert np.array_equal(volume.samples, np.where(alpha > 0, CUBE, 0) if name == "a" else CUBE)
        assert (volume.color is not None) == (name == "a")


def test_channels_and_times_in_names(tmp_path: Path) -> None:
    for channel, time in np.ndindex(2, 3):
        slices(tmp_path / "a", f"i_ch{channel}_t{time:02}_z{{}}.png", CUBE // (1 + channel + 2 * time))
    with pytest.raises(MissingOption, match="got 2 channels; pick with channel=0"):
        load(tmp_path / "a")
    volume = load(tmp_path / "a", channel="ch1", time=2)
    assert volume.times == 3 and np.array_equal(volume.samples, CUBE // 6)
    (tmp_path / "a" / "i_ch1_t02_z9.png").unlink()
    with pytest.raises(InputError, match="the same numbers in each channel and time, got some missing"):
        load(tmp_path / "a")
    for row in range(2):
        slices(tmp_path / "b", f"tile{row}_{{}}.png")
    with pytest.raises(InputError, match=r"two, 2 × 6; name those of one stack by a pattern such as tile\*_8"):
        load(tmp_path / "b")
    assert np.array_equal(load(tmp_path / "b" / "tile1_*.png").samples, CUBE)


def test_no_slices(tmp_path: Path) -> None:
    slices(tmp_path / "a", samples=CUBE[:2])
    tifffile.imwrite(tmp_path / "a" / "s_9.tif", CUBE[0, :3])
    with pytest.raises(InputError, match=r"s_9\.tif: expected 11×9 uint8, as s_8\.tif, got 11×3 uint8"):
        load(tmp_path / "a")
    data = (tmp_path / "a" / "s_8.tif").read_bytes()
    (tmp_path / "a" / "s_9.tif").write_bytes(data[:-20])
    with pytest.raises(InputError, match="cannot be read as TIFF"):
        load(tmp_path / "a")
    with pytest.raises(InputError, match="pattern: expected at least two pictures, got fewer"):
        load(tmp_path / "a" / "x*.tif")


def test_jpeg_xr_that_holds_its_decoder_in_a_loop_is_refused_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("imagecodecs")
    from splatgl.readers import tiff_validation

    write_compressed(tmp_path / "a.tif", "jpegxr")
    monkeypatch.setattr(tiff_validation, "_XR_LOOK", "tests.helpers.hostile:loop")
    monkeypatch.setattr(tiff_validation, "_XR_SECONDS", 0.0)
    for _ in range(2):
        with pytest.raises(InputError, match="crashes, takes too long"):
            load(tmp_path / "a.tif")
        monkeypatch.setattr(sys, "executable", "none")


@pytest.mark.parametrize("name", PICTURES)
def test_compressions_of_tiff(tmp_path: Path, name: str) -> None:
    write_compressed(tmp_path / "a.tif", name)
    volume, own = load(tmp_path / "a.tif"), tifffile.imread(tmp_path / "a.tif")
    assert np.array_equal(own if own.ndim == 3 else own[..., 0], volume.samples)
    # a larger picture in a page is refused before it is decoded
    write_compressed(tmp_path / "b.tif", name, np.pad(CUBE, ((0, 0), (0, 99), (0, 99))))
    with tifffile.TiffFile(tmp_path / "b.tif", mode="r+b") as file:
        for page in file.pages:
            for code in (256, 257, 278):
                if code in page.tags:
                    page.tags[code].overwrite(8)
    with pytest.raises(InputError, match=r"picture: expected 8 × 8 pixels at most, got|cannot be read as TIFF"):
        load(tmp_path / "b.tif")


def test_fax_is_read(tmp_path: Path) -> None:
    write_fax(tmp_path / "a.tif")
    volume = load(tmp_path / "a.tif", values="amounts")
    assert np.array_equal(volume.samples[0], tifffile.imread(tmp_path / "a.tif"))


def test_lsm(tmp_path: Path) -> None:
    data, samples = lsm_file()
    (tmp_path / "a.lsm").write_bytes(data)
    volume = load(tmp_path / "a.lsm", channel=1, time=2)
    assert np.array_equal(volume.samples, samples[2, :, 1])
    assert volume.spacing == pytest.approx((0.25, 0.25, 1)) and volume.unit == "um"
    assert volume.times == 3 and volume.time_step == 1.5

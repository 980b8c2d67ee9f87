"""Pictures by their headers: orientation tags, ICC profiles, gamma and primaries, against closed forms."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow
from PIL import ImageCms

import splatgl as sg
from splatgl.cli.main import main
from splatgl.comparison.pictures import frames, read
from splatgl.data.color import linear_from_srgb, srgb_from_linear

ROWS, COLUMNS = np.indices((20, 32))
SAMPLES = np.stack([40 + 6 * COLUMNS, 50 + 9 * ROWS, 240 - 4 * COLUMNS - ROWS], -1).astype(np.uint8)
# what a file holds of a picture by its orientation tag (EXIF 2.32 §4.6.4: the sides of its first row and column)
STORED: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda a: a,
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, 1),
    7: lambda a: np.rot90(a, 2).swapaxes(0, 1),
    8: lambda a: np.rot90(a, -1),
}


def write_png(path: Path, samples: np.ndarray, *chunks: tuple[bytes, bytes]) -> None:
    """A PNG of uint8 or uint16 [H, W, 1, 3 or 4] with further chunks."""
    height, width, channels = samples.shape
    depth, kind = 8 * samples.dtype.itemsize, {1: 0, 3: 2, 4: 6}[channels]
    rows = b"".join(b"\0" + row.astype(samples.dtype.newbyteorder(">")).tobytes() for row in samples)
    header = (b"IHDR", struct.pack(">2I5B", width, height, depth, kind, 0, 0, 0))
    parts = [header, *chunks, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    packed = [struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in parts]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(packed))


def scaled(samples: np.ndarray, kind: type[np.unsignedinteger]) -> np.ndarray:
    """8-bit samples as 8 or 16 bits."""
    return samples.astype(kind) * kind(np.iinfo(kind).max // 255)


def levels(path: Path) -> np.ndarray:
    """sRGB of a picture that is read, float64 [H, W, 3], from 0 to 255."""
    return 255 * sg.Image.load(path).straight()[..., :3]


@pytest.mark.parametrize("tag", STORED)
def test_pictures_stand_upright(tag: int, tmp_path: Path) -> None:
    exif = Pillow.Exif()
    exif[0x0112] = tag
    stored = np.ascontiguousarray(STORED[tag](SAMPLES))
    picture = Pillow.fromarray(stored)
    picture.save(tmp_path / "a.png", exif=exif)
    picture.save(tmp_path / "a.jpg", exif=exif, quality=100, subsampling=0)
    picture.save(tmp_path / "a.webp", exif=exif, lossless=True)
    write_png(tmp_path / "deep.png", np.uint16(257) * stored, (b"eXIf", exif.tobytes()[6:]))
    for name, most in (("a.png", 0.01), ("a.webp", 0.01), ("a.jpg", 4), ("deep.png", 0.01)):
        assert levels(tmp_path / name).shape == SAMPLES.shape
        assert np.abs(levels(tmp_path / name) - SAMPLES).max() < most


# sRGB's curve, and primaries of displays with more colours (SMPTE EG 432-1), in XYZ of D50 and as x and y under D65
P3_XYZ = np.array([[0.51512, 0.29198, 0.1571], [0.2412, 0.69225, 0.06657], [-0.00105, 0.04189, 0.78407]])
SRGB_XYZ = np.array([[0.43607, 0.38515, 0.14307], [0.22249, 0.71687, 0.06061], [0.01392, 0.09708, 0.7141]])
P3_CHROMATICITY = (0.3127, 0.329, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)


def icc_profile(space: bytes, matrix: np.ndarray) -> bytes:
    """A profile of version 4 with sRGB's curve: RGB by a matrix, or gray."""

    def fixed(values: tuple[float, ...]) -> bytes:
        return struct.pack(f">{len(values)}i", *(round(value * 65536) for value in values))

    curve = b"para\0\0\0\0\0\3\0\0" + fixed((2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045))
    name = b"mluc\0\0\0\0" + struct.pack(">II2s2sII", 1, 12, b"en", b"US", 2, 28) + "x".encode("utf-16-be") + b"\0\0"
    white = (0.9642, 1.0, 0.8249)
    tags = {b"desc": name, b"cprt": name, b"wtpt": b"XYZ \0\0\0\0" + fixed(white)}
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    else:
        tags |= {kind + b"TRC": curve for kind in (b"r", b"g", b"b")}
        tags |= {
            k + b"XYZ": b"XYZ \0\0\0\0" + fixed(tuple(c)) for k, c in zip((b"r", b"g", b"b"), matrix.T, strict=True)
        }
    table, body, start = b"", b"", 132 + 12 * len(tags)
    for kind, data in tags.items():
        table += kind + struct.pack(">II", start + len(body), len(data))
        body += data + bytes(-len(data) % 4)
    head = struct.pack(">I4sI4s4s4s", start + len(body), b"none", 0x04000000, b"mntr", space, b"XYZ ")
    head += bytes(12) + b"acsp" + bytes(28) + fixed(white) + bytes(48)
    return head + struct.pack(">I", len(tags)) + table + body


def iccp(profile: bytes) -> tuple[bytes, bytes]:
    return b"iCCP", b"x\0\0" + zlib.compress(profile)


def shown(samples: np.ndarray, matrix: np.ndarray = SRGB_XYZ) -> np.ndarray:
    """sRGB, 0 to 255, of encoded values with sRGB's curve and the primaries of a matrix."""
    light = linear_from_srgb(samples) @ (np.linalg.inv(SRGB_XYZ) @ matrix).T
    return 255 * srgb_from_linear(np.clip(light, 0, 1))


@pytest.mark.parametrize("alpha", [False, True])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_colors_are_those_of_their_profile(kind: type[np.unsignedinteger], alpha: bool, tmp_path: Path) -> None:
    top = np.iinfo(kind).max
    samples = scaled(SAMPLES, kind)
    stored = np.dstack([samples, np.full(samples.shape[:2], top // 3, kind)]) if alpha else samples
    write_png(tmp_path / "wide.png", stored, iccp(icc_profile(b"RGB ", P3_XYZ)))
    write_png(tmp_path / "plain.png", stored)
    assert np.abs(levels(tmp_path / "wide.png") - shown(samples / top, P3_XYZ)).max() < (
        1.6 if kind == np.uint8 else 0.3
    )
    assert np.abs(levels(tmp_path / "wide.png") - SAMPLES).max() > 20
    assert sg.Image.load(tmp_path / "wide.png").pixels[0, 0, 3] == pytest.approx(1 / 3 if alpha else 1)
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for profile in (srgb, b"damaged" * 30):
        write_png(tmp_path / "a.png", stored, iccp(profile))
        assert (sg.Image.load(tmp_path / "a.png").pixels == sg.Image.load(tmp_path / "plain.png").pixels).all()
    assert main(["compare", str(tmp_path / "wide.png"), str(tmp_path / "plain.png")]) == 1


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_profiles_of_gray_and_of_other_colors(kind: type[np.unsignedinteger], tmp_path: Path) -> None:
    gray = scaled(SAMPLES[..., :1], kind)
    write_png(tmp_path / "gray.png", gray, iccp(icc_profile(b"GRAY", P3_XYZ)))
    assert np.abs(levels(tmp_path / "gray.png") - SAMPLES[..., :1]).max() < 1.1
    # a profile of gray says nothing of colours
    write_png(tmp_path / "color.png", scaled(SAMPLES, kind), iccp(icc_profile(b"GRAY", P3_XYZ)))
    assert np.abs(levels(tmp_path / "color.png") - SAMPLES).max() < 0.01


def test_a_jpeg_and_frames_have_profiles_too(tmp_path: Path) -> None:
    picture, profile = Pillow.fromarray(SAMPLES), icc_profile(b"RGB ", P3_XYZ)
    picture.save(tmp_path / "a.jpg", quality=100, subsampling=0, icc_profile=profile)
    assert np.abs(levels(tmp_path / "a.jpg") - shown(SAMPLES / 255, P3_XYZ)).mean() < 1
    picture.save(tmp_path / "a.tiff", icc_profile=profile, save_all=True, append_images=[picture])
    pages = [255 * page.image.straight()[..., :3] for page in frames(tmp_path / "a.tiff")]
    assert len(pages) == 2 and np.abs(pages[0] - shown(SAMPLES / 255, P3_XYZ)).max() < 1.6


Truth = Callable[[np.ndarray], np.ndarray]
GAMMAS: dict[str, tuple[list[tuple[bytes, int | None]], Truth]] = {
    "linear": ([(b"gAMA", 100000)], lambda s: 255 * srgb_from_linear(s)),
    "of 1.8": ([(b"gAMA", 55556)], lambda s: 255 * srgb_from_linear(s**1.8)),
    "that stands for sRGB": ([(b"gAMA", 45455)], lambda s: 255 * s),
    "beside sRGB": ([(b"gAMA", 100000), (b"sRGB", None)], lambda s: 255 * s),
}


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("gamma", GAMMAS)
def test_gamma_of_png(gamma: str, kind: type[np.unsignedinteger], tmp_path: Path) -> None:
    given, truth = GAMMAS[gamma]
    chunks = [(name, b"\0" if value is None else struct.pack(">I", value)) for name, value in given]
    top = np.iinfo(kind).max
    write_png(tmp_path / "a.png", scaled(SAMPLES, kind), *chunks)
    assert np.abs(levels(tmp_path / "a.png") - truth(SAMPLES / 255)).max() < 0.51 * 255 / top + 0.01


@pytest.mark.parametrize("gamma", [45455, 100000])
def test_primaries_of_png(gamma: int, tmp_path: Path) -> None:
    chunks = [
        (b"gAMA", struct.pack(">I", gamma)),
        (b"cHRM", struct.pack(">8I", *(round(1e5 * v) for v in P3_CHROMATICITY))),
    ]
    write_png(tmp_path / "a.png", SAMPLES, *chunks)
    encoded = SAMPLES / 255 if gamma == 45455 else srgb_from_linear(SAMPLES / 255)
    assert np.abs(levels(tmp_path / "a.png") - shown(encoded, P3_XYZ)).max() < 1


def test_gray_of_16_bits_in_tiff_and_what_is_no_sample(tmp_path: Path) -> None:
    gray = scaled(SAMPLES[..., 0], np.uint16)
    Pillow.fromarray(gray).save(tmp_path / "a.tif")
    Pillow.fromarray(gray).save(tmp_path / "b.tif", save_all=True, append_images=[Pillow.fromarray(gray)])
    assert np.abs(levels(tmp_path / "a.tif") - SAMPLES[..., :1]).max() < 0.01
    assert [page.image.bits for page in frames(tmp_path / "b.tif")] == [16, 16]
    for kind in (np.float32, np.int32):
        Pillow.fromarray(gray.astype(kind)).save(tmp_path / "c.tif")
        with pytest.raises(sg.InputError, match=r"c.tif: cannot be read .* of 8 or 16 bits, got 32"):
            sg.Image.load(tmp_path / "c.tif")


def test_a_transparent_color_is_alpha(tmp_path: Path) -> None:
    """Of two files of one look, one with a key and one with alpha; what is hidden may be any colour."""
    key = tuple(int(n) for n in SAMPLES[3, 4])
    write_png(tmp_path / "key.png", SAMPLES, (b"tRNS", struct.pack(">3H", *key)))
    alpha = np.where(np.all(np.equal(SAMPLES, key), axis=-1), 0, 255).astype(np.uint8)
    hidden = np.dstack([SAMPLES, alpha])
    hidden[alpha == 0, :3] = 7
    write_png(tmp_path / "alpha.png", hidden)
    write_png(tmp_path / "gray.png", SAMPLES[..., :1], (b"tRNS", struct.pack(">H", key[0])))
    assert read(tmp_path / "key.png").mode == "RGBA" and read(tmp_path / "gray.png").mode == "gray with alpha"
    assert main(["compare", str(tmp_path / "key.png"), str(tmp_path / "alpha.png"), "--max-difference", "0"]) == 0


def test_damaged_tags_are_no_error(tmp_path: Path) -> None:
    write_png(
        tmp_path / "a.png", SAMPLES, (b"eXIf", b"no tags"), (b"gAMA", struct.pack(">I", 45455)), (b"cHRM", bytes(32))
    )
    assert np.abs(levels(tmp_path / "a.png") - SAMPLES).max() < 0.01
    file = io.BytesIO()
    Pillow.fromarray(SAMPLES).save(file, "PNG", exif=b"II*\0\x08\0\0\0\xff\xff")
    (tmp_path / "b.png").write_bytes(file.getvalue())
    assert np.abs(levels(tmp_path / "b.png") - SAMPLES).max() < 0.01

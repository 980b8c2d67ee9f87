"""`Image`: linear premultiplied float32 pixels, and PNG and NPY files that say where they came from."""

from __future__ import annotations

import io
import json
import os
import struct
import tempfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.errors import InputError, expected, missing_extra

# the PNG text chunk that holds the provenance as JSON
KEYWORD = "splatgl"
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, eq=False)
class Image:
    """pixels: float32 [H, W, 4], linear, premultiplied, row 0 on top. info: what was drawn and how."""

    pixels: np.ndarray
    info: Mapping[str, object] = field(default_factory=dict)

    def save(self, path: str | Path, bits: int = 8, background: tuple[float, float, float] | None = None) -> None:
        """Writes .png (sRGB, straight alpha, 8 or 16 bits) or .npy (the pixels); whole or not at all.

        background: linear RGB that a PNG is laid over; None keeps it transparent. An `xray` picture
        is scaled to its maximum in a PNG; the factor is in the file's text. Raises InputError for
        another suffix, and if the file cannot be written.
        """
        target = Path(path)
        info = dict(self.info)
        if target.suffix.lower() == ".npy":
            buffer = io.BytesIO()
            np.save(buffer, self.pixels)
            data = buffer.getvalue()
        elif target.suffix.lower() == ".png":
            data = self._png(info, bits, background)
        else:
            raise expected(target, "a name that ends in .png or .npy", repr(target.suffix))
        write_whole(target, data)

    @classmethod
    def load(cls, path: str | Path) -> Image:
        """A picture from .npy ([H, W, 4]) or any file Pillow reads, back in linear premultiplied light."""
        source = Path(path)
        if source.suffix.lower() == ".npy":
            return cls(_load_npy(source))
        straight, info = _load_png(source)
        linear = linear_from_srgb(straight[..., :3]) * straight[..., 3:]
        return cls(np.concatenate([linear, straight[..., 3:]], axis=-1).astype(np.float32), info)

    def straight(self) -> np.ndarray:
        """sRGB with straight alpha, float64 [H, W, 4] in [0, 1]."""
        pixels = np.clip(np.nan_to_num(self.pixels.astype(np.float64)), 0.0, None)
        alpha = np.minimum(pixels[..., 3:], 1.0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            color = np.where(alpha > 0, pixels[..., :3] / alpha, 0.0)
        return np.concatenate([srgb_from_linear(np.clip(color, 0.0, 1.0)), alpha], axis=-1)

    def over(self, background: tuple[float, float, float]) -> Image:
        """This picture on a colour (linear RGB)."""
        ground = np.append(np.asarray(background, np.float32), np.float32(1))
        return Image(self.pixels + (1 - self.pixels[..., 3:]) * ground, self.info)

    def _png(self, info: dict[str, object], bits: int, background: tuple[float, float, float] | None) -> bytes:
        image = self
        if info.get("blend") == "xray":
            top = float(self.pixels.max()) or 1.0
            info["scale"] = 1.0 / top
            image = Image(self.pixels / np.float32(top), info)
        if background is not None:
            image = image.over(background)
        if bits not in (8, 16):
            raise expected("bits", "8 or 16", bits)
        one = 2**bits - 1
        samples = np.rint(image.straight() * one).astype(np.uint8 if bits == 8 else np.uint16)
        return _with_text(_encode(samples), KEYWORD, json.dumps(info, ensure_ascii=True))


def write_whole(target: Path, data: bytes) -> None:
    """Writes a file beside its place and renames it there, so that it is never seen half-written."""
    temporary = ""
    try:
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name}.", delete=False) as file:
            temporary = file.name
            file.write(data)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary and os.path.exists(temporary):
            os.unlink(temporary)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _encode(samples: np.ndarray) -> bytes:
    if samples.dtype == np.uint8:
        from PIL import Image as Pillow

        buffer = io.BytesIO()
        Pillow.fromarray(samples).save(buffer, "PNG", compress_level=4)
        return buffer.getvalue()
    try:
        from imagecodecs import png_encode
    except ImportError as error:
        raise missing_extra("16-bit PNG", "imagecodecs", "readers") from error
    return bytes(png_encode(samples, level=4))


def _with_text(png: bytes, keyword: str, text: str) -> bytes:
    """The PNG with a tEXt chunk behind its header chunk (PNG specification §11.3.4.3)."""
    body = b"tEXt" + keyword.encode("latin-1") + b"\0" + text.encode("latin-1")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    header = len(PNG_SIGNATURE) + 25
    return png[:header] + chunk + png[header:]


def _load_npy(source: Path) -> np.ndarray:
    try:
        pixels = np.load(source, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{source}: cannot be read: {error}") from error
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype.kind != "f":
        raise expected(source, "float pixels [H, W, 4]", f"{pixels.dtype} {pixels.shape}")
    return np.asarray(pixels, np.float32)


def _load_png(source: Path) -> tuple[np.ndarray, dict[str, object]]:
    """Straight sRGB float64 [H, W, 4] in [0, 1], and the provenance if there is one."""
    from PIL import Image as Pillow

    try:
        with Pillow.open(source) as picture:
            text = getattr(picture, "text", {}).get(KEYWORD, "{}")
            deep = picture.format == "PNG" and _png_bits(source) == 16
            straight = np.asarray(picture.convert("RGBA"), np.float64) / 255
        return (_decode_deep(source) if deep else straight), json.loads(text)
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{source}: cannot be read as a picture: {error}") from error


def _png_bits(source: Path) -> int:
    with open(source, "rb") as file:
        return file.read(25)[24]


def _decode_deep(source: Path) -> np.ndarray:
    try:
        from imagecodecs import png_decode
    except ImportError as error:
        raise missing_extra(f"{source}: 16-bit PNG", "imagecodecs", "readers") from error
    samples = np.asarray(png_decode(source.read_bytes()), np.float64) / 65535
    if samples.ndim == 2 or samples.shape[2] < 3:
        alpha = samples[..., 1:2] if samples.ndim == 3 and samples.shape[2] == 2 else None
        gray = samples[..., None] if samples.ndim == 2 else samples[..., :1]
        samples = np.concatenate([gray] * 3 + ([alpha] if alpha is not None else []), axis=-1)
    if samples.shape[2] == 3:
        samples = np.concatenate([samples, np.ones_like(samples[..., :1])], axis=-1)
    return samples

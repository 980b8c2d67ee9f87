"""`Image`: linear premultiplied float32 pixels, their accuracy, and files of them with provenance."""

from __future__ import annotations

import io
import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import ceil, floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import linear_from_srgb, srgb_bytes, srgb_from_linear
from splatgl.data.figure import VECTOR, Figure, vector_library
from splatgl.errors import InputError, expected, import_extra, one_line
from splatgl.fileio import require_file, require_memory, write_file

if TYPE_CHECKING:
    from splatgl.geometry.camera import Camera


def aliasing_note(info: Mapping[str, object]) -> str:
    """A clause on the error of a picture whose voxels are narrower than its samples, by its provenance, as the
    reference takes the same samples; "" for others.
    """
    return "; aliasing is not counted" if info.get("aliased") is True else ""


@dataclass(frozen=True)
class Accuracy:
    """Error of a picture against the float64 reference of the same splats, linear premultiplied light.

    error_bound: largest error of any channel of any pixel. tolerance: the allowed one. tolerance_met: whether the bound
    is within it. checked: as `sg.check` stores it, of pixels that were drawn in float64. Each is None where it is not
    known. brightest: largest component of a picture of sums, to which its errors are relative. level: of the volume.
    note: of `aliasing_note`.
    """

    error_bound: float | None
    tolerance: float | None
    tolerance_met: bool | None
    checked: Mapping[str, Any] | None = None
    brightest: float | None = None
    level: int = 0
    note: str = ""

    def __str__(self) -> str:
        """The bound and the tolerance, and a line of each comparison."""
        if self.tolerance is None:
            return "its error is not known"
        known = "no error bound" if self.error_bound is None else f"error bound {self.error_bound:.3g}"
        met = {None: "not known to be met", False: "not met", True: "met"}[self.tolerance_met]
        text = f"{known}: the tolerance {self._allowed} is {met}{self.note}"
        return "\n".join([text, *self.comparisons])

    @property
    def _relative(self) -> str:
        """The light of a picture of sums, of which errors are a part."""
        return "" if self.brightest is None else f" of {self.brightest:.3g}"

    @property
    def _allowed(self) -> str:
        """The tolerance, of sums as light, as errors are."""
        return f"{(self.tolerance or 0.0) * (1.0 if self.brightest is None else self.brightest):.3g}{self._relative}"

    @property
    def summary(self) -> str:
        """A short line: the RMSE and the largest error of the compared pixels, or the bound."""
        if self.checked is None and self.error_bound is None:
            return "not known"
        if self.checked is None:
            met = "within" if self.tolerance_met else "above"
            tolerance = "" if self.tolerance is None else f", {met} the tolerance {self._allowed}"
            return f"error at most {self.error_bound:.2g}{tolerance}{self.note}"
        checked, relative = self.checked, self._relative
        is_whole, count = checked["confidence"] == 1, checked["pixels"]
        share = "all pixels" if is_whole else f"at least {floor(100 * (1 - checked['share'])):d} % of all pixels"
        largest = _round_up(checked["largest"])
        text = f"RMSE {checked['rmse']:.1g}{relative} in {count} checked pixels, {share} within {largest}{relative}"
        if checked["share_above_tolerance"] > checked["share"]:
            text += f", up to {_round_up(100 * checked['share_above_tolerance'])} % above the tolerance {self._allowed}"
        if self.level:
            text += f", of level {self.level}'s voxels"
        field = checked.get("field")
        return f"{text}{self.note}" + (
            f"; off the field itself by up to {field['largest']:.2g}{relative}" if field else ""
        )

    @property
    def comparisons(self) -> tuple[str, ...]:
        """Text on the errors of compared pixels, to the reference and to the field."""
        if self.checked is None:
            return ()
        checked, relative = self.checked, self._relative
        text = guarantee(checked, relative)
        text += f": {'all ' * (checked['confidence'] == 1)}{checked['pixels']} drawn in float64"
        if self.level:
            text += f", of level {self.level}'s voxels"
        text += f"; RMSE {checked['rmse']:.2g}, worst at {checked['worst'][0]}, {checked['worst'][1]}"
        field = checked.get("field")
        if field is None:
            return (text,)
        field_text = f"off the field itself by up to {field['largest']:.2g}{relative}, RMSE {field['rmse']:.2g}"
        return text, f"{field_text}, in {field['pixels']} of these pixels"


def guarantee(checked: Mapping[str, Any], relative: str = "") -> str:
    """The statement that follows from a comparison with float64. relative: to what, of sums."""
    most = f"{_round_up(checked['largest'])}{relative}"
    if checked["confidence"] == 1:
        return f"no pixel is off by more than {most}"
    above = checked["share_above_tolerance"]
    text = f"with {100 * checked['confidence']:.0f} % confidence at most {_round_up(100 * checked['share'])} % of the "
    text += f"pixels are off by more than {most}"
    return text if above <= checked["share"] else f"{text}, {_round_up(100 * above)} % by more than the tolerance"


def _round_up(number: float) -> str:
    """Two digits of a number, rounded up."""
    if number <= 0:
        return "0"
    step = 10.0 ** (floor(log10(number)) - 1)
    return f"{ceil(round(number / step, 9)) * step:.2g}"


# the EXR attribute that holds the provenance as JSON; in TIFF it is the ImageDescription
KEYWORD = "splatgl"
TIFF, EXR, JPEG = (".tif", ".tiff"), (".exr",), (".jpg", ".jpeg")
QUALITY = 95

Info = Mapping[str, object]


def require_library(suffix: str) -> None:
    """Raises InputError, before any work, if the library of a suffix is missing."""
    if suffix in TIFF:
        tiff_library()
    elif suffix in EXR:
        exr_library()
    elif suffix in VECTOR:
        vector_library()


def density(info: Info) -> float | None:
    """The dots per inch that the provenance states."""
    dpi = info.get("dpi")
    return float(dpi) if isinstance(dpi, int | float) else None


def reproducible(info: Info) -> dict[str, object]:
    """The provenance as files hold it, equal in all runs: without times, and without the comparison of as many pixels
    as a time allows.
    """
    kept = {name: value for name, value in info.items() if name != "seconds"}
    for name, value in kept.items():
        if isinstance(value, dict) and "seconds" in value:
            kept[name] = "of as many pixels as a time allows: not stored" if name == "checked" else reproducible(value)
    return kept


def encode_tiff(pixels: np.ndarray, info: Info) -> bytes:
    """float32 [H, W], or RGBA [H, W, 4] with associated alpha, deflated; the provenance is the ImageDescription."""
    buffer, description = io.BytesIO(), json.dumps(dict(info), ensure_ascii=True)
    kind: dict[str, Any] = {"photometric": "rgb", "extrasamples": ["assocalpha"]} if pixels.ndim == 3 else {}
    kind |= {"resolution": (dpi, dpi), "resolutionunit": "INCH"} if (dpi := density(info)) else {}
    values = pixels.astype(np.float32)
    tiff_library().imwrite(buffer, values, compression="zlib", description=description, metadata=None, **kind)
    return buffer.getvalue()


def encode_exr(pixels: np.ndarray, info: Info) -> bytes:
    """float32 [H, W] as channel Z, or RGBA [H, W, 4], linear and premultiplied, compressed without loss."""
    library, text, buffer = exr_library(), json.dumps(dict(info), ensure_ascii=True), io.BytesIO()
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage, KEYWORD: text}
    channels = {"RGBA" if pixels.ndim == 3 else "Z": np.ascontiguousarray(pixels, np.float32)}
    library.File(header, channels).write(buffer)
    return buffer.getvalue()


def encode_jpeg(samples: np.ndarray, info: Info) -> bytes:
    """JPEG of opaque sRGB samples, uint8 [H, W, 4]; the provenance is the comment."""
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    about: dict[str, Any] = {"comment": json.dumps(dict(info), ensure_ascii=True)}
    about |= {"dpi": (dpi, dpi)} if (dpi := density(info)) else {}
    try:
        Pillow.fromarray(samples[..., :3]).save(buffer, "JPEG", quality=QUALITY, subsampling=0, **about)
    except OSError as error:
        height, width, _ = samples.shape
        raise expected("JPEG", "at most 65500 pixels a side", f"{width}×{height}", "save as .png") from error
    return buffer.getvalue()


def load_tiff(source: Path) -> tuple[np.ndarray, dict[str, object]] | None:
    """Pixels float32 [H, W, 4] and provenance of a TIFF of splatgl, with associated alpha; None for other files, and
    without tifffile.
    """
    try:
        library = tiff_library()
    except InputError:
        return None
    with _picture_errors(source), library.TiffFile(source) as tiff:
        page = tiff.pages[0]
        is_rgba = page.dtype == np.float32 and page.shape[2:] == (4,) and tuple(page.extrasamples) == (1,)
        return (page.asarray(), provenance(page.description)) if is_rgba else None


def load_exr(source: Path) -> tuple[np.ndarray, dict[str, object]]:
    """Pixels float32 [H, W, 4] and the provenance of an EXR with the channels RGB or RGBA."""
    library = exr_library()
    with _picture_errors(source):
        part = library.File(str(source)).parts[0]
        channels = {name: channel.pixels for name, channel in part.channels.items()}
        text = str(part.header.get(KEYWORD, ""))
    if "RGBA" not in channels and "RGB" not in channels:
        raise expected(source, "the channels RGBA or RGB", ", ".join(channels) or "none")
    pixels = np.asarray(channels.get("RGBA", channels.get("RGB")), np.float32)
    if pixels.shape[2] == 3:
        pixels = np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1)
    return pixels, provenance(text)


@contextmanager
def _picture_errors(source: Path) -> Iterator[None]:
    """Converts any exception of a library into InputError."""
    try:
        yield
    except Exception as error:
        raise InputError(f"{source}: cannot be read as a picture: {one_line(error)}") from error


def provenance(text: str) -> dict[str, object]:
    """The provenance in JSON text; empty for other text."""
    try:
        table = json.loads(text or "{}")
    except ValueError:
        return {}
    return table if isinstance(table, dict) else {}


def tiff_library() -> Any:
    """tifffile. Raises InputError if it is missing."""
    return import_extra("tifffile", "TIFF pictures", "tifffile", "readers")


def exr_library() -> Any:
    """OpenEXR. Raises InputError if it is missing."""
    return import_extra("OpenEXR", "EXR pictures", "OpenEXR", "exr")


# endings of the files that `Image.save` writes
SAVED = (".png", ".npy", *JPEG, *TIFF, *EXR, *VECTOR)
BLACK = (0.0, 0.0, 0.0)
# rows per band: numpy converts samples to 8-byte indices, which should stay in the cache
BAND_ROWS = 16
METRES_OF_INCH = 0.0254
# bytes of a pixel as it is decoded, and in float32
DECODED = 4 + 16
# PNG specification §5.2, §9.2 and §11.2.2: signature, filter of differences to the row above, and colour types by the
# number of samples a pixel
PNG_SIGNATURE, UP, COLOR_TYPES = b"\x89PNG\r\n\x1a\n", 2, {3: 2, 4: 6}


@public
@dataclass(frozen=True, eq=False)
class Image:
    """pixels: float32 [H, W, 4], linear, premultiplied, row 0 at the top. info: how the image was rendered. figure: the
    picture without its annotations, and these, for PDF and SVG. bits: 8 or 16 of samples, None of floats. drawn:
    pixels as a renderer drew them, whose `accuracy` can be computed; None of files, of blurred pictures, and of copies
    for other processes. plan: the `ScenePlan` that drew it; None of files, and of copies for other processes.
    """

    pixels: np.ndarray
    info: Mapping[str, object] = field(default_factory=dict)
    figure: Figure | None = None
    bits: int | None = None
    drawn: np.ndarray | None = field(default=None, repr=False)
    plan: Any = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, object]:
        """The fields for a copy, without its plan and what was drawn, which may be large."""
        return {**self.__dict__, "drawn": None, "plan": None}

    @cached_property
    def accuracy(self) -> Accuracy:
        """The error against float64, computed when it is asked for first: of 60 random pixels, or 10 of a volume in
        bricks, unless `sg.check` or the file has compared others. They are the same in each run.
        """
        from splatgl.reference.check import accuracy_of

        return accuracy_of(self)

    def with_accuracy(self) -> Image:
        """The image with info["checked"] of its `accuracy`, unless its error has a bound or is compared already."""
        if self.drawn is None or "checked" in self.info or self.info.get("error_bound") is not None:
            return self
        return replace(self, info={**self.info, "checked": self.accuracy.checked})

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on omissions, and on options without effect: info["notes"]."""
        notes = self.info.get("notes", ())
        return notes if isinstance(notes, tuple) else ()

    def with_notes(self, notes: Sequence[str]) -> Image:
        """The image with further notes before its own, each once."""
        joined = tuple(dict.fromkeys((*notes, *self.notes)))
        return replace(self, info={**self.info, "notes": joined}) if joined else self

    @property
    def camera(self) -> Camera:
        """The camera of the picture. Raises InputError for pictures without one."""
        from splatgl.geometry.camera import Camera

        info: Any = self.info
        if "extent" not in info:
            raise expected("image", "one drawn by splatgl, which states its camera", "another one")
        axes = np.array([info[name] for name in ("right", "down", "forward")])
        return Camera(
            np.array(info["eye"]), axes, tuple(info["size"]), info["extent"], info["projection"] == "perspective"
        )

    def save(
        self,
        path: str | Path,
        bits: int = 8,
        background: tuple[float, float, float] | None = None,
        checked: bool = True,
    ) -> None:
        """Writes .png (sRGB, straight alpha, 8 or 16 bits), .jpg (sRGB), .npy, .tif or .exr (the pixels), atomically.
        In .svg and .pdf annotations are text and lines over the pixels.

        background: linear RGB behind a PNG, JPEG or page; None keeps it as it was drawn. An `xray` image is scaled to
        its maximum in these; the factor is in the file's text. Equal pictures give equal bytes: what took how long is
        not in the file, but its accuracy is, which takes .2 s and more if no bound is known, unless checked is False.
        Raises InputError for another suffix, for transparent pixels in JPEG, and if the file cannot be written.
        """
        name = Path(path)
        image = self if name.suffix.lower() == ".npy" or not checked else self.with_accuracy()
        write_file(name, image.encoded(name, bits, background))

    def encoded(self, name: Path, bits: int = 8, background: tuple[float, float, float] | None = None) -> bytes:
        """The bytes that `save` writes into a file of that name."""
        ending, info = name.suffix.lower(), reproducible(self.info)
        background = self.ground if background is None else background
        if ending not in SAVED:
            raise expected(name, f"a name that ends in {' or '.join(SAVED)}", repr(name.suffix))
        if ending == ".npy":
            return _npy(self.pixels)
        if ending in TIFF:
            return encode_tiff(self.pixels, info)
        if ending in EXR:
            return encode_exr(self.pixels, info)
        if ending in JPEG:
            samples = self._samples(info, 8, background or (BLACK if self.is_sum else None))
            if (samples[..., 3] < 255).any():
                fix = "name a background, or save it as .png"
                raise expected(name, "an opaque picture", "transparent pixels", fix)
            return encode_jpeg(samples, info)
        # the samples first: this adds the X-ray scale to `info`
        if ending in VECTOR:
            page = self.figure or Figure(_linear_pixels(self._samples(info, 8, None)))
            page = page if background is None else replace(page, ground=background)
            return page.encoded(ending, info, density(info))
        samples = self._samples(info, bits, background)
        return encode_png(samples, chunks=_about_chunks(info))

    @classmethod
    def load(cls, path: str | Path) -> Image:
        """Reads .npy ([H, W, 4]), .exr, .tif of floats, or what Pillow supports, as linear premultiplied light.

        Files of samples are read as a browser shows them: in sRGB by their colour profile or gamma, upright by their
        orientation tag.
        """
        source = Path(path)
        require_file(source)
        if source.suffix.lower() == ".npy":
            return cls(_load_npy(source))
        if source.suffix.lower() in EXR:
            return cls(*load_exr(source))
        if source.suffix.lower() in TIFF and (image := load_tiff(source)) is not None:
            return cls(*image)
        samples, info = load_png(source)
        return cls(_linear_pixels(samples), info, bits=8 * samples.itemsize)

    @classmethod
    def from_samples(cls, samples: np.ndarray) -> Image:
        """An image from sRGB samples with straight or no alpha: uint8 or uint16 [H, W, 3 or 4]."""
        if samples.ndim != 3 or samples.shape[2] not in (3, 4) or samples.dtype not in (np.uint8, np.uint16):
            raise expected("samples", "uint8 or uint16 [H, W, 3 or 4]", f"{samples.dtype} {samples.shape}")
        if samples.shape[2] == 3:
            opaque = np.full_like(samples[..., :1], np.iinfo(samples.dtype).max)
            samples = np.concatenate([samples, opaque], axis=-1)
        return cls(_linear_pixels(samples), bits=8 * samples.itemsize)

    def rounded(self, bits: int = 8, background: tuple[float, float, float] | None = None) -> Image:
        """The image after a round trip through a PNG of `bits` (8 or 16) on `background`, without writing one."""
        info, ground = dict(self.info), self.ground if background is None else background
        return Image(_linear_pixels(self._samples(info, bits, ground)), info, bits=bits)

    def straight(self) -> np.ndarray:
        """Pixels in sRGB with straight alpha, float64 [H, W, 4] in [0, 1]."""
        pixels = np.clip(np.nan_to_num(self.pixels.astype(np.float64)), 0.0, None)
        alpha = np.minimum(pixels[..., 3:], 1.0)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            color = np.where(alpha > 0, pixels[..., :3] / alpha, 0.0)
        return np.concatenate([srgb_from_linear(np.clip(color, 0.0, 1.0)), alpha], axis=-1)

    def over(self, background: tuple[float, float, float]) -> Image:
        """This image over a background colour (linear RGB)."""
        ground = np.append(np.asarray(background, np.float32), np.float32(1))
        return Image(self.pixels + (1 - self.pixels[..., 3:]) * ground, self.info)

    def to_pil(self) -> Any:
        """A Pillow image: sRGB with straight alpha, 8 bits, as `save` writes it."""
        from PIL import Image as Pillow

        return Pillow.fromarray(self.samples8())

    def samples8(self, background: tuple[float, float, float] | None = None) -> np.ndarray:
        """uint8 [H, W, 4], sRGB with straight alpha, as `save` writes them."""
        return self._samples(dict(self.info), 8, self.ground if background is None else background)

    @property
    def srgb(self) -> np.ndarray:
        """uint8 [H, W, 4], sRGB with straight alpha, as files and screens have it; `pixels` are linear light."""
        return self.samples8()

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The array `srgb`, so that `plt.imshow(image)` and `np.asarray(image)` show what a file shows."""
        if copy is False:
            raise ValueError("image: samples of sRGB are made when they are asked for: a copy")
        return np.asarray(self.srgb, dtype)

    def __repr__(self) -> str:
        """One line: size, source and blend mode."""
        height, width, _ = self.pixels.shape
        parts = [str(self.info[name]) for name in ("source", "blend") if self.info.get(name)]
        return f"<Image {width}×{height}{': ' if parts else ''}{', '.join(parts)}>"

    def _repr_png_(self) -> bytes:
        """PNG for notebooks."""
        return self.encoded(Path("image.png"))

    @property
    def is_sum(self) -> bool:
        """Whether the pixels are sums without a largest value."""
        return str(self.info.get("blend")).partition(" ")[0] == "xray"

    @property
    def white(self) -> float:
        """The light that is saved and shown as white: that of the brightest component of sums, unless they are scaled
        to it; else 1.
        """
        return (float(self.pixels.max()) or 1.0) if self.info.get("blend") == "xray" else 1.0

    @property
    def ground(self) -> tuple[float, float, float] | None:
        """The background of an X-ray, linear RGB, which its pixels do not hold; None for other images."""
        ground = self.info.get("background") if self.is_sum else None
        return (float(ground[0]), float(ground[1]), float(ground[2])) if isinstance(ground, list | tuple) else None

    def _samples(self, info: dict[str, object], bits: int, background: tuple[float, float, float] | None) -> np.ndarray:
        """Straight sRGB, uint8 or uint16 [H, W, 4]; the scale of an X-ray is stored in `info`."""
        image = self
        if info.get("blend") == "xray":
            top = self.white
            # on that of the file which it was read from
            known = info.get("scale")
            info["scale"] = (float(known) if isinstance(known, int | float) else 1.0) / top
            image = Image(self.pixels / np.float32(top), info)
        if background is not None:
            image = image.over(background)
        if bits not in (8, 16):
            raise expected("bits", "8 or 16", bits)
        if bits == 8 and image.pixels.dtype == np.float32 and (image.pixels[..., 3] == 1).all():
            light = np.clip(image.pixels, np.float32(0), np.float32(1))
            light[np.isnan(light)] = 0
            return srgb_bytes(light)
        top = 2**bits - 1
        return np.rint(image.straight() * top).astype(np.uint8 if bits == 8 else np.uint16)


def _npy(values: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, values)
    return buffer.getvalue()


def encode_png(samples: np.ndarray, level: int = 4, chunks: Sequence[tuple[bytes, bytes]] = ()) -> bytes:
    """A PNG of uint8 or uint16 [H, W, 3 or 4]. level: of zlib. chunks: kind and data of further ones. Rows are stored
    as differences to the row above, which packs pictures as well as a choice of filters for each row, in a third of its
    time.
    """
    height, width, channels = samples.shape
    rows = np.ascontiguousarray(samples, samples.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    filtered = np.full((height, 1 + rows.shape[1]), UP, np.uint8)
    filtered[:1, 1:] = rows[:1]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    header = struct.pack(">2I5B", width, height, 8 * samples.dtype.itemsize, COLOR_TYPES[channels], 0, 0, 0)
    chunks = ((b"IHDR", header), *chunks, (b"IDAT", zlib.compress(filtered.data, level)), (b"IEND", b""))
    return PNG_SIGNATURE + b"".join(_chunk(*chunk) for chunk in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _about_chunks(info: Mapping[str, object]) -> list[tuple[bytes, bytes]]:
    """The provenance, and the pixels of a metre if the dots per inch are stated (PNG specification §11.3.4.3 and
    §11.3.5.3).
    """
    text = f"{KEYWORD}\0{json.dumps(dict(info), ensure_ascii=True)}".encode("latin-1")
    pitch = round((density(info) or 0.0) / METRES_OF_INCH)
    return [(b"tEXt", text), *[(b"pHYs", struct.pack(">2IB", pitch, pitch, 1))] * bool(pitch)]


@lru_cache(maxsize=2)
def _linear_table(levels: int) -> np.ndarray:
    """Linear light, float32, of each of `levels` sRGB samples: a lookup table is much faster than a power per pixel."""
    return linear_from_srgb(np.arange(levels) / (levels - 1)).astype(np.float32)


def _linear_pixels(samples: np.ndarray) -> np.ndarray:
    """Linear premultiplied float32 of straight sRGB samples, uint8 or uint16 [H, W, 4]."""
    top = np.iinfo(samples.dtype).max
    table = _linear_table(top + 1)
    pixels = np.empty(samples.shape, np.float32)
    for row in range(0, len(samples), BAND_ROWS):
        band, alpha = pixels[row : row + BAND_ROWS], samples[row : row + BAND_ROWS, :, 3]
        np.take(table, samples[row : row + BAND_ROWS], out=band, mode="clip")
        np.divide(alpha, np.float32(top), out=band[..., 3])
        if alpha.size and alpha.min() < top:
            band[..., :3] *= band[..., 3:]
    return pixels


def _load_npy(source: Path) -> np.ndarray:
    try:
        pixels = np.load(source, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{source}: cannot be read: {error}") from error
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype.kind != "f":
        raise expected(source, "float pixels [H, W, 4]", f"{pixels.dtype} {pixels.shape}")
    return np.asarray(pixels, np.float32)


def load_png(source: Path) -> tuple[np.ndarray, dict[str, object]]:
    """Straight sRGB, uint8 or uint16 [H, W, 4], and the provenance, if any."""
    from PIL import Image as Pillow

    from splatgl.data.color_management import displayed_samples

    try:
        with Pillow.open(source) as picture:
            needed = picture.width * picture.height * DECODED
            require_memory(needed, source.stat().st_size, "draw it smaller", f"{source}: pixels")
            info = provenance(getattr(picture, "text", {}).get(KEYWORD, ""))
            with source.open("rb") as file:
                is_deep = picture.format == "PNG" and file.read(25)[24] == 16
            return displayed_samples(picture, _decode_deep(source) if is_deep else None), info
    except InputError:
        raise
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{source}: cannot be read as a picture: {error}") from error


def _decode_deep(source: Path) -> np.ndarray:
    """16-bit samples of any PNG colour type, as uint16 [H, W, 4]; Pillow would reduce them to 8 bits."""
    imagecodecs = import_extra("imagecodecs", f"{source}: 16-bit PNG", "imagecodecs", "readers")
    try:
        samples = np.atleast_3d(imagecodecs.png_decode(source.read_bytes()))
    except imagecodecs.PngError as error:
        raise ValueError(str(error)) from error
    # gray, gray + alpha, RGB, or RGBA
    count = samples.shape[2]
    color = samples[..., :3] if count > 2 else np.repeat(samples[..., :1], 3, axis=-1)
    alpha = samples[..., -1:] if count in (2, 4) else np.full_like(samples[..., :1], np.iinfo(samples.dtype).max)
    return np.concatenate([color, alpha], axis=-1)


# endings of the files that `save_map` writes
MAPS = (".npy", *TIFF, *EXR, ".png")
# grey of the farthest depth, sRGB; the nearest is white
FARTHEST = 0.15


def save_map(values: np.ndarray, path: str | Path, info: Mapping[str, object] | None = None) -> None:
    """Writes numbers [H, W], row 0 on top, NaN for no value: float32 in .npy, .tif and .exr (channel Z).

    .png: grey, the least number white, the greatest dark, no value transparent; the file's text holds both numbers.
    Raises InputError for another ending, a missing library, and a file that cannot be written.
    """
    name = Path(path)
    ending, text = name.suffix.lower(), dict(info or {})
    if ending not in MAPS:
        raise expected(name, f"a name that ends in {' or '.join(MAPS)}", repr(name.suffix))
    require_library(ending)
    if ending == ".png":
        write_file(name, _grey_image(values, text).encoded(name, bits=16))
        return
    numbers = np.ascontiguousarray(values, np.float32)
    if ending == ".npy":
        write_file(name, _npy(numbers))
    else:
        write_file(name, encode_tiff(numbers, text) if ending in TIFF else encode_exr(numbers, text))


def _grey_image(values: np.ndarray, info: dict[str, object]) -> Image:
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0.0, 1.0)
    share = (np.where(known, values, low) - low) / (high - low or 1.0)
    light = np.where(known, linear_from_srgb(1 - share * (1 - FARTHEST)), 0.0)[..., None]
    pixels = np.concatenate([light, light, light, known[..., None]], axis=-1).astype(np.float32)
    return Image(pixels, {**info, "white": low, "darkest": high})


def bounding_box(over: np.ndarray) -> tuple[int, int, int, int]:
    """left, top, right and bottom of the pixels, bool [H, W], of which there is one; the last two exclusive."""
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1

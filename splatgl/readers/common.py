"""Checks of sizes, memory maps, decompression and parsing of numbers, shared by readers."""

from __future__ import annotations

import bz2
import gzip
import logging
import math
import re
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PureWindowsPath
from typing import IO, Any, BinaryIO
from xml.etree.ElementTree import XML, Element, TreeBuilder, XMLParser

import numpy as np

from splatgl.data.volume import Hints
from splatgl.errors import InputError, expected, one_line
from splatgl.fileio import byte_count, require_memory

# parts of names of simulated fields, anywhere in a name, and whole words
PARTS = (
    *("density", "temperature", "pressure", "velocity", "vorticity", "speed", "entropy", "enstrophy", "energy"),
    *("helicity", "concentration", "salinity", "humidity", "viscosity", "divergence", "streamfunction", "turbulence"),
)
WORDS = ("rho", "temp", "vel", "mach", "wind", "flow", "flux", "theta", "phi", "qcriterion")
# names of arrays that are a program's variables
LETTERS = ("u", "v", "w", "p", "t")
FIELD = "field"
# names of arrays that do not say what they measure
_NAMELESS = re.compile(
    r"\w*(data|dataset|image|img|volume|vol|array|samples?|scalars?|values?|raw|stack|channel)_*\d*|a|[ts]?_*\d+", re.I
)


def is_field(name: str, array: bool = False) -> bool:
    """Whether a simulated field has that name. array: the name of an array in a file, not of the file."""
    lower = name.lower()
    words = re.split(r"[^a-z]+", lower)
    named = any(part in lower for part in PARTS) or any(word in WORDS for word in words)
    return named or (array and lower in LETTERS)


def array_fields(
    array: str, dtype: np.dtype, unit: str, length: str, vectors: bool = False, title: str = ""
) -> dict[str, Any]:
    """Fields of the `Volume` of an array: quantity by its title, else by its name, "" for one that says nothing, such
    as data; value_unit; hints of a field for real numbers of that name, for lengths of `vectors`, and for quantities
    with a `unit` over degrees, metres or kilometres, where other objects have millimetres. length: the grid's unit.
    title: its long name.
    """
    known = vectors or is_field(array, array=True) or (unit and length in ("", "m", "km"))
    hints = Hints(preset=FIELD) if known and dtype.kind == "f" else Hints()
    return {
        "hints": hints,
        "value_unit": unit,
        "quantity": title.strip() or ("" if _NAMELESS.fullmatch(array) else array),
    }


# most bytes that one byte of deflate data can expand to (zlib's technical notes: 1032:1)
DEFLATE_RATIO = 1032
# most bytes allocated on a file's word alone: where the codec's ratio is unbounded and the file is small. Most bytes
# of samples of a store or a multiscale image that are read at once; more are read in parts.
MAX_BYTES = 2**29
# first bytes of packed data
GZIP, BZIP2 = b"\x1f\x8b", b"BZh"
# bytes inflated or read at a time: small beside a volume, large beside a call's cost
CHUNK_BYTES = 2**20

# loggers of libraries that print by themselves or through Python's last resort; tifffile's is listened to
LOGGERS = (
    *("nibabel.global", "numcodecs", "PIL.ImageFile", "PIL.PngImagePlugin", "PIL.TiffImagePlugin"),
    *("cmap", "highdicom.base", "liffile", "pydicom", "pylibjpeg", "zarr"),
)

Shape = tuple[int, int, int]


def grid_shape(sizes: Sequence[int], what: str = "dimensions") -> Shape:
    """(D, H, W) from a header's sizes (x, y, z). Raises InputError unless all are positive."""
    if len(sizes) != 3:
        raise expected(what, "three axes", f"{len(sizes)} ({'x'.join(map(str, sizes))})")
    if min(sizes) < 1:
        got = "x".join(map(str, sizes))
        raise expected(what, "at least one voxel along each axis", got, "the header is damaged")
    x, y, z = (int(size) for size in sizes)
    return z, y, x


def require_bytes(needed: int, there: int, what: str = "data") -> None:
    """Raises InputError if fewer bytes are present than needed."""
    if there < needed:
        got = f"{max(there, 0)} bytes"
        raise expected(what, f"{needed} bytes", got, "the file is cut short or its header states a wrong size")


def require_plausible(needed: int, there: int, bounded: bool = True) -> None:
    """Raises InputError if `there` compressed bytes cannot hold `needed`; unbounded codecs are limited to MAX_BYTES."""
    limit = there * DEFLATE_RATIO if bounded else max(there * DEFLATE_RATIO, MAX_BYTES)
    if needed > limit:
        got = f"{there} compressed bytes, which hold {limit} at most"
        raise expected("data", f"{needed} bytes", got, "the file is cut short or its header states a wrong size")


def map_array(path: Path, offset: int, dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    """A read-only array [shape] (C order) mapped from `path` at `offset` bytes. Raises InputError if it is cut.

    If the file is truncated later, reading the array's missing pages crashes the process.
    """
    require_bytes(byte_count(shape, dtype), path.stat().st_size - offset)
    with decoder_errors("mapped samples"):
        return np.memmap(path, dtype=dtype, mode="r", offset=offset, shape=tuple(int(size) for size in shape))


def is_mapped(array: np.ndarray) -> bool:
    """Whether an array is a view of a memory-mapped file."""
    base: object = array
    while isinstance(base, np.ndarray):
        if isinstance(base, np.memmap):
            return True
        base = base.base
    return False


def inflate(path: Path, offset: int, dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    """The array [shape] in zlib or gzip data of `path` at `offset`; inflates no more bytes than the array holds."""
    # 1. the file must be large enough for the header's sizes
    needed, there = byte_count(shape, dtype), path.stat().st_size - offset
    require_plausible(needed, max(there, 0))
    require_memory(needed, there)
    # 2. inflate piece by piece into the array; 47 = 32 (zlib or gzip, by the header) + 15 (window bits)
    engine, out, filled, rest = zlib.decompressobj(wbits=47), np.empty(needed, np.uint8), 0, b""
    with path.open("rb") as file, decoder_errors("zlib data"):
        file.seek(offset)
        while not engine.eof or (filled < needed and (rest := engine.unused_data or file.read(CHUNK_BYTES))):
            if engine.eof:
                # the next of several members of gzip data
                if not rest.startswith(GZIP):
                    break
                engine = zlib.decompressobj(wbits=47)
            piece, rest = rest or engine.unconsumed_tail or file.read(CHUNK_BYTES), b""
            block = engine.decompress(piece, needed - filled + 1)
            if not piece and not block:
                raise expected("compressed data", "an end mark", "the end of the file", "the file is cut short")
            if filled + len(block) > needed:
                raise expected("inflated data", f"{needed} bytes", "more", "the header states a wrong size")
            out[filled : filled + len(block)] = np.frombuffer(block, np.uint8)
            filled += len(block)
    require_bytes(needed, filled, "inflated data")
    return out.view(dtype).reshape(tuple(shape))


def bunzip(path: Path, offset: int, dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    """The array [shape] in bzip2 data of `path` at `offset`. Raises InputError for fewer bytes and for more."""
    needed, there = byte_count(shape, dtype), path.stat().st_size - offset
    require_plausible(needed, there, bounded=False)
    require_memory(needed, there)
    with path.open("rb") as file, decoder_errors("bzip2 data"):
        file.seek(offset)
        data = bz2.BZ2File(file).read(needed + 1)
    require_bytes(needed, len(data), "inflated data")
    if len(data) > needed:
        raise expected("inflated data", f"{needed} bytes", "more", "the header states a wrong size")
    return np.frombuffer(data, np.uint8).view(dtype).reshape(tuple(shape))


def packing_of(path: Path) -> str:
    """ "gzip" or "bzip2" by the first bytes of a file, "" for others."""
    with path.open("rb") as file:
        first = file.read(len(BZIP2))
    return "gzip" if first.startswith(GZIP) else "bzip2" if first == BZIP2 else ""


def open_unpacked(path: Path) -> Any:
    """Opens a file for reading; its bytes are unpacked if it is gzip or bzip2 data."""
    openers: dict[str, Callable[..., Any]] = {"gzip": gzip.open, "bzip2": bz2.open, "": open}
    return openers[packing_of(path)](path, "rb")


def inflated_size(file: IO[bytes], room: int) -> int:
    """Bytes of the inflated zlib or gzip data of `file`, counted up to a little over `room`."""
    engine, size = zlib.decompressobj(wbits=47), 0
    while size <= room and not engine.eof and (piece := engine.unconsumed_tail or file.read(CHUNK_BYTES)):
        size += len(engine.decompress(piece, CHUNK_BYTES))
    return size


def find_data_file(header: Path, name: str, anywhere: bool) -> Path:
    """The data file `name` in the folder of `header` or below. Raises InputError for others, if not `anywhere`."""
    path, windows = header.parent / name.replace("\0", "?"), PureWindowsPath(name)
    if not anywhere:
        fix = "put both files side by side, or say --anywhere if you trust it"
        if name.startswith(("/", "\\")) or windows.drive or ".." in windows.parts or "\0" in name:
            # a header that was moved together with its data still states where they were
            path = header.parent / (windows.name or "?").replace("\0", "?")
            if ".." in windows.parts or not path.is_file():
                raise expected("data file", "a name inside the header's folder", repr(name), fix)
        try:
            inside = path.resolve().is_relative_to(header.parent.resolve())
        except (OSError, RuntimeError):
            # a symbolic link loop
            inside = False
        if not inside:
            raise expected("data file", "a file inside the header's folder", repr(name), fix)
    if not path.is_file():
        raise expected("data file", "a file next to the header", f"nothing named {name!r}", "copy it there")
    return path


def stack_files(
    header: Path, names: Sequence[str], axes: int, shape: Sequence[int], anywhere: bool, read: Callable[..., np.ndarray]
) -> np.ndarray:
    """The samples [shape] of several data files of a header, which are all found before one is read. axes: of each
    file, the last of the shape. read: reads a file's samples of such a shape.
    """
    outer, inner = shape[: len(shape) - axes], shape[len(shape) - axes :]
    if len(names) != math.prod(outer):
        raise expected("data file", f"{math.prod(outer)} files", len(names), "the header is damaged")
    files = [find_data_file(header, name, anywhere) for name in names]
    first = read(files[0], inner)
    require_memory(first.nbytes * len(files), sum(file.stat().st_size for file in files))
    return np.stack([first, *(read(file, inner) for file in files[1:])]).reshape(tuple(shape))


@contextmanager
def decoder_errors(title: str) -> Iterator[None]:
    """Converts any exception of a decoder into one InputError.

    Decoders raise many types (IndexError, AssertionError, struct.error, …), so the context encloses only the
    decoder's calls instead of filtering by type.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        # a library's code is at fault, and not what a file holds
        if isinstance(error, AttributeError | TypeError | ImportError) and _MISFIT.search(str(error)):
            why = f"the library that reads it fails, whatever the file ({one_line(error)})"
            why += "; install another version of it"
        else:
            why = f"{one_line(error)}; the file may be damaged, or of an unsupported kind"
        raise InputError(f"cannot be read as {title}: {why}") from error


# what Python says where libraries of versions that do not fit call each other
_MISFIT = re.compile(
    r"has no setter|can't set attribute|module '.*' has no attribute|type object '.*' has no attribute|"
    r"unexpected keyword argument|required positional argument|cannot import name|No module named"
)


@contextmanager
def silence_libraries() -> Iterator[None]:
    """Suppresses warnings and logs of libraries: a rejected file gives one line."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    disabled = [logger.disabled for logger in loggers]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for logger in loggers:
            logger.disabled = True
        try:
            yield
        finally:
            for logger, before in zip(loggers, disabled, strict=True):
                logger.disabled = before


def parse_number(text: object, default: Any = math.nan) -> Any:
    """The number in a text; the default for other text."""
    try:
        return float(str(text))
    except ValueError:
        return default


def convert_words(words: Sequence[str], kind: Callable[[str], Any], what: str) -> list[Any]:
    """The words of a header's field `what` as numbers of a kind, int or float. Raises InputError for other words."""
    try:
        return [kind(word) for word in words]
    except ValueError:
        number = "whole number" if kind is int else "number"
        raise expected(what, f"a {number}" if len(words) == 1 else f"{number}s", repr(" ".join(words))) from None


# bytes split into words at a time: small beside a volume, large beside a call's cost
_BLOCK_BYTES = 2**16
# longest number in bytes: float64 needs 24; numpy would give every word of a block the room of the longest
_WORD_LIMIT = 64


def read_numbers(file: BinaryIO, count: int, dtype: np.dtype, there: int) -> np.ndarray:
    """The next `count` numbers of `file` [count], in native byte order; leaves it at the end of their last line.

    there: bytes up to the file's end, which bound what is allocated. Raises InputError if there are fewer numbers,
    or more in the last line.
    """
    # 1. every number takes two bytes at least, the last one needs no blank behind it
    numbers = np.empty(min(count, there // 2 + 1), dtype.newbyteorder("="))
    filled, cut = 0, b""
    while filled < count:
        # 2. the words of a line or of a block of it; its last word may go on in the next block
        block = file.readline(_BLOCK_BYTES)
        words = (cut + block).split()
        cut = words.pop() if words and block and not block[-1:].isspace() else b""
        if max(map(len, (*words, cut)), default=0) > _WORD_LIMIT:
            raise expected("data", "numbers", f"a word of more than {_WORD_LIMIT} letters", "the file is damaged")
        # 3. as numbers
        if filled + len(words) > count or (not block and filled + len(words) < count):
            fix = "the file is cut short or damaged"
            raise expected("data", f"{count} numbers", filled + len(words), fix)
        with decoder_errors("numbers"):
            numbers[filled : filled + len(words)] = np.array(words or np.empty(0, "S1")).astype(numbers.dtype)
        filled += len(words)
    if cut:
        raise expected("data", f"{count} numbers", "more", "the header states a wrong size")
    return numbers


def read_text(file: BinaryIO, dtype: np.dtype, shape: Sequence[int], there: int) -> np.ndarray:
    """The numbers of text up to its end [shape], as `read_numbers`. Raises InputError if there are more or fewer."""
    count = math.prod(int(size) for size in shape)
    numbers = read_numbers(file, count, dtype, there)
    while block := file.read(_BLOCK_BYTES):
        if block.strip():
            raise expected("data", f"{count} numbers", "more", "the header states a wrong size")
    return numbers.reshape(tuple(shape))


# deepest nesting of elements; image files need six
MAX_DEPTH = 64


def parse_xml(text: str | bytes, title: str) -> Element:
    """The root element of `text`. Raises InputError for damaged XML, for a DOCTYPE, and beyond MAX_DEPTH."""
    with decoder_errors(title):
        return XML(text, XMLParser(target=_LimitedBuilder()))


class _LimitedBuilder(TreeBuilder):
    """Builder of elements that raises InputError for a DOCTYPE, and beyond MAX_DEPTH."""

    depth = 0

    def start(self, tag: Any, attrs: dict[Any, str], /) -> Element:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise expected("XML", f"at most {MAX_DEPTH} levels of elements", "more", "the file is damaged")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Element:
        self.depth -= 1
        return super().end(tag)

    def doctype(self, *_declaration: object) -> None:
        raise expected("XML", "no document type", "a DOCTYPE", "remove it")

"""Hostile files: damaged at random, and made to hang, to exhaust memory, or to reach beyond their folder."""

from __future__ import annotations

import bz2
import gzip
import io
import math
import random
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load

ROOT = Path(__file__).parents[2]
for _library in ("h5py", "mrcfile", "nibabel", "nrrd", "tifffile", "zarr"):
    pytest.importorskip(_library, reason="the extras dev and readers write and read the files")

from tests.fuzz import readers as fuzz  # noqa: E402
from tests.fuzz import seed_files  # noqa: E402
from tests.fuzz import seeds as good  # noqa: E402
from tests.fuzz.watch import uses_hdf5  # noqa: E402
from tests.helpers.hostile import ROOM, SECONDS, bounds, refused  # noqa: E402

# tracing memory makes reading take five times as long
fuzz.SECONDS = SECONDS


VOLUMES = [name for name in good.SEEDS if name not in ("scene", "transfer")]
# files of a test, the same ones in every run
MANY = 24


# --- damaged at random ------------------------------------------------------------------------------------------------


@pytest.mark.few(2)
@pytest.mark.parametrize("reader", VOLUMES)
def test_mutated_files_load_or_are_refused(tmp_path: Path, reader: str) -> None:
    if reader.startswith("dicom"):
        pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
    if reader in ("vtk-bits", "vtk-cells", "vtk-grids", "vtk-written", "vtk-surface", "hdf5-layouts"):
        pytest.importorskip("vtk", reason="writes or reads the files; it is in the extra vtk")
    # each look at a file of HDF5 starts a process
    looks = uses_hdf5(list(good.SEEDS[reader]()[0].files))
    for index in range(MANY // 4 if looks else MANY):
        path = fuzz.case(reader, index, 0, tmp_path / "case")
        with bounds(fuzz.LIMIT):
            result, said = fuzz.outcome(path, good.SEEDS[reader]()[0].kind)
        assert result in ("loaded", "refused"), (index, said)


TEXTS: dict[str, Callable[[list[int], int], bytes]] = {
    "a.nrrd": lambda sizes, skip: (
        f"NRRD0004\ntype: uchar\ndimension: {len(sizes)}\nsizes: {_spaced(sizes)}\nencoding: raw\n"
        f"byte skip: {skip}\nline skip: {skip // 2}\n\n"
    ).encode(),
    "a.mha": lambda sizes, skip: (
        f"NDims = 3\nDimSize = {_spaced(sizes)}\nHeaderSize = {skip}\nElementNumberOfChannels = {sizes[0]}\n"
        "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    ).encode(),
    "a.vtk": lambda sizes, skip: (
        f"# vtk DataFile Version 3.0\nt\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {_spaced(sizes)}\n"
        + (f"LOOKUP_TABLE t {skip}\n" if skip % 2 else "")
        + f"POINT_DATA {math.prod(sizes)}\nSCALARS s unsigned_char\n"
    ).encode(),
    "a.npy": lambda sizes, _skip: (
        b"\x93NUMPY\x01\x00\x76\x02"
        + f"{{'descr': '|u1', 'fortran_order': {bool(sizes[0] % 2)}, 'shape': {tuple(sizes)}}}".ljust(630).encode()
    ),
}


def _spaced(sizes: list[int]) -> str:
    return " ".join(map(str, sizes))


def _any_number(chance: random.Random) -> int:
    return chance.randint(-3, 12) if chance.random() < 0.5 else chance.randint(-(2**70), 2**70)


@pytest.mark.few(1)
@pytest.mark.parametrize("name", TEXTS)
def test_headers_of_any_numbers(tmp_path: Path, name: str) -> None:
    """What loads lies in the file; all else is refused, fast and without taking memory."""
    path, chance, loaded = tmp_path / name, random.Random(name), 0
    for _ in range(MANY):
        sizes = [_any_number(chance) for _ in range(chance.randint(1, 5))]
        if chance.random() < 0.5:
            sizes = [chance.randint(1, 7) for _ in range(3)]
        skip = chance.choice((0, 0, _any_number(chance)))
        path.unlink(missing_ok=True)
        path.write_bytes(TEXTS[name](sizes, skip) + b"\n" * 600)
        with bounds(ROOM):
            result, said = fuzz.outcome(path, "volume")
            assert result in ("loaded", "refused"), (sizes, skip, said)
            if result == "loaded":
                assert load(path).samples.size <= path.stat().st_size
                loaded += 1
    assert 0 < loaded < MANY


def test_the_fuzzer_tells_faults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npy"

    def fails(error: Exception) -> Callable[[Path, str], None]:
        def read(_path: Path, _kind: str) -> None:
            raise error

        return read

    caused = InputError(f"{path}: no")
    caused.__cause__ = MemoryError()
    faults = {
        "refused": InputError(f"{path}: no"),
        "other": InputError("no"),
        "over": caused,
    }
    for result, error in faults.items():
        monkeypatch.setattr(fuzz, "read", fails(error))
        assert fuzz.outcome(path, "volume")[0] == result
    monkeypatch.setattr(fuzz, "read", fails(KeyError("x")))
    assert fuzz.outcome(path, "volume") == ("other", "KeyError('x')")
    monkeypatch.setattr(fuzz, "SECONDS", -1.0)
    assert fuzz.outcome(path, "volume")[0] == "hang"


@pytest.mark.long
def test_the_fuzz_script_runs() -> None:
    command = [sys.executable, "-m", "tests.fuzz.readers", "--reader", "npy", "--count", "12"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    head, row = done.stdout.splitlines()
    assert done.returncode == 0, done.stdout
    assert head.split() == ["reader", "files", "refused", "loaded", *fuzz.FAULTS, "grown", "MiB"]
    found = row.split()
    assert found[:2] == ["npy", "12"] and found[4 : 4 + len(fuzz.FAULTS)] == ["0"] * len(fuzz.FAULTS)


@pytest.mark.long
def test_good_files_of_the_fuzzer_load(tmp_path: Path) -> None:
    for reader in VOLUMES:
        for number, seed in enumerate(good.SEEDS[reader]()):
            folder = tmp_path / f"{reader}{number}"
            for name, data in seed.files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_bytes(data)
            found, why = fuzz.outcome(folder / seed.main, seed.kind)
            # channels that a file doesn't say how to see are to be picked
            assert found == "loaded" or why.endswith("pick with channel=0 … channel=1, channel=all"), (reader, why)


# --- made by hand -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", autouse=True)
def traced() -> Iterator[None]:
    """Memory is traced from end to end: to stop it while Zarr's threads allocate crashes CPython 3.11."""
    tracemalloc.start()
    yield
    tracemalloc.stop()


def zipped(data: bytes, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        archive.writestr("a.npy", data)
    return out.getvalue()


def pages(*tables: list[tuple[int, int, int, int]], last: int = 0) -> bytes:
    """A TIFF file of pages, one behind the other, of (tag, type, count, value); `last` follows the last one."""
    data, place = b"II*\0" + struct.pack("<I", 8), 8
    for number, tags in enumerate(tables):
        place += 2 + 12 * len(tags) + 4
        following = place if number + 1 < len(tables) else last
        data += struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags)
        data += struct.pack("<I", following)
    return data


LONG_WORD = b"1" * 50_000 + b" " + b"1 " * 25_000
LIE = b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**30)
LAUGHS = '<!DOCTYPE l [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><VTKFile>&b;</VTKFile>'
VTK, META, NRRD = (seed_files.VTK.format(coding="BINARY").encode(), good.meta("LOCAL", seed_files.RAW), good.nrrd)
TAGS = [(256, 4, 1, 1), (257, 4, 1, 1), (273, 4, 1, 8), (278, 4, 1, 1), (279, 4, 1, 1)]
NIFTI = bytearray(good.nifti()[0].files["a.nii"])
NIFTI[352:356] = (2**31 - 16).to_bytes(4, "little")
PNG = good.picture()[0].files["a.png"]

HOSTILE = {
    # words as long as a file, each of which would be given the room of the longest
    "vtk word": ("a.vtk", seed_files.VTK.format(coding="ASCII").encode() + LONG_WORD, "a word of more than 64 letters"),
    "mha word": ("a.mha", good.meta("LOCAL", LONG_WORD, binary=False), "a word of more than 64 letters"),
    "nrrd word": ("a.nrrd", NRRD("text", LONG_WORD), "a word of more than 64 letters"),
    "vti word": (
        "a.vti",
        seed_files._vti("UInt32", "", "ascii", [LONG_WORD.decode(), "1 " * 3 * seed_files.CUBE.size]).files["a.vti"],
        "a word of more than 64 letters",
    ),
    "nrrd more": ("a.nrrd", NRRD("text", b"1 " * (seed_files.CUBE.size + 1)), "got 595"),
    "mha more": ("a.mha", good.meta("LOCAL", b"1\n" * (seed_files.CUBE.size + 1), binary=False), "got more"),
    # numbers that would go back, on and on, or beyond
    "vtk table": ("a.vtk", VTK + seed_files.RAW + b"\nLOOKUP_TABLE x -10\n", "entries: expected zero or more, got -40"),
    "vtk twice": ("a.vtk", VTK.replace(b"SCALARS", b"DIMENSIONS 1 1 1\nSCALARS") + seed_files.RAW, "before the data"),
    "nrrd lines": (
        "a.nrrd",
        NRRD("raw", seed_files.RAW, more="line skip: 9223372036854775807\n"),
        "line skip: expected",
    ),
    "nrrd skip": ("a.nrrd", NRRD("raw", seed_files.RAW, more="byte skip: -50\n"), "byte skip: expected -1"),
    "nrrd axes": (
        "a.nrrd",
        f"NRRD0004\ntype: uchar\ndimension: 70\nsizes: {'1 ' * 70}\nencoding: raw\n\n1".encode(),
        "dimension: expected 1 to 16, got 70",
    ),
    "nrrd none": ("a.nrrd", b"NRRD0004\ntype: uchar\ndimension: 0\nsizes:\nencoding: raw\n\n1", "a.nrrd: "),
    "nrrd head": ("a.nrrd", b"NRRD0004\n" + b"# no end\n" * 120_000, "header: expected at most 1048576 bytes"),
    "mha channels": ("a.mha", META.replace(b"Channels = 1", b"Channels = "), "Channels: expected one whole number"),
    "mha inf": ("a.mha", META.replace(b"Channels = 1", b"Channels = 1e999"), "Channels: expected a whole number"),
    "mha skip": ("a.mha", META.replace(b"HeaderSize = 0", b"HeaderSize = -9"), "HeaderSize: expected -1"),
    "mha lines": ("a.mha", b"Comment = x\n" * 20_000, "header: expected at most 10000 lines"),
    # lengths for which room would be made, and data that inflate beyond what is asked
    "npy lie": ("a.npy", LIE, "expected 1073741824 bytes"),
    "npz lie": ("a.npz", zipped(LIE + bytes(10**7)), "expected 1073741824 bytes"),
    "npz lzma": ("a.npz", zipped(LIE, zipfile.ZIP_LZMA), "stored or deflated data"),
    "nrrd bzip2": ("a.nrrd", NRRD("bzip2", bz2.compress(bytes(10**7))), "inflated data: expected 594 bytes, got more"),
    "nifti dims": (
        "a.nii",
        bytes(NIFTI[:40]) + struct.pack("<8h", 4, 1, 1, 1, -1, 1, 1, 1) + bytes(NIFTI[56:]),
        "axis",
    ),
    "png eps": (
        "a.png",
        b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n",
        "expected height picture, as the name says",
    ),
    # XML that grows or nests
    "vti entities": ("a.vti", LAUGHS.encode(), "a DOCTYPE"),
    "vti entities in UTF-16": ("a.vti", LAUGHS.encode("utf-16"), "a DOCTYPE"),
    "vti nests": ("a.vti", b"<a>" * 100_000, "at most 64 levels"),
    # pages that lead back, are too many for the file, or share what they say
    "tiff cycle": ("a.tif", pages(TAGS, TAGS, last=8) + bytes(99), "leading back to another"),
    "tiff empty pages": ("a.tif", pages(*([] for _ in range(999))) + bytes(99), "tags of a page: expected 4"),
    "tiff shared": ("a.tif", pages(TAGS + [(700, 1, 900, 8)] * 50) + bytes(999), "tags: expected at most"),
    "tiff codec": ("a.tif", pages([*TAGS, (258, 3, 1, 8), (259, 3, 1, 6), (262, 3, 1, 1)]) + b"9" * 99, "got OJPEG"),
    "tiff jpeg": (
        "a.tif",
        pages([*TAGS, (258, 3, 1, 8), (259, 3, 1, 7), (262, 3, 1, 1)]) + b"9" * 99,
        "compressed picture: expected 1 × 1 pixels at most, got none",
    ),
    "tiff strips": (
        "a.tif",
        pages([(256, 4, 1, 1), (257, 4, 1, 10**6), *TAGS[2:], (258, 3, 1, 8), (259, 3, 1, 8), (262, 3, 1, 1)])
        + b"9" * 99,
        "strips or tiles: expected 1000000 a page, got 1",
    ),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_file(tmp_path: Path, case: str) -> None:
    name, data, message = HOSTILE[case]
    (tmp_path / name).write_bytes(data)
    refused(tmp_path / name, message)


def test_a_length_in_a_picture_makes_no_room(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(PNG[:33] + struct.pack(">I", 2**31 - 1) + PNG[37:])
    with bounds(ROOM):
        assert load(tmp_path / "a.png").shape[1:] == seed_files.SHAPE[1:]


def test_extensions_of_nifti_are_stepped_over(tmp_path: Path) -> None:
    (tmp_path / "a.nii").write_bytes(NIFTI)
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(NIFTI))
    for name in ("a.nii", "a.nii.gz"):
        with bounds(ROOM):
            assert load(tmp_path / name).shape == seed_files.SHAPE


@pytest.mark.parametrize(
    ("planes", "more", "message"),
    [
        (10**10, "", "OME-XML: expected at most 1048576 planes, got 10000000000"),
        (10**5, "", "planes: expected about the file's 6 pages, got 100000"),
        (6, '<XMLAnnotation Start="0" End="1e12" Step="1"/>', "OME-XML: expected at most 1048576 steps"),
        ("six", "", "OME-XML SizeZ: expected a whole number, got 'six'"),
    ],
)
def test_planes_that_only_metadata_have(tmp_path: Path, planes: object, more: str, message: str) -> None:
    import tifffile

    sizes = f'SizeC="1" SizeT="1" SizeX="{seed_files.X}" SizeY="{seed_files.Y}" SizeZ="{planes}"'
    text = f"""<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06">
        <Image ID="Image:0"><Pixels DimensionOrder="XYZCT" ID="Pixels:0" {sizes} Type="uint8">
        <TiffData IFD="0" PlaneCount="6"/></Pixels></Image>{more}</OME>"""
    tifffile.imwrite(tmp_path / "a.tif", seed_files.CUBE, description=text, metadata=None)
    refused(tmp_path / "a.tif", message)


def test_entities_in_ome_xml(tmp_path: Path) -> None:
    import tifffile

    text = '<?xml version="1.0"?>' + LAUGHS.replace("VTKFile", "OME")
    tifffile.imwrite(tmp_path / "a.tif", seed_files.CUBE, description=text, metadata=None)
    refused(tmp_path / "a.tif", "a DOCTYPE")


def test_a_map_of_nothing_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((5000, 5000), np.uint8)).save(tmp_path / "a.png")
    refused(tmp_path / "a.png", "expected 2575000000 bytes")


def test_heights_as_wide_as_float64(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("1e308,-1e308\n0,0\n")
    tops = (load(tmp_path / "a.csv").samples > 0).argmin(axis=0)
    assert load(tmp_path / "a.csv").samples[-1].any(axis=None) and tops.shape == (2, 2)

"""Packed files that hold more than memory: refused in a line before they are unpacked, or read in part."""

from __future__ import annotations

import bz2
import gzip
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl import fileio
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import chunked as reading
from splatgl.readers import ome_zarr

pytestmark = pytest.mark.usefixtures("shared_programs")

MIB = 2**20
# of zeros, and the memory that may be taken
SHAPE, BUDGET = (24, 1024, 1024), 8 * MIB


def nifti(path: Path, shape: tuple[int, ...] = SHAPE, slope: float = 1.0) -> None:
    nibabel = pytest.importorskip("nibabel", reason="writes the files; it is in the extra readers")
    header = nibabel.Nifti1Header()
    header.set_data_dtype(np.uint8)
    header.set_slope_inter(slope, 0.0)
    header.set_data_shape(shape[::-1])
    image = nibabel.Nifti1Image(np.zeros(shape[::-1], np.uint8), np.eye(4), header)
    image.header.set_slope_inter(slope, 0.0)
    nibabel.save(image, path)


def mgh(path: Path) -> None:
    nibabel = pytest.importorskip("nibabel", reason="writes the files; it is in the extra readers")
    nibabel.save(nibabel.MGHImage(np.zeros(SHAPE[::-1], np.uint8), np.eye(4)), path)


def nrrd(path: Path, encoding: str) -> None:
    sizes_ = " ".join(map(str, SHAPE[::-1]))
    head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes_}\nencoding: {encoding}\n\n".encode()
    data = bytes(np.zeros(SHAPE, np.uint8))
    path.write_bytes(head + (gzip.compress(data) if encoding == "gzip" else bz2.compress(data)))


def meta(path: Path) -> None:
    data = zlib.compress(bytes(np.zeros(SHAPE, np.uint8)))
    head = f"NDims = 3\nDimSize = {' '.join(map(str, SHAPE[::-1]))}\nElementType = MET_UCHAR\nCompressedData = True\n"
    head += f"CompressedDataSize = {len(data)}\nElementDataFile = LOCAL\n"
    path.write_bytes(head.encode() + data)


def mrc(path: Path) -> None:
    mrcfile = pytest.importorskip("mrcfile", reason="writes the files; it is in the extra readers")
    kind = "gzip" if path.suffix == ".gz" else "bzip2"
    with mrcfile.new(path, compression=kind) as file:
        file.set_data(np.zeros(SHAPE, np.int8))


def tiff(path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="writes the files; it is in the extra readers")
    tifffile.imwrite(path, np.zeros(SHAPE, np.uint8), compression="zlib", metadata={"axes": "ZYX"})


def picture(path: Path) -> None:
    from PIL import Image

    Image.fromarray(np.zeros((3000, 1000), np.uint8)).save(path)


def dicom(path: Path) -> None:
    pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
    from tests.fuzz.seed_dicom import image, save

    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for n in range(12):
            save(image(np.zeros(SHAPE[1:], np.int16), n * 2.5), path.with_name("slice"))
            archive.write(path.with_name("slice"), f"{n}.dcm")
    path.with_name("slice").unlink()


BOMBS: dict[str, Callable[[Path], None]] = {
    "a.nii.gz": nifti,
    "a.mgz": mgh,
    "gzip.nrrd": lambda path: nrrd(path, "gzip"),
    "bzip2.nrrd": lambda path: nrrd(path, "bzip2"),
    "a.mha": meta,
    "a.mrc.gz": mrc,
    "a.mrc.bz2": mrc,
    "a.npz": lambda path: np.savez_compressed(path, np.zeros(SHAPE, np.uint8)),
    "a.tif": tiff,
    "a.png": picture,
    "a.zip": dicom,
}


@pytest.fixture
def budget() -> Iterator[None]:
    """That of a process which was given BUDGET."""
    with fileio.within(BUDGET):
        yield


def peak(work: Callable[[], object]) -> int:
    """Most bytes that Python and numpy held meanwhile."""
    started = not tracemalloc.is_tracing()
    if started:
        tracemalloc.start()
    tracemalloc.reset_peak()
    before = tracemalloc.get_traced_memory()[0]
    try:
        work()
        return tracemalloc.get_traced_memory()[1] - before
    finally:
        if started:
            tracemalloc.stop()


@pytest.mark.few(7)
@pytest.mark.parametrize("name", BOMBS)
@pytest.mark.usefixtures("budget")
def test_what_memory_does_not_hold_is_not_unpacked(tmp_path: Path, name: str) -> None:
    """Refused in a line that names the sizes."""
    path = tmp_path / name
    BOMBS[name](path)
    assert path.stat().st_size < BUDGET // 16

    def refused() -> None:
        message = r"samples: expected at most 8\.0 MiB in memory, got \d+\.\d MiB, packed in \S+ (bytes|KiB|MiB); "
        with pytest.raises(InputError, match=message):
            sg.load(path)

    assert peak(refused) < BUDGET


@pytest.mark.usefixtures("budget")
def test_pictures_to_compare_are_not_unpacked_either(tmp_path: Path) -> None:
    picture(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"a\.png: pixels: expected at most 8\.0 MiB in memory, got 57\.2 MiB, packed"):
        sg.Image.load(tmp_path / "a.png")


def test_with_enough_memory_they_are_read(tmp_path: Path) -> None:
    for name in ("gzip.nrrd", "a.mha", "a.npz"):
        BOMBS[name](tmp_path / name)
        assert sg.load(tmp_path / name).shape == SHAPE


@pytest.mark.usefixtures("budget")
def test_of_a_series_only_the_time_point_is_unpacked(tmp_path: Path) -> None:
    """24 of a MiB, where memory holds 8; twice where they are scaled."""
    nibabel = pytest.importorskip("nibabel", reason="writes the files; it is in the extra readers")
    data = np.zeros((128, 128, 64, 24), np.uint8)
    data[..., 7] = np.arange(64)
    nibabel.save(nibabel.Nifti1Image(data, np.eye(4)), tmp_path / "a.nii.gz")
    found = []
    assert peak(lambda: found.append(sg.load(tmp_path / "a.nii.gz", time=7))) < 4 * MIB
    np.testing.assert_array_equal(found[0].samples, data[..., 7].T)


@pytest.mark.usefixtures("budget")
def test_scaled_samples_are_there_twice(tmp_path: Path) -> None:
    """2 MiB of bytes are 8 of floats, more than the 8 that there are with them."""
    nifti(tmp_path / "a.nii.gz", (2, 1024, 1024))
    assert sg.load(tmp_path / "a.nii.gz").shape == (2, 1024, 1024)
    nifti(tmp_path / "b.nii.gz", (2, 1024, 1024), 0.5)
    with pytest.raises(InputError, match=r"at most 8\.0 MiB in memory, got 10\.0 MiB, packed"):
        sg.load(tmp_path / "b.nii.gz")


def test_the_command_keeps_to_its_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    BOMBS["a.mha"](tmp_path / "a.mha")
    asked = ["render", str(tmp_path / "a.mha"), "-o", str(tmp_path / "a.png"), "--size", "8"]
    assert main([*asked, "--memory", "8MiB"]) == 2
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1 and "at most 8.0 MiB in memory, got 24.0 MiB" in told[0]
    assert not (tmp_path / "a.png").exists()
    # and leaves none to what the process reads next
    assert fileio.budget() != 8 * MIB


def chunked(path: Path, side: int, chunk: int) -> np.ndarray:
    zarr = pytest.importorskip("zarr", reason="writes the store; it is in the extra readers")
    samples = np.arange(side**3, dtype=np.float32).reshape((side,) * 3) % 251
    store = zarr.create_array(path, shape=samples.shape, chunks=(chunk,) * 3, dtype="float32")
    store[:] = samples
    return samples


@pytest.mark.usefixtures("budget")
def test_decoded_chunks_take_a_share_of_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 8 MiB a mebibyte, thus 4 chunks of 256 KiB of all 64; and what a read of all finds is right."""
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 1000)
    monkeypatch.setattr(fileio, "ALWAYS", 0)
    samples = chunked(tmp_path / "a.zarr", 160, 40)
    found = sg.load(tmp_path / "a.zarr").samples
    assert np.array_equal(found[:], samples)
    assert 0 < sum(chunk.nbytes for chunk in found.cache.values()) <= BUDGET // 8
    with fileio.within(64 * BUDGET):
        assert np.array_equal(found[:, :1, :1], samples[:, :1, :1]) and np.array_equal(found[:], samples)
    assert sum(chunk.nbytes for chunk in found.cache.values()) == samples.nbytes


def test_chunks_that_memory_cannot_hold_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A chunk is decoded as a whole, however little of it is wanted; small ones always are."""
    monkeypatch.setattr(ome_zarr, "WHOLE_BYTES", 1000)
    monkeypatch.setattr(reading, "ALWAYS", MIB)
    chunked(tmp_path / "one.zarr", 96, 96)
    asked = ["render", str(tmp_path / "one.zarr"), "-o", str(tmp_path / "a.png"), "--size", "8"]
    assert main([*asked, "--memory", "8MiB"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and not (tmp_path / "a.png").exists()
    assert "chunks: expected one that is decoded in 8.0 MiB in all, got 200.1 MiB for one of 96×96×96; give" in told
    monkeypatch.setattr(reading, "ALWAYS", 16 * MIB)
    with fileio.within(BUDGET):
        assert sg.load(tmp_path / "one.zarr").samples[0, 0, 1] == 1


def test_samples_larger_than_a_share_of_the_memory_are_read_in_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An eighth of the budget, of every kind that is read in parts, and never below what is always held."""
    monkeypatch.setattr(fileio, "ALWAYS", MIB)
    samples = chunked(tmp_path / "a.zarr", 80, 40)
    h5py = pytest.importorskip("h5py", reason="writes the file; it is in the extra readers")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("a", data=samples, chunks=(40,) * 3)
    for name in ("a.zarr", "a.h5"):
        for memory, whole in ((16 * MIB, True), (15 * MIB, False), (1, False)):
            with fileio.within(memory):
                found = sg.load(tmp_path / name).samples
            assert isinstance(found, np.ndarray) == whole, (name, memory)
            assert np.array_equal(found[:3], samples[:3])
    assert fileio.held_within_budget(100) == 100

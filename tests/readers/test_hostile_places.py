"""Hostile places: pipes, devices, links and loops instead of files, and Zarr stores, which are folders of them."""

from __future__ import annotations

import json
import os
import pickle
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load
from splatgl.readers.common import map_array

for _library in ("h5py", "mrcfile", "nibabel", "nrrd", "tifffile", "zarr"):
    pytest.importorskip(_library, reason="the extras dev and readers write and read the files")

from tests.fuzz import seed_files  # noqa: E402
from tests.fuzz import seeds as good  # noqa: E402
from tests.helpers.hostile import refused  # noqa: E402

# --- what is no file --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.npy", "a.npz", "a_1x1x1_uint8.raw", "a.nrrd", "a.nii", "a.tif", "a.vti", "a.csv"])
def test_pipes_devices_and_loops_are_refused(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    refused(tmp_path / name, "a pipe or device")
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    refused(tmp_path / name, "a pipe or device")
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to(name)
    refused(tmp_path / name, "no such file")


@pytest.mark.parametrize("loops", [True, False], ids=["loop", "pipe"])
def test_data_files_that_are_none(tmp_path: Path, loops: bool) -> None:
    if loops:
        (tmp_path / "a.raw").symlink_to("a.raw")
    else:
        os.mkfifo(tmp_path / "a.raw")
    (tmp_path / "a.mhd").write_bytes(good.meta("a.raw"))
    refused(tmp_path / "a.mhd", "data file: expected a file")


def test_a_header_that_names_itself(tmp_path: Path) -> None:
    (tmp_path / "a.mhd").write_bytes(good.meta("a.mhd"))
    refused(tmp_path / "a.mhd", "data: expected 594 bytes")


def test_what_the_system_refuses_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    refused(tmp_path / ("a" * 300 + ".npy"), "cannot be read: File name too long")
    (tmp_path / "a.npy").write_bytes(b"x")

    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", denied)
    refused(tmp_path / "a.npy", "cannot be read: Permission denied")


def test_a_file_cut_short_before_it_is_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.raw").write_bytes(bytes(9))
    monkeypatch.setattr("splatgl.readers.common.require_bytes", lambda *_: None)
    with pytest.raises(InputError, match="mapped samples"):
        map_array(tmp_path / "a.raw", 0, np.dtype("u1"), (10,))


LOUD = """
import sys
from splatgl.errors import InputError
from splatgl.readers import load
for name in sys.argv[1:]:
    try:
        load(name)
    except InputError as error:
        print(error)
"""


def test_libraries_print_nothing(tmp_path: Path) -> None:
    names = ["a.nii", "b.npy", "c.vtk"]
    damaged = bytearray(good.nifti()[0].files["a.nii"])
    damaged[80:92] = struct.pack("<3f", -1.0, 0.0, 2.0)
    damaged[252:254] = struct.pack("<h", 99)
    (tmp_path / "a.nii").write_bytes(damaged)
    (tmp_path / "b.npy").write_bytes(good.npy()[0].files["a.npy"].replace(b"(6, 9, 11), }", b"(6L,9L,11),}L"))
    text = seed_files.vtk_legacy("ASCII")[0].files["a.vtk"].replace(b"flow float\n", b"flow float\n1e99 ")
    (tmp_path / "c.vtk").write_bytes(text)
    command = [sys.executable, "-c", LOUD, *(str(tmp_path / name) for name in names)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, "")


# --- Zarr -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store of format 2 with one chunk, 0.0.0, compressed by gzip."""
    import zarr
    from numcodecs import GZip

    path = tmp_path / "a.zarr"
    zarr.create_array(path, data=seed_files.CUBE, chunks=seed_files.CUBE.shape, zarr_format=2, compressors=GZip())
    assert load(path).shape == seed_files.CUBE.shape
    return path


def change(path: Path, **values: object) -> None:
    header = json.loads((path / ".zarray").read_text())
    (path / ".zarray").write_text(json.dumps(header | values))


def test_zarr_bombs(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from numcodecs import Blosc, Zstd

    # so that a small bomb is one
    monkeypatch.setattr("splatgl.readers.zarr_files.MAX_BYTES", 2**25)
    engine = zlib.compressobj(9, wbits=31)
    bomb = b"".join(engine.compress(bytes(2**24)) for _ in range(4)) + engine.flush()
    (store / "0.0.0").write_bytes(bomb)
    refused(store, "chunk 0.0.0: expected 594 bytes")
    for codec in (Zstd(), Blosc()):
        (store / "0.0.0").write_bytes(codec.encode(bytes(2**24)))
        change(store, compressor=codec.get_config())
        refused(store, "chunk 0.0.0: expected 594 bytes, got 16777216 at least")


@pytest.mark.parametrize("length", [0, 335_544_364])
def test_zarr_of_blosc_chunks_longer_than_their_files(store: Path, length: int) -> None:
    """Blosc's library trusts the length in a chunk's header and reads beyond the file, which ends the process."""
    from numcodecs import Blosc

    chunk = bytearray(Blosc().encode(np.arange(594).astype(np.uint8).tobytes()))
    chunk[12:16] = length.to_bytes(4, "little")
    (store / "0.0.0").write_bytes(chunk)
    change(store, compressor=Blosc().get_config())
    refused(store, f"bytes stored, got {length} stated; the file is damaged")


def test_zarr_of_more_chunks_than_files(store: Path) -> None:
    change(store, shape=[6, 9, 10**6], chunks=[1, 1, 1])
    refused(store, "chunks: expected at most")


@pytest.mark.parametrize("codec", ["pickle", "msgpack2", "bz2"])
def test_zarr_codecs_that_run_or_grow(store: Path, codec: str) -> None:
    (store / "0.0.0").write_bytes(pickle.dumps(bytes(594)))
    change(store, compressor=None, filters=[{"id": codec}])
    refused(store, "a.zarr: ")
    change(store, compressor={"id": "bz2", "level": 1}, filters=None)
    refused(store, "codecs: expected one of zlib, gzip, blosc, zstd, lz4, got bz2")


def test_zarr_of_pipes_and_links(store: Path) -> None:
    chunk = store / "0.0.0"
    chunk.unlink()
    chunk.symlink_to("/dev/zero")
    refused(store, "0.0.0: expected a file inside the store")
    chunk.unlink()
    os.mkfifo(chunk)
    refused(store, "0.0.0: expected a file inside the store")


def test_zarr_metadata_of_the_wrong_kinds(store: Path) -> None:
    (store / ".zarray").write_text("[" * 100_000)
    refused(store, "cannot be read as Zarr")
    (store / ".zarray").unlink()
    wrong: list[object] = [{"a": 1}, [7], [{"axes": 5, "datasets": [{"path": "../b"}]}], [{"datasets": []}]]
    for images in wrong:
        (store / ".zgroup").write_text('{"zarr_format": 2}')
        (store / ".zattrs").write_text(json.dumps({"multiscales": images}))
        refused(store, "a.zarr: ")

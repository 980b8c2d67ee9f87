"""Formats are recognized by contents: without an ending, with a wrong one, and where endings are shared."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load
from splatgl.readers.common import decoder_errors
from tests.fuzz.seeds import SEEDS

A = np.arange(7 * 12 * 13, dtype=np.int16).reshape(7, 12, 13)


def write_nifti(path: Path, **header: float) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Image(A.T, np.diag([-1.5, 2, 3, 1])), path)


def write_mgh(path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.MGHImage(A.T, np.eye(4)), path)


def write_mrc(path: Path) -> None:
    with pytest.importorskip("mrcfile").new(path) as file:
        file.set_data(A)


def write_itk(path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    sitk.WriteImage(sitk.GetImageFromArray(A), str(path))


def write_tiff(path: Path) -> None:
    pytest.importorskip("tifffile").imwrite(path, A)


WRITERS: dict[str, Callable[[Path], Any]] = {
    "a.nii": write_nifti,
    "a.nii.gz": write_nifti,
    "a.mgz": write_mgh,
    "a.mrc": write_mrc,
    "a.nrrd": write_itk,
    "a.mha": write_itk,
    "a.vtk": write_itk,
    "a.tif": write_tiff,
    "a.npy": partial(np.save, arr=A),
    "a.npz": partial(np.savez, a=A),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("other", ["scan", "scan.dat", "scan.nii.gz", "scan.tif", "scan.png"])
def test_contents_count(tmp_path: Path, name: str, other: str) -> None:
    WRITERS[name](tmp_path / name)
    shutil.move(tmp_path / name, tmp_path / other)
    volume = load(tmp_path / other)
    assert np.array_equal(volume.samples, A)
    # a file is packed or not, whatever its name says
    same = other == "scan" or other.endswith(name[1:]) or (name, other) == ("a.nii", "scan.nii.gz")
    assert ("not what its name says" in " ".join(volume.notes)) == (not same)


def test_packed_by_contents(tmp_path: Path) -> None:
    write_mrc(tmp_path / "a.mrc")
    (tmp_path / "b.mrc").write_bytes(gzip.compress((tmp_path / "a.mrc").read_bytes()))
    assert np.array_equal(load(tmp_path / "b.mrc").samples, A)


def test_raw_samples_with_a_size_in_their_name_are_raw(tmp_path: Path) -> None:
    data = b"NRRD" + bytes(60)
    (tmp_path / "a_4x4x4_uint8.raw").write_bytes(data)
    assert load(tmp_path / "a_4x4x4_uint8.raw").samples[0, 0].tobytes() == b"NRRD"


OTHER = {
    "a.nii.gz": (b"version https://git-lfs.github.com/spec/v1\n", "got a pointer of Git LFS; fetch the file"),
    "a.tif": (b"<!DOCTYPE html><html>not found", "got a page of HTML; download the file itself"),
    "b.tif": (b"\1\2\3", "got bytes that begin with 01 02 03; rename or convert the file"),
    "a.mha": (b"%PDF-1.7", "expected MetaImage, as the name says, got PDF"),
    "a.mgz": (b"hello", "got text that begins with 'hello'"),
    "a.vti": (b'<VTKFile type="PolyData">', "got VTK PolyData; it is a surface: --mesh"),
    "a.jp2": (b"\0\0\0\x0cjP  \r\n", "got JPEG 2000; a picture is one slice"),
    "a.nia": (b"<nifti_image\n", "got NIfTI in text; save it as .nii.gz"),
    "scan": (b"Rar!", "expected one that is read, got RAR; unpack it"),
}


@pytest.mark.parametrize("name", OTHER)
def test_a_file_of_another_kind_is_not_called_damaged(tmp_path: Path, name: str) -> None:
    data, message = OTHER[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as caught:
        load(tmp_path / name)
    assert message in str(caught.value) and "damaged" not in str(caught.value)


def test_marks_of_nifti(tmp_path: Path) -> None:
    """Numbers that are none, and grids of zeros, as some programs write them."""
    write_nifti(tmp_path / "a.nii")
    whole = bytearray((tmp_path / "a.nii").read_bytes())
    for scaling, values in (((2, np.nan), A * 2.0), ((0, np.nan), A), ((np.inf, 1), A)):
        whole[112:120] = np.array(scaling, "<f4").tobytes()
        (tmp_path / "a.nii").write_bytes(whole)
        assert np.array_equal(load(tmp_path / "a.nii").samples, values)
    whole[252:256] = b"\1\0\1\0"
    for bad in (0.0, np.nan):
        whole[280:328] = np.full(12, bad, "<f4").tobytes()
        (tmp_path / "a.nii").write_bytes(whole)
        volume = load(tmp_path / "a.nii")
        assert volume.spacing == (1.5, 2, 3) and "the file's sform is no grid and ignored" in volume.notes


def test_seeds_are_recognized(tmp_path: Path) -> None:
    """The seeds of fuzzing, without their endings."""
    for reader in ("nrrd", "metaimage", "nifti", "mgh", "vti-appended"):
        for seed in SEEDS[reader]():
            (tmp_path / "scan").write_bytes(seed.files[seed.main])
            assert load(tmp_path / "scan").count > 0


@pytest.mark.parametrize(
    "error",
    [
        AttributeError("property 'is_svs' of 'TiffFile' object has no setter"),
        TypeError("open() got an unexpected keyword argument 'mode'"),
        ImportError("cannot import name 'decode' from 'codecs'"),
    ],
)
def test_a_library_that_fails_by_itself_is_told_as_such(error: Exception) -> None:
    told = r"fails, whatever the file .*; install another version of it"
    with pytest.raises(InputError, match=told), decoder_errors("TIFF"):
        raise error
    with pytest.raises(InputError, match="the file may be damaged"), decoder_errors("TIFF"):
        raise AttributeError("'NoneType' object has no attribute 'pages'")

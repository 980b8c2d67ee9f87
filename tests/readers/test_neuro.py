"""MINC, AFNI and PAR/REC beside nibabel's reading; NRRD's lists of files; VTK's bits, texts and ids."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load
from tests.fuzz.seed_files import CUBE, Seed
from tests.fuzz.seed_neuro import afni, nrrd_list, write_vti, write_vtk

NAMES = ("minc1_4d.mnc", "minc2_4d.mnc", "minc2_1_scale.mnc", "tiny.mnc", "example4d+orig.HEAD", "phantom_varscale.PAR")


@pytest.mark.parametrize("name", NAMES)
def test_files_of_nibabel(name: str) -> None:
    nibabel = pytest.importorskip("nibabel")
    path = Path(pytest.importorskip("nibabel.testing").data_path) / name
    if not path.is_file():
        pytest.skip("nibabel's test data are not installed")
    volume = load(path)
    last = volume.times - 1
    volume = load(path, time=last) if last else volume
    image = nibabel.load(path)
    own = np.asarray(image.dataobj)
    is_minc = name.endswith(".mnc")
    if own.ndim == 4:
        own = own[last] if is_minc else own[..., last]
    np.testing.assert_allclose(volume.samples, own if is_minc else own.T, rtol=1e-6)
    place = np.array([1, 2, 3])
    world = image.affine[:3, :3] @ (place[::-1] if is_minc else place) + image.affine[:3, 3]
    np.testing.assert_allclose(volume.world_from_index @ place + volume.origin, world, atol=1e-4)
    assert volume.frame == "RAS" and volume.unit == "mm"


def test_a_pair_needs_both(tmp_path: Path) -> None:
    (tmp_path / "a.par").write_text("# === DATA DESCRIPTION FILE ===")
    with pytest.raises(InputError, match=r"pair: expected a\.REC beside it, got none"):
        load(tmp_path / "a.par")


def test_a_damaged_number_of_sub_bricks_is_refused_before_nibabel_allocates_their_scales(tmp_path: Path) -> None:
    pytest.importorskip("nibabel")
    header, data = afni()[0].files.items()
    damaged = header[1].replace(b" 3 1 0 0 0", b" 3 1000000000000 0 0 0")
    (tmp_path / header[0]).write_bytes(damaged)
    (tmp_path / data[0]).write_bytes(data[1])
    with pytest.raises(InputError, match="data: expected"):
        load(tmp_path / header[0])


@pytest.mark.parametrize("seed", nrrd_list(), ids=["pattern", "list"])
def test_lists_of_nrrd(tmp_path: Path, seed: Seed) -> None:
    for name, data in seed.files.items():
        (tmp_path / name).write_bytes(data)
    assert np.array_equal(load(tmp_path / "a.nhdr").samples, CUBE)
    (tmp_path / "s3.raw").unlink()
    with pytest.raises(InputError, match="data file: expected a file next to the header"):
        load(tmp_path / "a.nhdr")


@pytest.mark.parametrize(
    ("name", "mode"), [("a.vti", "Ascii"), ("a.vti", "Appended"), ("a.vtk", "ASCII"), ("a.vtk", "Binary")]
)
def test_bits_texts_and_ids_beside_numbers(tmp_path: Path, name: str, mode: str) -> None:
    pytest.importorskip("vtk")
    write = write_vti if name == "a.vti" else write_vtk
    write(tmp_path / name, mode)
    assert np.array_equal(load(tmp_path / name).samples, CUBE)
    mask = load(tmp_path / name, array="mask").samples
    assert mask.dtype == bool and np.array_equal(mask, CUBE > 90)
    assert np.array_equal(load(tmp_path / name, array="ids").samples.ravel(), np.arange(CUBE.size))
    write(tmp_path / name, mode, bits_only=True)
    assert np.array_equal(load(tmp_path / name).samples, CUBE > 90)


def put_qform(path: Path, parts: tuple[float, float, float], qfac: float, sform: bool) -> Path:
    """A block of NIfTI with a quaternion, written byte by byte; nibabel and SimpleITK write none that is too long."""
    nibabel = pytest.importorskip("nibabel")
    samples = np.zeros((12, 10, 8), np.int16)
    samples[1:4, 2:5, 1:3] = 500
    affine = np.array([[-2.0, 0, 0, 11], [0, 2, 0, -9], [0, 0, 3, 5], [0, 0, 0, 1]])
    raw = bytearray(nibabel.Nifti1Image(samples, affine).to_bytes())
    struct.pack_into("<2h6f", raw, 252, 1, sform, *parts, 11, -9, 5)
    struct.pack_into("<f", raw, 76, qfac)
    if not sform:
        raw[280:328] = bytes(48)
    path.write_bytes(raw)
    return path


NAN = float("nan")
LONG = (0.0, float(np.float32(np.sqrt(1 + 4e-7))), 0.0)


@pytest.mark.parametrize("sform", [True, False])
@pytest.mark.parametrize("qfac", [1.0, -1.0, 0.0])
@pytest.mark.parametrize(
    "parts", [LONG, (0.9, 0.5, 0.1), (5.0, 5.0, 5.0), (0.1, -0.2, 0.3), (0.0, 0.0, 0.0), (NAN, NAN, NAN)]
)
def test_quaternions_of_any_length(parts: tuple[float, float, float], qfac: float, sform: bool, tmp_path: Path) -> None:
    """The sform counts where there is one; a quaternion that is too long is normed, as by SimpleITK."""
    path = put_qform(tmp_path / "a.nii", parts, qfac, sform)
    volume = load(path)
    middle = volume.world_from_index @ (2, 3, 1.5) + volume.origin
    if sform:
        np.testing.assert_allclose(middle, (7, -3, 9.5), atol=1e-4)
    elif np.isnan(parts).any():
        assert volume.frame is None and "the file's qform is no grid and ignored" in volume.notes
    else:
        simpleitk = pytest.importorskip("SimpleITK")
        simpleitk.ProcessObject.SetGlobalWarningDisplay(False)
        right = simpleitk.ReadImage(str(path)).TransformContinuousIndexToPhysicalPoint((2, 3, 1.5))
        np.testing.assert_allclose(middle, np.array(right) * (-1, -1, 1), atol=2e-4)
        assert ("long, and taken for one of length 1" in " ".join(volume.notes)) == (np.linalg.norm(parts) > 1.001)


def test_quaternions_are_those_of_nibabel(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    for parts in np.random.default_rng(3).uniform(-0.57, 0.57, (8, 3)).tolist():
        path = put_qform(tmp_path / "a.nii", tuple(parts), -1.0, sform=False)
        volume, affine = load(path), nibabel.load(path).affine
        np.testing.assert_allclose(volume.world_from_index, affine[:3, :3], atol=1e-6)
        np.testing.assert_allclose(volume.origin, affine[:3, 3], atol=1e-6)


@pytest.mark.parametrize("good", [0, 1])
def test_mgh_without_an_orientation(good: int, tmp_path: Path) -> None:
    """FreeSurfer takes coronal slices of 1 mm where the flag is 0; a note says so."""
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.MGHImage(np.arange(120, dtype=np.int16).reshape(4, 5, 6), np.diag([2.0, 2, 3, 1]))
    nibabel.save(image, tmp_path / "a.mgh")
    raw = bytearray((tmp_path / "a.mgh").read_bytes())
    struct.pack_into(">h", raw, 28, good)
    (tmp_path / "a.mgh").write_bytes(raw)
    volume, affine = load(tmp_path / "a.mgh"), nibabel.load(tmp_path / "a.mgh").affine
    np.testing.assert_allclose(volume.world_from_index, affine[:3, :3], atol=1e-6)
    assert any("goodRASFlag 0" in note for note in volume.notes) == (good == 0)
    assert volume.spacing == ((2, 2, 3) if good else (1, 1, 1))


def test_an_offset_that_is_no_number_is_refused(tmp_path: Path) -> None:
    """Analyze's header states it in floating point."""
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.AnalyzeImage(np.zeros((3, 4, 5), np.int16), np.eye(4)), tmp_path / "a.img")
    raw = bytearray((tmp_path / "a.hdr").read_bytes())
    struct.pack_into("<f", raw, 108, NAN)
    (tmp_path / "a.hdr").write_bytes(raw)
    with pytest.raises(InputError, match=r"a\.img: cannot be read as Analyze: cannot convert float NaN to integer"):
        load(tmp_path / "a.img")

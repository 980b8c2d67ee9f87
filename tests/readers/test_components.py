"""Colours, vectors and complex numbers of voxels, and axes of one entry, as nibabel, SimpleITK and numpy write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl import InputError, load

F = (np.arange(4 * 5 * 6).reshape(4, 5, 6) * 7 % 251).astype(np.float32)
RGB = np.stack([F, F[::-1], 255 - F], -1).astype(np.uint8)
RGBA = np.concatenate([RGB, RGB[..., :1]], -1)
FLOW = np.stack([F, 2 * F, -F], -1)
IS_COLOR, IS_VECTOR, IS_COMPLEX = "read as a colour", "read as a vector", "rendered by their magnitude"


def told(volume: Any, text: str) -> bool:
    return any(text in note for note in volume.notes)


@pytest.mark.parametrize("ending", [".nii", ".nii.gz"])
@pytest.mark.parametrize("count", [3, 4])
def test_nifti_has_colours(tmp_path: Path, ending: str, count: int) -> None:
    nibabel = pytest.importorskip("nibabel")
    kind = np.dtype([(letter, "u1") for letter in "RGBA"[:count]])
    stored = np.ascontiguousarray(RGBA[..., :count]).view(kind)[..., 0].T
    nibabel.save(nibabel.Nifti1Image(stored, np.diag([0.25, 0.5, 2, 1])), tmp_path / f"a{ending}")
    volume = load(tmp_path / f"a{ending}")
    np.testing.assert_array_equal(volume.color, RGB)
    assert volume.spacing == (0.25, 0.5, 2) and volume.frame == "RAS" and not volume.notes
    np.testing.assert_array_equal(load(tmp_path / f"a{ending}", channel=2).samples, RGB[..., 2])


@pytest.mark.parametrize(("intent", "shape"), [(1006, (6, 5, 4, 1, 3)), (1007, (6, 5, 4, 1, 3)), (1007, (6, 5, 4, 3))])
def test_nifti_has_vectors_by_its_intent(tmp_path: Path, intent: int, shape: tuple[int, ...]) -> None:
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(FLOW.transpose(2, 1, 0, 3).reshape(shape), np.diag([0.25, 0.5, 2, 1]))
    image.header.set_intent(intent)
    nibabel.save(image, tmp_path / "a.nii.gz")
    volume = load(tmp_path / "a.nii.gz")
    np.testing.assert_array_equal(volume.vectors, FLOW)
    np.testing.assert_allclose(volume.samples, np.linalg.norm(FLOW, axis=-1), rtol=1e-6)
    assert volume.times == 1 and told(volume, "along right, front and head")
    np.testing.assert_array_equal(load(tmp_path / "a.nii.gz", channel=1).samples, 2 * F)


def test_a_channel_of_nifti_is_never_ignored(tmp_path: Path) -> None:
    """Numbers along a fifth axis are components without an intent, too; a grey image has no channel."""
    nibabel = pytest.importorskip("nibabel")
    parts = np.stack([F.T, 2 * F.T], -1)[:, :, :, None]
    nibabel.save(nibabel.Nifti1Image(parts, np.eye(4)), tmp_path / "a.nii")
    for name in ("array", "channel"):
        assert np.array_equal(load(tmp_path / "a.nii", **{name: 1}).samples, 2 * F)
    assert "array 0 of 2 is read" in load(tmp_path / "a.nii").notes[-1]
    nibabel.save(nibabel.Nifti1Image(F.T, np.eye(4)), tmp_path / "b.nii")
    with pytest.raises(InputError, match="channel: expected several numbers per voxel, got 1"):
        load(tmp_path / "b.nii", channel=1)


def test_complex_numbers_are_magnitudes(tmp_path: Path) -> None:
    nibabel, itk = pytest.importorskip("nibabel"), pytest.importorskip("SimpleITK")
    waves = (F * (3 + 4j)).astype(np.complex64)
    nibabel.save(nibabel.Nifti1Image(waves.T, np.eye(4)), tmp_path / "a.nii")
    itk.WriteImage(itk.GetImageFromArray(waves), str(tmp_path / "a.nrrd"))
    np.save(tmp_path / "a.npy", waves)
    for ending in ("nii", "nrrd", "npy"):
        volume = load(tmp_path / f"a.{ending}")
        np.testing.assert_allclose(volume.samples, 5 * F, rtol=1e-6)
        assert told(volume, IS_COMPLEX)


@pytest.mark.parametrize("ending", ["mha", "nrrd", "nii.gz"])
def test_itk_writes_colours_and_vectors(tmp_path: Path, ending: str) -> None:
    itk = pytest.importorskip("SimpleITK")
    for name, array in (("rgb", RGB), ("rgba", RGBA), ("flow", FLOW)):
        itk.WriteImage(itk.GetImageFromArray(array, isVector=True), str(tmp_path / f"{name}.{ending}"))
    for name in ("rgb", "rgba"):
        volume = load(tmp_path / f"{name}.{ending}")
        np.testing.assert_array_equal(volume.color, RGB)
        assert told(volume, IS_COLOR)
    np.testing.assert_array_equal(load(tmp_path / f"flow.{ending}").vectors, FLOW)


def test_numpy_has_colours_vectors_and_axes_of_one_entry(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for array in (RGB, RGBA, RGB[None], np.asfortranarray(RGB)):
        np.save(path, array)
        assert np.array_equal(load(path).color, RGB) and told(load(path), IS_COLOR)
    assert np.array_equal(load(path, channel=1).samples, RGB[..., 1])
    np.save(path, FLOW)
    assert np.array_equal(load(path).vectors, FLOW) and told(load(path), IS_VECTOR)
    for array in (F[None], F[None, None], F[..., None], F[:, None]):
        np.save(path, array)
        assert np.array_equal(load(path).samples, F)
    np.savez(tmp_path / "a.npz", a=RGB)
    assert np.array_equal(load(tmp_path / "a.npz").color, RGB)
    np.save(path, np.zeros((4, 5, 6, 7)))
    with pytest.raises(InputError, match=r"colours or vectors, got float64 \(4, 5, 6, 7\)"):
        load(path)

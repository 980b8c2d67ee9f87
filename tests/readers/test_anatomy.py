"""One patient in every format and frame: azimuth 0 is the front, the left is at the right, superior is up."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.animation.camera_track import RotationHull, turning
from splatgl.annotations.world_lines import letters
from splatgl.planning.culling import OpaqueBounds
from splatgl.scene.view import ViewOptions

STEP = np.array([2.0, 2.5, 3.0])
SIZE = (14, 12, 10)
ORIGIN = np.array([-9.0, 20.0, -30.0])
LOOK = {"points": ((50, 0.0), (150, 0.9)), "colormap": "gray", "window": (0, 900), "shading": False}


def patient() -> np.ndarray:
    """Samples [z, y, x] along left, posterior and superior: a body, bright nose, left arm and crown."""
    x, y, z = np.meshgrid(*(np.arange(n) for n in SIZE), indexing="ij")
    body = (np.abs(x - 6.5) < 4) & (np.abs(y - 5.5) < 3) & (z < 8)
    found = np.where(body, 300, 0)
    found[6:8, :3, 5:7] = 900
    found[10:13, 5:7, 2:6] = 600
    found[5:9, 4:8, 8:] = 450
    return found.transpose(2, 1, 0).astype(np.int16)


def turned(order: tuple[int, int, int], flips: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same patient on a grid whose axes x, y, z are LPS axes `order`, backwards where flipped: samples [z, y, x],
    steps [3, 3] as columns in LPS, and the first voxel's place.
    """
    samples = patient().transpose(2, 1, 0).transpose(order)
    steps, origin = np.zeros((3, 3)), ORIGIN.copy()
    for axis, (world, flip) in enumerate(zip(order, flips, strict=True)):
        steps[world, axis] = -STEP[world] if flip else STEP[world]
        origin[world] += (SIZE[world] - 1) * STEP[world] if flip else 0
        samples = np.flip(samples, axis) if flip else samples
    return np.ascontiguousarray(samples.transpose(2, 1, 0)), steps, origin


PLAIN = turned((0, 1, 2), (0, 0, 0))
OTHER = turned((1, 2, 0), (0, 1, 1))


def nrrd(space: str, signs: tuple[int, int, int], of: tuple) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        module = pytest.importorskip("nrrd", reason="writes the file; it is in the extra readers")
        samples, steps, origin = of
        turn = np.diag(np.array(signs, float))
        header = {"space": space, "space directions": (turn @ steps).T, "space origin": turn @ origin}
        module.write(str(folder / "a.nrrd"), samples, header, index_order="C")
        return folder / "a.nrrd"

    return write


def nifti(of: tuple) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        nibabel = pytest.importorskip("nibabel", reason="writes the file; it is in the extra readers")
        samples, steps, origin = of
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = np.diag([-1, -1, 1]) @ steps, np.diag([-1, -1, 1]) @ origin
        nibabel.save(nibabel.Nifti1Image(samples.T, affine), folder / "a.nii")
        return folder / "a.nii"

    return write


def dicom(of: tuple) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
        from tests.fuzz.seed_dicom import image, save

        samples, steps, origin = of
        lengths = np.linalg.norm(steps, axis=0)
        axes = (steps / lengths).T
        (folder / "ct").mkdir()
        for n, plane in enumerate(samples):
            data = image(plane, n, ImagePositionPatient=(origin + n * steps[:, 2]).tolist(), SliceThickness=lengths[2])
            data.ImageOrientationPatient, data.PixelSpacing = [*axes[0], *axes[1]], [lengths[1], lengths[0]]
            save(data, folder / "ct" / f"{n}.dcm")
        return folder / "ct"

    return write


def metaimage(of: tuple) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        samples, steps, origin = of
        lengths = np.linalg.norm(steps, axis=0)
        fields = {"NDims": [3], "DimSize": samples.shape[::-1], "ElementSpacing": lengths, "Offset": origin}
        fields["TransformMatrix"] = (steps / lengths).T.ravel()
        lines = [f"{name} = {' '.join(map(str, values))}\n" for name, values in fields.items()]
        head = "".join([*lines, "ElementType = MET_SHORT\nElementDataFile = LOCAL\n"])
        (folder / "a.mha").write_bytes(head.encode() + samples.astype("<i2").tobytes())
        return folder / "a.mha"

    return write


FILES = {
    "NRRD, LPS": nrrd("left-posterior-superior", (1, 1, 1), PLAIN),
    "NRRD, RAS": nrrd("right-anterior-superior", (-1, -1, 1), PLAIN),
    "NRRD, LAS": nrrd("left-anterior-superior", (1, -1, 1), PLAIN),
    "NRRD, RAS, axes in another order": nrrd("RAS", (-1, -1, 1), OTHER),
    "NRRD, LPS, axes in another order": nrrd("LPS", (1, 1, 1), OTHER),
    "NIfTI": nifti(PLAIN),
    "NIfTI, axes in another order": nifti(OTHER),
    "MetaImage": metaimage(PLAIN),
    "MetaImage, axes in another order": metaimage(OTHER),
    "DICOM, axial": dicom(PLAIN),
    "DICOM, sagittal": dicom(turned((1, 2, 0), (0, 1, 0))),
}


@pytest.mark.few(1)
@pytest.mark.parametrize("azimuth", [0.0, 40.0])
def test_one_patient_looks_the_same_from_every_file(azimuth: float, tmp_path: Path) -> None:
    """Seen from the front: bright nose before the body, left arm at the right, crown on top."""
    options = {"size": (32, 32), "elevation": 0.0, "azimuth": azimuth, "classification": "pre"}
    options["background"] = "transparent"
    first = None
    for n, (name, write) in enumerate(FILES.items()):
        (tmp_path / str(n)).mkdir()
        volume = sg.load(write(tmp_path / str(n)))
        assert volume.frame in ("LPS", "RAS"), name
        found = sg.render(volume, LOOK, **options).pixels
        first = found if first is None else first
        np.testing.assert_allclose(found, first, atol=2e-3, err_msg=name)
    if azimuth == 0:
        assert first is not None
        value = np.where(first[..., 3] > 0.5, first[..., 0] / np.maximum(first[..., 3], 0.5), 0.0)
        # linear light of the parts' greys: body 0.09, crown 0.21, arm 0.40, nose 1
        rows, columns = np.nonzero(value > 0.05)
        middle = (columns.min() + columns.max()) / 2
        assert np.nonzero(np.abs(value - 0.40) < 0.01)[1].mean() > middle + 5 and (value > 0.98).sum() > 8
        assert np.nonzero(np.abs(value - 0.21) < 0.01)[0].mean() < rows.min() + 6


@pytest.mark.parametrize("frame", ["LPS", "RAS", None])
def test_whatever_a_view_is_fitted_to_is_seen_from_the_front(frame: str | None) -> None:
    """Volumes, splats, scenes of layers, opaque parts, crops, tracks and the command line's view."""
    volume = sg.Volume(np.ones((5, 6, 7), np.float32), frame=frame)
    transfer = sg.Transfer([(0, 0.0), (1, 0.5)])
    subjects = [volume, OpaqueBounds(volume, transfer), sg.Scene([sg.Layer(volume, transfer)])]
    subjects += [sg.extract(volume, transfer, classification=how) for how in ("pre", "post", "auto")]
    subjects += [RotationHull.of(volume, np.array([0.0, 0.0, 1.0]))]
    cameras = [sg.Camera.orbit(subject) for subject in subjects]
    cameras += [ViewOptions(azimuth=0.0, elevation=0.0).camera(volume, subject) for subject in subjects]
    cameras += [turning(ViewOptions(azimuth=0.0, elevation=0.0), volume, volume, 5.0).base]
    for camera in cameras:
        assert np.allclose(camera.forward, (0, -1 if frame == "RAS" else 1, 0), atol=1e-9)
        if frame:
            towards, right, up = -camera.forward, camera.right, -camera.eye_from_world[1]
            assert [letters(frame, each) for each in (towards, right, up)] == ["A", "L", "S"]
    default = ViewOptions().camera(volume, volume)
    assert frame is None or letters(frame, -default.forward)[0] in "AL"

"""Labels that are written as DICOM SEG: where they were, with names and colours, for other readers too; over images."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from tests.fuzz.seed_dicom import image, save
from tests.fuzz.seed_segments import found_in

hd = pytest.importorskip("highdicom", reason="writes segmentations; it is in the extra dicom-seg")
TURN = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
TABLE = (Label(1, "liver", "#c08040"), Label(7, "the left kidney", "#00ff10"))
# frames of 35 bits, which begin at every bit of a byte
SHAPE = (8, 5, 7)
GRID: dict[str, Any] = {"spacing": (0.5, 0.75, 2.0), "origin": (-3.0, 10.5, 7.0), "unit": "mm", "frame": "LPS"}


@pytest.fixture
def labels(rng: np.random.Generator) -> sg.Volume:
    return sg.Volume(rng.choice(np.array([0, 1, 7]), SHAPE), direction=TURN, labels=TABLE, **GRID)


def assert_same(read: sg.Volume, right: sg.Volume) -> None:
    """Voxels of the same segments at the same places; colours pass through CIELab."""
    found, wanted = found_in(read), found_in(right.placed("LPS"))
    assert list(found) == list(wanted)
    for name, places in wanted.items():
        np.testing.assert_allclose(found[name], places, atol=1e-5)
    colors = [[int(label.color[n : n + 2], 16) for n in (1, 3, 5)] for v in (read, right) for label in v.labels or ()]  # type: ignore[index]
    ours, theirs = np.array_split(np.array(colors), 2)
    np.testing.assert_allclose(ours, theirs, atol=1)


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
def test_labels_come_back(frame: str, labels: sg.Volume, tmp_path: Path) -> None:
    notes = labels.placed(frame).save(path := tmp_path / "a.dcm")
    assert "7 is 2" in notes[-1] and "Tissue, MANUAL" in notes[-2]
    assert_same(sg.load(path), labels)
    samples = np.asarray(labels.samples)
    # other readers: bits, and a volume of numbers
    pydicom = pytest.importorskip("pydicom")
    data = pydicom.dcmread(path)
    assert "SourceImageSequence" not in data and data.FrameOfReferenceUID and not data.PatientName
    planes = [frame.PlanePositionSequence[0].ImagePositionPatient for frame in data.PerFrameFunctionalGroupsSequence]
    order = [round(place) for place in (np.array(planes) - labels.origin) @ TURN[:, 2] / labels.spacing[2]]
    masks = np.concatenate([(samples == 1)[order[:8]], (samples == 7)[order[8:]]])
    assert np.array_equal(data.pixel_array, masks)
    grid = (
        hd.seg.segread(path)
        .get_volume(combine_segments=True)
        .match_geometry(hd.Volume(samples, geometry(labels), "PATIENT"))
    )
    assert np.array_equal(grid.array, (samples > 0) * 1 + (samples == 7))
    itk = pytest.importorskip("SimpleITK", reason="needs SimpleITK")
    bits = itk.GetArrayFromImage(itk.ReadImage(str(path)))
    assert np.array_equal(bits > 0, masks)


def geometry(volume: sg.Volume) -> np.ndarray:
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = volume.world_from_index[:, ::-1], volume.origin
    return affine


def test_segments_that_overlap_stay_whole(labels: sg.Volume, tmp_path: Path) -> None:
    other = replace(labels, samples=np.ones(SHAPE, np.uint8), labels=(Label(1, "body", "#ffff00"),))
    both = replace(labels, channels=(labels, other), labels=(*TABLE, *(other.labels or ())))
    both.save(tmp_path / "a.dcm")
    read = sg.load(tmp_path / "a.dcm")
    assert {name: len(places) for name, places in found_in(read).items()} == {
        name: len(places) for name, places in found_in(both).items()
    }


@pytest.mark.filterwarnings("error::UserWarning:highdicom")
def test_patient_and_frame_are_those_of_the_images(
    tmp_path: Path, rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ct").mkdir()
    tags = {"PatientName": "Doe", "StudyInstanceUID": "1.2.5", "FrameOfReferenceUID": "1.2.6"}
    for n in range(8):
        save(image(np.zeros((5, 7), np.int16), 3.0 * n, **tags), tmp_path / "ct" / f"{n}.dcm")
    ct = sg.load(tmp_path / "ct")
    numbers = rng.choice(np.array([0, 1, 2], np.uint8), SHAPE)
    volume = replace(ct, samples=numbers, labels=(Label(1, "über \\ liver", "#ff0000"), Label(2, "b", "#0000ff")))
    volume.save(source := tmp_path / "labels.nii.gz")
    line = ["convert", str(source), str(path := tmp_path / "labels.seg.dcm"), "--images", str(tmp_path / "ct")]
    assert main(line) == 0
    captured = capsys.readouterr()
    assert f"{path}: DICOM SEG, 7 × 5 × 8" in captured.out and captured.err.count("\n") == 1
    read = sg.load(path)
    assert np.array_equal(read.samples, numbers) and [label.name for label in read.labels or ()] == [
        "über / liver",
        "b",
    ]
    import pydicom

    data = pydicom.dcmread(path)
    assert (data.PatientName, data.StudyInstanceUID, data.FrameOfReferenceUID) == ("Doe", "1.2.5", "1.2.6")
    assert len(data.ReferencedSeriesSequence[0].ReferencedInstanceSequence) == 8
    notes = replace(volume, origin=(0, 0, 900)).save(path, images=tmp_path / "ct")
    assert any("no slice of the segments lies on one of" in note for note in notes)


def test_what_is_no_segmentation_is_refused(
    labels: sg.Volume, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    shear = np.array([[1.0, 0.6, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, 1.0]])
    amounts = sg.Volume(rng.normal(size=SHAPE).astype(np.float32))
    for volume, told in (
        (amounts, "expected labels in a DICOM segmentation, got amounts; --values labels"),
        (replace(labels, direction=shear), "expected axes at right angles in a DICOM segmentation, got sheared"),
        (
            replace(labels, samples=np.zeros(SHAPE, np.uint8)),
            "segments: expected 1 to 4096 in a DICOM segmentation, got 0",
        ),
    ):
        with pytest.raises(sg.InputError, match=told):
            volume.save(tmp_path / "a.dcm")
    with pytest.raises(sg.InputError, match="images: expected no value for a NRRD file"):
        labels.save(tmp_path / "a.nrrd", images=tmp_path)
    with pytest.raises(sg.InputError, match="expected DICOM files, got none"):
        labels.save(tmp_path / "a.dcm", images=tmp_path)
    with monkeypatch.context() as patched:
        patched.setitem(sys.modules, "highdicom", None)
        with pytest.raises(sg.InputError, match=r"DICOM SEG files: needs .* 'splatgl\[dicom-seg\]'"):
            labels.save(tmp_path / "a.dcm")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("palette", [False, True])
def test_label_maps_of_others(palette: bool, labels: sg.Volume, tmp_path: Path, rng: np.random.Generator) -> None:
    """Numbers whose palette is their colour, and masks of one bit in JPEG 2000."""
    from pydicom.sr.codedict import codes
    from pydicom.uid import JPEG2000Lossless

    from splatgl.writers.segmentation import _stand_in

    numbers = rng.integers(0, 3, (3, 33, 35)).astype(np.uint8)
    stand_in = _stand_in(replace(labels, samples=numbers))
    lut = hd.PaletteColorLUTTransformation.from_colors(["black", "red", "blue"], palette_color_lut_uid=hd.UID())
    tissue, own = codes.SCT.Tissue, {"palette_color_lut_transformation": lut} if palette else {}
    data = hd.seg.Segmentation(
        [stand_in],
        hd.Volume(numbers, geometry(labels), "PATIENT", frame_of_reference_uid=stand_in.FrameOfReferenceUID),
        "LABELMAP" if palette else "BINARY",
        [hd.seg.SegmentDescription(n, f"s{n}", tissue, tissue, "MANUAL") for n in (1, 2)],
        *(hd.UID(), 1, hd.UID(), 1, "a", "b", "c", "d"),
        **(own or {"transfer_syntax_uid": JPEG2000Lossless}),
    )
    data.save_as(tmp_path / "a.dcm")
    read = sg.load(tmp_path / "a.dcm")
    assert np.array_equal(read.samples, numbers)
    assert [label.color for label in read.labels or ()] == (["#ff0000", "#0000ff"] if palette else [None, None])

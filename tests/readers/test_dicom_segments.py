"""Segmentations and contours of DICOM are labels where they lie, with their names and colours."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from splatgl.errors import InputError
from splatgl.readers import dicom_segments

pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
from tests.fuzz.seed_dicom import image, save
from tests.fuzz.seed_segments import (
    NAMES,
    SHAPE,
    STEP,
    circle,
    found_in,
    masks,
    palette_segmentation,
    segmentation,
    structures,
)

pytestmark = pytest.mark.usefixtures("shared_programs")


def places_of(mask: np.ndarray) -> np.ndarray:
    found = np.argwhere(mask)[:, ::-1] * [1.5, 2.0, STEP] + [10.0, 20.0, 0.0]
    return found[np.lexsort(found.T)]


@pytest.mark.parametrize("kind", ["BINARY", "FRACTIONAL", "LABELMAP"])
@pytest.mark.parametrize("overlap", [False, True])
def test_each_segment_lies_where_its_frames_do(kind: str, overlap: bool, tmp_path: Path) -> None:
    """In one volume of labels; in several channels if segments overlap, which labels of voxels can't."""
    of = masks(overlap and kind != "LABELMAP")
    volume = sg.load(segmentation(tmp_path / "seg.dcm", of, kind))
    found = found_in(volume)
    assert list(volume.labels or ()) == [
        Label(1, "Liver", "#80ae80"),
        Label(2, "Tumour", "#ff0000"),
        Label(3, "Vessel", None),
    ]
    for name, mask in zip(NAMES, of, strict=True):
        np.testing.assert_allclose(found[name], places_of(mask))
    assert len(volume.channels) == (2 if overlap and kind != "LABELMAP" else 0) and volume.frame == "LPS"
    assert any("half" in note for note in volume.notes) == (kind == "FRACTIONAL")
    if volume.channels:
        second = sg.load(tmp_path / "seg.dcm", channel=1)
        assert [label.name for label in second.labels or ()] == ["Tumour"] and not second.channels
        inside = sg.Volume(np.ones(SHAPE), (1.5, 2.0, STEP), (10, 20, 0), frame="LPS").masked(tmp_path / "seg.dcm")
        np.testing.assert_array_equal(inside.kept((0, 0, 0), SHAPE), of.any(axis=0))


def test_a_palette_is_the_colour_of_each_number(tmp_path: Path) -> None:
    volume = sg.load(palette_segmentation(tmp_path / "a.dcm"))
    assert [label.color for label in volume.labels or ()] == ["#80ae80", "#ff0000", "#000810"]
    np.testing.assert_allclose(found_in(volume)["Liver"], places_of(masks(False)[0]))


def test_segments_between_uneven_slices(tmp_path: Path) -> None:
    """Each slice is as thick as it says."""
    of = np.zeros((1, 4, 7, 7), bool)
    of[0, :, 2:4, 2:5] = True
    volume = sg.load(segmentation(tmp_path / "a.dcm", of, places=[0.0, 2.0, 5.0, 8.0], thick=3.0))
    assert np.asarray(volume.samples).any(axis=(1, 2)).all() and volume.spacing[2] == pytest.approx(2)
    of[0, 1:3] = False
    volume = sg.load(segmentation(tmp_path / "b.dcm", of))
    assert np.asarray(volume.samples).any(axis=(1, 2)).tolist() == [True, False, False, True]


def test_contours_fill_their_volume(tmp_path: Path) -> None:
    """Discs of polygons, of which inner ones are holes, and every other slice of a region stands for two."""
    area = 36 * np.sin(2 * np.pi / 72)
    planes = [3.0 * k for k in range(2, 10)]
    contours = [(1, "CLOSED_PLANAR", circle(20, z)) for z in planes]
    contours += [(2, "CLOSED_PLANAR", circle(radius, z, (55.0, 36.0))) for z in planes for radius in (20, 10)]
    contours += [(3, "CLOSED_PLANAR", circle(6, z, (0.0, -20.0))) for z in planes[::2]]
    contours += [(3, "POINT", np.array([[1.0, 2, 6]]))]
    volume = sg.load(structures(tmp_path / "rt.dcm", contours))
    sizes = {}
    for part in volume.channels:
        for label in part.labels or ():
            sizes[label.name] = float((np.asarray(part.samples) == label.number).sum() * np.prod(part.spacing))
    assert sizes["Liver"] == pytest.approx(area * 400 * 24, rel=0.01)
    assert sizes["Tumour"] == pytest.approx(area * 300 * 24, rel=0.01)
    assert sizes["Vessel"] == pytest.approx(area * 36 * 24, rel=0.03)
    assert [label.color for label in volume.labels or ()] == ["#ff8001", "#ff8002", "#ff8003"]
    places = found_in(volume)["Liver"]
    np.testing.assert_allclose(places.mean(axis=0), (40, 36, 16.5), atol=0.3)
    assert volume.notes[-1].startswith("1 contours are left out") and volume.frame == "LPS"


def test_contours_beside_points_only(tmp_path: Path) -> None:
    """A region of one point, as an isocentre, is left out; heights that rounding moves apart are one plane."""
    planes = [6.0049, 9.0, 12.0051]
    contours = [(1, "CLOSED_PLANAR", circle(20, z)) for z in planes] + [(2, "POINT", np.array([[1.0, 2, 6]]))]
    contours += [(3, "CLOSEDPLANAR_XOR", circle(r, z + 0.0004, (90.0, 36.0))) for z in planes for r in (20, 10)]
    volume = sg.load(structures(tmp_path / "rt.dcm", contours))
    assert volume.shape[0] == 3 and [label.name for label in volume.labels or ()] == [NAMES[0], NAMES[2]]
    sizes = np.bincount(np.asarray(volume.samples).ravel())[[1, 3]] * np.prod(volume.spacing)
    np.testing.assert_allclose(sizes, 36 * np.sin(2 * np.pi / 72) * 9 * np.array([400, 300]), rtol=0.01)


def test_a_point_far_away_takes_no_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Contours are filled in the box around each, not in all of a grid of 30 million voxels."""
    contours = [(n, "CLOSED_PLANAR", circle(6, z)) for n in (1, 2) for z in (0.0, 3.0, 6.0)]
    contours[3][2][5, 1] = 4e6
    path = structures(tmp_path / "rt.dcm", contours)
    started = time.process_time()
    volume = sg.load(path)
    assert volume.count > 1e7 and time.process_time() - started < 1
    monkeypatch.setattr(dicom_segments, "MOST_CROSSED", 1000)
    with pytest.raises(InputError, match="at most 1000 crossings of rows in a plane"):
        sg.load(path)


@pytest.mark.parametrize("degrees", [(90, 0), (0, 90), (20, -35)])
def test_contours_in_turned_planes(tmp_path: Path, degrees: tuple[float, float]) -> None:
    """Contours of sagittal, coronal and oblique slices fill the volume of the same ones in axial slices, turned."""
    (a, b), (c, d) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[a, 0, c], [0, 1, 0], [-c, 0, a]]) @ np.array([[1, 0, 0], [0, b, -d], [0, d, b]])
    contours = [(1, "CLOSED_PLANAR", circle(20, 3.0 * k) @ turn.T) for k in range(2, 8)]
    volume = sg.load(structures(tmp_path / "rt.dcm", contours))
    places = found_in(volume)["Liver"]
    np.testing.assert_allclose(places.mean(axis=0), turn @ (40, 36, 13.5), atol=0.1)
    size = len(places) * abs(np.linalg.det(volume.world_from_index))
    assert size == pytest.approx(36 * np.sin(2 * np.pi / 72) * 400 * 18, rel=0.01)


def test_segments_over_their_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A picture shows both segments of a voxel's column; files beside images in one folder are told."""
    (tmp_path / "ct").mkdir()
    for n in range(8):
        save(image(np.full((7, 7), 40, np.int16), STEP * n), tmp_path / "ct" / f"{n}.dcm")
    seg = segmentation(tmp_path / "seg.dcm", masks())
    options = ["--size", "24", "-o", str(tmp_path / "a.png"), "--points=100:0,200:1"]
    assert main(["render", str(tmp_path / "ct"), "--labels", str(seg), *options]) == 0
    assert "splats" in capsys.readouterr().out
    found = {}
    for names in ("1", "2", "3"):
        assert main(["render", str(seg), "--only-labels", names, "--size", "24", "-o", str(tmp_path / "a.npy")]) == 0
        pixels = np.load(tmp_path / "a.npy")
        found[names] = pixels[pixels[..., 3] > 0.5][:, :3].mean(axis=0)
    red, green, _ = found["2"]
    assert red > 5 * green and found["1"][1] > found["1"][0]
    seg.rename(tmp_path / "ct" / "seg.dcm")
    (note,) = sg.load(tmp_path / "ct").notes
    assert note == "segmentations in 1 files (SEG) next to the images are not rendered; --labels FILE adds one"
    with pytest.raises(InputError, match="channel: expected no value for images"):
        sg.load(tmp_path / "ct", channel=0)


def test_what_is_no_segmentation_is_told(tmp_path: Path) -> None:
    path = segmentation(tmp_path / "a.dcm", masks())
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(InputError, match="pixels: expected 56 bytes"):
        sg.load(path)
    far = segmentation(tmp_path / "b.dcm", masks(), places=[0, 3, 6, 9, 12, 15, 18, 1e6])
    with pytest.raises(InputError, match="slices within 4096 planes"):
        sg.load(far)
    empty = structures(tmp_path / "c.dcm", [(1, "OPEN_PLANAR", circle(3, 0))])
    with pytest.raises(InputError, match="closed contours, got points or open contours only"):
        sg.load(empty)
    segmentation(tmp_path / "d.dcm", masks())
    for name in ("b.dcm", "c.dcm"):
        (tmp_path / name).unlink()
    with pytest.raises(InputError, match=r"expected one segmentation, got 2: a\.dcm, d\.dcm"):
        sg.load(tmp_path)

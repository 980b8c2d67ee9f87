"""DICOM: frames that are moments, views or stacks of one file, and pixels in unusual bits and bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.errors import InputError
from splatgl.readers import list_volumes

pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
from pydicom.dataset import Dataset

from tests.fuzz.seed_dicom import enhanced, image, save
from tests.helpers.dicom import HU, written

CLASSES = "1.2.840.10008.5.1.4.1.1."
BYTES = (HU % 200).astype(np.uint8)


def item(**tags: object) -> Any:
    """A data set of these tags."""
    made = Dataset()
    for name, value in tags.items():
        setattr(made, name, value)
    return made


def without_position(array: np.ndarray, modality: str, sop: str, **tags: object) -> Any:
    """Frames that have no position."""
    data = image(array, Modality=modality, SOPClassUID=CLASSES + sop, **tags)
    del data.ImagePositionPatient, data.ImageOrientationPatient
    return data


TIMED = {
    "ultrasound": ("US", "3.1", {"FrameTime": "40"}),
    "angiography": ("XA", "12.1", {"FrameTimeVector": [0, 40, 30, 50, 40, 40]}),
    "by its rate": ("RF", "12.2", {"CineRate": 25}),
    "by its pointer": ("OT", "7.2", {"FrameIncrementPointer": 0x00181063, "FrameTime": "40"}),
    "nuclear": (
        "NM",
        "20",
        {
            "ImageType": ["ORIGINAL", "PRIMARY", "DYNAMIC"],
            "PhaseInformationSequence": [item(ActualFrameDuration=40)],
        },
    ),
}


@pytest.mark.parametrize("kind", TIMED)
def test_a_film_is_a_series_of_planes(tmp_path: Path, kind: str) -> None:
    """One voxel thick; the frames are time points, with their seconds."""
    modality, sop, tags = TIMED[kind]
    save(without_position(BYTES, modality, sop, **tags), tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm", time=4)
    np.testing.assert_array_equal(volume.samples, BYTES[4:5])
    assert (volume.times, volume.spacing) == (6, (1.5, 2.0, 1.5)) and volume.time_step == pytest.approx(0.04)
    assert "6 time points" in sg.load(tmp_path / "a.dcm").notes[0]


def test_films_of_a_series_are_told_apart(tmp_path: Path) -> None:
    """The largest is read; a colour film keeps its colours."""
    save(without_position(BYTES, "US", "3.1", FrameTime="40"), tmp_path / "a.dcm")
    colors = np.random.default_rng(1).integers(0, 255, (8, 9, 11, 3)).astype(np.uint8)
    data = without_position(colors[0], "US", "3.1", NumberOfFrames=8)
    data.PixelData = colors.tobytes()
    save(data, tmp_path / "b.dcm")
    volume = sg.load(tmp_path, time=5)
    assert volume.color is not None and volume.times == 8 and volume.time_step is None
    np.testing.assert_array_equal(volume.color[0], colors[5])
    assert list_volumes(tmp_path)[1:] == ["  1: US, 6 × 11 × 9, a.dcm", "  2: US, 8 × 11 × 9, b.dcm"]
    np.testing.assert_array_equal(sg.load(tmp_path, series=1, time=2).samples, BYTES[2:3])


def test_views_of_nuclear_medicine_are_no_slices(tmp_path: Path) -> None:
    """Views of a static image are picked by number, frames of a gated tomogram by slice and time slot."""
    save(without_position(BYTES, "NM", "20", ImageType=["ORIGINAL", "PRIMARY", "STATIC"]), tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm", array=3)
    np.testing.assert_array_equal(volume.samples, BYTES[3:4])
    gated = {"SliceVector": [1, 2, 3] * 2, "TimeSlotVector": [1, 1, 1, 2, 2, 2]}
    save(
        without_position(BYTES, "NM", "20", ImageType=["ORIGINAL", "PRIMARY", "RECON GATED TOMO"], **gated),
        tmp_path / "b.dcm",
    )
    volume = sg.load(tmp_path / "b.dcm", time=1)
    np.testing.assert_array_equal(volume.samples, BYTES[3:])
    assert (volume.times, volume.spacing[2]) == (2, 3.0)


@pytest.mark.parametrize("kind", ["turned", "beside", "above"])
def test_stacks_of_a_file_are_picked(tmp_path: Path, kind: str) -> None:
    """Enhanced files number their stacks: they are listed as series."""
    data = enhanced((HU[:5] // 2).astype(np.int16))
    for n, group in enumerate(data.PerFrameFunctionalGroupsSequence):
        second, place = n >= 3, n % 3
        group.FrameContentSequence = [item(StackID=str(1 + second))]
        where = {"turned": [1, 3.0 * place, 9], "beside": [1, 52, 3.0 * place], "above": [1, 2, 300 + 3.0 * place]}
        group.PlanePositionSequence = [item(ImagePositionPatient=where[kind] if second else [1, 2, 3.0 * place])]
        turned = second and kind == "turned"
        group.PlaneOrientationSequence = [item(ImageOrientationPatient=[1, 0, 0, 0, *((0, -1) if turned else (1, 0))])]
    save(data, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm")
    assert volume.shape[0] == 3 and volume.notes[0].startswith("series 1 of 2 (stack 1) is read")
    other = sg.load(tmp_path / "a.dcm", series=2)
    np.testing.assert_array_equal(other.samples, HU[3:5] // 2 * 2 - 7)
    assert other.origin == pytest.approx({"turned": (1, 0, 9), "beside": (1, 52, 0), "above": (1, 2, 300)}[kind])


def test_a_series_of_two_orientations(tmp_path: Path) -> None:
    """Files of one series in two planes are two stacks; the UID alone means the larger one."""
    written(tmp_path, HU[:4])
    for n in range(2):
        place = [0.0, 5.0 * n, 0.0]
        data = image(HU[n], ImagePositionPatient=place, ImageOrientationPatient=[1, 0, 0, 0, 0, -1])
        save(data, tmp_path / f"coronal{n}.dcm")
    assert sg.load(tmp_path, series="1.2.3").shape[0] == 4
    coronal = sg.load(tmp_path, series=2)
    assert coronal.shape[0] == 2 and coronal.spacing[2] == 5.0


def test_a_volume_of_ultrasound_has_a_frame_of_its_own(tmp_path: Path) -> None:
    """Its slices lie in the transducer's frame, not in the patient's."""
    data = enhanced(BYTES)
    data.SOPClassUID, data.Modality = CLASSES + "6.2", "US"
    shared = data.SharedFunctionalGroupsSequence[0]
    shared.PlaneOrientationVolumeSequence = [item(ImageOrientationVolume=[1, 0, 0, 0, 1, 0])]
    del shared.PlaneOrientationSequence, shared.PixelValueTransformationSequence
    for n, group in enumerate(data.PerFrameFunctionalGroupsSequence):
        group.PlanePositionVolumeSequence = [item(ImagePositionVolume=[7, 8, 0.5 * (5 - n)])]
        del group.PlanePositionSequence
    save(data, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm")
    np.testing.assert_array_equal(volume.samples, BYTES[::-1])
    assert (volume.spacing, volume.origin, volume.frame) == ((1.5, 2.0, 0.5), (7, 8, 0), None)


def test_sizes_of_pixels_of_other_images(tmp_path: Path) -> None:
    """Ultrasound states them by region, scanned films by their nominal size."""
    data = without_position(BYTES[0], "US", "6.1")
    del data.PixelSpacing
    regions = [
        item(PhysicalUnitsXDirection=4, PhysicalUnitsYDirection=3, PhysicalDeltaX=1.0, PhysicalDeltaY=1.0),
        item(PhysicalUnitsXDirection=3, PhysicalUnitsYDirection=3, PhysicalDeltaX=0.02, PhysicalDeltaY=-0.03),
    ]
    data.SequenceOfUltrasoundRegions = regions
    save(data, tmp_path / "a.dcm")
    assert sg.load(tmp_path / "a.dcm").spacing[:2] == pytest.approx((0.2, 0.3))
    data = image(BYTES[0], NominalScannedPixelSpacing=[0.5, 0.25])
    del data.PixelSpacing
    save(data, tmp_path / "b.dcm")
    assert sg.load(tmp_path / "b.dcm").spacing[:2] == (0.25, 0.5)


def test_a_slide_is_refused(tmp_path: Path) -> None:
    save(without_position(BYTES, "SM", "77.1.6"), tmp_path / "a.dcm")
    with pytest.raises(InputError, match="tiles of a slide"):
        sg.load(tmp_path / "a.dcm")


def test_bits_above_others_and_bytes_in_words(tmp_path: Path) -> None:
    """Old files keep 12 bits at the top of 16, and bytes in big-endian words."""
    from pydicom.uid import ExplicitVRBigEndian

    stored = ((HU.astype(np.int32) + 1000) << 4).astype(np.uint16) | 5
    save(image(stored, BitsStored=12, HighBit=15, RescaleIntercept=-1000), tmp_path / "a.dcm")
    np.testing.assert_array_equal(sg.load(tmp_path / "a.dcm").samples, HU)
    # frames of an odd number of bytes
    data = image(BYTES)
    data.file_meta.TransferSyntaxUID = ExplicitVRBigEndian
    data["PixelData"].VR = "OW"
    data.PixelData = np.frombuffer(BYTES.tobytes(), np.uint16).byteswap().tobytes()
    save(data, tmp_path / "b.dcm")
    np.testing.assert_array_equal(sg.load(tmp_path / "b.dcm").samples, BYTES)


def test_frames_that_share_their_chroma(tmp_path: Path) -> None:
    """Of every frame, not only of the first one, two pixels share theirs."""
    luma = (np.arange(3 * 4 * 6) * 3 % 200 + 20).astype(np.uint8).reshape(3, 4, 6)
    data = image(luma, SamplesPerPixel=3, PhotometricInterpretation="YBR_FULL_422", PlanarConfiguration=0)
    grey = np.full((3, 4, 3, 4), 128, np.uint8)
    grey[..., :2] = luma.reshape(3, 4, 3, 2)
    data.PixelData = grey.tobytes()
    save(data, tmp_path / "a.dcm")
    assert np.abs(sg.load(tmp_path / "a.dcm").samples.astype(int) - luma).max() <= 1


def test_times_run_across_midnight(tmp_path: Path) -> None:
    """By the date of the acquisition, where the file has one."""
    moments = (("20240229", "235958"), ("20240229", "235959.5"), ("20240301", "000001"))
    for number, (day, time) in enumerate(moments):
        tags = {"AcquisitionDate": day, "AcquisitionTime": time, "InstanceNumber": 9 - number}
        written(tmp_path / f"{number}", HU + number, Modality="MR", **tags)
    volume = sg.load(tmp_path, time=2)
    np.testing.assert_array_equal(volume.samples, HU + 2)
    assert volume.times == 3 and volume.time_step == pytest.approx(1.5)


def test_times_of_enhanced_frames(tmp_path: Path) -> None:
    """Their dates and times give the seconds between time points."""
    data = enhanced(BYTES)
    for n, group in enumerate(data.PerFrameFunctionalGroupsSequence):
        group.PlanePositionSequence[0].ImagePositionPatient = [1, 2, 3.0 * (n % 3)]
        group.FrameContentSequence = [
            item(TemporalPositionIndex=n // 3 + 1, FrameReferenceDateTime=f"2024022923595{8 + n // 3}.5+0100")
        ]
    save(data, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm", time=1)
    np.testing.assert_array_equal(volume.samples, BYTES[3:] * 2.0 - 7)
    assert volume.times == 2 and volume.time_step == pytest.approx(1.0)


def test_a_parametric_map_has_the_values_of_its_mapping(tmp_path: Path) -> None:
    """Stored numbers mean nothing; other images keep theirs, and a note says so."""
    mapping = item(RealWorldValueSlope=0.5, RealWorldValueIntercept=-3.0)
    mapping.MeasurementUnitsCodeSequence = [item(CodeValue="mm2/s", CodingSchemeDesignator="UCUM")]
    data = enhanced(BYTES)
    shared = data.SharedFunctionalGroupsSequence[0]
    shared.RealWorldValueMappingSequence = [mapping]
    save(data, tmp_path / "a.dcm")
    assert any("real-world" in note for note in sg.load(tmp_path / "a.dcm").notes)
    data.SOPClassUID = CLASSES + "30"
    save(data, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm")
    np.testing.assert_array_equal(volume.samples, BYTES * 0.5 - 3)
    assert (volume.value_unit, volume.notes) == ("mm2/s", ())


@pytest.mark.parametrize("photometric", ["MONOCHROME1", "MONOCHROME2"])
def test_frames_of_one_bit(photometric: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """Of 35 bits each, so that they begin at any bit of a byte; of MONOCHROME1 zero is bright."""
    masks = rng.integers(0, 2, (9, 5, 7)).astype(np.uint8)
    data = image(masks, BitsAllocated=1, BitsStored=1, HighBit=0, PhotometricInterpretation=photometric)
    data.PixelData = np.packbits(masks.ravel(), bitorder="little").tobytes()
    save(data, tmp_path / "a.dcm")
    samples = np.asarray(sg.load(tmp_path / "a.dcm").samples)
    assert np.array_equal(samples, 1 - masks if photometric == "MONOCHROME1" else masks)

"""DICOM's values and times: SUV of PET, dose, b-values, time points; files without ending and tables of contents."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.readers.dicom_vendors import CSA, csa_numbers
from splatgl.transfer.presets import default_transfer

pydicom = pytest.importorskip("pydicom")
from tests.fuzz.seed_dicom import csa, image, mosaic_image, save  # noqa: E402
from tests.helpers.dicom import written  # noqa: E402

PLANE = (np.arange(20).reshape(4, 5) * 7).astype(np.int16)
HOURS = {"SeriesDate": "20240102", "SeriesTime": "110000", "AcquisitionDate": "20240102", "AcquisitionTime": "110000"}


def pet(folder: Path, item: dict[str, object] | None = None, **tags: object) -> Path:
    """Three slices in Bq/ml, 3662.79 s (half a half-life of F-18 is 3293) after an injection of 300 MBq in 75 kg."""
    folder.mkdir(exist_ok=True)
    drug = pydicom.Dataset()
    told = {"RadionuclideTotalDose": 3e8, "RadionuclideHalfLife": 6586.2, "RadiopharmaceuticalStartTime": "100000.00"}
    for name, value in (told | (item or {})).items():
        if value is not None:
            setattr(drug, name, value)
    about = {"Modality": "PT", "Units": "BQML", "DecayCorrection": "START", "PatientWeight": 75, **HOURS}
    about |= {"CorrectedImage": ["ATTN", "DECY"], "RescaleSlope": 2.5, "RescaleIntercept": 0}
    for n in range(3):
        data = image(PLANE + n, 3.0 * n, **{name: value for name, value in (about | tags).items() if value is not None})
        data.RadiopharmaceuticalInformationSequence = [drug]
        save(data, folder / f"{n}.dcm")
    return folder


def test_pet_is_in_suv_by_body_weight(tmp_path: Path) -> None:
    volume = sg.load(pet(tmp_path / "a"))
    dose = 3e8 * 2 ** (-3600 / 6586.2)
    right = np.stack([PLANE + n for n in range(3)]) * 2.5 * 75_000 / dose
    np.testing.assert_allclose(volume.samples, right, rtol=1e-6)
    assert volume.value_unit == "SUV"
    assert volume.notes == ("values are SUV by body weight, from Bq/ml by the header's weight, dose and decay",)
    stated = {"RadiopharmaceuticalStartTime": None, "RadiopharmaceuticalStartDateTime": "20240102100000.00"}
    np.testing.assert_allclose(sg.load(pet(tmp_path / "b", stated)).samples, right, rtol=1e-6)
    night = {"SeriesTime": "003000", "AcquisitionTime": "003000"}
    early = sg.load(pet(tmp_path / "c", {"RadiopharmaceuticalStartTime": "233000"}, **night))
    np.testing.assert_allclose(early.samples, right, rtol=1e-6)
    injected = sg.load(pet(tmp_path / "d", DecayCorrection="ADMIN"))
    np.testing.assert_allclose(injected.samples, right * dose / 3e8, rtol=1e-6)
    gml = sg.load(pet(tmp_path / "e", Units="GML", PatientWeight=None))
    np.testing.assert_allclose(gml.samples[0], PLANE * 2.5)
    assert gml.value_unit == "SUV"


def test_vendors_factors_from_counts(tmp_path: Path) -> None:
    folder = pet(tmp_path / "a", Units="CNTS")
    assert "not SUV: the header has no factor to Bq/ml" in sg.load(folder).notes[0]
    for path in folder.iterdir():
        data = pydicom.dcmread(path)
        data.private_block(0x7053, "Philips PET Private Group", create=True).add_new(0x00, "DS", "0.02")
        save(data, path)
    np.testing.assert_allclose(sg.load(folder).samples[0], PLANE * 2.5 * 0.02, rtol=1e-6)


@pytest.mark.parametrize(
    ("tags", "item", "reason"),
    [
        ({"PatientWeight": None}, {}, "the header has no weight"),
        ({}, {"RadionuclideTotalDose": None}, "the header has no dose"),
        ({}, {"RadionuclideTotalDose": 300}, "a dose of 300 is not in Bq"),
        ({}, {"RadionuclideHalfLife": None}, "the header has no half-life"),
        ({"DecayCorrection": "NONE"}, {}, "DecayCorrection is NONE"),
        ({"CorrectedImage": ["DECY"]}, {}, "not corrected for attenuation and decay"),
        ({"SeriesTime": "120000"}, {}, "the times of injection and scan do not fit"),
        ({"Units": "PROPCNTS"}, {}, "values are in PROPCNTS, not SUV"),
    ],
)
def test_a_header_that_permits_no_suv_is_told(
    tmp_path: Path, tags: dict[str, object], item: dict[str, object], reason: str
) -> None:
    volume = sg.load(pet(tmp_path / "a", item, **tags))
    assert reason in volume.notes[0] and volume.value_unit != "SUV"
    np.testing.assert_allclose(volume.samples[0], PLANE * 2.5)


def repeated(folder: Path, numbers: list[dict[str, Any]]) -> Path:
    """Two slices for each entry, which has tags."""
    folder.mkdir()
    for n, tags in enumerate(numbers):
        for z in range(2):
            save(image(PLANE + n, 3.0 * z, InstanceNumber=n * 2 + z, **tags), folder / f"{n}-{z}.dcm")
    return folder


def test_dynamic_series_have_times(tmp_path: Path) -> None:
    clock = [{"AcquisitionTime": f"1059{30 + n * 20:02d}" if n < 2 else f"1100{n * 20 - 30:02d}"} for n in range(3)]
    for tags in (
        clock,
        [{"FrameReferenceTime": 20000 * n} for n in range(3)],
        [{"TriggerTime": 20000 * n} for n in range(3)],
    ):
        folder = repeated(tmp_path / next(iter(tags[0])), tags)
        volume = sg.load(folder, time=2)
        assert (volume.times, volume.time_step, volume.notes) == (3, 20, ()) and (volume.samples[0] == PLANE + 2).all()


def test_b_values_are_listed(tmp_path: Path) -> None:
    volume = sg.load(repeated(tmp_path / "a", [{"DiffusionBValue": b} for b in (0.0, 500.0, 1000.0)]))
    assert volume.notes == ("3 b-values at each position (0, 500, 1000): number 0 is read; array=N picks another",)
    assert volume.times == 1
    folder = repeated(tmp_path / "b", [{}, {}])
    for path in folder.iterdir():
        data = pydicom.dcmread(path)
        data.private_block(0x0019, "SIEMENS MR HEADER", create=True).add_new(
            0x0C, "IS", 1000 - 1000 * int(path.name[0])
        )
        save(data, path)
    assert "2 b-values at each position (0, 1000)" in sg.load(folder).notes[0]
    assert (sg.load(folder, array=1).samples[0] == PLANE).all()


def test_a_dose_is_in_gray(tmp_path: Path) -> None:
    dose = image(np.stack([PLANE, PLANE + 1]).astype(np.uint16), 0, Modality="RTDOSE", DoseUnits="GY")
    dose.NumberOfFrames, dose.DoseGridScaling, dose.GridFrameOffsetVector = 2, 0.5, [0.0, 3.0]
    save(dose, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm")
    np.testing.assert_allclose(volume.samples, np.stack([PLANE, PLANE + 1]) * 0.5)
    assert (volume.value_unit, volume.quantity, volume.spacing[2]) == ("Gy", "dose", 3)


def test_looks_of_uptake_and_dose(tmp_path: Path) -> None:
    """Uptake is hot metal up to SUV 10, or to the brightest value in other units; a dose spans 0 to its maximum."""
    hot = sg.load(pet(tmp_path / "a", RescaleSlope=1e4)).hints
    assert hot.window == (0, 10) and hot.colormap == "hot" and hot.points is not None and hot.points[-1][0] == 10
    plain = sg.load(pet(tmp_path / "b", PatientWeight=None))
    assert plain.hints.window is not None and 0.9 < plain.hints.window[1] / plain.samples.max() <= 1
    dose = image(np.stack([PLANE, PLANE + 1]).astype(np.uint16), 0, Modality="RTDOSE", DoseUnits="GY")
    dose.NumberOfFrames, dose.DoseGridScaling, dose.GridFrameOffsetVector = 2, 0.5, [0.0, 3.0]
    save(dose, tmp_path / "a.dcm")
    transfer = default_transfer(sg.load(tmp_path / "a.dcm"))
    assert transfer.window == (0, 67) and transfer.colormap == "spectrum" and not transfer.shading
    np.testing.assert_array_equal(transfer.opacity(np.array([0.0, 6.7, 67.0])), [0, 0, 0.3])
    assert sg.load(written(tmp_path / "ct")).hints == sg.Volume(np.zeros((1, 1, 1))).hints


AXES = np.linalg.qr(np.array([[1.0, 0.2, -0.1], [0.1, 1.0, 0.3], [0.2, -0.1, 1.0]]))[0]


def mosaic(path: Path, stated: dict[str, Any], add: int = 0, **tags: object) -> np.ndarray:
    """Writes a mosaic of five slices [5, 4, 6] and returns them. stated: of `mosaic_image`."""
    slices = np.random.default_rng(3).integers(1, 900, (5, 4, 6)).astype(np.uint16) + np.uint16(add)
    tags |= {"ImageOrientationPatient": AXES[:, :2].T.ravel().tolist(), "SpacingBetweenSlices": 3.6}
    save(mosaic_image(slices, stated, **tags), path)
    return slices


@pytest.mark.parametrize("sign", [1, -1])
def test_a_mosaic_is_split_as_nibabel_does(tmp_path: Path, sign: int) -> None:
    wrappers = pytest.importorskip("nibabel.nicom.dicomwrappers")
    normal = tuple((sign * np.cross(*AXES[:, :2].T)).tolist())
    header = csa(AcquisitionMatrixText=("4p*6",), NumberOfImagesInMosaic=(5,), SliceNormalVector=normal)
    slices = mosaic(tmp_path / "a.dcm", {"csa": header})
    volume = sg.load(tmp_path / "a.dcm")
    theirs = wrappers.wrapper_from_file(tmp_path / "a.dcm")
    # the slices in the order of the file, which nibabel's index has last; its first index is down
    ours = volume.samples if sign > 0 else volume.samples[::-1]
    np.testing.assert_array_equal(ours, slices)
    np.testing.assert_array_equal(ours, theirs.get_data().transpose(2, 0, 1))
    for index in [(0, 0, 0), (5, 3, 4), (2, 1, 1)]:
        x, y, z = index
        place = volume.world_from_index @ (x, y, z if sign > 0 else 4 - z) + volume.origin
        # nibabel's affine is in LPS, as DICOM
        np.testing.assert_allclose(place, theirs.affine[:3] @ (y, x, z, 1), atol=1e-5)
    assert volume.notes == ("a mosaic is split into 5 slices of 6 × 4",)


def test_a_scanners_header_as_nibabel_reads_it() -> None:
    nicom = pytest.importorskip("nibabel.nicom.csareader")
    path = Path(nicom.__file__).parent / "tests" / "data" / "csa2_b1000.bin"
    if not path.exists():
        pytest.skip("nibabel comes without its test data")
    tags = {CSA: SimpleNamespace(value=path.read_bytes())}
    entries = nicom.read(path.read_bytes())["tags"]
    for name in ("NumberOfImagesInMosaic", "SliceNormalVector", "B_value", "B_matrix"):
        assert list(csa_numbers(tags, name)) == entries[name]["items"][:3] != []
    assert csa_numbers(tags, "AcquisitionMatrixText") == csa_numbers({}, "B_value") == ()


@pytest.mark.parametrize("layout", [(1, 3), (0, 3), (1, 4), (0, 4)])
def test_mosaics_of_the_first_version(layout: tuple[int, int], tmp_path: Path) -> None:
    """Of scanners before 2004: marks tell which description a header follows, and a damaged one has no numbers."""
    about: dict[str, Any] = {"NumberOfImagesInMosaic": (5,), "SliceNormalVector": (0.0, 0.0, -1.0)}
    header = csa(1, *layout, AcquisitionMatrixText=("4p*6",), **about, B_value=("",))
    slices = mosaic(tmp_path / "a.dcm", {"csa": header})
    np.testing.assert_array_equal(sg.load(tmp_path / "a.dcm").samples, slices[::-1])
    tags = {CSA: SimpleNamespace(value=header)}
    assert csa_numbers(tags, "SliceNormalVector") == (0.0, 0.0, -1.0) and csa_numbers(tags, "B_value") == ()
    for damaged in (header[:-1000], header[:200] + header[201:], bytes(400), header.replace(b"M\0\0\0", bytes(4))):
        assert csa_numbers({CSA: SimpleNamespace(value=damaged)}, "NumberOfImagesInMosaic") == ()


def test_mosaics_by_private_tags_and_in_time(tmp_path: Path) -> None:
    slices = mosaic(tmp_path / "a.dcm", {"count": 5})
    volume = sg.load(tmp_path / "a.dcm")
    np.testing.assert_array_equal(volume.samples, slices)
    assert "order of its slices is not stated" in volume.notes[0] and volume.spacing == pytest.approx((1.5, 2, 3.6))
    mosaic(tmp_path / "b.dcm", {"matrix": "4p*6s"})
    volume = sg.load(tmp_path / "b.dcm")
    np.testing.assert_array_equal(volume.samples[:5], slices)
    assert volume.shape == (9, 4, 6) and "number of its slices is not stated" in volume.notes[0]
    mosaic(tmp_path / "c.dcm", {})
    assert sg.load(tmp_path / "c.dcm").notes[0].startswith("a mosaic is rendered as one image")
    (tmp_path / "times").mkdir()
    for n in range(3):
        mosaic(tmp_path / "times" / f"{n}.dcm", {"count": 5}, 10 * n, AcquisitionNumber=n + 1, InstanceNumber=n + 1)
    third = sg.load(tmp_path / "times", time=2)
    np.testing.assert_array_equal(third.samples, slices + 20)
    assert third.times == 3


def test_a_table_of_contents_leads_to_its_files(tmp_path: Path) -> None:
    from pydicom.fileset import FileSet

    files = FileSet()
    for n in range(3):
        data = image(PLANE + n, 3.0 * n, PatientID="1", PatientName="A", StudyInstanceUID="1.2.5", StudyID="1")
        data.StudyDate, data.StudyTime, data.SeriesNumber, data.InstanceNumber = "20240102", "100000", 1, n + 1
        data.SOPInstanceUID = data.file_meta.MediaStorageSOPInstanceUID = f"1.2.6.{n + 1}"
        files.add(data)
    files.write(tmp_path / "disc")
    save(image(PLANE + 9, 9.0), tmp_path / "disc" / "other.dcm")
    volume = sg.load(tmp_path / "disc" / "DICOMDIR")
    np.testing.assert_array_equal(volume.samples, np.stack([PLANE + n for n in range(3)]))


@pytest.mark.parametrize("implicit", [True, False])
def test_files_without_preamble_and_ending(tmp_path: Path, implicit: bool) -> None:
    for n in range(3):
        data = image(PLANE + n, 3.0 * n)
        data.ImageType = ["ORIGINAL", "PRIMARY"]
        bare = pydicom.Dataset({element.tag: element for element in data if element.tag.group > 2})
        bare.save_as(tmp_path / f"IM{n}", implicit_vr=implicit, little_endian=True)
    assert sg.load(tmp_path).shape == (3, 4, 5) and sg.load(tmp_path / "IM1").shape == (1, 4, 5)

"""DICOM: series of slices and multi-frame files, written by pydicom, become the volumes that their headers describe."""

from __future__ import annotations

import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.readers import list_volumes

pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
from tests.fuzz.seed_dicom import enhanced, image, packed_image, save
from tests.helpers.dicom import HU, written

pytestmark = pytest.mark.usefixtures("shared_programs")

# a tilted patient: rows along (0.8, 0.6, 0), columns along z
ROWS, COLUMNS = (0.8, 0.6, 0.0), (0.0, 0.0, -1.0)
NORMAL = np.cross(ROWS, COLUMNS)


def test_slices_are_sorted_by_position(tmp_path: Path) -> None:
    """Whatever their names, numbers and folders are; other files don't matter."""
    for n, plane in enumerate(HU):
        place = (np.array([10.0, -20, 30]) + 2.5 * n * NORMAL).tolist()
        data = image(plane, ImagePositionPatient=place, ImageOrientationPatient=[*ROWS, *COLUMNS], InstanceNumber=9 - n)
        folder = tmp_path / "study" / f"disc{n % 2}"
        folder.mkdir(parents=True, exist_ok=True)
        save(data, folder / ("IM0" if n < 2 else f"{(n * 5) % 7}.IMA"))
    (tmp_path / "study" / "notes.txt").write_text("none of it")
    (tmp_path / "study" / "preview.dcm").write_bytes(b"\x89PNG\r\n" + bytes(200))
    volume = sg.load(tmp_path / "study")
    np.testing.assert_array_equal(volume.samples, HU)
    np.testing.assert_allclose(volume.world_from_index, np.column_stack([ROWS, COLUMNS, NORMAL]) * [1.5, 2.0, 2.5])
    np.testing.assert_allclose(volume.origin, [10, -20, 30], atol=1e-9)
    assert (volume.frame, volume.unit, volume.name, volume.notes) == ("LPS", "mm", "study", ())
    assert volume.samples.dtype == np.int16


def test_one_slice_tells_of_its_folder(tmp_path: Path) -> None:
    folder = written(tmp_path / "ct")
    files = sorted(folder.iterdir())
    told = f"one slice; its folder has {len(files) - 1} more such files: give the folder for all slices of the series"
    assert sg.load(files[0]).notes == (told,) and sg.load(folder).notes == ()
    alone = tmp_path / "alone.dcm"
    files[0].rename(alone)
    assert sg.load(alone).notes == ()


def test_units_of_values(tmp_path: Path) -> None:
    """Hounsfield's of a CT, unless the file says otherwise."""
    assert sg.load(written(tmp_path / "a", Modality="CT")).value_unit == "HU"
    assert sg.load(written(tmp_path / "b", Modality="CT", RescaleType="US")).value_unit == ""
    assert sg.load(written(tmp_path / "c", Modality="MR")).value_unit == ""
    assert sg.load(written(tmp_path / "d", Modality="PT", Units="BQML")).value_unit == "Bq/ml"


def test_tilted_gantry_shears_the_grid(tmp_path: Path) -> None:
    """Each voxel lies where ImagePositionPatient puts it: positions move along the columns, too."""
    slope = np.tan(np.radians(15.0))
    places = [[1.0, 2.0 + 3.0 * n * slope, 3.0 * n] for n in range(6)]
    (tmp_path / "ct").mkdir()
    for n, plane in enumerate(HU):
        save(image(plane, n * 3.0, ImagePositionPatient=places[n]), tmp_path / "ct" / f"{n}")
    volume = sg.load(tmp_path / "ct")
    np.testing.assert_array_equal(volume.samples, HU)
    for n, place in enumerate(places):
        there = volume.world_from_index @ [4, 5, n] + volume.origin
        np.testing.assert_allclose(there, np.add(place, [4 * 1.5, 5 * 2.0, 0]), atol=1e-9)
    assert abs(volume.direction[:, 1] @ volume.direction[:, 2]) > 0.25 and volume.notes == ()


@pytest.mark.parametrize("kind", ["zip", "classic", "enhanced", "implicit", "big-endian", "without preamble"])
def test_other_files(tmp_path: Path, kind: str) -> None:
    """A zip, frames in one file, and other encodings hold the same volume."""
    from pydicom.uid import ExplicitVRBigEndian, ImplicitVRLittleEndian

    path = tmp_path / ("ct.zip" if kind == "zip" else "ct.dcm")
    if kind == "zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for file in written(tmp_path / "slices", step=3.0).iterdir():
                archive.write(file, f"deep/{file.name}")
            archive.writestr("readme.txt", "text")
    elif kind == "enhanced":
        data = enhanced((HU + 7).astype(np.int16))
        data.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence[0].RescaleSlope = 1
        save(data, path)
    else:
        data = image(HU)
        if kind == "implicit":
            data.file_meta.TransferSyntaxUID = ImplicitVRLittleEndian
        if kind == "big-endian":
            data.file_meta.TransferSyntaxUID = ExplicitVRBigEndian
            data.PixelData = HU.astype(">i2").tobytes()
        save(data, path)
    if kind == "without preamble":
        whole = path.read_bytes()
        path.write_bytes(whole[whole.index(b"\x08\x00\x16\x00UI") :])
    volume = sg.load(path)
    np.testing.assert_array_equal(volume.samples, HU)
    assert volume.samples.dtype == np.int16 and volume.spacing == pytest.approx((1.5, 2.0, 3.0))
    assert volume.origin == pytest.approx((1.0, 2.0, 0.0)) and volume.name == "ct"


@pytest.mark.parametrize("codec", ["rle", "j2k", "lossless", "ls", "jpeg"])
def test_compressed(tmp_path: Path, codec: str) -> None:
    pytest.importorskip("openjpeg" if codec == "j2k" else "libjpeg", reason="decodes; it is in the extra dicom")
    pytest.importorskip("imagecodecs", reason="writes JPEG; it is in the extra readers")
    y, x = np.mgrid[:40, :48]
    planes = (100 + 50 * np.sin(x / 9 + np.arange(3)[:, None, None]) + y / 2).astype(np.uint8)
    planes = planes if codec == "jpeg" else planes.astype(np.uint16) * 200
    save(packed_image(planes, codec), tmp_path / "a.dcm")
    found = sg.load(tmp_path / "a.dcm").samples
    assert found.shape == planes.shape and found.dtype == planes.dtype
    np.testing.assert_allclose(found.astype(int), planes.astype(int), atol=3 if codec == "jpeg" else 0)


# --- series -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Three series: one of a single large picture, the largest, and a smaller one whose pixels are cut off."""
    scout = np.zeros((60, 60), np.int16)
    written(tmp_path / "study", scout[None], SeriesInstanceUID="1.2.77", SeriesNumber=1, SeriesDescription="scout")
    written(tmp_path / "study" / "b", HU, SeriesInstanceUID="1.2.88", SeriesNumber=2, SeriesDescription="thin B30")
    written(tmp_path / "study" / "c", HU[:2], SeriesInstanceUID="1.2.188", SeriesNumber=3, Modality="MR")
    for file in (tmp_path / "study" / "c").iterdir():
        file.write_bytes(file.read_bytes()[:-50])
    return tmp_path / "study"


def test_the_largest_series_is_read_and_told(study: Path) -> None:
    volume = sg.load(study)
    np.testing.assert_array_equal(volume.samples, HU)
    assert volume.notes == ("series 2 of 3 is read, the largest; series=N picks another",)


@pytest.mark.parametrize(("asked", "planes"), [(1, 1), ("2", 6), ("77", 1), ("1.2.88", 6), (".88", 6)])
def test_a_series_is_picked(study: Path, asked: str | int, planes: int) -> None:
    volume = sg.load(study, series=asked)
    assert (len(volume.samples), volume.notes) == (planes, ())


@pytest.mark.parametrize("asked", ["88", "4", "1.2", "-1", "99999999999999999999"])
def test_a_series_that_is_none_or_several(study: Path, asked: str) -> None:
    with pytest.raises(InputError, match=r"series: expected a number from 1 to 3.*2: CT, 6 × 11 × 9, thin B30"):
        sg.load(study, series=asked)


def test_info_lists_series_from_headers(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those without all of their pixels, too."""
    lines = ["series", "  1: CT, 1 × 60 × 60, scout", "  2: CT, 6 × 11 × 9, thin B30", "  3: MR, 2 × 11 × 9"]
    assert list_volumes(study) == lines
    assert main(["info", str(study)]) == 0
    told = capsys.readouterr()
    assert told.out.startswith("series\n  1: CT, 1 × 60 × 60, scout\n  2: CT") and "11 × 9 × 6" in told.out
    assert told.err == "splatgl: series 2 of 3 is read, the largest; series=N picks another\n"


@pytest.mark.long
def test_render_a_folder(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["render", str(study), "-o", str(tmp_path / "a.png"), "--size", "32"]
    assert main(arguments) == 0 and (tmp_path / "a.png").is_file()
    assert "series 2 of 3" in capsys.readouterr().err
    assert main([*arguments, "--quiet"]) == 0 and capsys.readouterr() == ("", "")
    assert main([*arguments, "--series", "2"]) == 0 and capsys.readouterr().err == ""


@pytest.mark.few(1)
@pytest.mark.parametrize("option", ["--mask", "--layer", "--labels"])
def test_notes_of_what_lies_beside_a_volume(
    option: str, study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The series that is read of a layer's folder, or of a mask's, is told once, with the folder."""
    first = str(study / "b")
    arguments = ["render", first, option, str(study), "-o", str(tmp_path / "a.png"), "--size", "64", "--check", "0"]
    assert main([*arguments, "--annotate", "scale"]) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if "series" in line]
    named = "mask study" if option == "--mask" else "study"
    assert notes == [f"splatgl: {named}: series 2 of 3 is read, the largest; series=N picks another"]
    assert main([*arguments, "--quiet"]) == 0 and capsys.readouterr().err == ""
    if option != "--mask":
        assert main(["pick", first, "8,8", option, str(study), "--size", "16"]) in (0, 1)
        assert "splatgl: study: series 2 of 3" in capsys.readouterr().err


# --- samples ----------------------------------------------------------------------------------------------------------


def one(tmp_path: Path, array: np.ndarray, **tags: object) -> sg.Volume:
    save(image(array, **tags), tmp_path / "one.dcm")
    return sg.load(tmp_path / "one.dcm")


@pytest.mark.parametrize(
    ("tags", "dtype"),
    [
        ({"RescaleIntercept": -1024, "BitsStored": 12, "HighBit": 11}, np.int16),
        ({"RescaleIntercept": -1024}, np.int16),
        ({"RescaleIntercept": -40000}, np.int32),
        ({"RescaleIntercept": 30000}, np.int32),
        ({"RescaleSlope": "0.5", "RescaleIntercept": "3.25"}, np.float32),
        ({}, np.uint16),
    ],
)
def test_rescaled(tmp_path: Path, tags: dict[str, object], dtype: type) -> None:
    """Whole numbers in the narrowest type that holds all that may be stored; float32 for scales."""
    stored = np.arange(4096, dtype=np.uint16).reshape(64, 64)
    samples = one(tmp_path, stored, **tags).samples
    expected = stored * float(str(tags.get("RescaleSlope", 1))) + float(str(tags.get("RescaleIntercept", 0)))
    np.testing.assert_array_equal(samples[0], expected)
    assert samples.dtype == dtype


def test_each_slice_has_its_own_scale(tmp_path: Path) -> None:
    """As in PET."""
    (tmp_path / "pet").mkdir()
    for n, plane in enumerate(HU):
        save(image(plane, n, RescaleSlope=n + 0.5, Modality="PT"), tmp_path / "pet" / f"{n}.dcm")
    samples = sg.load(tmp_path / "pet").samples
    np.testing.assert_allclose(samples, HU * (np.arange(6) + 0.5)[:, None, None], rtol=1e-6)


def test_monochrome1_is_inverted(tmp_path: Path) -> None:
    stored = np.arange(99, dtype=np.uint16).reshape(9, 11)
    tags = {"PhotometricInterpretation": "MONOCHROME1", "BitsStored": 12, "HighBit": 11}
    np.testing.assert_array_equal(one(tmp_path, stored, **tags).samples[0], 4095 - stored)
    tags = {"PhotometricInterpretation": "MONOCHROME1"}
    np.testing.assert_array_equal(one(tmp_path, HU[0], **tags).samples[0], -1 - HU[0].astype(int))


def test_padding_is_not_a_number(tmp_path: Path) -> None:
    """Where it is declared and there, as a value or a range; 0 is background."""
    stored = HU[0].copy()
    stored[:3], stored[3] = -2000, -1990
    samples = one(tmp_path, stored, PixelPaddingValue=-2000, RescaleIntercept=5).samples[0]
    assert np.isnan(samples[:3]).all() and samples.dtype == np.float32
    np.testing.assert_array_equal(samples[3:], stored[3:] + 5)
    both = one(tmp_path, stored, PixelPaddingValue=-2000, PixelPaddingRangeLimit=-1990).samples[0]
    assert np.isnan(both[:4]).all() and np.isfinite(both[4:]).all()
    plain = one(tmp_path, np.maximum(stored, 0), PixelPaddingValue=0).samples
    assert plain.dtype == np.int16 and (plain[0] == np.maximum(stored, 0)).all()


@pytest.mark.parametrize("limit", [None, "same", "other"])
@pytest.mark.parametrize(
    ("dtype", "kind", "value"),
    [(np.int16, "US", 63536), (np.int16, "SS", -2000), (np.uint16, "SS", -2000), (np.uint16, "US", 63536)],
)
def test_padding_is_of_the_pixels_type(tmp_path: Path, dtype: type, kind: str, value: int, limit: str | None) -> None:
    """63536 of unsigned 16 bits is −2000 of signed ones, whichever of both a header writes; the end of a range too."""
    stored = np.full((4, 6), 24, np.int16)
    stored[:2], stored[2] = -2000, -1990
    data = image(stored.astype(dtype), RescaleIntercept=-1024)
    data.add_new((0x0028, 0x0120), kind, value)
    if limit:
        ends = {"US": 63546, "SS": -1990}
        other = kind if limit == "same" else {"US": "SS", "SS": "US"}[kind]
        data.add_new((0x0028, 0x0121), other, ends[other])
    save(data, tmp_path / "a.dcm")
    samples = sg.load(tmp_path / "a.dcm").samples[0]
    rows = 3 if limit else 2
    assert np.isnan(samples[:rows]).all() and (samples[3:] == -1000).all()
    assert limit or (samples[2] == stored[2].astype(dtype).astype(float) - 1024).all()


def test_table_begins_at_a_signed_value(tmp_path: Path) -> None:
    from pydicom.dataset import Dataset

    table = Dataset()
    table.add_new((0x0028, 0x3002), "US", [3, 65535, 16])
    table.add_new((0x0028, 0x3006), "US", [7, 5, 300])
    stored = np.array([[-1, 0, 1]], np.int16)
    np.testing.assert_array_equal(one(tmp_path, stored, ModalityLUTSequence=[table]).samples[0], [[7, 5, 300]])


NUCLEAR = "1.2.840.10008.5.1.4.1.1.20"


def nuclear(array: np.ndarray, gap: float, **tags: object) -> Any:
    """Frames of nuclear medicine, the first at z = 60, whose place the detector has."""
    from pydicom.dataset import Dataset

    data, detector = image(array, SpacingBetweenSlices=gap, SOPClassUID=NUCLEAR, Modality="NM", **tags), Dataset()
    detector.ImagePositionPatient, detector.ImageOrientationPatient = [1.0, 2.0, 60.0], [1, 0, 0, 0, 1, 0]
    del data.ImagePositionPatient, data.ImageOrientationPatient
    data.DetectorInformationSequence = [detector]
    return data


def heights(volume: sg.Volume) -> dict[float, float]:
    """The mean sample of each plane, by its place along z."""
    places = [float((volume.world_from_index @ [0, 0, n] + volume.origin)[2]) for n in range(volume.shape[0])]
    return dict(zip(places, np.asarray(volume.samples).mean(axis=(1, 2)).tolist(), strict=True))


@pytest.mark.parametrize("gap", [-4.0, 4.0])
def test_frames_of_nuclear_medicine_are_stacked_by_the_sign(tmp_path: Path, gap: float) -> None:
    """Of their distance (PS3.3 C.8.4.15); in the order of their slices, and gated ones each in its time."""
    frames = np.arange(5, dtype=np.uint16)[:, None, None] * np.ones((1, 9, 11), np.uint16)
    expected = {60 + gap * n: float(n) for n in range(5)}
    save(nuclear(frames, gap), tmp_path / "plain.dcm")
    assert heights(sg.load(tmp_path / "plain.dcm")) == pytest.approx(expected)
    order = [3, 0, 4, 1, 2]
    save(nuclear(frames[order], gap, SliceVector=[n + 1 for n in order]), tmp_path / "ordered.dcm")
    assert heights(sg.load(tmp_path / "ordered.dcm")) == pytest.approx(expected)
    both = np.concatenate([frames, frames + 100])
    tags = {"SliceVector": [*range(1, 6)] * 2, "TimeSlotVector": [1] * 5 + [2] * 5}
    save(nuclear(both, gap, **tags), tmp_path / "gated.dcm")
    gated = sg.load(tmp_path / "gated.dcm")
    assert heights(gated) == pytest.approx(expected)
    assert gated.notes == ("2 time slots at each position: number 0 is read; time=N picks another",)
    assert heights(sg.load(tmp_path / "gated.dcm", array=1)) == pytest.approx({z: n + 100 for z, n in expected.items()})


def test_the_sign_of_a_distance_elsewhere(tmp_path: Path) -> None:
    """Positions decide; without them, only nuclear medicine gives a sign a meaning, and others are told."""
    frames = np.arange(4, dtype=np.int16)[:, None, None] * np.ones((1, 9, 11), np.int16)
    save(image(frames, 10.0, SpacingBetweenSlices=-2.0, Modality="MR"), tmp_path / "mr.dcm")
    volume = sg.load(tmp_path / "mr.dcm")
    assert heights(volume) == pytest.approx({10.0: 0, 12.0: 1, 14.0: 2, 16.0: 3})
    assert len(volume.notes) == 1 and "negative SpacingBetweenSlices" in volume.notes[0]
    volume = sg.load(written(tmp_path / "slices", frames, 2.0, SpacingBetweenSlices=-2.0))
    assert heights(volume) == pytest.approx({0.0: 0, 2.0: 1, 4.0: 2, 6.0: 3}) and volume.notes == ()
    data = enhanced(frames, 2.0)
    data.SharedFunctionalGroupsSequence[0].PixelMeasuresSequence[0].SpacingBetweenSlices = -2.0
    save(data, tmp_path / "enhanced.dcm")
    assert list(heights(sg.load(tmp_path / "enhanced.dcm"))) == pytest.approx([0.0, 2.0, 4.0, 6.0])


@pytest.mark.parametrize("places", [(0.0, 3.0, 6.0), (50.0, 47.0, 44.0)])
def test_offsets_of_a_dose(tmp_path: Path, places: tuple[float, ...]) -> None:
    """From the first frame along the normal; or places along z, where the first is the position's."""
    frames = np.arange(3, dtype=np.uint16)[:, None, None] * np.ones((1, 9, 11), np.uint16)
    data = image(frames, 50.0, GridFrameOffsetVector=list(places), Modality="RTDOSE", DoseGridScaling=1)
    if places[0]:
        data.ImageOrientationPatient = [1, 0, 0, 0, -1, 0]
    del data.SliceThickness
    save(data, tmp_path / "dose.dcm")
    found = heights(sg.load(tmp_path / "dose.dcm"))
    assert found == pytest.approx({place + (0 if places[0] else 50): float(n) for n, place in enumerate(places)})


@pytest.mark.parametrize("kind", ["overlay", "table", "views"])
def test_what_a_header_states_and_is_not_drawn_is_told(tmp_path: Path, kind: str) -> None:
    from pydicom.dataset import Dataset

    data = nuclear(HU, 3.0, ImageType=["ORIGINAL", "PRIMARY", "TOMO"]) if kind == "views" else image(HU[0])
    if kind == "overlay":
        data.add_new((0x6000, 0x0010), "US", 9)
    if kind == "table":
        data.RealWorldValueMappingSequence = [Dataset()]
    save(data, tmp_path / "a.dcm")
    (note,) = sg.load(tmp_path / "a.dcm").notes
    assert {"overlay": "overlays", "table": "real-world", "views": "views from around"}[kind] in note


def test_modality_table(tmp_path: Path) -> None:
    from pydicom.dataset import Dataset

    table = Dataset()
    table.LUTDescriptor, table.LUTData = [4, 10, 16], [7, 5, 300, 20]
    table["LUTDescriptor"].VR = table["LUTData"].VR = "US"
    stored = np.array([[9, 10, 11], [12, 13, 14]], np.uint16)
    samples = one(tmp_path, stored, ModalityLUTSequence=[table]).samples[0]
    np.testing.assert_array_equal(samples, [[7, 7, 5], [300, 20, 20]])


@pytest.mark.parametrize("kind", ["RGB", "YBR_FULL", "PALETTE COLOR", "planar"])
def test_colors(tmp_path: Path, kind: str) -> None:
    """Colours of voxels, and their luma as samples."""
    rgb = np.random.default_rng(1).integers(0, 256, (8, 10, 3)).astype(np.uint8)
    data = image(rgb)
    if kind == "YBR_FULL":
        from PIL import Image

        data.PhotometricInterpretation = kind
        data.PixelData = np.asarray(Image.fromarray(rgb).convert("YCbCr")).tobytes()
    if kind == "planar":
        data.PlanarConfiguration = 1
        data.PixelData = np.moveaxis(rgb, -1, 0).tobytes()
    if kind == "PALETTE COLOR":
        data = image(np.arange(80, dtype=np.uint8).reshape(8, 10), PhotometricInterpretation=kind)
        for n, name in enumerate(("Red", "Green", "Blue")):
            setattr(data, f"{name}PaletteColorLookupTableDescriptor", [80, 0, 16])
            data[f"{name}PaletteColorLookupTableDescriptor"].VR = "US"
            entries = (rgb.reshape(-1, 3)[:, n].astype("<u2") * 257).tobytes()
            setattr(data, f"{name}PaletteColorLookupTableData", entries)
    save(data, tmp_path / "a.dcm")
    volume = sg.load(tmp_path / "a.dcm")
    np.testing.assert_allclose(volume.color[0].astype(int), rgb, atol=2 if kind == "YBR_FULL" else 0)
    luma = volume.color[0] @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(volume.samples[0], luma, atol=0.5)


def test_floating_point_pixels(tmp_path: Path) -> None:
    data = image(HU[0])
    del data.PixelData, data.PixelRepresentation, data.BitsStored, data.HighBit
    values = np.linspace(-1, 1, 99, dtype=np.float32).reshape(9, 11)
    data.BitsAllocated, data.FloatPixelData = 32, values.tobytes()
    save(data, tmp_path / "a.dcm")
    np.testing.assert_array_equal(sg.load(tmp_path / "a.dcm").samples[0], values)


def test_memory(tmp_path: Path) -> None:
    """Slices are read one at a time: the peak is little more than the array."""
    planes = np.zeros((41, 256, 256), np.int16)
    written(tmp_path / "ct", planes, 1.0, SpacingBetweenSlices=1)
    sg.load(tmp_path / "ct")
    tracemalloc.start()
    volume = sg.load(tmp_path / "ct")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert volume.samples.nbytes < peak < 1.2 * volume.samples.nbytes


@pytest.mark.parametrize("form", ["US", "OW"])
@pytest.mark.parametrize(("bits", "wide"), [(8, False), (8, True), (16, True)])
def test_modality_tables_of_8_bits(tmp_path: Path, bits: int, wide: bool, form: str) -> None:
    """Entries of 8 bits lie in bytes, two in each number of 16 bits, an odd number of them padded, or in one each as
    those of 16 bits, which is how pydicom reads them.
    """
    import pydicom
    from pydicom.dataset import Dataset
    from pydicom.pixels.processing import apply_modality_lut

    data = np.array([7, 5, 200, 20, 9], np.uint16 if wide else np.uint8).tobytes() + bytes(not wide)
    table = Dataset()
    table.add_new((0x0028, 0x3002), "US", [5, 10, bits])
    table.add_new((0x0028, 0x3006), form, data if form == "OW" else np.frombuffer(data, "<u2").tolist())
    stored = np.array([[9, 10, 11], [12, 13, 14]], np.uint16)
    volume = one(tmp_path, stored, ModalityLUTSequence=[table])
    np.testing.assert_array_equal(volume.samples[0], [[7, 7, 5], [200, 20, 9]])
    if wide:
        right = apply_modality_lut(stored, pydicom.dcmread(tmp_path / "one.dcm"))
        np.testing.assert_array_equal(volume.samples[0], right)


@pytest.mark.parametrize("positions", [True, False])
def test_pixels_of_an_aspect_without_a_size(tmp_path: Path, positions: bool) -> None:
    """Pixels are as high as PixelAspectRatio says, with a note; PixelSpacing counts where it is stated."""
    for n in range(3):
        data = image(np.arange(12, dtype=np.int16).reshape(3, 4), 2.0 * n)
        del data.PixelSpacing
        if not positions:
            del data.ImagePositionPatient, data.ImageOrientationPatient
        data.InstanceNumber, data.PixelAspectRatio = n + 1, [3, 2]
        save(data, tmp_path / f"{n}.dcm")
    volume = sg.load(tmp_path)
    assert volume.spacing[:2] == (1.0, 1.5)
    assert "pixels are 1.5 times as high as wide, by PixelAspectRatio" in volume.notes
    (tmp_path / "b").mkdir()
    sized = one(tmp_path / "b", np.zeros((2, 3), np.int16), PixelAspectRatio=[3, 2])
    assert sized.spacing == one(tmp_path, np.zeros((2, 3), np.int16)).spacing and not any(
        "PixelAspectRatio" in note for note in sized.notes
    )

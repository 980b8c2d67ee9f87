"""DICOM that is uneven, mixed, damaged or no volume: told in a note or on one line, without what identifies anybody."""

from __future__ import annotations

import struct
import subprocess
import sys
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError

pytest.importorskip("pydicom", reason="writes the files; it is in the extra dicom")
from tests.fuzz.seed_dicom import enhanced, image, packed_image, save
from tests.helpers.dicom import HU, written

pytestmark = pytest.mark.usefixtures("shared_programs")

# --- slices that make no plain stack ----------------------------------------------------------------------------------


def placed(folder: Path, places: list[float], planes: np.ndarray = HU, **tags: object) -> Path:
    """Slices at those places along z."""
    folder.mkdir(exist_ok=True)
    for n, place in enumerate(places):
        save(image(planes[n % len(planes)], place, InstanceNumber=n + 1, **tags), folder / f"{n:03d}.dcm")
    return folder


def test_missing_slices_are_empty(tmp_path: Path) -> None:
    volume = sg.load(placed(tmp_path / "ct", [0, 2.5, 5, 12.5, 15]))
    assert volume.notes == ("2 of 7 slices are missing: left empty",)
    assert volume.spacing[2] == pytest.approx(2.5) and volume.samples.dtype == np.float32
    assert np.isnan(volume.samples[3:5]).all()
    np.testing.assert_array_equal(volume.samples[[0, 1, 2, 5, 6]], HU[:5])


def test_uneven_slices_are_told(tmp_path: Path) -> None:
    volume = sg.load(placed(tmp_path / "ct", [0, 2.5, 5.3, 7.5, 10]))
    assert len(volume.notes) == 1 and "uneven slices: rendered 2.5" in volume.notes[0]
    assert volume.spacing[2] == pytest.approx(2.5, rel=0.01) and volume.shape[0] == 5


# places; thicknesses, None: not told; the drawn planes and, of these, those that are empty
UNEVEN: dict[str, tuple[Any, Any, Any, Any]] = {
    "two distances": ([0, 2.5, 5, 7.5, 10, 15, 20], [2.5] * 5 + [5] * 2, np.arange(9) * 2.5, []),
    "no multiples": ([0, 5, 10, 15, 23, 31], [5] * 4 + [8] * 2, np.arange(7) * 5.0, []),
    "thick first": ([0, 4, 8, 10, 12, 14], [4] * 3 + [2] * 3, np.arange(8) * 2.0, []),
    "three": ([0, 1, 2, 4, 6, 9, 12], [1] * 3 + [2] * 2 + [3] * 2, np.arange(13.0), []),
    "far apart as planned": ([0, 10, 20, 30, 35, 40, 45], [1] * 7, np.arange(10) * 5.0, []),
    "thickness not told": ([0, 2, 4, 6, 10, 14, 18], None, np.arange(10) * 2.0, []),
    "missing beside thick ones": ([0, 2, 4, 6, 10, 14, 18, 30], [2] * 4 + [4] * 4, np.arange(16) * 2.0, range(10, 15)),
    "irregular": ([0, 2.5, 4, 7.5, 9], [4] * 5, np.arange(7) * 1.5, []),
}


@pytest.mark.parametrize("kind", UNEVEN)
def test_uneven_slices_are_resampled(kind: str, tmp_path: Path) -> None:
    """At the least distance, linearly: a ramp along z stays what it is, and nothing is empty where slices touch."""
    places, thick, planes, empty = UNEVEN[kind]
    (tmp_path / "ct").mkdir()
    for n, place in enumerate(places):
        data = image(np.full((4, 5), round(100 * place), np.int16), place, SliceThickness=thick and thick[n])
        save(data, tmp_path / "ct" / f"{n}.dcm")
    volume = sg.load(tmp_path / "ct")
    assert volume.spacing[2] == pytest.approx(planes[1]) and volume.origin[2] == pytest.approx(0)
    expected = np.minimum(100 * planes, 100 * places[-1])
    expected[list(empty)] = np.nan
    np.testing.assert_allclose(volume.samples[:, 1, 2], expected, atol=0.51)
    assert volume.notes[0].startswith("uneven slices") and f"resampled every {planes[1]:g} mm" in volume.notes[0]
    assert len(volume.notes) == 1 + bool(empty) and (volume.samples.dtype == np.int16) == (not empty)


def test_colors_and_padding_of_uneven_slices(tmp_path: Path) -> None:
    """A colour is that of one slice; beside padding, the nearer slice's value stands."""
    for name, kind in (("rgb", np.uint8), ("ct", np.int16)):
        (tmp_path / name).mkdir()
        for n, place in enumerate([0, 1, 2, 4, 6]):
            plane = np.full((4, 5, 3) if name == "rgb" else (4, 5), 10 * (n + 1), kind)
            tags = {} if name == "rgb" else {"PixelPaddingValue": 50}
            save(image(plane, place, SliceThickness=2, **tags), tmp_path / name / f"{n}.dcm")
    assert sg.load(tmp_path / "rgb").color[:, 0, 0, 0].tolist() in (
        [10, 20, 30, n, 40, m, 50] for n in (30, 40) for m in (40, 50)
    )
    values = sg.load(tmp_path / "ct").samples[:, 0, 0]
    np.testing.assert_array_equal(values[[0, 1, 2, 3, 4, 6]], [10, 20, 30, 35, 40, np.nan])
    assert np.isnan(values[5]) or values[5] == 40


@pytest.mark.parametrize("places", [[0, 1, 2, 900], [0, 1, 3.4, 3.5, 9]])
def test_no_grid_is_refused(tmp_path: Path, places: list[float]) -> None:
    with pytest.raises(InputError, match="slices: expected"):
        sg.load(placed(tmp_path / "ct", places))


@pytest.mark.parametrize(
    ("tag", "values", "title"),
    [
        ("TemporalPositionIdentifier", (2, 1), "time points"),
        ("TriggerTime", (40, 0), "trigger times"),
        ("EchoTime", (90.5, 12), "echo times"),
        ("AcquisitionTime", ("101500.25", "101400"), "acquisition times"),
        ("AcquisitionNumber", (4, 3), "acquisitions"),
    ],
)
def test_several_images_at_each_place(tmp_path: Path, tag: str, values: tuple[object, object], title: str) -> None:
    """The earlier one is read, though it is stored later; array picks."""
    later, earlier = (np.full_like(HU[:3], value) for value in (50, 7))
    folder = placed(tmp_path / "mr", [0, 1, 2], later, **{tag: values[0]})
    for n, plane in enumerate(earlier):
        save(image(plane, n, InstanceNumber=n + 9, **{tag: values[1]}), folder / f"x{n}.dcm")
    volume = sg.load(folder)
    name, listed = ("array", " (12, 90.5)") if title == "echo times" else ("time", "")
    assert volume.notes == (f"2 {title} at each position{listed}: number 0 is read; {name}=N picks another",)
    assert volume.times == (1 if listed else 2)
    assert (volume.samples == 7).all() and volume.shape[0] == 3
    assert (sg.load(folder, array=1).samples == 50).all() and sg.load(folder, array=1).notes == ()
    with pytest.raises(InputError, match="array: expected a number from 0 to 1"):
        sg.load(folder, array=2)


def test_some_places_have_two_images(tmp_path: Path) -> None:
    volume = sg.load(placed(tmp_path / "ct", [0, 1, 2, 3, 1, 2]))
    assert volume.notes == ("2 images have the position of another one; the first of each is read",)
    np.testing.assert_array_equal(volume.samples, HU[:4])


def test_localizers_are_left_out(tmp_path: Path) -> None:
    folder = placed(tmp_path / "ct", [0, 1, 2, 3])
    save(image(np.zeros((30, 30), np.int16), 1.0), folder / "large.dcm")
    save(image(HU[5], 1.0, ImageOrientationPatient=[1, 0, 0, 0, 0, -1]), folder / "coronal.dcm")
    save(image(HU[5], 1.0, PixelSpacing=[1, 1]), folder / "near.dcm")
    volume = sg.load(folder)
    assert volume.notes == ("3 of 7 images have another size or orientation: left out",)
    np.testing.assert_array_equal(volume.samples, HU[:4])


def test_images_without_positions(tmp_path: Path) -> None:
    """In the order of their numbers, in no patient's frame."""
    (tmp_path / "us").mkdir()
    for n in range(4):
        data = image(HU[n], InstanceNumber=n)
        del data.ImagePositionPatient, data.ImageOrientationPatient
        save(data, tmp_path / "us" / f"{9 - n}.dcm")
    volume = sg.load(tmp_path / "us")
    assert volume.notes == ("no positions: 4 images in the order of their numbers, 3 mm apart",)
    np.testing.assert_array_equal(volume.samples, HU[:4])
    assert volume.frame is None and volume.spacing == (1.5, 2.0, 3.0)


# --- what is refused --------------------------------------------------------------------------------------------------


def without_pixels(path: Path, modality: str, sop: str) -> None:
    data = image(HU[0], Modality=modality, SOPClassUID=sop)
    for name in ("Rows", "Columns", "PixelData") if modality != "SEG" else ():
        delattr(data, name)
    save(data, path)


def cut(path: Path) -> None:
    save(image(HU[0]), path)
    path.write_bytes(path.read_bytes()[:-30])


def cut_in_header(path: Path) -> None:
    save(image(HU[0]), path)
    path.write_bytes(path.read_bytes()[:500])


def lying(path: Path, codec: str = "") -> None:
    data = packed_image(HU[0].astype(np.uint16), codec) if codec else image(HU[0])
    data.Rows = data.Columns = 65535
    save(data, path)


def many_frames(path: Path) -> None:
    data = packed_image(HU.astype(np.uint16), "rle")
    data.NumberOfFrames = 2**31 - 1
    save(data, path)


def large_jpeg(path: Path) -> None:
    """Whose own header states other sizes than the file's."""
    data = packed_image(np.zeros((16, 16), np.uint8), "jpeg")
    at = data.PixelData.index(b"\xff\xc0") + 5
    data.PixelData = data.PixelData[:at] + struct.pack(">HH", 65000, 65000) + data.PixelData[at + 4 :]
    save(data, path)


def few_groups(path: Path) -> None:
    data = enhanced(HU)
    data.PerFrameFunctionalGroupsSequence = data.PerFrameFunctionalGroupsSequence[:4]
    save(data, path)


def video(path: Path) -> None:
    from pydicom.uid import MPEG2MPML

    data = packed_image(np.zeros((16, 16), np.uint8), "jpeg")
    data.file_meta.TransferSyntaxUID = MPEG2MPML
    save(data, path)


def deflated(path: Path) -> None:
    from pydicom.uid import DeflatedExplicitVRLittleEndian

    data = image(HU[0])
    data.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    save(data, path)


def odd_bits(path: Path) -> None:
    save(image(HU[0], BitsAllocated=12, BitsStored=12, HighBit=11), path)


def text(path: Path) -> None:
    path.write_text("a report")


BAD: dict[str, tuple[Callable[[Path], None], str]] = {
    "cut": (cut, "pixels: expected 198 bytes, got 168 bytes"),
    "cut in the header": (cut_in_header, "DICOM: expected images, got files without pixels|file: expected pixels"),
    "SR": (lambda path: without_pixels(path, "SR", "1.2.840.10008.5.1.4.1.1.88.11"), "a report, without an image"),
    "RTSTRUCT": (
        lambda path: without_pixels(path, "RTSTRUCT", "1.2.840.10008.5.1.4.1.1.481.3"),
        "contours: expected at least one",
    ),
    "SEG": (lambda path: without_pixels(path, "SEG", "1.2.840.10008.5.1.4.1.1.66.4"), "segments: expected 1 to"),
    "DICOMDIR": (lambda path: without_pixels(path, "", "1.2.840.10008.1.3.10"), "name the folder that it is in"),
    "lying": (lying, "pixels: expected 8589672450 bytes"),
    "lying, RLE": (lambda path: lying(path, "rle"), "pixels: expected sizes that they can hold"),
    "frames": (many_frames, "pixels: expected at most .* frames, in .* bytes, got 2147483647"),
    "large JPEG": (large_jpeg, "expected 16 × 16 pixels, got 65000 × 65000"),
    "groups": (few_groups, "frames: expected 6, as the header says, got 4"),
    "video": (video, "transfer syntax: expected"),
    "deflated": (deflated, "transfer syntax: expected one that isn't deflated"),
    "odd bits": (odd_bits, "pixels: expected 1 or 8 to 64 bits each"),
    "text": (text, "contents: expected DICOM, as the name says, got text"),
}


@pytest.mark.parametrize("name", BAD)
def test_refused_on_one_line(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    """With exit code 2, without warnings of the library, and before memory is taken."""
    make, told = BAD[name]
    path = tmp_path / "a.dcm"
    make(path)
    capfd.readouterr()
    tracemalloc.start()
    try:
        code = main(["info", str(path)])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    out, err = capfd.readouterr()
    assert code == 2 and len(err.splitlines()) == 1 and err.startswith(f"splatgl: {path}: ")
    with pytest.raises(InputError, match=told):
        sg.load(path)
    assert (out == "" or out.startswith("series\n")) and peak < 2**24


def test_folders_that_hold_no_series(tmp_path: Path) -> None:
    with pytest.raises(
        InputError, match="expected a file, or a folder of Zarr or DICOM or picture slices, got another folder"
    ):
        sg.load(tmp_path)
    cut_in_header(tmp_path / "a.dcm")
    cut(tmp_path / "b.dcm")
    with pytest.raises(InputError, match="pixels"):
        sg.load(tmp_path)
    (tmp_path / "x.zip").write_bytes(b"PK\x05\x06" + bytes(18))
    with pytest.raises(InputError, match="DICOM: expected DICOM files, got none"):
        sg.load(tmp_path / "x.zip")


def test_a_damaged_slice_is_named(tmp_path: Path) -> None:
    """A header that can't be read is left out and told; cut pixels are refused, as a slice would be missing."""
    folder = written(tmp_path / "ct")
    whole = (folder / "1.dcm").read_bytes()
    (folder / "9.dcm").write_bytes(whole[:132] + b"\xff" * 90)
    (folder / "1.dcm").write_bytes(whole[:-20])
    with pytest.raises(InputError, match=r"ct: 1\.dcm: pixels: expected 198 bytes"):
        sg.load(folder)


@pytest.mark.parametrize("damage", ["cut", "overlap", "password", "codec", "nameless"])
def test_damaged_zips(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "ct.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in written(tmp_path / "ct").iterdir():
            archive.write(file, file.name)
    data = bytearray(path.read_bytes())
    entries = [n for n in range(len(data) - 4) if data[n : n + 4] == b"PK\x01\x02"]
    for at in entries:
        if damage == "overlap":
            data[at + 20 : at + 24] = struct.pack("<I", 10**6)
        if damage == "password":
            data[at + 8] |= 1
        if damage == "nameless":
            data[at + 28 : at + 30] = b"\0\0"
        if damage == "codec":
            data[at + 10] = 97
    if damage == "cut":
        del data[len(data) // 2 : len(data) // 2 + 40]
    path.write_bytes(data)
    with pytest.raises(InputError, match="zip"):
        sg.load(path)


def test_missing_libraries_name_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(image(HU[0]), tmp_path / "a.dcm")
    save(packed_image(np.kron(HU[0].astype(np.uint16), np.ones((4, 4), np.uint16)), "j2k"), tmp_path / "j.dcm")
    save(packed_image(np.zeros((16, 16), np.uint8), "jpeg"), tmp_path / "l.dcm")
    from pydicom.pixels.decoders.base import Decoder

    with monkeypatch.context() as patch:
        patch.setattr(Decoder, "is_available", property(lambda self: not self.UID.is_encapsulated))
        assert sg.load(tmp_path / "a.dcm").shape == (1, 9, 11)
        with pytest.raises(InputError, match=r"needs the library pylibjpeg-openjpeg.*splatgl\[dicom\]"):
            sg.load(tmp_path / "j.dcm")
        with pytest.raises(InputError, match=r"needs the library pylibjpeg-libjpeg.*splatgl\[dicom-jpeg\]"):
            sg.load(tmp_path / "l.dcm")
    for name in [name for name in sys.modules if name.split(".")[0] == "pydicom"]:
        monkeypatch.setitem(sys.modules, name, None)
    for path in (tmp_path / "a.dcm", tmp_path):
        with pytest.raises(InputError, match=r"needs the library pydicom.*splatgl\[dicom\]"):
            sg.load(path)


# --- patients ---------------------------------------------------------------------------------------------------------

MARK = "MARKER"
SECRETS = (
    *("PatientName", "PatientID", "PatientAddress", "InstitutionName", "StudyID", "AccessionNumber", "OperatorsName"),
    *("ReferringPhysicianName", "StudyDescription", "PatientComments", "OtherPatientNames", "DeviceSerialNumber"),
)


def secret(path: Path, **tags: object) -> None:
    """A file whose identifying fields hold MARK, or a number, a date and a time of its own."""
    data = image(HU[0], **tags)
    for name in SECRETS:
        setattr(data, name, f"{MARK}^{name}"[:16])
    data.PatientBirthDate, data.StudyDate, data.StudyInstanceUID = "19670507", "20260712", "1.2.998877"
    save(data, path)


@pytest.mark.long
def test_nothing_that_identifies_a_patient_is_shown(tmp_path: Path) -> None:
    """Neither on standard output nor error, nor in pictures; also where a damaged header puts it elsewhere."""
    (tmp_path / "ct").mkdir()
    for n in range(3):
        secret(tmp_path / "ct" / f"{n}", ImagePositionPatient=[0, 0, n], SeriesDescription="thorax")
    # identifying text where numbers and names of kinds are read
    bad = {
        "uid": {"SeriesInstanceUID": "1.2.998877"},
        "photometric": {"PhotometricInterpretation": MARK},
        "kind": {"Rows": 0},
    }
    for name, tags in bad.items():
        secret(tmp_path / f"{name}.dcm", **tags)
    secret(tmp_path / "text.dcm")
    raw = (tmp_path / "text.dcm").read_bytes()
    (tmp_path / "text.dcm").write_bytes(raw.replace(b"2.0\\1.5 ", b"MARKER1 "))
    (tmp_path / "vr.dcm").write_bytes(raw.replace(b"\x28\x00\x10\x00US\x02\x00", b"\x28\x00\x10\x00LO\x02\x00"))
    secret(tmp_path / "count.dcm", NumberOfFrames=123456)
    raw = (tmp_path / "count.dcm").read_bytes()
    (tmp_path / "count.dcm").write_bytes(raw.replace(b"123456", b"MARKER"))
    assert len({path.read_bytes() for path in tmp_path.glob("*.dcm")}) == len(bad) + 3
    runs = [
        ["info", "ct"],
        ["render", "ct", "-o", "a.png", "--size", "32", "--explain"],
        ["info", "ct", "--series", "9"],
    ]
    runs += [["info", f"{name}.dcm"] for name in (*bad, "text", "vr", "count")]
    for arguments in runs:
        done = subprocess.run(
            [sys.executable, "-m", "splatgl", *arguments], cwd=tmp_path, capture_output=True, text=True
        )
        told = done.stdout + done.stderr
        assert "Traceback" not in told and told
        assert not any(word in told for word in (MARK, "19670507", "20260712", "998877", "Warning"))
    picture = (tmp_path / "a.png").read_bytes()
    assert b"ct" in picture and not any(word in picture for word in (b"MARKER", b"19670507", b"998877"))


@pytest.mark.parametrize("codec", ["rle", "j2k", "jpeg"])
def test_a_compressed_picture_that_is_cut_is_refused(tmp_path: Path, codec: str) -> None:
    """Decoders fill the rest of it without an error."""
    pytest.importorskip("libjpeg" if codec == "jpeg" else "openjpeg", reason="reads it; it is in the extra dicom")
    plane = np.random.default_rng(2).integers(0, 255, (40, 48)).astype(np.uint8)
    save(packed_image(plane, codec), tmp_path / "a.dcm")
    (tmp_path / "a.dcm").write_bytes((tmp_path / "a.dcm").read_bytes()[:-40])
    with pytest.raises(InputError, match=r"pixels: expected \d+ bytes, got \d+ bytes; the file is cut short"):
        sg.load(tmp_path / "a.dcm")

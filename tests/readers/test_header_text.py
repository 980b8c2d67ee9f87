"""Text of headers and tables that is not ASCII, and the units that it names."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.bars import length_text
from splatgl.data.affine import metres_in, unit_name
from splatgl.data.times import seconds_in
from splatgl.fileio import decode_text, load_table
from splatgl.geometry.clipping import world_units
from splatgl.readers.dicom_headers import plain_text
from splatgl.transfer.transfer_nodes import load_transfer
from splatgl.writers import save

SAMPLES = np.arange(120, dtype="<i2")
SPELLINGS = ["\u00b5m", "\u03bcm", "\u339b", "um", "micron", "Micrometers", r"\u00B5m"]


def write_nrrd(path: Path, lines: list[bytes], samples: np.ndarray = SAMPLES) -> Path:
    kind = b"short" if samples.dtype.itemsize == 2 else b"uchar"
    head = [b"NRRD0005", b"type: " + kind, b"dimension: 3", b"sizes: 4 5 6", b"endian: little", b"encoding: raw"]
    path.write_bytes(b"\n".join([*head, *lines, b"", b""]) + samples.tobytes())
    return path


def write_metaimage(path: Path, unit: bytes, data: bytes = b"LOCAL") -> Path:
    head = b"NDims = 3\nDimSize = 4 5 6\nElementSpacing = 0.5 0.5 2\nDistanceUnits = %b\nElementType = MET_SHORT\n"
    path.write_bytes(head % unit + b"ElementDataFile = " + data + b"\n" + SAMPLES.tobytes())
    return path


@pytest.mark.parametrize("coding", ["utf-8", "latin-1"])
@pytest.mark.parametrize("text", [*SPELLINGS, "\u00c5", "\u212b", "\u00c5ngström", "nm"])
def test_units_in_headers(text: str, coding: str, tmp_path: Path) -> None:
    """The unit of a voxel is the same in each spelling, coding and field."""
    # a program for Latin-1 writes other letters by their numbers, as ImageJ does
    raw = text.encode(coding, "backslashreplace")
    quoted = b'"%b" "%b" "%b"' % (raw, raw, raw)
    space = [b"space dimension: 3", b"space directions: (0.5,0,0) (0,0.5,0) (0,0,2)", b"space units: " + quoted]
    files = [
        write_nrrd(tmp_path / "space.nrrd", space),
        write_nrrd(tmp_path / "axes.nrrd", [b"spacings: 0.5 0.5 2", b"units: " + quoted]),
        write_metaimage(tmp_path / "a.mha", raw),
    ]
    metres = 1e-6 if text in SPELLINGS else 1e-9 if text == "nm" else 1e-10
    for file in files:
        volume = sg.load(file)
        assert metres_in(volume.unit) == metres, file.name
        assert volume.spacing == (0.5, 0.5, 2.0)


def test_names_of_units() -> None:
    """Each spelling of a unit has one name, metres and seconds; others stay as they are."""
    assert {unit_name(text) for text in SPELLINGS} == {"um"}
    assert [unit_name(text) for text in ("Meters", "inches", "pixels", "furlong", " ms ")] == [
        "m",
        "in",
        "",
        "furlong",
        "ms",
    ]
    assert [seconds_in(text) for text in ("\u00b5s", "\u03bcs", "MS", "h", "day", "mm", None)] == [
        1e-6,
        1e-6,
        1e-3,
        3600.0,
        86400.0,
        None,
        None,
    ]
    assert metres_in("ms") is metres_in("s") is None


@pytest.mark.parametrize("unit", ["um", "\u00b5m", "\u03bcm", "micrometer"])
def test_bars_and_places_take_each_spelling(unit: str) -> None:
    assert (length_text(3.0, unit), length_text(3000.0, unit), length_text(0.25, unit)) == ("3 µm", "3 mm", "250 nm")
    assert world_units("nm", unit, "x<30nm") == pytest.approx(1e-3)
    assert world_units("\u00e5", unit, "x<30Å") == pytest.approx(1e-4)


@pytest.mark.parametrize("unit", SPELLINGS)
@pytest.mark.parametrize("ending", ["nrrd", "mha", "nii", "tif"])
def test_volumes_in_each_spelling_are_written(unit: str, ending: str, tmp_path: Path) -> None:
    """A volume's unit is one name, whatever its caller writes, and so files keep it."""
    volume = sg.Volume(SAMPLES.reshape(6, 5, 4), (0.5, 0.5, 2.0), unit=unit)
    save(volume, tmp_path / f"a.{ending}")
    again = sg.load(tmp_path / f"a.{ending}")
    assert volume.unit == again.unit == "um" and again.spacing == (0.5, 0.5, 2.0)


def test_segment_names_and_notes(tmp_path: Path) -> None:
    """Names of segments keep their letters, also where a program wrote another coding into one line."""
    lines = [
        "Segment0_Name:=Größe Niere".encode(),
        "Segment1_Name:=Übergang".encode("latin-1"),
        "content: Schädel".encode(),
    ]
    lines += [b"Segment0_LabelValue:=1", b"Segment1_LabelValue:=2", b"Segment0_ID:=a", b"Segment1_ID:=b"]
    samples = (np.arange(120) % 3).astype(np.uint8)
    volume = sg.load(write_nrrd(tmp_path / "a.seg.nrrd", lines, samples))
    assert [label.name for label in volume.labels or ()] == ["Größe Niere", "Übergang"]


@pytest.mark.parametrize("coding", ["utf-8", "latin-1"])
def test_names_of_data_files(coding: str, tmp_path: Path) -> None:
    (tmp_path / "Schädel.raw").write_bytes(SAMPLES.tobytes())
    name = "Schädel.raw".encode(coding)
    head = tmp_path / "a.mhd"
    write_metaimage(head, b"mm", name)
    nrrd = write_nrrd(tmp_path / "a.nhdr", [b"data file: " + name], np.zeros(0, np.int16))
    assert (sg.load(head).samples == sg.load(nrrd).samples).all()


@pytest.mark.parametrize("coding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_label_tables_in_each_coding(coding: str, tmp_path: Path) -> None:
    """A table of labels is read with a byte-order mark, and in the codings of Windows."""
    table = '# ITK-SnAP Label Description File\n    1  255 0 0  1 1 1  "Größe – links…"\n    2  0 255 0  1 1 1  "Å"\n'
    samples = np.zeros((6, 5, 4), np.uint8)
    samples[1:4, 1:3, 1:3], samples[4:, 3:] = 1, 2
    write_nrrd(tmp_path / "a.nrrd", [], samples)
    (tmp_path / "a.label").write_bytes(table.encode(coding))
    assert [label.name for label in sg.load(tmp_path / "a.nrrd").labels or ()] == ["Größe – links…", "Å"]


def test_byte_order_marks_of_other_text(tmp_path: Path) -> None:
    """Scene files, transfer functions and tables of heights may begin with a mark, as Windows' programs write them."""
    (tmp_path / "a.toml").write_text('volume = "a.nrrd"\n', encoding="utf-8-sig")
    assert load_table(tmp_path / "a.toml", "a scene") == {"volume": "a.nrrd"}
    entry = {"Name": "a", "Points": [0, 0, 0.5, 0, 1, 1, 0.5, 0], "RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1]}
    (tmp_path / "a.json").write_text(json.dumps([entry]), encoding="utf-8-sig")
    assert load_transfer(tmp_path / "a.json", 1.0).points
    (tmp_path / "a.csv").write_text("1,2,3\n4,,6\n7,8,9\n", encoding="utf-8-sig")
    (tmp_path / "b.csv").write_text("1,2,3\n4,5,6\n", encoding="utf-8-sig")
    assert min(sg.load(tmp_path / name).count for name in ("a.csv", "b.csv")) > 0


def test_texts_of_hdf5(tmp_path: Path) -> None:
    """Attributes in Latin-1, which h5py returns with surrogates or as bytes."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for n, raw in enumerate(("\u00b5m".encode("latin-1"), "\u00b5m".encode(), "\u03bcm".encode())):
            data = file.create_dataset(f"d{n}", data=np.random.default_rng(1).random((4, 5, 6)))
            data.attrs["spacing"], data.attrs["unit"] = (2.0, 0.5, 0.5), np.bytes_(raw)
            text = file.create_dataset(f"t{n}", data=np.random.default_rng(1).random((4, 5, 6)))
            text.attrs["spacing"] = (2.0, 0.5, 0.5)
            text.attrs.create("unit", raw, dtype=h5py.string_dtype("utf-8"))
    assert {sg.load(tmp_path / "a.h5", array=f"/{kind}{n}").unit for n in range(3) for kind in "dt"} == {"um"}


def test_names_of_vtk_arrays(tmp_path: Path) -> None:
    head = "# vtk DataFile Version 3.0\na\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\nPOINT_DATA 8\n"
    text = (
        head + "SCALARS a float 1\nLOOKUP_TABLE default\n" + "1 " * 8 + "\nSCALARS Δp float 1\nLOOKUP_TABLE default\n"
    )
    (tmp_path / "a.vtk").write_text(text + "2 3 " * 4 + "\n", encoding="utf-8")
    assert float(np.max(sg.load(tmp_path / "a.vtk", array="Δp").samples)) == 3.0


def test_decoding() -> None:
    assert [decode_text(raw) for raw in (b"\xb5m", b"\xc2\xb5m", b"\xef\xbb\xbf\xce\xbcm", b"\x85", b"")] == [
        "\u00b5m",
        "\u00b5m",
        "\u03bcm",
        "…",
        "",
    ]


def test_texts_of_dicom_without_a_character_set() -> None:
    """UTF-8 that pydicom takes for Latin-1 is repaired, Latin-1 stays."""
    assert [plain_text(text) for text in ("Größe".encode().decode("latin-1"), "Größe", "肝臓")] == [
        "Größe",
        "Größe",
        "肝臓",
    ]

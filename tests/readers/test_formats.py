"""NumPy, raw, NRRD, NIfTI and MetaImage: the phantom written and read back, mapped where it can be."""

from __future__ import annotations

import bz2
import gzip
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import load
from splatgl.readers.common import is_mapped
from splatgl.readers.options import LoadOptions
from tests.helpers.phantom import ORIGIN, SIZES, SPACING, F, Q, check, put

Writer = Callable[[Path], Path]


# --- NumPy and raw ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("samples", [F, np.asfortranarray(F)], ids=["C", "F"])
def test_npy(tmp_path: Path, samples: np.ndarray) -> None:
    np.save(tmp_path / "letter.npy", samples)
    check(load(tmp_path / "letter.npy"), grid=False, frame=None, mapped=True)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz_picks_the_only_volume_or_the_named_array(tmp_path: Path, save: Callable[..., None]) -> None:
    save(tmp_path / "letter.npz", table=np.eye(3), letter=F)
    check(load(tmp_path / "letter.npz"), grid=False, frame=None, mapped=False)
    save(tmp_path / "letter.npz", other=F + 1, letter=F)
    with pytest.raises(InputError, match="pick one with array=NAME; there are: other, letter"):
        load(tmp_path / "letter.npz")
    check(load(tmp_path / "letter.npz", array="letter"), grid=False, frame=None, mapped=False)


@pytest.mark.parametrize("mark", ["_be", "-BE", " be"])
def test_raw_by_its_name_with_a_mark_of_its_own(tmp_path: Path, mark: str) -> None:
    path = put(tmp_path / f"letter_5x7x4_uint16{mark}.raw", F.astype(">u2").tobytes())
    np.testing.assert_array_equal(load(path).samples, F)
    left = put(tmp_path / "letter_uint16_left_5x7x4.raw", F.astype("<u2").tobytes())
    np.testing.assert_array_equal(load(left).samples, F)


def test_raw_by_its_name(tmp_path: Path) -> None:
    path = put(tmp_path / "letter_5x7x4_uint16be.raw", F.astype(">u2").tobytes())
    volume = load(path)
    np.testing.assert_array_equal(volume.samples, F)
    assert is_mapped(volume.samples) and volume.name == "letter_5x7x4_uint16be"


@pytest.mark.parametrize("dtype", [">u2", "uint16be"])
def test_raw_by_options(tmp_path: Path, dtype: str) -> None:
    path = put(tmp_path / "letter.raw", b"head", F.astype(">u2").tobytes())
    options = LoadOptions(shape=SIZES, dtype=dtype, header_offset=4)
    check(load(path, options), grid=False, frame=None, mapped=True)
    assert load(path, options, spacing=SPACING).spacing == SPACING


# --- NRRD ------------------------------------------------------------------------------------------------------------

NRRD = "NRRD0004\n# comment\ntype: {type}\ndimension: 3\nsizes: 5 7 4\nendian: {endian}\nencoding: {encoding}\n"


def vectors(matrix: np.ndarray) -> str:
    """The columns of world-from-index as NRRD's vectors, one per axis."""
    return " ".join("(" + ",".join(repr(float(value)) for value in column) + ")" for column in matrix.T)


DIRECTIONS = f"space directions: {vectors(Q * SPACING)}\n"
SPACE = f"space: left-posterior-superior\nspace origin: {vectors(np.array([ORIGIN]).T)}\n"


@pytest.mark.parametrize("grid", [SPACE + DIRECTIONS, DIRECTIONS + SPACE], ids=["space first", "directions first"])
@pytest.mark.parametrize("endian", ["little", "big"])
def test_nrrd_raw_is_mapped(tmp_path: Path, grid: str, endian: str) -> None:
    header = NRRD.format(type="short", endian=endian, encoding="raw")
    data = F.astype("<i2" if endian == "little" else ">i2").tobytes()
    check(load(put(tmp_path / "letter.nrrd", header, grid, "\n", data)), grid=True, frame="LPS", mapped=True)
    put(tmp_path / "letter.bin", b"line\n\0\0\0", data)
    detached = header + grid + "data file: letter.bin\nline skip: 1\nbyte skip: 3\n"
    check(load(put(tmp_path / "letter.nhdr", detached)), grid=True, frame="LPS", mapped=True)
    detached = header + grid + "data file: ./letter.bin\nbyte skip: -1\n"
    check(load(put(tmp_path / "letter.nhdr", detached)), grid=True, frame="LPS", mapped=True)


ENCODED = {
    "gzip": gzip.compress(F.tobytes()),
    "bzip2": bz2.compress(F.tobytes()),
    "text": " ".join(map(str, F.ravel())).encode(),
}


@pytest.mark.parametrize("encoding", ENCODED)
def test_nrrd_encodings(tmp_path: Path, encoding: str) -> None:
    header = NRRD.format(type="uchar", endian="little", encoding=encoding)
    path = put(tmp_path / "letter.nrrd", header, SPACE, DIRECTIONS, "\n", ENCODED[encoding])
    check(load(path), grid=True, frame="LPS", mapped=False)


@pytest.mark.parametrize(
    ("space", "frame"),
    [
        ("right-anterior-superior", "RAS"),
        ("RAS", "RAS"),
        ("LPS", "LPS"),
        ("left-anterior-superior", "LPS"),
        ("3D-left-handed", None),
        ("scanner-xyz", None),
    ],
)
def test_nrrd_frames(tmp_path: Path, space: str, frame: str | None) -> None:
    header = NRRD.format(type="uchar", endian="little", encoding="raw")
    units = 'space units: "mm" "mm" "mm"\n'
    path = put(tmp_path / "letter.nrrd", header, f"space: {space}\n", DIRECTIONS, units, "\n", F.tobytes())
    assert (load(path).frame, load(path).unit) == (frame, "mm")


def test_nrrd_spacings(tmp_path: Path) -> None:
    header = NRRD.format(type="uchar", endian="little", encoding="raw")
    volume = load(put(tmp_path / "letter.nrrd", header, "spacings: 1.5 -2.25 nan\n", "\n", F.tobytes()))
    assert volume.spacing == (1.5, 2.25, 1.0) and volume.frame is None
    np.testing.assert_array_equal(volume.world_from_index, np.diag([1.5, -2.25, 1.0]))
    assert volume.notes == ("the file states no spacing along z: 1 is taken",)


def test_nrrd_units_of_several_lengths(tmp_path: Path) -> None:
    """Lengths are converted to the first unit."""
    header = NRRD.format(type="uchar", endian="little", encoding="raw")
    units = 'units: "um" "um" "mm"\n'
    volume = load(put(tmp_path / "a.nrrd", header, "spacings: 1 2 0.003\n", units, "\n", F.tobytes()))
    assert volume.spacing == pytest.approx((1, 2, 3)) and volume.unit == "um"
    # fewer units than axes of space
    few = put(tmp_path / "b.nrrd", header, "space: LPS\n", DIRECTIONS, 'space units: "mm"\n', "\n", F.tobytes())
    assert load(few).shape == F.shape


def test_gzip_data_of_several_members(tmp_path: Path) -> None:
    """As programs write them that compress in parts."""
    header = NRRD.format(type="uchar", endian="little", encoding="gzip")
    parts = [gzip.compress(part.tobytes()) for part in F]
    path = put(tmp_path / "a.nrrd", header, "\n", *parts)
    np.testing.assert_array_equal(load(path).samples, F)
    path.write_bytes(path.read_bytes()[: -len(parts[-1])] + b"junk")
    with pytest.raises(InputError, match="inflated data: expected"):
        load(path)


def test_nrrd_left_anterior_is_turned(tmp_path: Path) -> None:
    """LAS has y the other way than LPS; a space of four dimensions has time besides."""
    header = NRRD.format(type="uchar", endian="little", encoding="raw")
    turned = np.diag([1.0, -1.0, 1.0])
    grid = f"space: LAS\nspace origin: {vectors(np.array([turned @ ORIGIN]).T)}\n"
    grid += f"space directions: {vectors(turned @ (Q * SPACING))}\n"
    check(load(put(tmp_path / "letter.nrrd", header, grid, "\n", F.tobytes())), grid=True, frame="LPS", mapped=True)
    header = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 5 7 4 2\nencoding: raw\nkinds: domain domain domain time\n"
    rows = [f"({','.join(map(repr, row))},0)" for row in (Q * SPACING).T.tolist()]
    header += f"space: left-posterior-superior-time\nspace directions: {' '.join(rows)} (0,0,0,2)\n"
    header += f"space origin: ({','.join(map(repr, ORIGIN))},0)\n\n"
    path = put(tmp_path / "letter.nrrd", header, np.stack([F + 1, F]).tobytes())
    check(load(path, array=1), grid=True, frame="LPS", mapped=True)
    check(load(path, time=1), grid=True, frame="LPS", mapped=True)
    first = load(path)
    assert (first.times, first.time_step) == (2, 2.0) and first.notes == ("time 0 of 2: --time picks another",)
    # as ITK writes it: a space of four dimensions without a name
    header = header.replace("space: left-posterior-superior-time", "space dimension: 4").replace("time\n", "domain\n")
    path = put(tmp_path / "letter.nrrd", header, np.stack([F + 1, F]).tobytes())
    check(load(path, time=1), grid=True, frame=None, mapped=True)
    assert load(path).times == 2


@pytest.mark.parametrize(
    ("centers", "spacing", "origin"),
    [
        ("cell cell cell", (2, 2, 4), (11, -19, 7)),
        ("node node node", (2.5, 14 / 6, 16 / 3), (10, -20, 5)),
        ("", (2, 2, 4), (11, -19, 7)),
    ],
)
def test_nrrd_axis_mins_and_maxs(tmp_path: Path, centers: str, spacing: tuple, origin: tuple) -> None:
    """From face to face of cells, from middle to middle of nodes; a grid that runs down has its axis turned."""
    header = NRRD.format(type="uchar", endian="little", encoding="raw")
    header += f"centers: {centers}\n" if centers else ""
    path = put(tmp_path / "a.nrrd", header, "axis mins: 10 -20 5\naxis maxs: 20 -6 21\n\n", F.tobytes())
    volume = load(path)
    assert volume.spacing == pytest.approx(spacing) and volume.origin == pytest.approx(origin)
    assert len(volume.notes) == (not centers)
    path = put(tmp_path / "b.nrrd", header, "axis mins: 20 -20 5\naxis maxs: 10 -6 21\n\n", F.tobytes())
    assert load(path).direction[0, 0] == -1 and load(path).spacing == pytest.approx(spacing)
    given = put(
        tmp_path / "c.nrrd", header, "spacings: 1 1 nan\naxis mins: nan nan 5\naxis maxs: nan nan 21\n\n", F.tobytes()
    )
    assert load(given).spacing == pytest.approx((1, 1, spacing[2]))
    with pytest.raises(InputError, match="axis mins: expected one per axis"):
        load(put(tmp_path / "d.nrrd", header, "axis mins: 10 -20\naxis maxs: 20 -6\n\n", F.tobytes()))


def test_nrrd_says_what_it_does_not_restore(tmp_path: Path) -> None:
    header = NRRD.format(type="uchar", endian="little", encoding="raw") + "old min: -1\nold max: 3\nsample units: K\n"
    volume = load(put(tmp_path / "a.nrrd", header, "space: scanner-xyz\n", DIRECTIONS, "\n", F.tobytes()))
    assert volume.value_unit == "K" and ["quantized" in volume.notes[1], "scanner" in volume.notes[0]] == [True, True]


LAYERS = ["1 0", "2 0", "1 1"]


@pytest.mark.parametrize("tags", ["layers", "before layers"])
def test_segments_of_3d_slicer_are_named_by_their_layer(tmp_path: Path, tags: str) -> None:
    """The same number means another segment in another layer; of older files each segment is a layer of its own."""
    names = ["liver", "bone", "tumour"] if tags == "layers" else ["liver", "bone"]
    values = np.zeros((2, 4, 7, 5), np.uint8)
    values[0, 1:3], values[1, 2:4] = 1, 1
    values[0, :, 0] = 2 if tags == "layers" else 0
    header = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 5 7 4\nencoding: raw\nkinds: list domain domain domain\n"
    header += SPACE + DIRECTIONS.replace("directions: ", "directions: none ")
    for n, name in enumerate(names):
        header += f"Segment{n}_ID:=Segment_{n}\nSegment{n}_Name:={name}\nSegment{n}_Color:=1 0 0.{n}\n"
        if tags == "layers":
            number, layer = LAYERS[n].split()
            header += f"Segment{n}_LabelValue:={number}\nSegment{n}_Layer:={layer}\n"
    path = put(tmp_path / "a.seg.nrrd", header, "\n", np.moveaxis(values, 0, -1).tobytes())
    volume = load(path)
    told = [[label.name for label in part.labels or ()] for part in volume.channels]
    assert told == ([["liver", "bone"], ["tumour"]] if tags == "layers" else [["liver"], ["bone"]])
    assert [part.name for part in volume.channels] == [", ".join(each) for each in told]
    for part, right in zip(volume.channels, values, strict=True):
        np.testing.assert_array_equal(part.samples, right)
    second = load(path, channel=1)
    assert [label.name for label in second.labels or ()] == told[1] and not second.channels
    check_grid = volume.channels[1]
    np.testing.assert_allclose(check_grid.world_from_index, Q * SPACING)


def test_nrrd_channel(tmp_path: Path) -> None:
    header = "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 5 7 4\nencoding: raw\n" + SPACE
    header += DIRECTIONS.replace("directions: ", "directions: none ") + "\n"
    path = put(tmp_path / "letter.nrrd", header, np.stack([F + 1, F], axis=-1).tobytes())
    with pytest.raises(InputError, match="pick one with channel=0 … channel=1"):
        load(path)
    check(load(path, channel=1), grid=True, frame="LPS", mapped=True)
    # the list of a sequence of 3D Slicer counts times
    header = header.replace("encoding", "kinds: list domain domain domain\nencoding").rstrip("\n")
    header += "\naxis 0 index type:=numeric\naxis 0 index values:=0 0.5\n\n"
    path = put(tmp_path / "letter.nrrd", header, np.stack([F + 1, F], axis=-1).tobytes())
    check(volume := load(path, time=1), grid=True, frame="LPS", mapped=True)
    assert volume.times == 2 and volume.time_step == 0.5


# --- NIfTI -----------------------------------------------------------------------------------------------------------


def nifti(path: Path, samples: np.ndarray, slope: float = 1.0, intercept: float = 0.0, oriented: bool = True) -> Path:
    nibabel = pytest.importorskip("nibabel")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = Q * SPACING, ORIGIN
    image = nibabel.Nifti1Image(samples.T, affine if oriented else None)
    image.header.set_xyzt_units("mm")
    image.header.set_slope_inter(slope, intercept)
    if not oriented:
        image.header.set_zooms(SPACING)
    image.to_filename(path)
    return path


@pytest.mark.parametrize(("name", "mapped"), [("letter.nii", True), ("letter.nii.gz", False)])
def test_nifti(tmp_path: Path, name: str, mapped: bool) -> None:
    volume = load(nifti(tmp_path / name, F))
    check(volume, grid=True, frame="RAS", mapped=mapped)
    assert volume.unit == "mm" and volume.samples.dtype == np.uint8


def test_nifti_agrees_with_nibabel(tmp_path: Path) -> None:
    """nibabel's own array is [x, y, z], and its own affine takes (x, y, z) to RAS."""
    nibabel = pytest.importorskip("nibabel")
    path = nifti(tmp_path / "letter.nii", F, slope=0.5, intercept=-3.0)
    image, volume = nibabel.load(path), load(path)
    assert volume.samples.dtype == np.float32
    np.testing.assert_allclose(volume.samples, image.get_fdata().T)
    point = np.array([3.0, 5.0, 2.0])
    world = nibabel.affines.apply_affine(image.affine, point)
    np.testing.assert_allclose(volume.world_from_index @ point + volume.origin, world, rtol=1e-6)


def test_nifti_with_two_places(tmp_path: Path) -> None:
    """The sform counts; a note states how far the qform lies from it."""
    nibabel = pytest.importorskip("nibabel")
    for far, notes in ((0.0, 0), (5.0, 1)):
        image = nibabel.Nifti1Image(F.T, None)
        image.set_sform(np.diag([2.0, 2, 3, 1]), 4)
        qform = np.diag([2.0, 2, 3, 1])
        qform[2, 3] = far
        image.set_qform(qform, 1)
        nibabel.save(image, tmp_path / "a.nii")
        volume = load(tmp_path / "a.nii")
        assert volume.origin == (0, 0, 0) and len(volume.notes) == notes
    assert "the qform differs from it by up to 5" in volume.notes[0]


def test_nifti_without_orientation_has_no_frame(tmp_path: Path) -> None:
    volume = load(nifti(tmp_path / "letter.nii", F, oriented=False))
    assert volume.notes == ("no sform or qform: the file does not state the patient's orientation",)
    assert volume.frame is None and volume.origin == (0, 0, 0)
    np.testing.assert_allclose(volume.spacing, SPACING)
    np.testing.assert_array_equal(volume.direction, np.eye(3))


@pytest.mark.parametrize(("code", "unit"), [(3, "um"), (10, "mm"), (4, ""), (0, "")])
def test_nifti_units(tmp_path: Path, code: int, unit: str) -> None:
    """xyzt_units also holds the unit of time, and in damaged files anything; byte 123 of the header."""
    path = nifti(tmp_path / "letter.nii", F)
    data = bytearray(path.read_bytes())
    data[123] = code
    assert load(put(path, bytes(data))).unit == unit


def test_nifti_time_points(tmp_path: Path) -> None:
    path = nifti(tmp_path / "letter.nii", np.stack([F + 1, F]))
    first = load(path)
    assert first.times == 2 and np.array_equal(first.samples, F + 1) and first.notes
    check(load(path, array="1"), grid=True, frame="RAS", mapped=True)
    check(load(path, time=1), grid=True, frame="RAS", mapped=True)


# --- MetaImage -------------------------------------------------------------------------------------------------------

META = "ObjectType = Image\nNDims = 3\nDimSize = 5 7 4\n"
META_MATRIX = " ".join(map(repr, Q.T.ravel().tolist()))
META_GRID = f"TransformMatrix = {META_MATRIX}\nOffset = 10 -20 30.5\nElementSpacing = 1.5 2.25 3\n"


@pytest.mark.parametrize("order", ["<", ">"])
def test_metaimage_raw_is_mapped(tmp_path: Path, order: str) -> None:
    header = META + META_GRID + f"ElementByteOrderMSB = {order == '>'}\nElementType = MET_SHORT\n"
    data = F.astype(order + "i2").tobytes()
    path = put(tmp_path / "letter.mha", header, "ElementDataFile = LOCAL\n", data)
    check(load(path), grid=True, frame="LPS", mapped=True)
    put(tmp_path / "samples.raw", b"skipped", data)
    path = put(tmp_path / "letter.mhd", header, "HeaderSize = -1\nElementDataFile = samples.raw\n")
    check(load(path), grid=True, frame="LPS", mapped=True)


def test_metaimage_moved_with_its_data(tmp_path: Path) -> None:
    """A header that states where its data were is read with the file of that name beside it."""
    put(tmp_path / "a.raw", F.tobytes())
    for place in (r"C:\scans\a.raw", "/scans/a.raw"):
        header = META + META_GRID + f"ElementType = MET_UCHAR\nElementDataFile = {place}\n"
        check(load(put(tmp_path / "letter.mhd", header)), grid=True, frame="LPS", mapped=True)


def test_metaimage_zlib(tmp_path: Path) -> None:
    data = zlib.compress(F.tobytes())
    header = META + META_GRID + f"CompressedData = True\nCompressedDataSize = {len(data)}\nElementType = MET_UCHAR\n"
    path = put(tmp_path / "letter.mha", header, "ElementDataFile = LOCAL\n", data)
    check(load(path), grid=True, frame="LPS", mapped=False)


def test_metaimage_text_channels_and_fallbacks(tmp_path: Path) -> None:
    header = META + "BinaryData = False\nElementSize = 1.5 2.25 3\nPosition = 1 2 3\nElementNumberOfChannels = 2\n"
    text = " ".join(map(str, np.stack([F + 1, F], axis=-1).ravel()))
    path = put(tmp_path / "letter.mha", header, "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n", text)
    volume = load(path, channel=1)
    np.testing.assert_array_equal(volume.samples, F)
    assert (volume.spacing, volume.origin, volume.frame) == (SPACING, (1, 2, 3), None)


def test_metaimage_of_several_times(tmp_path: Path) -> None:
    """The fourth axis, with its spacing in seconds; all of it stays mapped."""
    times = np.stack([F + n for n in range(3)])
    grid = "NDims = 4\nDimSize = 5 7 4 3\nElementSpacing = 1.5 2.25 3 2\nOffset = 1 2 3 0\n"
    grid += "TransformMatrix = 0 1 0 0 -1 0 0 0 0 0 1 0 0 0 0 1\n"
    path = put(tmp_path / "a.mha", grid, "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n", times.tobytes())
    first, last = load(path), load(path, time=2)
    assert (first.times, first.time_step, first.spacing, first.origin) == (3, 2.0, SPACING, (1, 2, 3))
    np.testing.assert_array_equal(first.samples, F)
    np.testing.assert_array_equal(last.samples, F + 2)
    np.testing.assert_array_equal(last.direction, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert is_mapped(last.samples) and first.notes == ("time 0 of 3: --time picks another",) and not last.notes
    with pytest.raises(InputError, match="time: expected a number from 0 to 2, got 3"):
        load(path, time=3)


def test_metaimage_colors_and_vectors(tmp_path: Path) -> None:
    """Bytes are colours, real or signed numbers vectors of the world; a channel may be picked of both."""
    three = np.stack([F, F // 2, 255 - F], axis=-1)
    header = META + "ElementNumberOfChannels = {}\nElementType = {}\nElementDataFile = LOCAL\n"
    for count in (3, 4):
        data = np.concatenate([three, F[..., None]], axis=-1)[..., :count].tobytes()
        path = put(tmp_path / f"{count}.mha", header.format(count, "MET_UCHAR"), data)
        np.testing.assert_array_equal(load(path).color, three)
        np.testing.assert_array_equal(load(path, channel=1).samples, F // 2)
        assert load(path, channel=1).color is None
    for kind, dtype in (("MET_FLOAT", "<f4"), ("MET_SHORT", "<i2")):
        path = put(tmp_path / f"{kind}.mha", header.format(3, kind), three.astype(dtype).tobytes())
        np.testing.assert_array_equal(load(path).vectors, three)
        np.testing.assert_allclose(load(path).samples, np.linalg.norm(three.astype(float), axis=-1), rtol=1e-6)
    path = put(tmp_path / "u2.mha", header.format(3, "MET_USHORT"), three.astype("<u2").tobytes())
    with pytest.raises(InputError, match="pick one with channel=0"):
        load(path)


@pytest.mark.parametrize("named", ["LIST", "LIST 2D", "LIST 3D", "s%02d.raw 0 6 2", "s%02d.raw 0"])
def test_metaimage_in_files_of_slices(tmp_path: Path, named: str) -> None:
    step = 2 if named.endswith("2") else 1
    names = [f"s{step * n:02}.raw" for n in range(4)]
    if named == "LIST 3D":
        put(tmp_path / names[0], F.astype(">i2").tobytes())
        names = names[:1]
    else:
        for name, plane in zip(names, F, strict=True):
            put(tmp_path / name, plane.astype(">i2").tobytes())
    listed = "\n".join(names) if named.startswith("LIST") else ""
    header = META + META_GRID + "ElementByteOrderMSB = True\nElementType = MET_SHORT\n"
    path = put(tmp_path / "letter.mhd", header, f"ElementDataFile = {named}\n", listed)
    check(load(path), grid=True, frame="LPS", mapped=False)
    put(tmp_path / names[-1], b"cut")
    with pytest.raises(InputError, match="the file is cut short"):
        load(path)


@pytest.mark.parametrize(
    ("letters", "diagonal"), [("RAI", (1, 1, 1)), ("LPI", (-1, -1, 1)), ("RAS", (1, 1, -1)), ("PRS", None), ("???", ())]
)
def test_metaimage_orientation_by_letters(tmp_path: Path, letters: str, diagonal: tuple[int, ...] | None) -> None:
    """Each is the side that an axis comes from; with a matrix they agree, or the matrix is taken and that is told."""
    end = "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    path = put(tmp_path / "a.mha", META, f"AnatomicalOrientation = {letters}\n", end, F.tobytes())
    volume = load(path)
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, -1]])
    expected = turned if diagonal is None else np.diag(diagonal or (1, 1, 1))
    np.testing.assert_array_equal(volume.direction, expected)
    assert volume.frame == ("LPS" if letters != "???" else None) and volume.notes == ()
    matrix = "TransformMatrix = 1 0 0 0 1 0 0 0 1\n"
    path = put(tmp_path / "b.mha", META, matrix, f"AnatomicalOrientation = {letters}\n", end, F.tobytes())
    volume = load(path)
    assert np.array_equal(volume.direction, np.eye(3)) and volume.frame == "LPS"
    assert len(volume.notes) == (letters not in ("RAI", "???"))


def test_metaimage_scale_that_is_not_applied_is_told(tmp_path: Path) -> None:
    scale = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = 0\n"
    end = "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    (note,) = load(put(tmp_path / "a.mha", META, scale, end, F.tobytes())).notes
    assert "ElementToIntensityFunction" in note
    assert not load(put(tmp_path / "b.mha", META, scale.replace("= 2", "= 1"), end, F.tobytes())).notes


# --- nothing is read before it is asked for --------------------------------------------------------------------------

BIG = (512, 256, 256)
"""Voxels along x, y, z of a sparse file of 32 MiB, which takes no room on disk."""


def sparse(path: Path, header: str | bytes) -> Path:
    put(path, header)
    with path.open("r+b") as file:
        file.truncate(len(header) + 512 * 256 * 256)
    return path


def big_nifti(folder: Path) -> Path:
    path = nifti(folder / "big.nii", np.zeros((1, 1, 1), np.uint8))
    header = bytearray(path.read_bytes()[:352])
    header[42:48] = np.array(BIG, "<i2").tobytes()
    return sparse(path, bytes(header))


def big_npy(folder: Path) -> Path:
    np.save(folder / "big.npy", np.zeros((1, 1, 1), np.uint8))
    header = (folder / "big.npy").read_bytes()[:128].replace(b"(1, 1, 1), }        ", b"(256, 256, 512), }  ")
    return sparse(folder / "big.npy", header)


SIZE = " ".join(map(str, BIG))
MAPPED: dict[str, Writer] = {
    "raw": lambda folder: sparse(folder / "big_512x256x256_uint8.raw", b""),
    "npy": big_npy,
    "nrrd": lambda folder: sparse(
        folder / "big.nrrd", f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {SIZE}\nencoding: raw\n\n"
    ),
    "nifti": big_nifti,
    "metaimage": lambda folder: sparse(
        folder / "big.mha", f"NDims = 3\nDimSize = {SIZE}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
    ),
    "vtk": lambda folder: sparse(
        folder / "big.vtk",
        f"# vtk DataFile Version 3.0\nbig\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS {SIZE}\n"
        "POINT_DATA 33554432\nSCALARS s unsigned_char\nLOOKUP_TABLE default\n",
    ),
}


@pytest.mark.parametrize("kind", MAPPED)
def test_a_file_that_can_be_mapped_is_not_read(tmp_path: Path, kind: str) -> None:
    path = MAPPED[kind](tmp_path)
    load(path)  # imports
    tracemalloc.start()
    volume = load(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert volume.shape == BIG[::-1] and is_mapped(volume.samples)
    assert peak < 2**20


COMMENT = 15_000 * "long "
COMMENTED = {
    "a.nrrd": f"NRRD0004\n# {COMMENT}\ntype: uchar\ndimension: 3\nsizes: 2 2 2\nencoding: raw\n\n",
    "a.mha": f"Comment = {COMMENT}\nNDims = 3\nDimSize = 2 2 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
    "a.vtk": f"# vtk DataFile Version 3.0\n{COMMENT}\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n"
    "POINT_DATA 8\nSCALARS s unsigned_char\nLOOKUP_TABLE default\n",
}


@pytest.mark.parametrize("name", COMMENTED)
def test_comments_may_be_long(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(COMMENTED[name].encode() + bytes(range(8)))
    assert load(tmp_path / name).samples.ravel().tolist() == list(range(8))


# --- the phantom ------------------------------------------------------------------------------------------------------


def test_phantom_tells_every_turn_and_flip_apart() -> None:
    turned = [F.transpose(order) for order in ((0, 2, 1), (1, 0, 2), (2, 1, 0))]
    flipped = [np.flip(F, axis) for axis in range(3)]
    assert all(other.shape != F.shape or (other != F).any() for other in turned + flipped)
    assert np.linalg.norm(Q - Q.T) > 0.5 and np.allclose(Q @ Q.T, np.eye(3))

"""Written files: what comes back, what the formats' own libraries read, and what is refused or told."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import writers
from splatgl.cli.main import main
from splatgl.data.color import luma
from splatgl.data.volume import Hints, Label
from splatgl.writers import TARGETS, save

for library in ("nibabel", "nrrd", "tifffile", "zarr"):
    pytest.importorskip(library, reason="needs the extra readers")
Said = pytest.CaptureFixture[str]
SUFFIXES = [suffix for target in TARGETS if "images" not in target.holds for suffix in target.suffixes]
PLACED = (".nii", ".nii.gz", ".nrrd", ".mha", ".zarr")
# x runs to the left's opposite, y down, z forwards; and a sheared grid
TURN = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
SHEAR = np.array([[1.0, 0.6, 0.0], [0.0, 0.8, 0.0], [0.0, 0.0, -1.0]])
GRID: dict[str, Any] = {"spacing": (0.5, 0.75, 2.0), "origin": (-3.0, 10.5, 7.0), "unit": "mm", "frame": "LPS"}
TABLE = (Label(1, "liver", "#c08040"), Label(7, 'the "left" kidney', "#00ff10", 0.5, True))


def numbers(dtype: str, rng: np.random.Generator) -> np.ndarray:
    """Samples [3, 5, 7] up to the ends of a type; of floats with NaN and infinity."""
    kind = np.dtype(dtype)
    if kind.kind == "b":
        return np.asarray(rng.random((3, 5, 7)) > 0.5)
    if kind.kind == "f":
        samples = rng.normal(size=(3, 5, 7)).astype(dtype)
        samples[1, 2, 3], samples[0, 0, 0] = np.nan, np.inf
        return samples
    info = np.iinfo(kind)
    samples = rng.integers(info.min, info.max, (3, 5, 7), np.dtype(kind).newbyteorder("="), endpoint=True)
    samples[0, 0, :2] = info.min, info.max
    return samples.astype(dtype)


def assert_placed(read: sg.Volume, right: sg.Volume) -> None:
    """The same places of voxels in the same frame; NIfTI rounds to float32."""
    read = read.placed(right.frame)
    assert read.frame == right.frame and read.unit == right.unit
    assert np.allclose(read.world_from_index, right.world_from_index, rtol=0, atol=1e-6)
    assert np.allclose(read.origin, right.origin, rtol=0, atol=1e-6)


@pytest.mark.parametrize("suffix", PLACED)
@pytest.mark.parametrize("direction", [pytest.param(TURN, id="turned"), pytest.param(SHEAR, id="sheared")])
def test_grids_come_back(suffix: str, direction: np.ndarray, tmp_path: Path, rng: np.random.Generator) -> None:
    volume = sg.Volume(numbers(">f4", rng), direction=direction, **GRID)
    for frame in ("LPS", "RAS"):
        notes = (placed := volume.placed(frame)).save(tmp_path / f"{frame}{suffix}")
        assert len(notes) == (suffix == ".zarr")
        read = sg.load(tmp_path / f"{frame}{suffix}")
        assert np.array_equal(read.samples, volume.samples, equal_nan=True)
        assert_placed(read, placed)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_plain_grid_comes_back_without_a_word(suffix: str, tmp_path: Path, rng: np.random.Generator) -> None:
    volume = sg.Volume(numbers("u2", rng), (0.5, 0.75, 2.0), unit="um")
    notes = volume.save(tmp_path / f"a{suffix}")
    read = sg.load(tmp_path / f"a{suffix}")
    assert np.array_equal(read.samples, volume.samples) and read.frame is None and read.origin == (0, 0, 0)
    if suffix == ".npy":
        assert notes == ("NumPy holds no spacing",)
    else:
        assert notes == () and read.spacing == volume.spacing and read.unit == "um"


@pytest.mark.parametrize("suffix", [".nii", ".nrrd", ".mha", ".ome.tif", ".zarr", ".npy"])
def test_types_keep_their_numbers(suffix: str, tmp_path: Path, rng: np.random.Generator) -> None:
    for dtype in ("u1", "i1", ">u2", "i2", ">i4", "u4", "i8", ">u8", "Q", "f2", ">f4", ">f8", "?"):
        samples = numbers(dtype, rng)
        path = tmp_path / f"{dtype.strip('>?')}{suffix}"
        if suffix == ".ome.tif" and dtype in ("i8", ">u8", "Q"):
            with pytest.raises(sg.InputError, match="samples: expected numbers that OME-TIFF holds exactly"):
                sg.Volume(samples).save(path)
            assert not path.exists()
            continue
        sg.Volume(samples).save(path)
        read = np.asarray(sg.load(path, values="amounts").samples[:])
        assert np.array_equal(read, samples, equal_nan=samples.dtype.kind == "f")
        assert read.dtype.byteorder in "=|<" and (read.dtype.kind == samples.dtype.kind or dtype == "?")


def test_long_integers_of_ome_take_the_type_that_holds_them(tmp_path: Path) -> None:
    for low, high, kept in ((0, 70_000, "int32"), (0, 2**32 - 1, "uint32"), (-(2**40), 2**40, "float64")):
        notes = sg.Volume(np.array([[[low, high]]])).save(tmp_path / "a.ome.tif")
        assert notes == (f"samples: int64 is written as {kept}, as OME-TIFF has no other",)
        assert sg.load(tmp_path / "a.ome.tif").samples.tolist() == [[[low, high]]]


@pytest.mark.parametrize("source", [*SUFFIXES[:5], ".zarr", ".npy"])
def test_every_pair(source: str, tmp_path: Path, rng: np.random.Generator, capsys: Said) -> None:
    volume = sg.Volume(rng.integers(-900, 900, (3, 5, 7)).astype(">i2"), direction=TURN, **GRID)
    volume.save(first := tmp_path / f"a{source}")
    before = sg.load(first)
    for suffix in SUFFIXES:
        last = tmp_path / f"b{suffix}"
        assert main(["convert", str(first), str(last), "--quiet"]) == 0
        read = sg.load(last)
        assert np.array_equal(read.samples, volume.samples)
        if suffix in PLACED and before.frame:
            assert_placed(read, volume)
        elif suffix != ".npy":
            assert (read.spacing, read.unit) == (before.spacing, before.unit)
    assert capsys.readouterr() == ("", "")


def test_nibabel_reads_the_same(tmp_path: Path, rng: np.random.Generator) -> None:
    import nibabel

    volume = sg.Volume(numbers("f4", rng), direction=TURN, **GRID)
    volume.save(tmp_path / "a.nii.gz")
    image: Any = nibabel.load(tmp_path / "a.nii.gz")
    assert np.array_equal(np.asarray(image.dataobj).T, volume.samples, equal_nan=True)
    turned = volume.placed("RAS")
    assert np.allclose(image.affine[:3, :3], turned.world_from_index, atol=1e-6)
    assert np.allclose(image.get_qform(), image.affine, atol=1e-6) and image.header.get_xyzt_units()[0] == "mm"
    # colours, and vectors along the world's axes of the file
    color = rng.integers(0, 256, (3, 5, 7, 3)).astype(np.uint8)
    sg.Volume(luma(color), color=color).save(tmp_path / "c.nii")
    rgb = np.asarray(nibabel.load(tmp_path / "c.nii").dataobj)
    assert np.array_equal(np.stack([rgb[name] for name in "RGB"], axis=-1).transpose(2, 1, 0, 3), color)
    vectors = rng.normal(size=(3, 5, 7, 3)).astype(np.float32)
    lengths = np.linalg.norm(vectors, axis=-1)
    sg.Volume(lengths, vectors=vectors, direction=TURN, **GRID).save(tmp_path / "v.nii")
    image = nibabel.load(tmp_path / "v.nii")
    assert image.shape == (7, 5, 3, 1, 3) and image.header.get_intent()[0] == "vector"
    assert np.array_equal(
        np.asarray(image.dataobj)[:, :, :, 0].transpose(2, 1, 0, 3), vectors * np.float32([-1, -1, 1])
    )
    # sizes beyond 16 bits
    sg.Volume(np.zeros((1, 1, 40_000), np.uint8)).save(tmp_path / "long.nii")
    assert nibabel.load(tmp_path / "long.nii").shape == (40_000, 1, 1)


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha"])
def test_simpleitk_reads_the_same(suffix: str, tmp_path: Path, rng: np.random.Generator) -> None:
    itk = pytest.importorskip("SimpleITK", reason="needs SimpleITK")
    volume = sg.Volume(numbers("i2", rng), direction=TURN, **GRID)
    volume.save(tmp_path / f"a{suffix}")
    image = itk.ReadImage(str(tmp_path / f"a{suffix}"))
    assert np.array_equal(itk.GetArrayFromImage(image), volume.samples)
    assert np.allclose(image.GetSpacing(), volume.spacing) and np.allclose(image.GetOrigin(), volume.origin)
    assert np.allclose(np.reshape(image.GetDirection(), (3, 3)), TURN)


def test_pynrrd_reads_the_same(tmp_path: Path, rng: np.random.Generator) -> None:
    import nrrd

    volume = sg.Volume(numbers(">f8", rng), direction=SHEAR, value_unit="HU", **GRID)
    volume.save(tmp_path / "a.nrrd")
    data, header = nrrd.read(str(tmp_path / "a.nrrd"))
    assert np.array_equal(data.T, volume.samples, equal_nan=True)
    assert np.array_equal(header["space directions"], volume.world_from_index.T)
    assert header["space"] == "left-posterior-superior" and header["space units"] == ["mm"] * 3
    assert sg.load(tmp_path / "a.nrrd").value_unit == "HU"


def channels_of(rng: np.random.Generator) -> sg.Volume:
    """Two channels with names, colours and windows."""
    rows = (("DAPI", "#0000ff", (10.0, 900.0)), ("GFP", "#12ff80", (0.0, 4000.0)))
    parts = tuple(
        sg.Volume(numbers("u2", rng), (0.5, 0.5, 2.0), unit="um", name=name, hints=Hints(color=color, window=window))
        for name, color, window in rows
    )
    return replace(parts[0], channels=parts, name="cells")


@pytest.mark.parametrize("suffix", [".ome.tif", ".zarr"])
def test_channels_keep_names_and_colours(suffix: str, tmp_path: Path, rng: np.random.Generator) -> None:
    volume = channels_of(rng)
    assert volume.save(tmp_path / f"a{suffix}") == ()
    read = sg.load(tmp_path / f"a{suffix}")
    for part, right in zip(read.channels, volume.channels, strict=True):
        assert np.array_equal(part.samples[:], right.samples)
        assert (part.name, part.hints.color, part.spacing, part.unit) == (
            right.name,
            right.hints.color,
            (0.5, 0.5, 2),
            "um",
        )
        assert suffix != ".zarr" or part.hints.window == right.hints.window
    if suffix == ".ome.tif":
        import tifffile

        with tifffile.TiffFile(tmp_path / "a.ome.tif") as tiff:
            assert tiff.series[0].axes == "CZYX"
            assert np.array_equal(tiff.asarray(), [part.samples for part in volume.channels])
            assert 'PhysicalSizeZ="2.0"' in str(tiff.ome_metadata) and 'Name="GFP"' in str(tiff.ome_metadata)
    with pytest.raises(sg.InputError, match=r"channels: expected one in a NIfTI file, got 2 \(DAPI, GFP\); pick one"):
        volume.save(tmp_path / "a.nii")


def test_colours_come_back(tmp_path: Path, rng: np.random.Generator) -> None:
    color = rng.integers(0, 256, (3, 5, 7, 3)).astype(np.uint8)
    volume = sg.Volume(luma(color), (1, 2, 3), color=color, unit="mm")
    for suffix in (".nrrd", ".mha", ".ome.tif", ".nii.gz", ".npy"):
        assert volume.save(tmp_path / f"a{suffix}") == ("NumPy holds no spacing",) * (suffix == ".npy")
        assert np.array_equal(sg.load(tmp_path / f"a{suffix}").color, color)
    volume.save(tmp_path / "a.zarr")
    read = sg.load(tmp_path / "a.zarr").channels
    assert np.array_equal(np.stack([part.samples[:] for part in read], axis=-1), color)
    assert [part.hints.color for part in read] == ["#ff0000", "#00ff00", "#0000ff"]
    vectors = rng.normal(size=(3, 5, 7, 3)).astype(np.float32)
    lengths = np.linalg.norm(vectors, axis=-1)
    field = sg.Volume(lengths, vectors=vectors, direction=TURN, **GRID).placed("RAS")
    for suffix in (".nrrd", ".mha", ".nii"):
        field.save(tmp_path / f"v{suffix}")
        assert np.array_equal(sg.load(tmp_path / f"v{suffix}").placed("LPS").vectors, vectors)
    assert field.save(tmp_path / "v.ome.tif")[0].endswith("vectors in addition to samples")
    # samples that say something else
    assert replace(field, samples=volume.samples).save(tmp_path / "s.nrrd") == (
        "NRRD holds no vectors in addition to samples",
    )
    assert np.array_equal(sg.load(tmp_path / "s.nrrd").samples, volume.samples)
    notes = replace(volume, samples=volume.samples + 1).save(tmp_path / "s.mha")
    assert notes == ("samples are not written where there are colours",)


@pytest.mark.parametrize("suffix", [".nii", ".nrrd", ".mha", ".ome.tif", ".zarr"])
def test_times_come_back(suffix: str, tmp_path: Path, rng: np.random.Generator, capsys: Said) -> None:
    frames = [sg.Volume(numbers("i2", rng), (1, 1, 2), unit="mm", times=3, time_step=0.25) for _ in range(3)]
    save(frames[0], tmp_path / f"a{suffix}", 3, frames.__getitem__)
    # through another file, in which the middle one is missing
    assert main(["convert", str(tmp_path / f"a{suffix}"), str(tmp_path / "b.nrrd"), "--time", "0:3:2"]) == 0
    assert "2 time points" in capsys.readouterr().out
    for path, kept, step in ((f"a{suffix}", frames, 0.25), ("b.nrrd", frames[::2], 0.5)):
        for number, frame in enumerate(kept):
            read = sg.load(tmp_path / path, time=number)
            assert np.array_equal(read.samples[:], frame.samples)
            assert (read.times, read.time_step, read.spacing) == (len(kept), step, (1, 1, 2))
    assert main(["convert", str(tmp_path / f"a{suffix}"), str(tmp_path / "c.npy"), "--time", "1"]) == 0
    assert np.array_equal(np.load(tmp_path / "c.npy"), frames[1].samples)
    assert main(["convert", str(tmp_path / f"a{suffix}"), str(tmp_path / "d.npy")]) == 0
    assert "time 0 of 3" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha", ".ome.tif", ".zarr", ".npy"])
def test_labels_keep_names_and_colours(suffix: str, tmp_path: Path, rng: np.random.Generator) -> None:
    samples = rng.choice(np.array([0, 1, 7]), (3, 5, 7))
    notes = sg.Volume(samples, labels=TABLE).save(tmp_path / f"a{suffix}")
    beside = [] if suffix in (".nrrd", ".zarr") else [f"a{'.ome' * (suffix == '.ome.tif')}.label"]
    assert [path.name for path in tmp_path.glob("*.label")] == beside
    assert [note for note in notes if "labels" in note] == [
        f"names and colours of labels are in {name}" for name in beside
    ]
    read = sg.load(tmp_path / f"a{suffix}")
    assert np.array_equal(read.samples[:], samples)
    assert [(label.number, label.color) for label in read.labels or ()] == [(1, "#c08040"), (7, "#00ff10")]
    assert read.labels and read.labels[0].name == "liver"
    if beside:
        assert read.labels == (TABLE[0], replace(TABLE[1], name="the  left  kidney"))


def test_a_table_of_labels_of_an_older_file_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.nii.gz"
    sg.Volume(np.ones((2, 3, 4), np.uint8), labels=TABLE).save(path)
    notes = sg.Volume(np.ones((2, 3, 4), np.uint8)).save(path)
    assert notes == ("a.label names numbers of a.nii.gz: remove it if it is of another",)
    assert sg.Volume(np.ones((2, 3, 4), np.float32)).save(path) == ()


def test_layers_of_segments_come_back(tmp_path: Path, rng: np.random.Generator) -> None:
    parts = [sg.Volume(rng.integers(0, 2, (3, 5, 7)).astype(np.uint8), labels=(Label(1, name),)) for name in "ab"]
    volume = replace(parts[0], channels=tuple(parts), labels=(Label(1, "a"), Label(1, "b")))
    volume.save(tmp_path / "a.seg.nrrd")
    read = sg.load(tmp_path / "a.seg.nrrd").channels
    assert [part.name for part in read] == ["a", "b"]
    assert all(np.array_equal(part.samples, right.samples) for part, right in zip(read, parts, strict=True))


def test_units_that_a_format_lacks_are_converted(tmp_path: Path) -> None:
    volume = sg.Volume(np.zeros((2, 2, 2), np.uint8), (4, 8, 8), (8, 0, 0), unit="nm")
    notes = volume.save(tmp_path / "a.nii")
    assert "unit: nm is written as um, as NIfTI has no other" in notes
    assert "the frame is unknown, and NIfTI has only RAS: it is read as that" in notes
    read = sg.load(tmp_path / "a.nii")
    assert read.spacing == pytest.approx((0.004, 0.008, 0.008)) and read.origin[0] == pytest.approx(0.008)


@pytest.mark.parametrize("labels", [None, ()])
def test_stores_have_levels(labels: Any, tmp_path: Path, rng: np.random.Generator) -> None:
    """Of an odd size, in boxes smaller than a level: means, or the most frequent numbers, over 2×2×2 voxels."""
    import zarr

    samples = rng.integers(0, 4, (3, 131, 260)).astype(np.uint8)
    volume = sg.Volume(samples, (1, 1, 3), (5, 6, 7), labels=labels)
    volume.save(tmp_path / "a.zarr")
    group = zarr.open_group(tmp_path / "a.zarr", mode="r")
    told = dict(group.attrs)["ome"]
    assert group.metadata.zarr_format == 3 and told["version"] == "0.5" and "version" not in told["multiscales"][0]
    assert group["0"].metadata.dimension_names == ("z", "y", "x")
    assert [group[str(n)].shape for n in range(4)] == [(3, 131, 260), (3, 66, 130), (3, 33, 65), (3, 17, 33)]
    assert np.array_equal(group["0"][:], samples)
    blocks = np.pad(samples, [(0, 0), (0, 1), (0, 0)], mode="edge").reshape(3, 66, 2, 130, 2)
    if labels is None:
        assert np.array_equal(group["1"][:], np.rint(blocks.mean(axis=(2, 4))))
    else:
        votes = np.stack([(blocks == n).sum(axis=(2, 4)) for n in range(4)])
        assert np.array_equal(np.take_along_axis(votes, group["1"][:][None], 0)[0], votes.max(axis=0))
    read = sg.load(tmp_path / "a.zarr").coarser[0]
    assert (read.spacing, read.origin) == ((2, 2, 3), (5.5, 6.5, 7))


class Watched:
    """Samples that are read in parts; counts the bytes of the largest part."""

    def __init__(self, samples: np.ndarray) -> None:
        self.samples, self.shape, self.dtype, self.most = samples, samples.shape, samples.dtype, 0

    def __getitem__(self, key: Any) -> np.ndarray:
        part = self.samples[key]
        self.most = max(self.most, part.nbytes)
        return part


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha", ".ome.tif", ".npy"])
def test_large_samples_are_read_in_slabs(
    suffix: str, tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writers, "SLAB_BYTES", 200)
    watched = Watched(rng.integers(0, 9, (9, 5, 7)).astype(np.int16))
    sg.Volume(watched).save(tmp_path / f"a{suffix}")
    assert watched.most == 2 * 5 * 7 * 2
    assert np.array_equal(sg.load(tmp_path / f"a{suffix}", values="amounts").samples, watched.samples)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("b.xyz", "expected a name that ends in one of .nii, .nii.gz, .nrrd"),
        ("none/b.nii", "expected a folder that is there, got none named none; make it first"),
        ("a.npy/b.nii", "expected a folder, got the file a.npy"),
        ("folder.nii", "expected a file to write, got a directory"),
        ("full.zarr", "expected a name that is free, got one that is there; remove it first"),
    ],
)
def test_outputs_are_refused_before_anything_is_read(
    name: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Said
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.npy").write_bytes(b"not an array")
    Path("folder.nii").mkdir()
    Path("full.zarr").mkdir()
    assert main(["convert", "a.npy", name]) == 2
    assert message in (said := capsys.readouterr().err) and said.count("\n") == 1
    assert main(["convert", "a.npy", "b.nii"]) == 2 and "a.npy: " in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.npy", "folder.nii", "full.zarr"]


def test_the_source_stays(tmp_path: Path, capsys: Said) -> None:
    np.save(path := tmp_path / "a.npy", np.zeros((2, 2, 2)))
    before = path.read_bytes()
    assert main(["convert", str(path), str(path)]) == 2 and "the source itself" in capsys.readouterr().err
    assert path.read_bytes() == before


@contextmanager
def full_disk(module: Any, name: str, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Writing ends with an error behind the first slab."""

    def end(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(module, name, end)
        yield


def test_a_failed_run_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from splatgl.writers import formats

    volume = sg.Volume(np.ones((2, 3, 4), np.uint8), labels=TABLE)
    (path := tmp_path / "a.nii").write_bytes(b"old")
    path.chmod(0o600)
    with full_disk(formats, "_write_slabs", monkeypatch), pytest.raises(sg.InputError, match="No space left"):
        volume.save(path)
    with full_disk(formats, "describe_levels", monkeypatch), pytest.raises(sg.InputError, match="No space left"):
        volume.save(tmp_path / "a.zarr")
    assert path.read_bytes() == b"old" and [file.name for file in tmp_path.iterdir()] == ["a.nii"]
    volume.save(path)
    assert path.stat().st_mode & 0o777 == 0o600


def test_crops(tmp_path: Path, rng: np.random.Generator, capsys: Said) -> None:
    volume = replace(channels_of(rng), origin=(1, 2, 3))
    volume = replace(volume, channels=tuple(replace(part, origin=(1, 2, 3)) for part in volume.channels))
    volume.save(tmp_path / "a.zarr")
    crop = ["convert", str(tmp_path / "a.zarr"), str(tmp_path / "b.zarr"), "--crop"]
    assert main([*crop, "2:-1,1:,:2"]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'b.zarr'}: OME-Zarr, 4 × 4 × 2\n"
    read = sg.load(tmp_path / "b.zarr")
    assert read.origin == (2.0, 2.5, 3.0) and read.channels[1].name == "GFP"
    assert np.array_equal(read.channels[1].samples[:], volume.channels[1].samples[:2, 1:, 2:-1])
    assert main(["convert", str(tmp_path / "a.zarr"), str(tmp_path / "c.zarr"), "--crop", "9:,:,:"]) == 2
    # a level in parts, read through the window
    window = sg.Volume(Watched(np.arange(210).reshape(5, 6, 7)))
    from splatgl.cli.export import crop_volume

    cut = crop_volume(window, "1:6,2:5,:3")
    assert np.array_equal(cut.samples[1:3, 0, ::2], window.samples.samples[:3, 2:5, 1:6][1:3, 0, ::2])
    assert np.array_equal(cut.samples[-1], window.samples.samples[2, 2:5, 1:6])

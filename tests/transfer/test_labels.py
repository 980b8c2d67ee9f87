"""Segmentations: a colour a label, nothing between two numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.data.volume import Label
from splatgl.scene.view import ViewOptions
from splatgl.transfer.colormaps import COLORS, colors_of
from splatgl.transfer.presets import label_transfer

pytestmark = pytest.mark.usefixtures("shared_programs")

TABLE = (Label(2, "liver", "#ff0000"), Label(7, "bone", "#00ff00"), Label(9, "vein"))


def segments(dtype: type = np.uint8, labels: tuple[Label, ...] | None = TABLE) -> sg.Volume:
    """Three blocks that touch; between numbers 2 and 9 lies 7."""
    samples: np.ndarray = np.zeros((16, 16, 24), dtype)
    samples[4:12, 4:12, 4:10], samples[4:12, 4:12, 10:16], samples[4:12, 4:12, 16:20] = 2, 9, 7
    return sg.Volume(samples, name="segments", labels=labels)


def colors(splats: sg.Splats) -> set[str]:
    srgb = {tuple(row) for row in np.rint(linear_srgb(splats.colors) * 255).astype(int).tolist()}
    return {"#{:02x}{:02x}{:02x}".format(*row) for row in srgb}


def linear_srgb(linear: np.ndarray) -> np.ndarray:
    levels = linear_from_srgb(np.arange(256) / 255)
    return np.abs(linear[..., None] - levels).argmin(axis=-1) / 255


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.int32])
def test_each_voxel_has_the_colour_of_its_label(dtype: type) -> None:
    volume = segments(dtype)
    splats = sg.extract(volume, sg.default_transfer(volume))
    assert splats.post is None and splats.source is not None and splats.source.only_pre == "labels"
    assert len(splats) == np.count_nonzero(volume.samples)
    assert colors(splats) == {"#ff0000", "#00ff00", colors_of([9])[0]}
    x, y, z = splats.positions.T.astype(int)
    numbers = volume.samples[z, y, x]
    for number, color in ((2, "#ff0000"), (7, "#00ff00"), (9, colors_of([9])[0])):
        assert colors(splats.part(numbers == number)) == {color}


def test_no_colour_lies_between_two(renderer: sg.Renderer) -> None:
    """Neighbours mix as light at the edge of their voxels; never to the colour of 7 between 2 and 9."""
    volume = segments(labels=(Label(2, "", "#ff0000"), Label(7, "", "#00ff00"), Label(9, "", "#0000ff")))
    splats = sg.extract(volume, label_transfer(volume))
    camera = sg.Camera.orthographic((10, -30, 7.5), (10, 0, 7.5), (0, 0, 1), height=6.0, size=(36, 6))
    left = renderer.render(splats.part(splats.positions[:, 0] < 16), camera, sg.Settings(shading="off"))
    assert left.pixels[:, :, 1].max() < 1e-6 and left.pixels[:, :, 0].max() > 0.9 < left.pixels[:, :, 2].max()


def test_some_labels_and_their_opacities() -> None:
    volume = segments()
    transfer = label_transfer(volume, [(7, 1.0), (2, 0.5)])
    assert tuple(transfer.labels) == ((2, "#ff0000", 0.495), (7, "#00ff00", 0.99))
    assert transfer.weakened(0.1).labels[1] == (7, "#00ff00", pytest.approx(0.099))
    splats = sg.extract(volume, transfer)
    assert len(splats) == np.isin(volume.samples, (2, 7)).sum()
    found = -np.expm1(-np.unique(splats.depths))
    assert np.allclose(found, [0.495, 0.99], atol=1e-6)
    assert sg.Transfer.from_toml(transfer.to_toml()) == transfer
    with pytest.raises(sg.InputError, match=r"only_labels: expected some of 2, 7, 9, got 3"):
        label_transfer(volume, [(3, 1.0)])


@pytest.mark.long
def test_numbers_without_a_table_have_colours_of_their_own() -> None:
    """The same for each number in every file; 0 is the background."""
    volume = segments(labels=None)
    assert sg.default_transfer(volume).labels == tuple((n, colors_of([n])[0], 0.99) for n in (2, 7, 9))
    many = colors_of(range(1, 200))
    assert len(set(many)) == 199 and all(color in many for color in COLORS)
    two = sg.Volume((segments().samples > 0).astype(np.uint8))
    assert not sg.default_transfer(two).labels
    with pytest.raises(sg.InputError, match=r"whole numbers, each of a segment, got values such as 0\.5;"):
        label_transfer(sg.Volume(np.full((2, 2, 2), 0.5, np.float32)))
    noise = sg.Volume(np.arange(2**20 + 2, dtype=np.uint32).reshape(2, 1, -1), labels=())
    with pytest.raises(sg.InputError, match="at most 1048576 labels"):
        sg.default_transfer(noise)


def test_normals_are_those_of_what_is_shown() -> None:
    """Not of the numbers: a ball of two labels is lit as one; slabs of planes change nothing."""
    r = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0)
    samples = np.where(r < 8, 3, 0).astype(np.uint8)
    samples[:, :, 12:][samples[:, :, 12:] > 0] = 200
    volume = sg.Volume(samples, labels=())
    splats = sg.extract(volume, label_transfer(volume), classification="pre")
    outward = splats.positions - 11.5
    normal = splats.records["normal"].astype(np.float64)
    rim = np.linalg.norm(outward, axis=1) > 7
    lengths = np.linalg.norm(outward, axis=1) * np.linalg.norm(normal, axis=1)
    cosine = np.abs((outward * normal).sum(axis=1))[rim] / lengths[rim]
    assert cosine.min() > 0.93
    for slab in (1, 3):
        other = sg.extract(volume, label_transfer(volume), slab=slab, classification="pre")
        assert np.array_equal(other.records, splats.records)
        assert other.labels is not None and splats.labels is not None
        assert np.array_equal(other.labels.faced, splats.labels.faced)


@pytest.mark.parametrize(
    "labels", [3, [(1, "red", 0.5)], [(1.5, "#ff0000", 0.5)], [(1, "#ff0000", 2)], [(1, "#ff0000", 1)] * 2, [(1, 2)]]
)
def test_bad_labels_are_told(labels: Any) -> None:
    with pytest.raises(sg.InputError, match="labels: expected"):
        sg.Transfer([(0, 1)], labels=list(labels) if isinstance(labels, list) else [labels])


@pytest.mark.long
def test_labels_of_the_command_line(renderer: sg.Renderer, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Over a volume whose opacities are stated, and by themselves; which are shown."""
    ball, volume = sg.scenes.ball(12), segments()
    np.save(tmp_path / "ball.npy", ball.samples)
    np.save(tmp_path / "seg.npy", volume.samples)
    out = tmp_path / "a.npy"
    shown = ["--size", "30", "-o", str(out), "--background", "transparent", "--quiet"]
    line = ["render", str(tmp_path / "ball.npy"), *shown]
    look = ["--points", "0.5:0,1:0.4"]
    assert main([*line, *look, "--labels", str(tmp_path / "seg.npy"), "--only-labels", "2,7:0.5"]) == 0
    labels = sg.load(tmp_path / "seg.npy")
    ball = sg.load(tmp_path / "ball.npy")
    seen = sg.Layer(ball, replace(sg.default_transfer(ball), points=[(0.5, 0.0), (1.0, 0.4)]))
    scene = sg.Scene([seen, sg.Layer(labels, label_transfer(labels, [(2, 1.0), (7, 0.5)]))])
    camera = ViewOptions(size=(30, 30)).camera(ball, scene)
    assert np.array_equal(np.load(out), renderer.render(scene, camera).pixels)
    alone = ["render", str(tmp_path / "seg.npy"), *shown]
    assert main([*alone, "--only-labels", "9"]) == 0
    splats = sg.extract(labels, label_transfer(labels, [(9, 1.0)]))
    assert np.array_equal(
        np.load(out), renderer.render(splats, ViewOptions(size=(30, 30)).camera(labels, splats)).pixels
    )
    for more, said in (
        (["--only-labels", "4"], "some of 2, 7, 9, got 4"),
        (["--only-labels", "x"], "expected labels N"),
    ):
        try:
            code = main([*alone, *more])
        except SystemExit as ended:
            code = int(str(ended.code))
        assert code == 2 and said in capsys.readouterr().err


def test_tables_of_files(tmp_path: Path) -> None:
    """3D Slicer's tags, OME-Zarr's image-label, NIfTI's intent; names and colours as stored."""
    nrrd, zarr, nibabel = (pytest.importorskip(name) for name in ("nrrd", "zarr", "nibabel"))
    samples = segments().samples
    header = {"Segment0_LabelValue": "2", "Segment0_Name": "liver", "Segment0_Color": "1 0 0.2"}
    header |= {"Segment1_LabelValue": "7", "Segment1_Name": "bone", "Segment1_Color": "odd"}
    nrrd.write(str(tmp_path / "a.seg.nrrd"), samples.T, header)
    volume = sg.load(tmp_path / "a.seg.nrrd")
    assert volume.labels == (Label(2, "liver", "#ff0033"), Label(7, "bone"))
    assert sg.default_transfer(volume).labels == ((2, "#ff0033", 0.99), (7, colors_of([7])[0], 0.99))
    group = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    group.create_array("0", data=samples, chunks=samples.shape)
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": [{"path": "0"}]}]
    group.attrs["image-label"] = {"colors": [{"label-value": 9, "rgba": [0, 255, 16, 255]}, {"label-value": 0}]}
    assert sg.load(tmp_path / "a.zarr").labels == (Label(9, "", "#00ff10"),)
    image = nibabel.Nifti1Image(samples.T, np.eye(4))
    image.header.set_intent("label")
    image.to_filename(tmp_path / "a.nii")
    assert [n for n, _, _ in sg.default_transfer(sg.load(tmp_path / "a.nii")).labels] == [2, 7, 9]


SNAP = """################################################
# ITK-SnAP Label Description File
# File format:
# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL
################################################
    0     0    0    0        0  0  0    "Clear Label"
    2   255    0    0        1  1  1    "liver"
    9     0    0  255      0.5  1  1    "vena, \u00e9paisse"
"""


@pytest.mark.parametrize("name", ["seg.label", "seg.lbl", "seg.txt"])
def test_itk_snaps_table_beside_a_segmentation(tmp_path: Path, name: str) -> None:
    nibabel = pytest.importorskip("nibabel")
    path = tmp_path / "seg.nii.gz"
    nibabel.save(nibabel.Nifti1Image(segments().samples.T, np.eye(4)), path)
    assert not sg.load(path).labels
    (tmp_path / name).write_text(SNAP, encoding="utf-8")
    right = (Label(2, "liver", "#ff0000"), Label(9, "vena, \u00e9paisse", "#0000ff", 0.5))
    assert sg.load(path).labels == right
    assert sg.default_transfer(sg.load(path)).labels == ((2, "#ff0000", 0.99), (9, "#0000ff", 0.495))


def test_itk_snaps_table_hides_labels_unless_they_are_asked_for(tmp_path: Path) -> None:
    np.save(tmp_path / "seg.npy", segments().samples)
    (tmp_path / "seg.label").write_text(SNAP.replace("1  1  1", "1  0  1"))
    volume = sg.load(tmp_path / "seg.npy")
    assert [each.hidden for each in volume.labels or ()] == [True, False]
    assert sg.default_transfer(volume).labels == ((2, "#ff0000", 0.0), (9, "#0000ff", 0.495))
    shown = label_transfer(volume, [(2, 1.0), (9, 1.0)]).labels
    assert shown == ((2, "#ff0000", 0.99), (9, "#0000ff", 0.495))


def test_other_texts_are_no_tables(tmp_path: Path) -> None:
    np.save(tmp_path / "seg.npy", segments().samples)
    (tmp_path / "seg.txt").write_bytes(b"patient 3 \xff\x00" * 100)
    assert sg.load(tmp_path / "seg.npy").labels is None
    np.save(tmp_path / "real.npy", segments().samples.astype(np.float32) * 1.3)
    (tmp_path / "real.txt").write_text(SNAP)
    assert sg.load(tmp_path / "real.npy").labels is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (SNAP.replace("255    0    0", "256    0    0"), "seg.label, line 7: expected NUMBER R G B"),
        (SNAP.replace('"liver"', "liver"), "seg.label, line 7"),
        (SNAP.replace("1  1  1", "1.5  1  1"), "seg.label, line 7"),
        (SNAP.replace("1  1  1", f"1  {'9' * 5000}  1"), "seg.label, line 7"),
        (SNAP[: SNAP.index("    2 ")], "seg.label: expected labels, got none"),
    ],
)
def test_a_damaged_table_is_told(tmp_path: Path, text: str, told: str) -> None:
    np.save(tmp_path / "seg.npy", segments().samples)
    (tmp_path / "seg.label").write_text(text)
    with pytest.raises(sg.InputError, match=re.escape(told)):
        sg.load(tmp_path / "seg.npy")


def test_a_stack_of_few_colours_is_no_segmentation() -> None:
    """It keeps its colours, whatever its brightness is taken for."""
    volume = segments()
    color = np.stack([volume.samples, volume.samples // 2, 0 * volume.samples], axis=-1)
    assert sg.default_transfer(volume).labels
    painted = sg.Volume(volume.samples, color=color)
    assert not sg.default_transfer(painted).labels


@pytest.mark.parametrize("normal", [(1.0, 1.0, 0.0), (0.0, -1.0, 1.0), (1.0, 1.0, 1.0)])
def test_faces_of_labels_are_lit_across_them_in_the_world(normal: tuple[float, ...]) -> None:
    """Of a half-space on a grid of long voxels, towards its matter, within a few degrees."""
    spacing = np.array([1.0, 2.0, 0.7])
    across = np.array(normal) / np.linalg.norm(normal)
    z, y, x = np.indices((28, 12, 20))
    apart = (np.stack([x - 9.5, y - 5.5, z - 13.5], axis=-1) * spacing) @ across
    volume = sg.Volume((apart > 0).astype(np.uint8), (1.0, 2.0, 0.7), labels=(Label(1, "half", "#ff0000"),))
    splats = sg.extract(volume, label_transfer(volume))
    i, j, k = splats.positions.astype(int).T
    middle = (np.abs(splats.positions - (9.5, 5.5, 13.5)) < (5, 3, 7)).all(axis=1)
    found = splats.records["normal"][middle & (apart[k, j, i] < 1.0)].astype(float)
    assert len(found) > 20
    mean = (found / np.linalg.norm(found, axis=1, keepdims=True)).mean(axis=0)
    assert np.degrees(np.arccos(mean @ across / np.linalg.norm(mean))) < 5

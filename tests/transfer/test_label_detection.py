"""Labels and amounts are told apart by their neighbours: flat areas with sharp borders, against counts and fields."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.colormaps import label_color, label_opacity
from splatgl.transfer.label_detection import AMOUNTS, LABELS, MASK, kind_of, mark_kind

pytestmark = pytest.mark.usefixtures("shared_programs")

N = 36
PLACES = np.indices((N, N, N))
BALL = np.linalg.norm(PLACES - 17.3, axis=0)


def smooth(levels: int, seed: int = 0, waves: float = 2.0) -> np.ndarray:
    """A sum of six plane waves in whole numbers from 0 to levels − 1."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(6, 3)) * waves * 2 * np.pi / N / 1.7
    field = sum(
        np.sin(np.tensordot(way, PLACES, 1) + phase) for way, phase in zip(ways, rng.uniform(0, 6, 6), strict=True)
    )
    return np.rint((field - np.min(field)) / np.ptp(field) * (levels - 1))


def noisy(levels: int, noise: float) -> np.ndarray:
    return np.maximum(np.rint(smooth(levels) + np.random.default_rng(1).normal(0, noise, (N, N, N))), 0)


def counts(mean: Any, seed: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).poisson(mean, (N, N, N)).astype(float)


def blurred(levels: int) -> np.ndarray:
    """Two balls of matter as a scanner sees them, their edges spread over some voxels."""
    edge = 1 / (1 + np.exp((BALL - 12) / 0.7)) + 1.5 / (1 + np.exp((np.linalg.norm(PLACES - 20, axis=0) - 4) / 0.7))
    return np.rint(edge / edge.max() * (levels - 1))


def spots() -> np.ndarray:
    rng = np.random.default_rng(3)
    found = sum(
        height * np.exp(-(((PLACES - place[:, None, None, None]) ** 2).sum(axis=0)) / 3)
        for place, height in zip(rng.uniform(3, N - 3, (20, 3)), rng.uniform(5, 25, 20), strict=True)
    )
    return np.rint(np.asarray(found))


def nearest(count: int, seed: int = 4) -> np.ndarray:
    """The number, from 1 on, of the nearest of some random places."""
    places = np.random.default_rng(seed).uniform(0, N, (count, 3))
    squares = [((PLACES - place[:, None, None, None]) ** 2).sum(axis=0) for place in places]
    return np.argmin(squares, axis=0) + 1.0


def organs() -> np.ndarray:
    made = np.where(BALL < 12, 2.0, 0.0)
    made[(np.linalg.norm(PLACES - 12, axis=0) < 6) & (BALL < 14)] = 1
    made[np.linalg.norm(PLACES - 24, axis=0) < 5] = 4
    return made


def salted(share: float) -> np.ndarray:
    rng, made = np.random.default_rng(5), atlas(12)
    return np.where(rng.random(made.shape) < share, rng.integers(0, 13, made.shape), made).astype(float)


def atlas(count: int) -> np.ndarray:
    return np.where(BALL < 15, nearest(count), 0.0)


def sparse() -> np.ndarray:
    made = np.zeros((N, N, N))
    made[30:33, 3:6, 3:6], made[30:33, 6:9, 3:7], made[1:4, 20:24, 30:33] = 5, 9, 2
    return made


KINDS: dict[str, tuple[str, Callable[[], np.ndarray]]] = {
    **{f"a smooth field of {n}": (AMOUNTS, partial(smooth, n)) for n in (3, 4, 5, 8, 12, 20, 30, 33)},
    **{f"a wavy field of {n}": (AMOUNTS, partial(smooth, n, 1, 6.0)) for n in (3, 4, 6, 9, 17, 30)},
    **{f"a field of 8 with noise {x}": (AMOUNTS, partial(noisy, 8, x)) for x in (0.2, 0.35, 0.5, 1.0)},
    **{f"counts of {mean}": (AMOUNTS, partial(counts, mean)) for mean in (0.02, 0.1, 0.3, 1, 3, 10)},
    "photons of a ball": (AMOUNTS, lambda: counts(6 * np.exp(-(BALL**2) / 150))),
    "photons of a sharp ball": (AMOUNTS, lambda: counts(np.where(BALL < 10, 8, 0.3))),
    **{f"blurred edges in {n}": (AMOUNTS, partial(blurred, n)) for n in (5, 8, 16, 32, 250)},
    "spots": (AMOUNTS, spots),
    "coins": (AMOUNTS, lambda: (np.random.default_rng(6).random((N, N, N)) < 0.3).astype(float)),
    **{f"{n} regions": (LABELS, partial(nearest, n)) for n in (3, 5, 12, 40)},
    **{f"an atlas of {n}": (LABELS, partial(atlas, n)) for n in (4, 30, 120)},
    "organs": (LABELS, organs),
    "regions with salt": (LABELS, lambda: salted(0.05)),
    "few cells": (LABELS, sparse),
    "numbers far apart": (LABELS, lambda: nearest(6) ** 7),
    "a mask": (MASK, lambda: (BALL < 9).astype(float)),
}


@pytest.mark.few(11)
@pytest.mark.parametrize("name", list(KINDS))
def test_kinds_of_whole_numbers(name: str) -> None:
    """The same in any type; no picture of one that isn't the other's."""
    expected, make = KINDS[name]
    samples = make()
    for dtype in (np.uint16 if samples.max() < 2**16 else np.int32, np.int32, np.float32):
        volume = sg.Volume(samples.astype(dtype))
        assert kind_of(volume)[0] == expected, (dtype, kind_of(volume))
        transfer = sg.default_transfer(volume)
        numbers = np.unique(samples)
        assert len(transfer.labels) == (len(numbers) - (0 in numbers)) * (expected == LABELS)
        assert transfer == sg.default_transfer(sg.Volume(samples.astype(np.float64)))


def test_nothing_and_fractions_are_no_labels() -> None:
    for samples in (np.zeros((1, 1, 1)), np.full((4, 4, 4), np.nan), np.full((4, 4, 4), 3, np.uint8), nearest(5) / 3):
        assert kind_of(sg.Volume(samples))[0] == AMOUNTS
    holes = nearest(5)
    holes[3:9] = np.nan
    assert kind_of(sg.Volume(holes))[0] == LABELS
    assert kind_of(sg.Volume(nearest(5), value_unit="K"))[0] == AMOUNTS


def test_a_few_cells_of_a_large_volume_are_found() -> None:
    """Between the places that are looked at first."""
    samples: np.ndarray = np.zeros((120, 130, 140), np.uint16)
    samples[71:75, 51:55, 33:37], samples[71:75, 55:58, 33:37] = 7, 3
    assert kind_of(sg.Volume(samples))[0] == LABELS
    samples[71:75, 51:58, 33:37] = np.random.default_rng(0).integers(1, 30, (4, 7, 4))
    assert kind_of(sg.Volume(samples))[0] == AMOUNTS


def test_nested_areas_are_labels_by_name() -> None:
    """A tumour in an organ is like a field of three values."""
    nested = np.where(BALL < 5, 2, np.where(BALL < 12, 1, 0)).astype(np.uint8)
    assert kind_of(sg.Volume(nested, name="liver"))[0] == AMOUNTS
    for name in ("liver_seg", "sub-1_dseg", "Labels 3", "aseg", "tumour-mask"):
        assert kind_of(sg.Volume(nested, name=name))[0] == LABELS
    assert kind_of(sg.Volume(counts(1), name="labels"))[0] == AMOUNTS


def test_the_choice_is_told_and_an_option_changes_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", atlas(40).astype(np.uint16))
    np.save(tmp_path / "c.npy", counts(1).astype(np.uint8))
    for name, said, other in (("a", "rendered as labels", "amounts"), ("c", "rendered as amounts", "labels")):
        path = str(tmp_path / f"{name}.npy")
        assert main(["info", path]) == 0
        err = capsys.readouterr().err
        assert said in err and f"--values {other} renders" in err and err.count("\n") == 1
        scene = SceneFile(path, {"values": other})
        volume = scene.open()
        assert not volume.notes and bool(scene.transfer_for(volume).labels) == (other == "labels")
        assert bool(sg.default_transfer(sg.load(path, values=other)).labels) == (other == "labels")
        assert bool(sg.default_transfer(sg.Volume.of(np.load(path), values=other)).labels) == (other == "labels")
    # what is given decides, and nothing is to be told
    assert not SceneFile(path, transfer={"preset": "surface"}).open().notes
    with pytest.raises(sg.InputError, match="values: expected labels, amounts or heights, got 'names'"):
        sg.load(path, values="names")
    table = sg.Volume(atlas(4).astype(np.uint8), labels=(Label(1, "one"),))
    assert mark_kind(table) is table and table.of_values("labels").labels == table.labels
    assert table.of_values("amounts").labels is None


def test_numbers_of_64_bits_keep_their_colours() -> None:
    """Two that float64 does not tell apart; unsigned ones beyond the signed."""
    near, far = 2**60, 2**64 - 5
    labels = ((1, "#00ff00", 0.5), (near, "#ff0000", 0.25), (near + 1, "#0000ff", 1.0), (far, "#ffffff", 0.75))
    values = np.array([0, 1, near, near + 1, near + 2, far], np.uint64)
    assert label_opacity(labels, values).tolist() == [0, 0.5, 0.25, 1, 0, 0.75]
    assert label_color(labels, values)[:, 2].tolist() == [0, 0, 0, 1, 0, 1]
    assert label_opacity(labels, np.array([1.0, np.nan, 1.5])).tolist() == [0.5, 0, 0]


def test_each_of_many_cells_is_drawn() -> None:
    samples = np.repeat(np.repeat(np.repeat(np.arange(1, 513).reshape(8, 8, 8), 3, 0), 3, 1), 3, 2)
    volume = sg.Volume(samples.astype(np.uint32), name="cells")
    splats = sg.extract(volume, sg.default_transfer(volume))
    assert len(splats) == samples.size
    assert len(np.unique(splats.colors, axis=0)) > 480


@pytest.mark.long
def test_a_picture_of_many_cells_tells_how_many(tmp_path: Path) -> None:
    """Their table is longer than what readers of PNG take for a text."""
    samples = np.repeat(np.repeat(np.arange(1, 20001).reshape(1, 100, 200), 3, 1), 3, 2)
    np.save(tmp_path / "cells.npy", np.repeat(samples, 3, 0).astype(np.int32))
    line = ["render", str(tmp_path / "cells.npy"), "--size", "20", "-o", str(tmp_path / "a.png"), "--check", "0"]
    assert main([*line, "--quiet"]) == 0
    assert sg.Image.load(tmp_path / "a.png").info["transfer"] == "# 20,000 labels in colours of their numbers"


def test_options_of_amounts_draw_amounts(tmp_path: Path) -> None:
    """Unless the file itself says that its numbers are labels: then they are refused, not left out."""
    np.save(tmp_path / "a.npy", atlas(12).astype(np.uint8))
    for given in ({"window": (0, 9)}, {"colormap": "hot"}, {"points": ((0, 0), (9, 1))}):
        scene = SceneFile(str(tmp_path / "a.npy"), transfer=given)
        volume = scene.open()
        assert not volume.notes and not scene.transfer_for(volume).labels
    with pytest.raises(sg.InputError, match="labels: expected none of the options of amounts, got window; --values"):
        SceneFile("a", transfer={"window": (0, 9)}).transfer_for(sg.Volume(atlas(12).astype(np.uint8), labels=()))
    cube = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 3\n"
    (tmp_path / "a.off").write_text(cube)
    with pytest.raises(sg.InputError, match="options: expected none of volumes for a mesh, got spacing"):
        SceneFile(str(tmp_path / "a.off"), {"spacing": (1, 1, 1)}).open()


def nearly(kind: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Numbers of cells as programs store an atlas, and fields of NIfTI's header."""
    whole, noise = nearest(5).astype(float), np.random.default_rng(1).normal(size=nearest(5).shape)
    kinds: dict[str, tuple[np.ndarray, dict[str, Any]]] = {
        "float32": ((whole * (1 + 1e-7 * noise)).astype(np.float32), {}),
        "float64": (whole / 3 * 3.0000000001, {}),
        "resampled": ((whole + 1e-4 * noise).astype(np.float32), {}),
        "scaled": (np.rint(whole * 32767 / 900).astype(np.int16), {"scl_slope": 900 / 32767}),
        "thirds": ((whole * 3).astype(np.int32), {"scl_slope": 1 / 3, "scl_inter": 0}),
        "shifted": ((whole * 10 - 7).astype(np.int16), {"scl_slope": 0.1, "scl_inter": 0.7}),
    }
    return kinds[kind]


@pytest.mark.parametrize("intent", [0, 1002])
@pytest.mark.parametrize("kind", ["float32", "float64", "resampled", "scaled", "thirds", "shifted"])
def test_atlases_that_are_whole_but_for_rounding(kind: str, intent: int, tmp_path: Path) -> None:
    """Each voxel is drawn by its number, by itself, as labels that are asked for, and as a mask."""
    nibabel = pytest.importorskip("nibabel")
    stored, fields = nearly(kind)
    header = nibabel.Nifti1Header()
    header.set_data_shape(stored.shape[::-1])
    header.set_data_dtype(stored.dtype)
    for name, value in {"scl_slope": 1, "scl_inter": 0, "intent_code": intent, "sform_code": 1, **fields}.items():
        header[name] = value
    header["srow_x"], header["srow_y"], header["srow_z"] = np.eye(4, dtype=np.float32)[:3]
    header["vox_offset"], header["magic"] = 352, b"n+1"
    (tmp_path / "a.nii").write_bytes(header.binaryblock + bytes(4) + stored.tobytes())
    right = np.rint(nibabel.load(tmp_path / "a.nii").get_fdata().T)
    assert (right == nearest(5)).all()
    by_itself = SceneFile(str(tmp_path / "a.nii")).open()
    asked = SceneFile(str(tmp_path / "a.nii"), transfer={"only_labels": ()}).open()
    stated = sg.load(tmp_path / "a.nii", values="labels")
    for volume in (by_itself, asked, stated):
        assert (np.asarray(volume.samples) == right).all()
    assert by_itself.labels == stated.labels == ()
    assert (sg.load(tmp_path / "a.nii").labels == ()) == (intent == 1002)
    number = int(right.max())
    numbers = [label for label, _, _ in sg.default_transfer(by_itself).labels]
    assert numbers == [n for n in np.unique(right).astype(int).tolist() if n]
    kept = sg.Volume(np.ones(right.shape)).masked(sg.load(tmp_path / "a.nii"), (number,))
    assert (kept.kept((0, 0, 0), right.shape) == (right == number)).mean() > 0.99


def test_fractions_are_told_by_their_values(tmp_path: Path) -> None:
    """Neither the type nor whole numbers are blamed."""
    np.save(tmp_path / "a.npy", np.linspace(0, 1, 480, dtype=np.float32).reshape(6, 8, 10))
    with pytest.raises(sg.InputError, match=r"whole numbers, each of a segment, got values such as 0\.4\d+"):
        sg.load(tmp_path / "a.npy", values="labels")
    small = sg.Volume(np.random.default_rng(1).random((8, 8, 8)).astype(np.float32) * 0.01)
    assert kind_of(small, 0.02)[0] == AMOUNTS and mark_kind(small).samples is small.samples

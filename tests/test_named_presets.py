"""Presets by name, the sheet of them, and the blend that a preset implies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli import presets
from splatgl.cli.main import main
from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.splat.presets import MEDICAL, PRESETS, preset, preset_named

SLICERS = ["CT-AAA", "CT-Air", "CT-Bone", "CT-Bones", "CT-Cardiac", "CT-Chest-Contrast", "CT-Coronary-Arteries"]
SLICERS += ["CT-Lung", "CT-Soft", "CT-Soft-Tissue", "CT-Muscle", "CT-Fat", "CT-Liver-Vasculature", "MR-Default"]
SLICERS += ["MR-Angio", "MR-MIP", "MR-T2-Brain", "MIP", "DTI-FA", "CT_AAA", "mr angio"]
# Hounsfield units of what each preset is for, and of what it leaves out
SHOWS = {
    "ct-aaa": (350.0, 40.0),
    "ct-air": (-650.0, 40.0),
    "ct-bones": (400.0, 150.0),
    "ct-cardiac": (300.0, -100.0),
    "ct-chest-contrast": (300.0, -500.0),
    "ct-coronary-arteries": (400.0, 100.0),
    "ct-lung": (-300.0, 200.0),
    "ct-muscle": (60.0, -100.0),
    "ct-fat": (-90.0, 50.0),
    "ct-liver-vasculature": (250.0, 0.0),
}


def body(scale: float = 1.0, offset: float = 0.0) -> np.ndarray:
    """Air, with a ball of soft tissue, in which there is a bone; Hounsfield units, or values linear in them."""
    place = np.linalg.norm(np.indices((32, 32, 32)) - 15.5, axis=0)
    units = np.select([place < 4, place < 12], [700.0, 40.0], -1000.0)
    return (units + np.random.default_rng(1).normal(0, 20, units.shape)) * scale + offset


@pytest.mark.parametrize("name", SLICERS)
def test_names_that_others_use(name: str) -> None:
    assert preset(name, Volume(body())).points


def test_every_tissue_is_told() -> None:
    assert {each.name for each in MEDICAL if each.hounsfield} == set(SHOWS)


@pytest.mark.parametrize("name", SHOWS)
def test_hounsfield_units(name: str) -> None:
    shown, hidden = SHOWS[name]
    transfer = preset(name, Volume(body()))
    assert transfer.opacity(shown) > 0.2 and transfer.opacity(hidden) < 0.05


@pytest.mark.parametrize("name", ["ct-aaa", "ct-air", "ct-bones", "ct-muscle"])
def test_values_of_another_scale_are_adapted_to(name: str) -> None:
    """Bone, tissue, and what lies between air and tissue are as opaque as in Hounsfield units."""
    right = preset(name, Volume(body()))
    transfer = preset(name, Volume(body(0.05, 120.0)))
    for unit in (700.0, 40.0, -1000.0):
        assert transfer.opacity(unit * 0.05 + 120) == pytest.approx(float(right.opacity(unit)), abs=0.3)


def test_presets_differ() -> None:
    volume = Volume(body())
    looks = [preset(name, volume) for name in PRESETS]
    assert len({(look.points, look.colormap, look.window) for look in looks}) == len(looks)


@pytest.mark.parametrize(
    ("name", "near"), [("ct-bon", "ct-bone, ct-bones"), ("angio", "mr-angio"), ("CT-Lnug", "ct-lung"), ("liver", "ct-")]
)
def test_near_names_are_told(name: str, near: str) -> None:
    with pytest.raises(InputError, match=f"expected one of {near}.*splatgl presets"):
        preset_named(name)


@pytest.mark.parametrize("name", ["xyz", "", 3])
def test_of_a_name_like_none_all_are_told(name: object) -> None:
    with pytest.raises(InputError, match=r"ct-bone, ct-soft, mri, .*mip"):
        preset_named(name)


@pytest.mark.long
def test_a_preset_implies_a_blend(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where neither --blend nor the scene has one."""
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", body()[::2, ::2, ::2])
    Path("s.toml").write_text('volume = "v.npy"\n[transfer]\npreset = "MIP"\n[settings]\nblend = "minip"\n')
    blends = []
    for options in (["v.npy", "--preset", "MIP"], ["v.npy", "--preset", "mr-mip", "--blend", "composite"], ["s.toml"]):
        assert main(["render", *options, "-o", "v.png", "--size", "16", "--quiet", "--check", "0"]) == 0
        blends.append(sg.Image.load("v.png").info["blend"])
    assert blends == ["mip", "composite", "minip"]


def test_presets_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(PRESETS)
    assert all(len(line.split()) > 3 for line in lines)


@pytest.mark.long
def test_a_sheet_of_presets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pictures are those of `render` by the same preset, each under a label."""
    monkeypatch.chdir(tmp_path)
    some = {name: PRESETS[name] for name in ("ct-bones", "ct-air", "mip")}
    monkeypatch.setattr(presets, "PRESETS", some)
    np.save("v.npy", body().astype(np.float32)[::2, ::2, ::2])
    assert main(["presets", "v.npy", "-o", "sheet.png"]) == 0
    page = np.asarray(Pillow.open("sheet.png"))
    side, label = presets.SIDE, presets.LABEL
    assert page.shape == (side + label, 4 * side, 3)
    pictures = [page[label:, n * side : (n + 1) * side].astype(int) for n in range(4)]
    for n, picture in enumerate(pictures):
        # letters, and the corner's background: black behind values along rays, white behind surfaces
        assert page[:label, n * side : (n + 1) * side].min() < 100
        assert picture[0, 0].tolist() == ([0] * 3 if n == 3 else [255] * 3)
        assert all(np.abs(picture - other).max() > 30 for other in pictures[:n])


def test_a_sheet_says_where_nothing_is_visible(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    clear = PRESETS["ct-fat"]
    monkeypatch.setattr(presets, "PRESETS", {"ct-fat": clear})
    samples = np.full((8, 8, 8), -1000.0)
    samples[2:4] = 500.0
    monkeypatch.setattr(presets, "preset", lambda name, volume: sg.Transfer([(0.0, 0.0), (1.0, 0.0)]))
    np.save("v.npy", samples)
    assert main(["presets", "v.npy"]) == 0
    page = np.asarray(Pillow.open("presets.png").convert("L"))
    middle = page[presets.LABEL :, presets.SIDE :]
    assert 0 < (middle < 100).sum() < 2000


def test_large_volumes_are_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presets, "MOST", 1000)
    found = presets.smaller(Volume(body(), (1.0, 2.0, 3.0)))
    assert found.shape == (8, 8, 8) and found.spacing == (4.0, 8.0, 12.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["-o", "x.png"], "expected a volume to draw"),
        (["missing.nrrd"], "missing.nrrd"),
        (["v.npy", "-o", "x.npy"], "ends in .png"),
    ],
)
def test_bad_sheets(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", body())
    assert main(["presets", *options]) == 2
    told = capsys.readouterr().err
    assert said in told and len(told.splitlines()) == 1

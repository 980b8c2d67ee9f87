"""Presets, by name too; the transfer function chosen from a volume's values; and the blend that a preset implies."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli import presets
from splatgl.cli.main import main
from splatgl.data.volume import Hints, Volume, halve_volume
from splatgl.errors import InputError
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.colormaps import colormap
from splatgl.transfer.presets import (
    BONE_HU,
    MEDICAL,
    PRESETS,
    SOLID,
    constant_note,
    default_transfer,
    preset,
    preset_named,
)
from splatgl.transfer.statistics import PLANES, sorted_percentile, statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.document import Document
from splatgl.viewer.loading import _first_note

pytestmark = pytest.mark.usefixtures("shared_programs")

# presets of tissues between others, which the largest values are none of
BANDS = ("ct-air", "ct-lung", "ct-muscle", "ct-fat")
DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))


def data_file(name: str) -> Path:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


def ball(size: int = 48, low: float = 20.0, high: float = 100.0, noise: float = 6.0) -> np.ndarray:
    grid = np.indices((size, size, size)) - (size - 1) / 2
    inside = np.linalg.norm(grid, axis=0) < size / 3
    rng = np.random.default_rng(3)
    return np.where(inside, high, low) + rng.normal(0.0, noise, inside.shape)


def first_value(transfer: Transfer, level: float) -> float:
    """The value where the opacity first reaches `level`."""
    values = np.linspace(transfer.points[0][0], transfer.points[-1][0], 100_001)
    return float(values[np.argmax(transfer.opacity(values) >= level)])


def test_an_object_in_noise_is_cut_out() -> None:
    samples = ball()
    transfer = default_transfer(Volume(samples))
    kept = transfer.opacity(samples) > 0.1
    inside = ball(noise=0.0) > 60
    assert (kept == inside).mean() > 0.999
    # not a fog: the object is close to opaque, and its colour is not dark
    assert transfer.opacity(100.0) > 0.7
    assert transfer.color(80.0).mean() > 0.2


def test_values_that_are_not_finite_are_ignored() -> None:
    samples = ball()
    spoilt = samples.copy()
    spoilt[::7, ::5, ::3] = np.nan
    spoilt[0, 0, 0] = np.inf
    assert first_value(default_transfer(Volume(spoilt)), 0.4) == pytest.approx(
        first_value(default_transfer(Volume(samples)), 0.4), abs=3
    )


def test_what_surrounds_the_object_on_all_sides_is_background() -> None:
    # tissue (100) fills most of the box and touches its faces; a bright vessel runs inside it, air beside it
    samples = np.random.default_rng(5).normal(100.0, 6.0, (40, 40, 40))
    samples[:, :12] = 5.0
    samples[8:30, 24:28, 24:28] = 220.0
    assert statistics(Volume(samples)).cuts[0].value < 80
    assert 125 < first_value(default_transfer(Volume(samples)), 0.4) < 215


@pytest.mark.parametrize("value", [0.0, -3.0, 7e20])
def test_a_constant_volume_is_a_fog(value: float) -> None:
    """Its box is seen by how long rays are in it; of coarser voxels, too."""
    volume = Volume(np.full((24, 25, 26), value))
    for part in (volume, halve_volume(volume)):
        look = default_transfer(part)
        assert 1 - (1 - look.opacity(value)) ** 24 == pytest.approx(1 - np.exp(-1.5), abs=1e-3)


@pytest.mark.parametrize("samples", [np.full((9, 8, 7), 3.0), np.zeros((9, 8, 7), np.int16)])
def test_every_door_says_that_a_volume_is_constant(
    samples: np.ndarray, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = f"constant: all samples are {samples[0, 0, 0]:g}, so that nothing is visible but the box"
    file = tmp_path / "v.nrrd"
    Volume(samples).save(file)
    for line in (["info"], ["render", "-o", str(tmp_path / "v.png"), "--size", "24"], ["info", "--json"]):
        assert main([line[0], str(file), *line[1:]]) == 0
        printed = capsys.readouterr()
        assert told in printed.out + printed.err
    for source in (file, samples):
        with pytest.warns(sg.InputWarning, match="nothing is visible"):
            image = sg.render(source, size=(24, 24), background="transparent")
        assert told in image.info["notes"] and image.pixels[..., 3].max() < 0.95
        assert sg.render(source, size=(24, 24), blend="mip", background="transparent").pixels[..., 3].max() > 0.9
    document = Document.open(SceneFile(str(file)), quiet=True)
    assert _first_note(document) == told
    other = samples.copy()
    other[0, 0, 0] += 1
    assert constant_note(Volume(other)) == ""


def test_a_volume_of_nothing_is_transparent() -> None:
    transfer = default_transfer(Volume(np.full((3, 3, 3), np.nan)))
    assert transfer.opacity([np.nan, 0.0, 1.0]).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.few(48)
@pytest.mark.parametrize("name", list(PRESETS))
@pytest.mark.parametrize("samples", [np.zeros((1, 1, 1)), np.array([[[0, 255]]], np.uint8), ball(16)])
def test_every_preset_takes_any_volume(name: str, samples: np.ndarray) -> None:
    transfer = preset(name, Volume(samples))
    if name in BANDS:
        assert transfer.opacity(np.linspace(samples.min(), samples.max(), 2000)).max() > 0.2
    else:
        assert transfer.opacity(samples.max()) > 0.3


def test_a_sparse_volume_shows_what_stands_out() -> None:
    samples = np.zeros((40, 64, 64), np.uint8)
    samples[20, 30:34, :] = np.linspace(14, 255, 64).astype(np.uint8)
    transfer = default_transfer(Volume(samples))
    assert transfer.opacity(0) == 0.0
    assert np.all(transfer.opacity(np.arange(14, 256)) > 0.0)
    assert transfer.opacity(255) > 0.7


def test_a_tiny_object_between_the_sampled_planes_is_found() -> None:
    samples = np.zeros((20 * PLANES, 8, 8), np.float32)
    samples[11, 4, 4], samples[11, 4, 5] = 3.0, 5.0
    transfer = default_transfer(Volume(samples))
    assert transfer.opacity(0.0) == 0.0
    assert transfer.opacity(5.0) > 0.5


def test_labels_and_masks_are_solid() -> None:
    mask = ball(noise=0.0) > 60
    assert default_transfer(Volume(mask)).opacity([0, 1]).tolist() == [0.0, SOLID]
    labels = np.where(mask, 3, 0).astype(np.uint8)
    labels[20:22] *= 2
    assert default_transfer(Volume(labels)).opacity([0, 3, 6]).tolist() == [0.0, SOLID, SOLID]


@pytest.mark.parametrize("shades", [(43, 150), (0, 18, 54), (0, 43, 130, 182, 255)])
def test_only_black_is_background_among_few_colours(shades: tuple[int, ...]) -> None:
    luma = np.kron(np.resize(np.array(shades, np.uint8), (4, 4, 4)), np.ones((4, 4, 4), np.uint8))
    volume = sg.Volume(luma, color=np.repeat(luma[..., None], 3, axis=3))
    opacity = sg.default_transfer(volume).opacity(np.array(shades))
    np.testing.assert_array_equal(opacity > 0.9, np.array(shades) > 0)


def test_hounsfield_units_are_recognised() -> None:
    samples = ball(low=-1000.0, high=40.0, noise=15.0)
    soft = default_transfer(Volume(samples))
    assert soft.opacity(40.0) > 0.5
    samples[20:28, 20:28, 20:28] += 900.0
    assert default_transfer(Volume(samples)).points == BONE_HU.points
    # a range without air is not a CT
    assert default_transfer(Volume(ball())).points != BONE_HU.points


def test_hints_come_first() -> None:
    hints = Hints(points=((1.0, 0.0), (2.0, 0.5)), window=(0.0, 9.0), unit=2.0, colormap="hot", shading=False)
    transfer = default_transfer(Volume(ball(16), hints=hints))
    assert transfer == Transfer(((1, 0), (2, 0.5)), "hot", (0, 9), 2.0, shading=False)
    assert default_transfer(Volume(ball(16), hints=Hints(preset="mri"))) == preset("mri", Volume(ball(16)))
    window = default_transfer(Volume(ball(16), hints=Hints(window=(30.0, 60.0))))
    assert window.opacity(30.0) == 0.0
    assert window.window == (30.0, 60.0)


def test_an_unknown_preset_is_refused() -> None:
    with pytest.raises(InputError, match="ct-bone"):
        preset("ct", Volume(np.zeros((2, 2, 2))))


def test_only_a_few_planes_of_a_big_volume_are_read() -> None:
    asked = set()

    class Counting(np.ndarray):
        def __getitem__(self, key: Any) -> Any:
            asked.add(key)
            return np.asarray(super().__getitem__(key))

    samples = np.tile(ball(48), (6, 1, 1)).view(Counting)
    assert len(statistics(Volume(samples)).values) > 0
    assert 0 < len(asked) <= PLANES


@pytest.mark.parametrize("kind", ["bool", "i1", "u1", "<i2", ">i2", "<u2", ">u2", ">i4", "u4", "i8", ">u8"])
def test_whole_numbers_have_the_statistics_of_the_same_numbers_as_floats(kind: str) -> None:
    dtype = np.dtype(kind)
    rng = np.random.default_rng(4)
    low, high = (0, 1) if kind == "bool" else (np.iinfo(dtype).min, np.iinfo(dtype).max)
    samples = np.clip(rng.normal(40.0, 900.0, (9, 20, 30)), low, high).astype(dtype)
    # the ends, which float64 need not hold
    samples[0, 0, :2] = low, high
    whole, floats = statistics(Volume(samples)), statistics(Volume(samples.astype(np.float64)))
    assert whole.values.dtype == np.float64
    assert np.array_equal(whole.values, floats.values) and (np.diff(whole.values) >= 0).all()
    assert (whole.background, whole.cuts, whole.whole) == (floats.background, floats.cuts, floats.whole)


# --- real data: near the thresholds that are known to show it ---


@pytest.mark.parametrize(
    ("name", "dtype", "shape", "about"),
    [
        ("visible_male_128x256x256_uint8.raw", "u1", (256, 256, 128), 40),
        ("tooth.raw", ">u2", (161, 94, 103), 650),
        ("HeadMRVolume.raw", "u1", (42, 62, 48), 40),
    ],
)
def test_real_volumes_are_cut_where_people_cut_them(
    name: str, dtype: str, shape: tuple[int, int, int], about: float
) -> None:
    samples = np.fromfile(data_file(name), dtype).reshape(shape)
    transfer = default_transfer(Volume(samples))
    assert first_value(transfer, 0.4) == pytest.approx(about, rel=0.1)


def test_the_visible_males_bone() -> None:
    samples = np.fromfile(data_file("visible_male_128x256x256_uint8.raw"), "u1").reshape(256, 256, 128)
    assert first_value(preset("ct-bone", Volume(samples)), 0.4) == pytest.approx(90, rel=0.1)


def test_values_that_signed_integers_cannot_hold() -> None:
    """Of uint64 next to 2⁶⁴, which floats round up to it."""
    samples = np.full((3, 3, 3), 2**64 - 1, np.uint64)
    assert default_transfer(Volume(samples)).points[0][0] == 2.0**64


def test_names_in_any_case() -> None:
    volume = Volume(ball())
    assert preset("CT-Bone", volume) == preset("ct-bone", volume)
    with pytest.raises(InputError, match=r"ct-bone, ct-bones.* got 'ct-bonne'; splatgl presets lists all"):
        preset("ct-bonne", volume)


def test_percentiles_are_numpys() -> None:
    """To the last bit."""
    rng = np.random.default_rng(9)
    for count in (1, 2, 3, 1000, 99_991):
        values = np.sort(rng.normal(0, 1e3, count))
        for percent in (0.0, 0.1, 1.0, 33.3, 50.0, 99.9, 99.99, 100.0):
            assert sorted_percentile(values, percent) == np.percentile(values, percent)
    assert sorted_percentile(np.array([-1.7e308, 1.7e308]), 50.0) == 0.0


def test_colours_of_surfaces_span_the_data() -> None:
    """Windows never begin below the data; the light part of the map does it, and another window has the whole map."""
    x, y, z = np.meshgrid(*(np.linspace(-2, 2, 24),) * 3)
    cells = np.rint(255 * np.exp(-(x * x + y * y + z * z))).astype(np.uint8)
    volume = Volume(cells)
    look = default_transfer(volume)
    assert look.window is not None and look.window[0] >= cells.min() and look.colormap == "ivory[0.6:]"
    assert np.abs(look.color(look.window[0]) - colormap("ivory")[round(0.6 * 255)]).max() < 0.01
    scene = SceneFile("", transfer={"window": (0.0, 100.0)})
    assert scene.transfer_for(volume).colormap == "ivory"


def test_parts_of_colour_maps() -> None:
    whole = colormap("viridis")
    upper = colormap("viridis[0.5:]")
    assert np.abs(upper[-1] - whole[-1]).max() < 1e-12 and np.abs(upper[0] - (whole[127] + whole[128]) / 2).max() < 1e-3
    assert (colormap("#ff0000[0.2:0.3]") == colormap("#ff0000")).all()
    for bad in ("viridis[0.6:0.5]", "viridis[:2]", "viridis[a:]", "nothing[0:1]"):
        with pytest.raises(InputError, match="colormap"):
            colormap(bad)


# --- by name ----------------------------------------------------------------------------------------------------------


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
    "ct-skin": (40.0, -500.0),
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


@pytest.mark.parametrize("name", ["skin", "Muscle", "bone", "lung", "fat"])
def test_presets_of_a_ct_by_their_tissue(name: str) -> None:
    assert preset_named(name) is preset_named(f"ct-{name}") and preset_named("vessels").name == "ct-aaa"


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
    found = presets.subsampled(Volume(body(), (1.0, 2.0, 3.0)))
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


def test_nuclei_are_not_saturated() -> None:
    """Of bright structures on a dark ground at most 2 % of the voxels have the largest opacity."""
    random, (z, y, x) = np.random.default_rng(3), np.indices((20, 48, 48))
    nuclei = sum(
        600 * gain * (np.hypot(np.hypot(y - row, x - column), 2 * (z - 10)) < 9)
        for row, column, gain in ((12, 12, 0.7), (14, 35, 1.0), (34, 24, 1.3))
    )
    samples = nuclei * random.normal(1, 0.15, nuclei.shape) + random.normal(100, 8, nuclei.shape)
    volume = sg.Volume(samples.clip(0).astype(np.uint16), unit="um")
    end = sg.preset("microscopy", volume).points[-1][0]
    assert 0 < (volume.samples[nuclei > 0] >= end).mean() < 0.02

"""Fields of simulations: which volumes are one, what is drawn of them, and logarithmic scales."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Volume
from splatgl.errors import InputError
from splatgl.readers.common import is_field
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.preintegration import ValueClassifier
from splatgl.transfer.presets import default_transfer, logarithmic_transfer, preset
from splatgl.transfer.transfer import Transfer

pytestmark = pytest.mark.usefixtures("shared_programs")

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))
NAMED = ["isabel_windspeed_t02", "Density", "gas-temperature", "pressure0", "velocity magnitude", "vel", "qcriterion"]
UNNAMED = ["tooth", "head_mri", "windows", "p", "t1", "flowers", "stent", ""]


def smooth(shape: tuple[int, int, int] = (20, 24, 28)) -> np.ndarray:
    """Waves of random directions around 3: computed values, one class."""
    rng = np.random.default_rng(5)
    places = np.indices(shape).reshape(3, -1)
    waves = sum(np.sin(rng.normal(0, 0.4, 3) @ places + rng.uniform(0, 6)) for _ in range(12))
    return (3.0 + 0.3 * np.asarray(waves).reshape(shape)).astype(np.float32)


def densities() -> np.ndarray:
    """Lognormal densities over decades, smooth in space."""
    return np.exp(1.2 * (smooth() - 3.0)).astype(np.float32)


@pytest.mark.parametrize("name", NAMED + UNNAMED)
def test_names_of_fields(name: str) -> None:
    assert is_field(name) == (name in NAMED)
    assert is_field(name, array=True) == (name in [*NAMED, "p"])


def test_a_field_is_seen_through() -> None:
    samples = smooth()
    transfer = default_transfer(Volume(samples))
    assert (transfer.colormap, transfer.shading) == ("viridis", False)
    assert transfer.window is not None and transfer.window[0] == samples.min()
    assert transfer.window[1] == pytest.approx(np.percentile(samples, 99.9), rel=1e-3)
    assert 0.2 < transfer.opacity(samples.max()) < 0.8 and transfer.opacity(np.median(samples)) < 0.01


@pytest.mark.parametrize("change", [{"frame": "LPS"}, {"unit": "mm"}])
def test_what_scanners_see_is_no_field(change: dict[str, str]) -> None:
    assert default_transfer(Volume(smooth(), **change)).colormap == "ivory[0.6:]"


@pytest.mark.parametrize("kind", ["levels", "whole", "noisy"])
def test_values_that_are_not_computed_are_no_field(kind: str) -> None:
    samples = smooth()
    if kind == "levels":
        samples = np.round(samples * 40) / 40
    elif kind == "whole":
        samples = (samples * 40).astype(np.uint16)
    else:
        samples = samples + np.random.default_rng(2).normal(0, samples.std() / 2, samples.shape)
    assert default_transfer(Volume(samples)).colormap == "ivory[0.6:]"


def test_a_named_field_is_one_whatever_its_values() -> None:
    samples = np.zeros((8, 20, 20), np.float32)
    samples[4, 5:9, 5:9] = np.linspace(1, 5, 16).reshape(4, 4)
    assert default_transfer(Volume(samples, name="density")).colormap == "viridis"
    assert default_transfer(Volume(samples, name="scan")).colormap == "glow"


def vtk(path: Path, arrays: list[str]) -> Path:
    """A legacy VTK file of one voxel more along each axis, with float scalars of these names."""
    numbers = " ".join(f"{value:.9g}" for value in smooth((4, 5, 6)).ravel())
    fields = "\n".join(f"{name} 1 120 float\n{numbers}" for name in arrays)
    head = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 6 5 4\nORIGIN 0 0 0\n"
    path.write_text(f"{head}SPACING 1 1 1\nPOINT_DATA 120\nFIELD f {len(arrays)}\n{fields}\n")
    return path


def test_arrays_of_vtk_tell_what_they_are(tmp_path: Path) -> None:
    path = vtk(tmp_path / "a.vtk", ["mask", "Temperature", "p"])
    hints = {name: sg.load(path, array=name).hints.preset for name in ("mask", "Temperature", "p")}
    assert hints == {"mask": None, "Temperature": "field", "p": "field"}
    assert default_transfer(sg.load(path, array="p")).colormap == "viridis"


def test_real_fields() -> None:
    carotid = DATA / "carotid_76x49x45_scalar_and_velocity.vtk"
    if not carotid.exists():
        pytest.skip(f"{carotid} is not here")
    speed = sg.load(carotid, array="vectors")
    assert default_transfer(speed).colormap == "viridis"
    assert default_transfer(sg.load(carotid)).colormap == "ivory[0.6:]"
    winds = sg.load(DATA / "isabel" / "isabel_windspeed_t30.nrrd")
    for volume in (winds, Volume(winds.samples), speed):
        transfer = default_transfer(volume)
        assert transfer.colormap == "viridis" and transfer.window is not None
        assert transfer.window[0] == pytest.approx(float(np.min(volume.samples)))


def test_the_largest_floats_have_a_default() -> None:
    samples = np.random.default_rng(0).random((8, 8, 8)) * np.finfo(float).max * np.where(np.arange(8) % 2, 1.0, -1.0)
    with np.errstate(over="raise"):
        assert np.isfinite(default_transfer(Volume(samples)).points).all()
    assert np.isfinite(preset("mr-default", Volume(samples)).points).all()


# --- logarithmic scales ---


def test_a_logarithmic_scale_is_linear_in_logarithms() -> None:
    transfer = Transfer([(0.01, 0.0), (100.0, 0.8)], "gray", (0.001, 1000.0), scale="log")
    linear = Transfer([(-2.0, 0.0), (2.0, 0.8)], "gray", (-3.0, 3.0))
    values = np.geomspace(1e-5, 1e5, 41)
    assert np.allclose(transfer.opacity(values), linear.opacity(np.log10(values)), atol=1e-12)
    assert np.allclose(transfer.color(values), linear.color(np.log10(values)), atol=1e-12)
    assert transfer.opacity([0.0, -5.0, np.nan]).tolist() == [0.0, 0.0, 0.0]
    assert Transfer.from_toml(transfer.to_toml()) == transfer
    assert "scale" not in linear.to_toml()


@pytest.mark.parametrize(
    "fields",
    [{"points": [(0.0, 0.0), (1.0, 0.5)]}, {"window": (-1.0, 2.0)}, {"scale": "root"}, {"scale": 3}],
)
def test_bad_scales(fields: dict[str, object]) -> None:
    with pytest.raises(InputError, match="transfer"):
        Transfer(**{"points": [(1.0, 0.0), (2.0, 0.5)], "scale": "log", **fields})


def test_integrals_over_values_hold_on_a_logarithmic_scale() -> None:
    """Means over intervals of any decade, and the table that is drawn from, are those of a fine sum."""
    transfer = Transfer([(0.1, 0.0), (1.0, 0.3), (1000.0, 0.9)], "viridis", (0.1, 1000.0), scale="log")
    integral = ValueClassifier.of(transfer, "b-spline", (4, 4, 4)).integral
    for low, high in ((0.11, 0.13), (0.5, 3.0), (2.0, 500.0)):
        values = np.linspace(low, high, 200_001)
        extinction = transfer.extinction(transfer.opacity(values), 1.0)
        right = np.concatenate([(transfer.color(values) * extinction[:, None]).mean(axis=0), [extinction.mean()]])
        assert np.allclose(integral.mean(np.array([low]), np.array([high]))[0], right, rtol=2e-3)


def test_a_logarithmic_picture_is_the_reference(renderer: sg.Renderer) -> None:
    volume = Volume(densities())
    transfer = logarithmic_transfer(preset("field", volume), volume)
    splats, camera = sg.extract(volume, transfer), sg.Camera.orbit(volume, 30, 20, size=(24, 20))
    image, right = renderer.render(splats, camera), sg.reference.render(splats, camera)
    assert image.info["classification"] == "post" and image.pixels[..., 3].max() > 0.5
    assert np.abs(image.pixels - right.pixels).max() < 1e-3


def test_points_of_a_logarithmic_scale() -> None:
    samples = densities()
    found = SceneFile("x", transfer={"scale": "log", "preset": "field"}).transfer_for(Volume(samples))
    assert found.scale == "log" and found.colormap == "viridis" and found.window is not None
    assert found.points[0][0] == pytest.approx(np.median(samples), rel=0.01)
    assert found.window[0] == pytest.approx(samples.min()) and found.points[-1][0] <= samples.max()
    own = SceneFile("x", transfer={"scale": "log", "points": ((0.5, 0.0), (8.0, 0.6))}).transfer_for(Volume(samples))
    assert own.points == ((0.5, 0.0), (8.0, 0.6)) and own.scale == "log"
    wide = np.geomspace(1e-12, 1e3, 4096).reshape(16, 16, 16)
    far = logarithmic_transfer(found, Volume(wide))
    assert far.window is not None and far.window[1] / far.window[0] == pytest.approx(1e4)


@pytest.mark.long
def test_log_says_where_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    samples = densities()
    samples[:3], samples[3] = 0.0, -1.0
    np.save("density.npy", samples)
    assert main(["render", "density.npy", "--log", "-o", "d.png", "--size", "20", "--check", "0"]) == 0
    least, middle = samples[samples > 0].min(), np.median(samples[samples > 0])
    assert f"logarithmic colours viridis over {least:g} … " in capsys.readouterr().out
    assert main(["render", "density.npy", "-o", "e.png", "--size", "20", "--check", "0"]) == 0
    assert "logarithmic" not in capsys.readouterr().out
    assert middle > least and sg.Image.load("d.png").info["transfer"] != sg.Image.load("e.png").info["transfer"]
    np.save("none.npy", -samples * (samples > 0))
    assert main(["render", "none.npy", "--log", "-o", "n.png"]) == 2
    assert "expected positive values" in capsys.readouterr().err

"""Antialiasing by samples: means with the end correction, on the GPU as in float64, and near the truth."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.resolve import MOST_SAMPLES
from splatgl.reference.blend import pixel_means
from tests.helpers.noise import noise, views
from tests.helpers.splatting import SPLATS

AUTO = SPLATS.replace(antialias="auto")


@pytest.mark.parametrize("k", [1, 2, 3, 4, 7])
def test_means_of_cubics_are_exact(k: int) -> None:
    """Within the picture; at its edges, where the last samples are repeated, they are not."""
    size = 6
    x = (np.arange(size * k) + 0.5) / k
    f = 1 + x * (0.5 + x * (-0.3 + 0.07 * x))
    samples = (f[:, None] * (2 - f[None, :]))[..., None]
    edges = np.arange(size + 1.0)
    whole = edges + edges**2 / 4 - edges**3 / 10 + 0.07 * edges**4 / 4
    mean = np.diff(whole)
    right = mean[:, None] * (2 - mean[None, :])
    found = pixel_means(samples, k)[..., 0]
    assert np.abs(found - right)[1:-1, 1:-1].max() < 1e-12
    assert k > 2 or np.abs(samples.reshape(size, k, size, k).mean(axis=(1, 3)) - right)[1:-1, 1:-1].max() > 1e-3


@pytest.mark.parametrize("k", [1, 2, 3])
def test_no_mean_is_beyond_the_samples(k: int, rng: np.random.Generator) -> None:
    samples = (rng.random((5 * k, 4 * k, 4)) < 0.5).astype(float)
    found = pixel_means(samples, k)
    assert found.shape == (5, 4, 4) and found.min() >= 0 and found.max() <= 1
    assert pixel_means(np.ones((3 * k, 2 * k, 1)), k) == pytest.approx(1, abs=1e-15)


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", ["quads", "tiles"])
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_auto_is_within_its_bound(technique: str, blend: str, renderer: sg.Renderer) -> None:
    for grid, tolerance in (("cubes", 0.1), ("sheared", 1 / 255), ("cubes", 1e-4)):
        splats = noise(grid, size=9)
        for camera in views(splats).values():
            background = None if blend == "xray" else (0.2, 0.4, 0.6)
            settings = AUTO.replace(technique=technique, blend=blend, tolerance=tolerance, background=background)
            image = renderer.render(splats, camera, settings, verify_bound=False)
            right = sg.reference.render(splats, camera, settings)
            assert image.info["samples"] == right.info["samples"]
            assert np.abs(image.pixels - right.pixels).max() <= image.info["error_bound"]


def test_samples_are_as_many_as_are_needed() -> None:
    splats = noise()
    near, far = views(splats)["close"], sg.Camera.orbit(splats, size=(16, 16), zoom=1 / 16)
    assert [sg.plan(splats, near, AUTO.replace(tolerance=t)).samples for t in (0.1, 1 / 255, 1e-4)] == [1, 2, 3]
    chosen = sg.plan(splats, far, AUTO)
    assert chosen.samples == MOST_SAMPLES and chosen.program.seen.antialias
    assert not sg.plan(splats, near, AUTO).program.seen.antialias
    assert "2×2 samples a pixel" in sg.plan(splats, near, AUTO).explain()


def test_samples_are_only_as_many_as_opengl_draws() -> None:
    splats = noise()
    large = views(splats)["close"].resized((9000, 8))
    assert sg.plan(splats, large, AUTO).samples == 1
    assert "2×2 samples a pixel left out" in sg.plan(splats, large, AUTO).explain()
    assert sg.plan(splats, large.resized((8192, 8)), AUTO).samples == 2
    assert sg.plan(splats, large.resized((8192, 4096)), AUTO).samples == 1


def test_auto_is_nearer_to_many_samples(renderer: sg.Renderer) -> None:
    """Than one sample, and than splats that are stretched, by far."""
    volume = sg.scenes.ball(14)
    splats = sg.extract(volume, sg.default_transfer(volume), classification="pre")
    camera = sg.Camera.orbit(volume, 20, 10, size=(40, 40))
    settings = {"auto": AUTO, "paper": SPLATS, "off": SPLATS.replace(antialias="off")}
    truth = renderer.render(splats, camera, SPLATS.replace(antialias="supersample", samples=16)).pixels
    off = {
        name: np.sqrt(((renderer.render(splats, camera, s).pixels - truth) ** 2).mean()) for name, s in settings.items()
    }
    assert off["auto"] < 0.2 * off["paper"] and off["auto"] < 0.2 * off["off"]

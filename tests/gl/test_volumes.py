"""Whole volumes: any affine grid shows the same object; axes, handedness and rows; blending's closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.scenes import ball, letter_f
from splatgl.reference.blend import pixel_means
from splatgl.splat.kernels import kernel
from tests.helpers.splatting import SPLATS

SHEAR = np.array([[1.0, 0.35, 0.1], [0.0, 1.0, -0.25], [0.2, 0.0, 1.0]])
GRIDS = [((1, 1, 1), np.eye(3)), ((1, 1, 5), np.eye(3)), ((0.5, 1, 2), np.eye(3)), ((1, 1.2, 1.5), SHEAR)]
VIEWS = [(0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.5, -0.7, 0.6)]
# τ is proportional to the sample within 0.5 %
FAINT = sg.Transfer([(0, 0), (1, 0.01)], unit=1.0, shading=False)


def pictures(smooth: bool, view: tuple, pixels: int, renderer: sg.Renderer, projection: str) -> list[np.ndarray]:
    found = []
    for spacing, direction in GRIDS:
        splats = sg.extract(ball(30.0, spacing, direction, smooth), FAINT, classification="pre")
        eye = 100.0 * np.array(view)
        size = (pixels, pixels)
        if projection == "perspective":
            camera = sg.Camera.look_at(eye, (0, 0, 0), (0, 1, 0.1), 40, size)
        else:
            camera = sg.Camera.orthographic(eye, (0, 0, 0), (0, 1, 0.1), 72, size)
        found.append(renderer.render(splats, camera, SPLATS.replace(blend="xray")).pixels[..., 3].astype(np.float64))
    return found


@pytest.mark.few(2)
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize("pixels", [24, 72])
def test_smooth_ball_on_any_grid(view: tuple, projection: str, pixels: int, renderer: sg.Renderer) -> None:
    """Within 2 % of the peak of each other; voxels 1/6 … 3 pixels wide."""
    found = pictures(True, view, pixels, renderer, projection)
    peak = max(picture.max() for picture in found)
    # the ray through the middle: 0.01 · ∫ ½(1 + cos(πr/30)) dr over 60 = 0.3; wide pixels blur it
    assert peak == pytest.approx(0.3, rel=0.02 if pixels > 24 else 0.04)
    for picture in found[1:]:
        assert np.abs(picture - found[0]).max() < 0.02 * peak


@pytest.mark.parametrize("view", VIEWS)
def test_hard_ball_keeps_its_sum(view: tuple, renderer: sg.Renderer) -> None:
    found = pictures(False, view, 72, renderer, "orthographic")
    volume = 4 / 3 * np.pi * 30**3 * -np.log1p(-0.01)
    for picture in found:
        assert picture.sum() == pytest.approx(volume, rel=0.01)


def test_letter_f_pins_axes_and_rows(renderer: sg.Renderer) -> None:
    """From the front: x to the right in red, z upwards in blue, y away in green; F's arms at the top right."""
    splats = sg.extract(letter_f(), sg.default_transfer(letter_f()), classification="pre")
    camera = sg.Camera.orbit(splats, azimuth=0, elevation=0, fov=20, size=(120, 120))
    pixels = renderer.render(splats, camera, SPLATS.replace(shading="off")).pixels
    assert_looks_like_f(pixels, camera, splats)
    # from behind x runs to the left
    behind = sg.Camera.orbit(splats, azimuth=180, elevation=0, fov=20, size=(120, 120))
    with pytest.raises(AssertionError):
        assert_looks_like_f(renderer.render(splats, behind, SPLATS.replace(shading="off")).pixels, camera, splats)


def assert_looks_like_f(pixels: np.ndarray, camera: sg.Camera, splats: sg.Splats) -> None:
    def color_at(x: float, y: float, z: float) -> np.ndarray:
        eye = camera.eye_from_points(np.array([x, y, z]))
        pitch = camera.extent / camera.size[1]
        column = eye[0] / eye[2] / pitch + camera.size[0] / 2
        row = eye[1] / eye[2] / pitch + camera.size[1] / 2
        return pixels[int(row), int(column)]

    # right means a larger column, up a smaller row
    assert camera.eye_from_points(np.array([50.0, 0, 0]))[0] > camera.eye_from_points(np.array([5.0, 0, 0]))[0]
    red, blue = color_at(50, 0, 1.5), color_at(1.5, 0, 24)
    assert red[0] > 3 * max(red[1], red[2])
    assert blue[2] > 2 * max(blue[0], blue[1])
    # the F: stem, upper arm, lower arm, and the gap between the arms
    for x, z in ((18, 30), (40, 58), (34, 40)):
        assert color_at(x, 16, z)[3] > 0.9
    for x, z in ((40, 47), (44, 40), (40, 25)):
        assert color_at(x, 16, z)[3] < 0.1


def two_splats(front: float = 0.7, back: float = 1.1) -> sg.Splats:
    return sg.Splats.from_points([(0, 0, 5), (0, 0, 9)], [(1, 0.2, 0.1), (0.1, 0.3, 1)], [front, back])


def pixel_of(image: sg.Image) -> np.ndarray:
    return image.pixels[0, 0].astype(np.float64)


@pytest.fixture
def through_the_middle() -> sg.Camera:
    return sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (1, 1))


def test_composite_of_two(renderer: sg.Renderer, through_the_middle: sg.Camera) -> None:
    """1 − exp(−τF(0)) each, the nearer over the farther; antialiasing off: both are far beyond z_k."""
    peak = float(kernel("crawfis-max").footprint(np.zeros(())))
    a, b = -np.expm1(-0.7 * peak), -np.expm1(-1.1 * peak)
    near, far = np.array([1, 0.2, 0.1]), np.array([0.1, 0.3, 1])
    found = pixel_of(renderer.render(two_splats(), through_the_middle, SPLATS.replace(antialias="off")))
    assert found[:3] == pytest.approx(near * a + (1 - a) * far * b, abs=1e-4)
    assert found[3] == pytest.approx(1 - (1 - a) * (1 - b), abs=1e-4)


def test_xray_and_mip_of_two(renderer: sg.Renderer, through_the_middle: sg.Camera) -> None:
    peak = float(kernel("crawfis-max").footprint(np.zeros(())))
    near, far = np.array([1, 0.2, 0.1]), np.array([0.1, 0.3, 1])
    xray = pixel_of(renderer.render(two_splats(), through_the_middle, SPLATS.replace(blend="xray", antialias="off")))
    assert xray[:3] == pytest.approx(peak * (0.7 * near + 1.1 * far), abs=2e-4)
    assert xray[3] == pytest.approx(peak * 1.8, abs=2e-4)
    # the maximum of opacity·colour by channel; opacity is of the reference length, here 1
    mip = pixel_of(renderer.render(two_splats(), through_the_middle, SPLATS.replace(blend="mip")))
    assert mip[:3] == pytest.approx(np.maximum(near * -np.expm1(-0.7), far * -np.expm1(-1.1)), abs=2e-4)
    assert mip[3] == pytest.approx(-np.expm1(-1.1), abs=2e-4)


@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth"])
def test_attenuation_of_one(attenuation: str, renderer: sg.Renderer) -> None:
    """Beyond z_k: coverage·(1 − e^−τF) as the paper has it, 1 − e^−(τF/m²) by optical depth; alike before it."""
    peak = float(kernel("crawfis-max").footprint(np.zeros(())))
    for pixel in (0.5, 4.0):
        camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), pixel, (1, 1))
        splats = sg.Splats.from_points([(0, 0, 0)], [(1, 1, 1)], [2.0])
        found = pixel_of(renderer.render(splats, camera, SPLATS.replace(attenuation=attenuation)))[3]
        m2 = max(1.0, pixel) ** 2
        paper, depth = -np.expm1(-2 * peak) / m2, -np.expm1(-2 * peak / m2)
        assert found == pytest.approx(paper if attenuation == "opacity" else depth, abs=1e-4)


def test_supersampling_is_the_mean_of_its_samples(renderer: sg.Renderer) -> None:
    splats = sg.extract(letter_f(), sg.default_transfer(letter_f()), classification="pre")
    camera = sg.Camera.orbit(splats, 30, 20, size=(40, 30))
    settings = SPLATS.replace(antialias="supersample", samples=3)
    found = renderer.render(splats, camera, settings).pixels
    fine = renderer.render(splats, camera.resized((120, 90)), SPLATS.replace(antialias="paper")).pixels
    assert np.abs(found - pixel_means(fine.astype(float), 3)).max() < 1e-6


def test_background_lies_behind(renderer: sg.Renderer) -> None:
    splats = two_splats()
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (32, 32))
    clear = renderer.render(splats, camera, SPLATS).pixels
    ground = (0.2, 0.4, 0.6)
    found = renderer.render(splats, camera, SPLATS.replace(background=ground)).pixels
    assert np.abs(found - (clear + (1 - clear[..., 3:]) * np.array([*ground, 1]))).max() < 1e-6
    assert found[0, 0] == pytest.approx([*ground, 1], abs=1e-6)


@pytest.mark.parametrize("target", ["rgba16f", "rgba8"])
def test_targets_hold_what_they_can(target: str, renderer: sg.Renderer) -> None:
    """2000 layers of opacity 0.001: half floats and 8 bits lose them, as measured for this stack."""
    splats = sg.Splats.from_points(np.arange(2000)[:, None] * [0, 0, 1.0], np.ones((2000, 3)), np.full(2000, 1e-3))
    camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 1e-6, (1, 1))
    right = pixel_of(renderer.render(splats, camera, SPLATS))[3]
    peak = float(kernel("crawfis-max").footprint(np.zeros(())))
    assert right == pytest.approx(-np.expm1(-2 * peak), abs=3e-4)
    # software rounds to nearest and keeps less; a card may keep more
    assert abs(pixel_of(renderer.render(splats, camera, SPLATS.replace(target=target)))[3] - right) > 0.1 * right


def test_8_bits_mix_display_values(renderer: sg.Renderer) -> None:
    """400 splats of opacity 0.03 end at their own colour but for what 8 bits lose: 0.03 (c − pixel) < ½. The reference
    mixes as the framebuffer does: half of white is the display value ½.
    """
    camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 1e-6, (1, 1))
    peak, paper = float(kernel("crawfis-max").footprint(np.zeros(()))), sg.Settings.paper(shading="off")

    def pile(count: int, levels: tuple[int, int, int], opacity: float) -> sg.Splats:
        colors = np.tile(linear_from_srgb(np.array(levels) / 255), (count, 1))
        places = np.arange(count)[:, None] * [0, 0, 2.0]
        return sg.Splats.from_points(places, colors, np.full(count, -np.log1p(-opacity) / peak))

    many, half = pile(400, (60, 100, 40), 0.03), pile(1, (255, 255, 255), 0.5)
    for settings in (paper, paper.replace(background="black")):
        drawn, right = (pixel_of(draw(many, camera, settings)) for draw in (renderer.render, sg.reference.render))
        assert np.abs(255 * srgb_from_linear(drawn[:3]) - (44, 84, 24)).max() < 9
        assert 255 * srgb_from_linear(right[:3]) == pytest.approx((60, 100, 40), abs=0.1)
    for ground, shown in (("black", 0.5), ("#808080", 0.5 + 0.5 * 128 / 255)):
        for draw in (renderer.render, sg.reference.render):
            image = draw(half, camera, paper.replace(background=ground))
            assert srgb_from_linear(pixel_of(image)[:3]) == pytest.approx([shown] * 3, abs=2 / 255)
    assert pixel_of(renderer.render(half, camera, paper)) == pytest.approx([0.5] * 4, abs=2 / 255)


def test_sums_need_more_than_8_bits(renderer: sg.Renderer) -> None:
    splats, camera = two_splats(), sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 1, (3, 3))
    image = renderer.render(splats, camera, sg.Settings.paper(blend="xray", table_bits=32))
    assert image.info["target"] == "rgba32f" and "sums of optical depth exceed 8 bits" in " ".join(image.notes)
    assert (
        image.pixels
        == renderer.render(splats, camera, sg.Settings.paper(blend="xray", table_bits=32, target="rgba32f")).pixels
    ).all()


def test_8_bits_hold_a_single_layer(renderer: sg.Renderer) -> None:
    """Of labels, too, which are drawn as boxes instead of splats in sheets."""
    values, labels = np.ones((3, 3, 3)), sg.Volume(np.ones((3, 3, 3), np.uint8)).of_values("labels")
    for volume, told in ((sg.Volume(values), "target rgba8"), (labels, "target rgba8: expected a single layer")):
        scene = sg.Scene([sg.Layer(volume), sg.Layer(volume)])
        camera = sg.Camera.orbit(scene, size=(4, 4))
        for draw in (renderer.render, sg.reference.render):
            with pytest.raises(sg.InputError, match=told):
                draw(scene, camera, sg.Settings(target="rgba8"))


def test_shading_is_a_head_light(renderer: sg.Renderer) -> None:
    """C = c (0.3 + 0.7 |n·l|): full along the gradient, 0.3 + 0.35 at 60° to it."""
    volume = sg.Volume(np.broadcast_to(np.arange(9.0)[:, None, None], (9, 41, 41)))
    splats = sg.extract(volume, sg.Transfer([(0, 0.99)], colormap="white"), classification="pre")
    for slant, right in ((0.0, 1.0), (60.0, 0.65)):
        a = np.radians(slant)
        eye = np.array([20, 20, 4]) + 50 * np.array([np.sin(a), 0, -np.cos(a)])
        camera = sg.Camera.orthographic(eye, (20, 20, 4), (0, -1, 0), 2, (1, 1))
        pixel = pixel_of(renderer.render(splats, camera, SPLATS))
        assert pixel[0] / pixel[3] == pytest.approx(right, abs=2e-3)
        plain = pixel_of(renderer.render(splats, camera, SPLATS.replace(shading="off")))
        assert plain[0] / plain[3] == pytest.approx(1.0, abs=1e-5)


def test_orthographic_sees_nothing_behind_the_eye(renderer: sg.Renderer) -> None:
    camera = sg.Camera.orthographic((0, 0, 7), (0, 0, 9), (0, -1, 0), 4, (3, 3))
    settings = SPLATS.replace(blend="xray")
    both = renderer.render(two_splats(), camera, settings).pixels
    alone = renderer.render(sg.Splats.from_points([(0, 0, 9)], [(0.1, 0.3, 1)], [1.1]), camera, settings).pixels
    assert (both == alone).all()
    assert alone[1, 1, 3] > 0


@pytest.mark.few(5)
@pytest.mark.parametrize("depth", [1e-30, 1e-7, 1e-3, 0.02, 0.06, 0.0626, 0.07, 0.5, 5.0, 50.0])
def test_opacity_of_any_optical_depth(depth: float, renderer: sg.Renderer, through_the_middle: sg.Camera) -> None:
    """1 − exp(−τ) keeps float32's digits from 1e−30 up; the float table's F costs 2e−4 of τ."""
    peak = float(kernel("crawfis-max").footprint(np.zeros(())))
    splats = sg.Splats.from_points([(0, 0, 5)], [(1, 1, 1)], [depth])
    through = SPLATS.replace(antialias="off")
    tau = float(pixel_of(renderer.render(splats, through_the_middle, through.replace(blend="xray")))[3])
    assert tau == pytest.approx(depth * peak, rel=2e-4)
    found = pixel_of(renderer.render(splats, through_the_middle, through))[3]
    assert found == pytest.approx(-np.expm1(-tau), rel=1e-6)

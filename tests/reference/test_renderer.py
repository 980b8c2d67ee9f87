"""The float64 reference against closed forms and against the same sums done one pair at a time."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.scenes import letter_f
from splatgl.geometry.view import GridView
from splatgl.planning.culling import back_to_front, order_for
from splatgl.planning.resolve import Resolved
from splatgl.planning.scene import resolve_scene
from splatgl.reference import rays
from splatgl.reference.blend import ADD, Accumulator, CompensatedSum, pixel_means
from splatgl.reference.rays import PixelBoxes, Pixels, pixel_boxes, splats_may_reach
from splatgl.reference.renderer import render, render_pixels
from splatgl.splat.footprint import ROWS, Splat
from splatgl.splat.kernels import kernel
from splatgl.splat.line_integral import row1
from tests.helpers.noise import GRIDS, noise, views
from tests.helpers.splatting import SPLATS

PEAK = float(kernel("crawfis-max").footprint(np.zeros(())))
# extinctions of a near and a far splat, and their colours, exact in float32
NEAR, FAR = 0.75, 1.125
NEAR_COLOR, FAR_COLOR = np.array([1, 0.25, 0.125]), np.array([0.125, 0.5, 1])


def two_splats(swapped: bool = False) -> sg.Splats:
    places = [(0, 0, 5), (0, 0, 9)]
    return sg.Splats.from_points(places[::-1] if swapped else places, [NEAR_COLOR, FAR_COLOR], [NEAR, FAR])


def pixel_of(splats: sg.Splats, **asked: object) -> np.ndarray:
    """One pixel that looks along the z axis from the origin."""
    camera = sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 60, (1, 1))
    return render(splats, camera, SPLATS.replace(**{"antialias": "off", **asked})).pixels[0, 0]


def scattered(count: int, spread: float, spacing: object = 1.0, seed: int = 4) -> sg.Splats:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-spread, spread, (count, 3))
    return sg.Splats.from_points(points, rng.random((count, 3)), rng.uniform(0.1, 2, count), spacing)


@pytest.mark.parametrize("swapped", [False, True])
def test_composite_of_two(swapped: bool) -> None:
    (near, a), (far, b) = ((c, -np.expm1(-s * PEAK)) for c, s in ((NEAR_COLOR, NEAR), (FAR_COLOR, FAR)))
    if swapped:
        (near, a), (far, b) = (far, b), (near, a)
    right = np.append(near * a + (1 - a) * far * b, 1 - (1 - a) * (1 - b))
    assert pixel_of(two_splats(swapped)) == pytest.approx(right, abs=1e-14)
    # drawn from either end the picture is the same
    assert pixel_of(two_splats(swapped), order="front-to-back") == pytest.approx(right, abs=1e-14)


def test_xray_and_mip() -> None:
    xray = np.append(NEAR * NEAR_COLOR + FAR * FAR_COLOR, NEAR + FAR) * PEAK
    assert pixel_of(two_splats(), blend="xray") == pytest.approx(xray, rel=1e-13)
    # the maximum by channel of opacity · colour, without 1/m²
    for antialias in ("off", "paper"):
        mip = pixel_of(two_splats(), blend="mip", antialias=antialias)
        opacity = -np.expm1([-NEAR, -FAR])
        right = np.append(np.maximum(opacity[0] * NEAR_COLOR, opacity[1] * FAR_COLOR), opacity[1])
        # a bent line through the middle is not quite the straight one
        assert mip == pytest.approx(right, rel=1e-12 if antialias == "off" else 0.1)
    alone = sg.Splats.from_points([(0.375, 0, 5)], [FAR_COLOR], [FAR])
    shape = float(kernel("crawfis-max").footprint(np.array(0.375))) / PEAK
    assert pixel_of(alone, blend="mip") == pytest.approx(-np.expm1(-FAR) * shape * np.append(FAR_COLOR, 1), rel=1e-12)


def test_one_splat_is_its_line_integral() -> None:
    """Every pixel 1 − exp(−τ row1), on a grid that is not cubic."""
    splats = sg.Splats.from_points([(3, 1, 20)], [(1, 0.5, 0)], [0.8], (1, 2, 0.7))
    camera = sg.Camera.look_at((0, 0, 0), (2, 1, 20), (0, -1, 0), 40, (12, 8))
    found = render(splats, camera, SPLATS.replace(attenuation="optical-depth")).pixels
    x, y = camera.slopes()
    view = GridView.of(splats.grid, camera, kernel("crawfis-max"))
    assert (view.coverage(view.voxels(splats.positions)[2]) < 1).all()
    voxel = view.voxels(splats.positions)[:, :, None]
    value = row1(view, voxel, np.stack(np.broadcast_arrays(x[None, :], y[:, None]))).value
    right = -np.expm1(-splats.records["optical_depth"].astype(float) * value)
    assert np.abs(found[..., 3] - right).max() < 1e-13
    assert np.abs(found[..., :3] - right[..., None] * [1, 0.5, 0]).max() < 1e-13
    assert right.max() > 0.01


@pytest.mark.parametrize("row", ["row2", "row3", "row4", "row5"])
def test_other_rows_are_table_1(row: str) -> None:
    """One cubic splat beyond z_k, every pixel."""
    voxel, camera = (3.0, 1.0, 20.0), sg.Camera.look_at((0, 0, 0), (0, 0, 1), (0, -1, 0), 50, (12, 8))
    splats = sg.Splats.from_points([voxel], [(1, 0.5, 0)], [0.5])
    found = render(splats, camera, SPLATS.replace(blend="xray"), row).pixels[..., 3]
    ray = np.stack(np.broadcast_arrays(*(s[None, :] if n == 0 else s[:, None] for n, s in enumerate(camera.slopes()))))
    right = 0.5 * ROWS[row](Splat(kernel("crawfis-max"), np.array(voxel), np.moveaxis(ray, 0, -1), camera.z_k(1.0)))
    assert camera.z_k(1.0) < 20 and right.max() > 0.01
    assert np.abs(found - right).max() < 1e-12


def test_sums_keep_what_rounding_takes() -> None:
    """10⁻⁷ in a hundred parts between two huge numbers; a faint pixel after an opaque one in the same chunk."""
    kept, where = CompensatedSum.zeros((1,)), np.array([0])
    for term in (1e8, *[1e-9] * 100, -1e8):
        kept.add(where, np.array([term]))
    assert kept.value[0] == pytest.approx(1e-7, rel=1e-12, abs=0)
    faint = 1e-7 * np.arange(1, 5)
    band, depth = Accumulator.empty(2), np.concatenate([[1e9], faint])
    ADD["over"](band, np.array([0, 1, 1, 1, 1]), depth, np.eye(5)[:, 2:], np.ones(5))
    before = np.concatenate([[0], np.cumsum(faint)])
    right = -np.expm1(-faint) * np.exp(-before[:-1])
    assert band.color.value[1] == pytest.approx(right[1:], rel=1e-14, abs=0)


@pytest.mark.long
def test_a_million_faint_splats() -> None:
    """10⁶ optical depths of 1e−7: 1 − e^−0.1, to the last digits."""
    points = np.arange(1_000_000)[:, None] * np.array([0, 0, 1.0])
    splats = sg.Splats.from_points(points, np.ones((1_000_000, 3)), np.full(1_000_000, 1e-7 / PEAK))
    camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 1e-6, (1, 1))
    pixel = render(splats, camera).pixels[0, 0]
    # the splats' own depths are float32
    assert pixel == pytest.approx(-np.expm1(-1e6 * PEAK * splats.records["optical_depth"][0].astype(float)), rel=1e-13)
    assert pixel == pytest.approx(0.0951625864882278, rel=1e-7)


def test_opaque_splats_leave_nothing_undefined() -> None:
    """Behind optical depths of 10⁴ colour stays the front's, opacity 1, in both attenuations."""
    points = np.arange(400)[:, None] * np.array([0, 0, 1.0])
    splats = sg.Splats.from_points(points, np.linspace(0, 1, 1200).reshape(400, 3), np.full(400, 1e4))
    for height, attenuation in ((1e-6, "opacity"), (1.5, "opacity"), (1.5, "optical-depth")):
        camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), height, (1, 1))
        pixel = render(splats, camera, SPLATS.replace(attenuation=attenuation)).pixels[0, 0]
        assert np.isfinite(pixel).all()
        assert pixel[3] == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("attenuation", ["opacity", "optical-depth"])
def test_attenuation(attenuation: str) -> None:
    """(1 − e^−τF)/m² as the paper has it, 1 − e^−(τF/m²) by optical depth; two of them over each other."""
    camera = sg.Camera.orthographic((0, 0, -9), (0, 0, 0), (0, -1, 0), 4.0, (1, 1))
    splats = sg.Splats.from_points([(0, 0, 0), (0, 0, 3)], np.ones((2, 3)), [2.0, 2.0])
    one = -np.expm1(-2 * PEAK) / 16 if attenuation == "opacity" else -np.expm1(-2 * PEAK / 16)
    found = render(splats, camera, SPLATS.replace(attenuation=attenuation)).pixels[0, 0]
    assert found == pytest.approx(1 - (1 - one) ** 2, rel=1e-12)


@pytest.mark.few(2)
@pytest.mark.parametrize(("kernel_name", "bound"), [("crawfis-max", 0.011), ("gaussian", 0.045)])
@pytest.mark.parametrize("distance", [10.0, 200.0])
def test_homogeneous_slab(kernel_name: str, bound: float, distance: float) -> None:
    """1 − exp(−σL) with L the slant path, away from the edges, before and beyond z_k."""
    sigma, thick, wide = 0.2, 12, 61 if distance < 100 else 101
    volume = sg.Volume(np.ones((thick, wide, wide), np.uint8))
    splats = sg.extract(volume, sg.Transfer([(0, -np.expm1(-sigma))], unit=1.0, shading=False), classification="pre")
    middle = (wide - 1) / 2
    eye, size = (middle, middle, -0.5 - distance), (60, 60) if distance < 100 else (16, 16)
    camera = sg.Camera.look_at(eye, (middle, middle, 0), (0, -1, 0), 60 if distance < 100 else 12, size)
    assert sg.plan(splats, camera, SPLATS).program.seen.antialias == (distance > 100)
    found = render(splats, camera, SPLATS.replace(kernel=kernel_name)).pixels[..., 3]
    x, y = camera.slopes()
    path = thick * np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2)
    assert np.abs(-np.log1p(-found) / (sigma * path) - 1).max() < bound


def by_hand(splats: sg.Splats, camera: sg.Camera, blend: str) -> np.ndarray:
    """The picture, a splat at a time over all pixels, back to front."""
    plan = sg.plan(splats, camera, SPLATS)
    view = GridView.of(splats.grid, camera, kernel("crawfis-max"), plan.program.seen.antialias)
    x, y = (slopes / (1 if camera.perspective else splats.grid.mean_spacing) for slopes in camera.slopes())
    ray = np.stack(np.broadcast_arrays(x[None, :], y[:, None]))
    picture = np.zeros((*ray.shape[1:], 4))
    for n in back_to_front(splats, order_for(splats, camera)):
        voxel = view.voxels(splats.positions[n : n + 1])
        if not camera.perspective and voxel[2, 0] < 0:
            continue
        found = row1(view, voxel[:, :, None], ray)
        depth = float(splats.records["optical_depth"][n])
        light = np.append(splats.colors[n].astype(float), 1.0)
        if blend == "composite":
            alpha = -np.expm1(-depth * found.value)[..., None]
            picture = light * alpha + (1 - alpha) * picture
        elif blend == "xray":
            picture += light * depth * found.value[..., None]
        else:
            alpha = -np.expm1(-depth * splats.unit / splats.grid.mean_spacing)
            picture = np.maximum(picture, light * alpha * (found.value / found.peak)[..., None])
    return picture


@pytest.mark.few(3)
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
@pytest.mark.parametrize("spacing", [1.0, (0.6, 1.0, 1.9)])
@pytest.mark.parametrize("parallel", [False, True])
def test_one_splat_at_a_time(blend: str, spacing: object, parallel: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks, bands, sorting, boxes: the eye amid the splats, many small chunks."""
    splats = scattered(300, 6.0, spacing)
    camera = sg.Camera.look_at((1, -2, 0.5), (1.5, 3, 0), (0, 0, 1), 100, (21, 17))
    if parallel:
        camera = camera.parallel(splats, 12.0)
    monkeypatch.setattr(rays, "PAIRS", 1000)
    monkeypatch.setattr("splatgl.reference.renderer.BAND", 100)
    found = render(splats, camera, SPLATS.replace(blend=blend, attenuation="optical-depth")).pixels
    right = by_hand(splats, camera, blend)
    assert right[..., 3].max() > 0.8
    assert np.abs(found - right).max() < 1e-11 * right.max()


@pytest.mark.few(5)
@pytest.mark.parametrize("row", ["row1", "row2", "row3", "row4", "row5"])
@pytest.mark.parametrize("pixels", [8, 32])
def test_boxes_hold_every_ray(row: str, pixels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every splat tried on every pixel gives the same picture, splats behind and around the eye included."""
    grids = [1.0] if row in ("row2", "row3") else [1.0, (0.5, 1.0, 2.5)]
    for spacing in grids:
        splats = scattered(200, 9.0, spacing, seed=pixels)
        camera = sg.Camera.look_at((1, -2, 0.5), (1.5, 3, 0), (0, 0, 1), 110, (pixels, pixels // 2))
        found = render(splats, camera, SPLATS.replace(blend="xray"), row).pixels
        with monkeypatch.context() as patched:
            patched.setattr("splatgl.reference.renderer.pixel_boxes", everywhere)
            right = render(splats, camera, SPLATS.replace(blend="xray"), row).pixels
        assert np.abs(found - right).max() < 1e-11


def everywhere(view: GridView, row: str, voxel: np.ndarray, camera: sg.Camera) -> PixelBoxes:
    zero = np.zeros(voxel.shape[1], np.int64)
    return PixelBoxes(zero, zero + camera.size[0], zero, zero + camera.size[1])


def test_supersampling_and_background() -> None:
    splats = scattered(300, 5.0)
    camera = sg.Camera.orbit(splats, 30, 20, size=(20, 15))
    found = render(splats, camera, SPLATS.replace(antialias="supersample", samples=3)).pixels
    fine = render(splats, camera.resized((60, 45)), SPLATS).pixels
    assert np.abs(found - pixel_means(fine, 3)).max() < 1e-14
    # by 1/24 of the differences across a pixel's edges from the plain mean
    assert 1e-4 < np.abs(found - fine.reshape(15, 3, 20, 3, 4).mean(axis=(1, 3))).max() < 0.1
    ground = (0.2, 0.4, 0.6)
    on = render(splats, camera, SPLATS.replace(antialias="supersample", samples=3, background=ground)).pixels
    assert np.abs(on - (found + (1 - found[..., 3:]) * [*ground, 1])).max() < 1e-14


def test_shading() -> None:
    """C = c (0.3 + 0.7 |n·l|): 1 along the gradient, 0.65 at 60° to it; off changes nothing else."""
    volume = sg.Volume(np.broadcast_to(np.arange(9.0)[:, None, None], (9, 41, 41)))
    splats = sg.extract(volume, sg.Transfer([(0, 0.99)], colormap="white"), classification="pre")
    for slant, right in ((0.0, 1.0), (60.0, 0.65)):
        a = np.radians(slant)
        eye = np.array([20, 20, 4]) + 500 * np.array([np.sin(a), 0, -np.cos(a)])
        for camera in (
            sg.Camera.orthographic(eye, (20, 20, 4), (0, -1, 0), 2, (1, 1)),
            sg.Camera.look_at(eye, (20, 20, 4), (0, -1, 0), 0.1, (1, 1)),
        ):
            lit, plain = (render(splats, camera, SPLATS.replace(shading=s)).pixels[0, 0] for s in ("auto", "off"))
            assert lit[0] / plain[0] == pytest.approx(right, abs=2e-3 if slant else 1e-4)
            assert lit[3] == plain[3]


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_any_place_and_unit(scale: float) -> None:
    samples = np.random.default_rng(8).random((5, 6, 7)).astype(np.float32)
    pictures = []
    for s, offset in ((1.0, 0.0), (scale, 1e6 * scale)):
        volume = sg.Volume(samples, spacing=(s, 2 * s, s), origin=(offset, -offset, offset))
        splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.5)]), classification="pre")
        pictures.append(render(splats, sg.Camera.orbit(volume, 30, 20, size=(24, 24))).pixels)
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-8


def test_what_it_says_and_refuses() -> None:
    splats = scattered(20, 3.0)
    camera = sg.Camera.orbit(splats, size=(8, 8))
    seen: list[int] = []

    def progress(bands: object, count: int) -> object:
        seen.append(count)
        return bands

    image = sg.reference.render(splats, camera, SPLATS, row="row4", progress=progress)
    assert image.pixels.dtype == np.float64 and seen == [1]
    assert (image.info["row"], image.info["kernel"]) == ("row4", "crawfis-max")
    assert image.info["seconds"] > 0
    with pytest.raises(sg.InputError, match="row: expected row1 or row2"):
        render(splats, camera, row="row6")
    with pytest.raises(sg.InputError, match="row: expected row1, row4 or row5 for voxels that are not cubes"):
        render(scattered(20, 3.0, (1, 1, 2)), camera, row="row2")


def test_no_splats_is_the_background() -> None:
    nothing = sg.extract(sg.Volume(np.zeros((4, 4, 4))), sg.Transfer([(0, 0), (1, 1)]), classification="pre")
    image = render(nothing, sg.Camera.orbit(nothing, size=(8, 8)), SPLATS.replace(background=(0.5, 0, 1)))
    assert (image.pixels == np.array([0.5, 0, 1, 1])).all()


def test_letter_reads_as_drawn() -> None:
    """Rows from the top, columns from the left: red x to the right of the stem, F's arms above."""
    splats = sg.extract(letter_f(), sg.default_transfer(letter_f()), classification="pre")
    pixels = render(splats, sg.Camera.orbit(splats, 0, 0, fov=20, size=(60, 60)), SPLATS.replace(shading="off")).pixels
    rows, columns = np.nonzero(pixels[..., 3] > 0.5)
    red = (pixels[..., 0] > 3 * pixels[..., 2]) & (pixels[..., 3] > 0.5)
    assert np.nonzero(red)[0].mean() > rows.mean() + 5
    top = columns[rows < 25]
    assert top.mean() > 25 and (rows < 30).mean() > 0.4


@pytest.mark.parametrize("compositing", ["splats", "sheets"])
@pytest.mark.parametrize("antialias", ["off", "auto", "supersample"])
def test_scattered_pixels_are_those_of_the_picture(antialias: str, compositing: str) -> None:
    splats = sg.extract(
        sg.Volume(np.random.default_rng(3).random((6, 6, 6))), sg.Transfer([(0.4, 0), (1, 0.8)]), classification="pre"
    )
    camera = sg.Camera.orbit(splats, 30, 20, size=(20, 16), zoom=1.6)
    settings = SPLATS.replace(antialias=antialias, samples=3, compositing=compositing, background=(0.1, 0.2, 0.3))
    whole = render(splats, camera, settings).pixels.reshape(-1, 4)
    random = np.flatnonzero(np.random.default_rng(1).random(320) < 0.1)
    for wanted in (np.array([0, 19, 20, 300, 319]), np.arange(140, 160), random, random[:0]):
        found = render_pixels(resolve_scene(splats, camera, settings), wanted)
        assert found.shape == (len(wanted), 4) and np.abs(found - whole[wanted]).max(initial=0.0) < 1e-12
    assert np.ptp(whole[random]) > 0.3


@pytest.mark.parametrize("name", ["fitted", "close", "wide", "parallel", "far", "parallel, far"])
@pytest.mark.parametrize("grid", GRIDS)
def test_only_splats_that_reach_pixels_are_drawn(grid: str, name: str) -> None:
    """No splat whose box contains a pixel is left out, and few others are kept."""
    splats = noise(grid)
    camera = views(splats)[name]
    resolved = Resolved.of(splats, camera, SPLATS)
    view, camera = resolved.view, resolved.camera
    boxes = pixel_boxes(view, "row1", view.voxels(splats.positions), camera)
    width, height = camera.size
    kept = []
    middle = height // 2 * width + width // 2
    for some in ([middle, middle + 1], [0, 1, 2, width, width + 1], range(width), [5, 3 * width + 2]):
        wanted = Pixels.of(camera.size, np.array(some))
        meet = np.zeros(len(splats), bool)
        for row, column in zip(wanted.row, wanted.column, strict=True):
            inside = (boxes.left <= column) & (column < boxes.right)
            meet |= inside & (boxes.top <= row) & (row < boxes.bottom)
        owner, pixel = wanted.within(boxes)
        assert np.array_equal(np.unique(owner), np.flatnonzero(meet)) and (wanted.most_in(boxes) >= meet).all()
        assert ((boxes.left[owner] <= wanted.column[pixel]) & (wanted.row[pixel] < boxes.bottom[owner])).all()
        found = splats_may_reach(splats, view, wanted)
        assert not (meet & ~found).any()
        kept.append(found.mean())
    assert min(kept) < 0.6 or "far" in name

"""Labels drawn as the boxes of their voxels: against closed forms, and a march from face to face of the test's own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.volume import Label, halve_volume
from splatgl.planning.culling import visible_boxes
from splatgl.reference.depth_pick import depths, pick
from splatgl.splat import lighting
from splatgl.transfer.presets import label_transfer
from tests.helpers.boxes import BLUE, GREEN, GRIDS, RED, TABLE, noise, splats_of

PLAIN = sg.Settings(antialias="off", shading="off")


Parts = list[tuple[float, float, int]]


def passed(volume: sg.Volume, camera: sg.Camera, planes: tuple[tuple[float, ...], ...] = ()) -> Iterator[Parts]:
    """Of each pixel's ray, from face to face of cells: both distances, and the number of the part's middle."""
    into, right, below, forward = np.linalg.inv(volume.world_from_index), *camera.eye_from_world
    for down, across in product(camera.slopes()[1], camera.slopes()[0]):
        aside = across * right + down * below
        start, along = (camera.eye, forward + aside) if camera.perspective else (camera.eye + aside, forward)
        along = along / np.linalg.norm(along)
        i, d = into @ (start - np.asarray(volume.origin)), into @ along
        cuts = [0.0]
        for axis, size in enumerate(volume.shape[::-1]):
            cuts += ((np.arange(size + 1) - 0.5 - i[axis]) / d[axis]).tolist() if abs(d[axis]) > 1e-12 else []
        crossed = [p for p in planes if abs(np.dot(p[:3], along)) > 1e-12]
        cuts += [(p[3] - np.dot(p[:3], start)) / np.dot(p[:3], along) for p in crossed]
        parts: Parts = []
        for near, far in pairwise(np.unique([cut for cut in cuts if cut >= 0])):
            middle = (near + far) / 2
            x, y, z = np.rint(i + d * middle).astype(int)
            inside = all(0 <= n < size for n, size in zip((z, y, x), volume.shape, strict=True))
            if inside and all(np.dot(p[:3], start + along * middle) >= p[3] for p in planes):
                parts.append((near, far, int(volume.samples[z, y, x])))
        yield parts


def extinctions(volume: sg.Volume) -> np.ndarray:
    """Per world length, by number."""
    found, spacing = np.zeros(4), abs(np.linalg.det(volume.world_from_index)) ** (1 / 3)
    for number, _, opacity in label_transfer(volume).labels:
        found[number] = -np.log1p(-opacity) / spacing
    return found


def marched(volume: sg.Volume, camera: sg.Camera, planes: tuple[tuple[float, ...], ...] = ()) -> np.ndarray:
    """[H, W, 4]: the parts of each ray, composited in their order."""
    color = np.zeros((4, 3))
    for number, text, _ in label_transfer(volume).labels:
        color[number] = [int(text[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    picture, extinction = np.zeros((camera.size[0] * camera.size[1], 4)), extinctions(volume)
    for pixel, parts in zip(picture, passed(volume, camera, planes), strict=True):
        light = 1.0
        for near, far, number in parts:
            through = np.exp(-extinction[number] * (far - near))
            pixel += light * (1 - through) * np.append(color[number], 1.0)
            light *= through
    return picture.reshape(camera.size[1], camera.size[0], 4)


def absorbed(volume: sg.Volume, camera: sg.Camera, depth: float, least: bool) -> np.ndarray:
    """[H, W, 2]: distances at which rays pass that optical depth, or half of all if that is less, and numbers there."""
    found, extinction = np.full((camera.size[0] * camera.size[1], 2), np.nan), extinctions(volume)
    for pixel, parts in zip(found, passed(volume, camera), strict=True):
        depths = np.cumsum([extinction[number] * (far - near) for near, far, number in parts])
        enough = min(depth, depths[-1] / 2) if least and len(depths) else depth
        if len(depths) and depths[-1] >= enough > 0:
            n = int(np.searchsorted(depths, enough))
            pixel[:] = parts[n][1] - (depths[n] - enough) / extinction[parts[n][2]], parts[n][2]
    return found.reshape(camera.size[1], camera.size[0], 2)


def views(volume: sg.Volume) -> dict[str, sg.Camera]:
    """Outside, inside, on faces of voxels, and along an axis."""
    middle, size = volume.center, float(np.linalg.norm(volume.corners[7] - volume.corners[0]))
    on_face = volume.world_from_index @ [2.5, 1.5, 3.0] + np.asarray(volume.origin)
    aside = middle + np.array([0.7, -0.5, 0.4]) * size
    look, flat = sg.Camera.look_at, sg.Camera.orthographic
    return {
        "outside": look(aside, middle, (0, 0, 1), fov=50, size=(14, 11)),
        "inside": look(middle + 0.21, middle + np.array([1.0, 0.4, 0.3]), (0, 0, 1), fov=90, size=(14, 11)),
        "on a face": look(on_face, middle + np.array([0.3, 0.1, 1.0]), (0, 1, 0), fov=80, size=(14, 11)),
        "parallel": flat(aside, middle, (0, 0, 1), height=size, size=(14, 11)),
        "parallel, inside": flat(middle, middle + np.array([1.0, 0.4, 0.3]), (0, 0, 1), height=size, size=(14, 11)),
        # no ray runs within a face, where it may be of either side
        "along an axis": flat(
            middle + np.array([0.01, -size, 0.01]), middle + np.array([0.01, 0, 0.01]), (0, 0, 1), size, size=(14, 11)
        ),
    }


@pytest.mark.parametrize("spacing", [1.0, 8.0])
@pytest.mark.parametrize("opacity", [0.05, 0.5, 0.99])
def test_a_block_is_as_wide_as_its_voxels(renderer: sg.Renderer, opacity: float, spacing: float) -> None:
    """16 voxels at every opacity: nothing before its faces, its closed form behind them, within 1/40 voxel."""
    samples = np.zeros((18, 18, 20), np.uint8)
    samples[1:17, 1:17, 2:18] = 1
    volume = sg.Volume(samples, (spacing,) * 3, labels=(Label(1, "", RED, opacity / 0.99),))
    height, pixels = 0.5 * spacing, 20 * 40
    middle = volume.center
    camera = sg.Camera.orthographic(middle - (0, 50 * spacing, 0), middle, (0, 0, 1), height=height, size=(pixels, 20))
    for technique in ("tiles", "quads"):
        drawn = renderer.render(splats_of(volume), camera, PLAIN.replace(technique=technique))
        assert drawn.info["kernel"] == "box" and drawn.info["technique"] == technique
        alpha = drawn.pixels[10, :, 3]
        inside = np.flatnonzero(alpha > 1e-7)
        assert len(inside) == 16 * 40 and np.array_equal(inside, np.arange(2 * 40, 18 * 40))
        assert np.abs(alpha[inside] - (1 - (1 - opacity) ** 16)).max() < 3e-4


@pytest.mark.few(2)
@pytest.mark.parametrize("grid", GRIDS)
def test_pictures_are_those_marched_from_face_to_face(
    grid: str, renderer: sg.Renderer, rng: np.random.Generator
) -> None:
    """Whatever the grid and the view, the eye in a voxel or on a face: by OpenGL and by the reference."""
    volume = noise(rng, grid)
    for name, camera in views(volume).items():
        right = marched(volume, camera)
        assert right[..., 3].max() > 0.2, name
        found = sg.reference.render(splats_of(volume), camera, PLAIN).pixels
        assert np.abs(found - right).max() < 1e-7, name
        for technique, most in (("tiles", 4e-4), ("quads", 2e-5)):
            drawn = renderer.render(splats_of(volume), camera, PLAIN.replace(technique=technique)).pixels
            assert np.abs(drawn - right).max() < most, (name, technique)


@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_planes_cut_boxes_exactly(grid: str, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = noise(rng, grid)
    normal = np.array([0.5, 0.6, -0.62])
    normal /= np.linalg.norm(normal)
    planes = ((*normal.tolist(), float(normal @ volume.center)), (0.0, 0.0, 1.0, float(volume.center[2]) - 1.3))
    for name, camera in views(volume).items():
        right = marched(volume, camera, planes)
        cut = PLAIN.replace(clip=planes)
        assert np.abs(sg.reference.render(splats_of(volume), camera, cut).pixels - right).max() < 1e-7, name
        for technique, most in (("tiles", 4e-4), ("quads", 5e-5)):
            drawn = renderer.render(splats_of(volume), camera, cut.replace(technique=technique)).pixels
            assert np.abs(drawn - right).max() < most, (name, technique)


def test_neighbours_do_not_mix(renderer: sg.Renderer) -> None:
    """Every sample of a border between two solid labels is of one of them."""
    samples = np.ones((4, 4, 8), np.uint8)
    samples[:, :, 4:] = 3
    volume = sg.Volume(samples, labels=(Label(1, "", RED), Label(3, "", BLUE)))
    camera = sg.Camera.orthographic((3.4, -9, 1.5), (3.4, 0, 1.5), (0, 0, 1), height=1.0, size=(60, 12))
    drawn = renderer.render(splats_of(volume), camera, PLAIN).pixels[5]
    reds, blues = drawn[:, 0] > 0.5, drawn[:, 2] > 0.5
    assert (reds ^ blues).all() and drawn[:, :3].min(axis=0)[1] == 0
    assert (np.minimum(drawn[:, 0], drawn[:, 2]) == 0).all() and reds.sum() == 31


@pytest.mark.parametrize("blend", ["xray", "mip"])
def test_sums_and_maxima(blend: str, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Σ τ along the ray; the largest opacity that it meets."""
    volume = noise(rng, "3:1")
    camera, settings = views(volume)["outside"], PLAIN.replace(blend=blend)
    found = sg.reference.render(splats_of(volume), camera, settings).pixels
    right = marched(volume, camera)[..., 3]
    if blend == "xray":
        assert np.abs(-np.expm1(-found[..., 3]) - right).max() < 1e-7
    else:
        assert set(np.round(np.unique(found[..., 3]), 6).tolist()) <= {0.0, 0.0495, 0.495, 0.99}
        assert np.array_equal(found[..., 3] > 0, right > 0)
    for technique in ("tiles", "quads"):
        drawn = renderer.render(splats_of(volume), camera, settings.replace(technique=technique)).pixels
        assert np.abs(drawn - found).max() < 5e-5, technique


def ball(radius: float = 9.3, size: int = 24, spacing: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> sg.Volume:
    """A ball of two labels."""
    z, y, x = (np.indices((size,) * 3) - (size - 1) / 2) * np.array(spacing[::-1])[:, None, None, None]
    samples = np.where(x * x + y * y + z * z < radius**2, 1, 0).astype(np.uint8)
    samples[:, :, size // 2 :][samples[:, :, size // 2 :] > 0] = 2
    return sg.Volume(samples, spacing, labels=(Label(1, "", "#ffffff"), Label(2, "", "#ffffff")))


@pytest.mark.parametrize("most", [lighting.MOST_NORMALS, 5000])
def test_a_ball_is_lit_as_a_ball(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not as bricks; the border of its two labels is not seen; by normals of every voxel, or every other."""
    monkeypatch.setattr(lighting, "MOST_NORMALS", most)
    volume = ball()
    middle = volume.center
    camera = sg.Camera.orthographic(middle - (3, 40, 7), middle, (0, 0, 1), height=16, size=(48, 48))
    drawn = sg.reference.render(splats_of(volume), camera, PLAIN.replace(shading="on")).pixels
    across, down = np.meshgrid(*camera.slopes())
    share = (across**2 + down**2) / 9.3**2
    some = share < 0.7
    cosine = np.sqrt(1 - np.where(some, share, 0))
    brightness = drawn[..., 0] / np.maximum(drawn[..., 3], 1e-9)
    off = np.where(some, brightness - (0.3 + 0.7 * cosine), 0.0)
    assert np.sqrt((off[some] ** 2).mean()) < 0.02 and np.abs(off).max() < 0.08


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "settings",
    [
        sg.Settings(),
        sg.Settings(light="glossy", clip=((0.6, 0.8, 0.0, 12.0),)),
        sg.Settings(ambient_occlusion=0.8, shadows=0.6, antialias="off"),
    ],
)
def test_light_is_the_reference_s(settings: sg.Settings, renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = replace(ball(7, 16, (1.0, 1.0, 1.4)), labels=(Label(1, "", RED, 0.4), Label(2, "", GREEN)))
    middle = volume.center
    camera = sg.Camera.look_at(middle + np.array([18, -20, 9]), middle, (0, 0, 1), fov=40, size=(30, 30))
    right = sg.reference.render(splats_of(volume), camera, settings).pixels
    for technique, most in (("tiles", 4e-4), ("quads", 1e-4)):
        drawn = renderer.render(splats_of(volume), camera, settings.replace(technique=technique)).pixels
        assert np.abs(drawn - right).max() < most, technique


@pytest.mark.long
def test_layers_of_labels_add_up(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """A grid and itself again, each half as opaque: as one of the whole; and over values as in float64."""
    volume = noise(rng, "3:1")
    camera = views(volume)["outside"]
    thin = sg.Layer(volume, label_transfer(volume))
    halves = [(n, c, float(1 - np.sqrt(1 - o))) for n, c, o in label_transfer(volume).labels]
    half = sg.Layer(volume, replace(label_transfer(volume), labels=halves))
    whole = renderer.render(sg.Scene([thin]), camera, PLAIN).pixels
    two = renderer.render(sg.Scene([half, half]), camera, PLAIN).pixels
    assert np.abs(two - whole).max() < 1e-3 and whole[..., 3].max() > 0.9
    values = sg.Volume(rng.random((9, 8, 9)).astype(np.float32), (1.0, 1.0, 2.0))
    scene = sg.Scene([sg.Layer(values, sg.Transfer([(0, 0.0), (1, 0.3)], unit=1.0)), thin])
    for name in ("outside", "parallel, inside"):
        view, lit = views(volume)[name], sg.Settings(antialias="off", clip=((0.0, 0.6, 0.8, -1.0),))
        right = sg.reference.render(scene, view, lit).pixels
        assert np.abs(renderer.render(scene, view, lit).pixels - right).max() < 1e-3, name


def test_meshes_end_rays_within_boxes(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """An opaque wall hides what a plane there would cut off."""
    volume = noise(rng, "cubes")
    camera = views(volume)["outside"]
    x = float(volume.center[0]) + 0.3
    corners = np.array([[x, -40, -40], [x, 40, -40], [x, 40, 40], [x, -40, 40]])
    wall = sg.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), color=GREEN)
    scene = sg.Scene([sg.Layer(volume)], meshes=[wall])
    before = marched(volume, camera, ((1.0, 0.0, 0.0, x),))
    behind = renderer.render(scene, camera, PLAIN).pixels
    assert np.abs(behind[..., 0] - before[..., 0]).max() < 4e-4
    assert np.abs(sg.reference.render(scene, camera, PLAIN).pixels - behind).max() < 4e-4


def test_masked_voxels_are_left_out_whole(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    volume = noise(rng, "cubes")
    kept = rng.random(volume.shape) < 0.6
    masked = volume.masked(sg.Volume(kept.astype(np.uint8), volume.spacing, volume.origin))
    camera = views(volume)["outside"]
    right = marched(replace(volume, samples=np.where(kept, volume.samples, 0)), camera)
    drawn = renderer.render(splats_of(masked), camera, PLAIN).pixels
    assert np.abs(drawn - right).max() < 4e-4


def test_what_asks_for_a_kernel_has_it(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """The paper's footprints are drawn where they are asked for."""
    splats = splats_of(noise(rng, "cubes"))
    camera = views(noise(rng, "cubes"))["outside"]
    for asked in ({"kernel": "gaussian"}, {"antialias": "paper"}, {"align": "ray"}, {"attenuation": "opacity"}):
        assert renderer.plan(splats, camera, sg.Settings().replace(**asked)).kernel.name != "box"
    assert renderer.plan(splats, camera, sg.Settings(compositing="sheets")).kernel.name == "box"


@pytest.mark.few(1)
@pytest.mark.parametrize("grid", GRIDS)
def test_picks_and_depths_are_of_the_voxels_that_rays_meet(grid: str, rng: np.random.Generator) -> None:
    """The number, and where half of the light is absorbed, or anything; the largest opacity."""
    volume = noise(rng, grid)
    look, rays = label_transfer(volume), 0
    for name, camera in views(volume).items():
        across, down = np.meshgrid(*camera.slopes())
        length = np.sqrt(across**2 + down**2 + 1) if camera.perspective else 1.0
        for share in (0.5, 0.0):
            right = absorbed(volume, camera, max(-np.log1p(-share), 1e-9), False)[..., 0] / length
            assert np.allclose(depths(volume, camera, share, transfer=look), right, atol=2e-6, equal_nan=True), name
        first = absorbed(volume, camera, np.log(2), True)
        for row, column in product(range(0, camera.size[1], 2), range(camera.size[0])):
            found, (distance, number) = pick(volume, camera, (column, row), look), first[row, column]
            assert (found is None) == bool(np.isnan(distance)), name
            if found is not None:
                assert found.value == number and found.distance == pytest.approx(distance, abs=1e-6), name
                rays += 1
        deepest = depths(volume, camera, "max", transfer=look) * length
        for place, parts in zip(deepest.ravel(), passed(volume, camera), strict=True):
            most = max((number for *_, number in parts), default=0)
            near = next((near for near, _, number in parts if number == most > 0), np.nan)
            assert place == pytest.approx(near, abs=1e-6, nan_ok=True), name
    assert rays > 60


def test_labels_that_a_mask_leaves_out_are_not_picked() -> None:
    samples = np.full((3, 3, 3), 3, np.uint8)
    kept = np.ones((3, 3, 3), np.uint8)
    kept[:, 0] = 0
    volume = sg.Volume(samples, labels=TABLE).masked(sg.Volume(kept))
    camera = sg.Camera.orthographic((1.2, -9, 1.1), (1.2, 0, 1.1), (0, 0, 1), height=1.0, size=(1, 1))
    assert depths(volume, camera, 0.0)[0, 0] == pytest.approx(9.5)
    found = pick(volume, camera, (0, 0))
    assert found is not None and 9.5 < found.distance < 10


def test_coarser_labels_are_numbers_that_there_are(rng: np.random.Generator) -> None:
    """Of most voxels of a block, never one between two; a label one voxel thin is still there."""
    samples = np.zeros((8, 9, 10), np.uint8)
    samples[:, 3], samples[4:, 5:] = 2, 9
    for volume, given in ((sg.Volume(samples), True), (sg.Volume(samples, labels=()), False)):
        coarse = halve_volume(volume, given)
        assert coarse.samples.dtype == np.uint8 and set(np.unique(coarse.samples)) == {0, 2, 9}
        assert (coarse.samples[:, 1] == 2).all() and (coarse.samples[2:, 3:] == 9).all()
    noise_ = rng.integers(0, 3, (6, 6, 6)).astype(np.int16)
    blocks = noise_.reshape(3, 2, 3, 2, 3, 2).transpose(0, 2, 4, 1, 3, 5).reshape(27, 8)
    chosen = halve_volume(sg.Volume(noise_), labels=True).samples.ravel()
    counts = np.array([np.bincount(block, minlength=3) for block in blocks])
    assert (counts[np.arange(27), chosen] == counts.max(axis=1)).all()


def test_boxes_that_others_hide_are_left_out(renderer: sg.Renderer) -> None:
    """From outside of a solid block; not where the eye, its plane or a cut is within it."""
    samples = np.full((28, 28, 28), 3, np.uint8)
    samples[1:-1, 1:-1, 1:-1] = 4
    volume = sg.Volume(samples, (1.0, 1.0, 1.5), labels=(Label(3, "", RED), Label(4, "", BLUE)))
    splats, middle = splats_of(volume), volume.center

    def drawn(camera: sg.Camera, settings: sg.Settings = PLAIN) -> int:
        plan = renderer.plan(splats, camera, settings)
        right = sg.reference.render(splats, camera, settings).pixels
        assert np.abs(renderer.render(splats, camera, settings).pixels - right).max() < 4e-4
        return len(visible_boxes(splats, plan.resolved))

    aside = sg.Camera.look_at(middle + np.array([50, -40, 30]), middle, (0, 0, 1), fov=40, size=(16, 16))
    flat = sg.Camera.orthographic(middle + np.array([50, -40, 30]), middle, (0, 0, 1), height=60, size=(16, 16))
    assert drawn(aside) < 0.7 * len(splats) > drawn(flat)
    x, y, z = np.array([0.8, 0.0, 0.6])
    within = sg.Camera.look_at(middle, middle + np.array([1.0, 0.2, 0.1]), (0, 0, 1), fov=60, size=(16, 16))
    beside = sg.Camera.orthographic(middle, middle + np.array([1.0, 0.2, 0.1]), (0, 0, 1), height=60, size=(16, 16))
    cut = PLAIN.replace(clip=((x, y, z, float(np.dot((x, y, z), middle))),))
    assert drawn(within) == drawn(beside) == drawn(aside, cut) == len(splats)


def test_moving_labels_are_means_of_boxes(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """Sums, too, which have streaks of other voxels."""
    splats = splats_of(noise(rng, "cubes"))
    camera, moves = views(noise(rng, "cubes"))["outside"], sg.Motion(spin=(0, 0, 20))
    for blend in ("composite", "xray"):
        settings = PLAIN.replace(blend=blend, moments=2)
        plan = renderer.plan(splats, camera, settings, moves)
        assert plan.moments == 2 and plan.exposure is None and plan.kernel.name == "box"
    assert renderer.plan(splats, camera, PLAIN.replace(blend="xray", motion="exact"), moves).exposure is not None

"""Hidden interiors: bounds against rays marched through cells, and pictures against those of all voxels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import splatgl as sg
from splatgl.errors import InputError
from splatgl.planning.bricks import Bricks
from splatgl.planning.resolve import select_splats
from splatgl.splat import extract, hidden_interior
from splatgl.splat.hidden_interior import LIGHT, HiddenInterior, depths_before, depths_from_outside
from splatgl.transfer.preintegration import ValueClassifier

SIDE = 48
# steps of marched rays, in cells
STEP = 0.01
SOLID = sg.Transfer([(60, 0.0), (100, 0.9999)])


@pytest.fixture
def small_interiors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out hidden interiors of a few voxels."""
    monkeypatch.setattr(hidden_interior, "LEAST", 64)
    monkeypatch.setattr(hidden_interior, "_is_worth_it", lambda dense, side: True)


def radius(side: int = SIDE) -> np.ndarray:
    """Distances [D, H, W] from the middle of a cube of voxels."""
    z, y, x = (axis - (side - 1) / 2 for axis in np.ogrid[:side, :side, :side])
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def inside(distance: np.ndarray) -> np.ndarray:
    """Samples of 200 at distances well below 0, 0 well above, a ramp between."""
    return np.clip(100 - 50 * distance, 0, 200)


def hidden(samples: np.ndarray, transfer: sg.Transfer = SOLID, reach: int = 1, **volume: object) -> np.ndarray:
    """bool: which samples are hidden."""
    whole = sg.Volume(samples.astype(np.float32), **volume)  # type: ignore[arg-type]
    post = ValueClassifier.of(transfer, "b-spline", whole.shape[::-1])
    found = HiddenInterior.of(whole, post, transfer.unit or 1.0, reach)
    return np.zeros(samples.shape, bool) if found is None else found.inside((0, 0, 0), whole.shape)


def march(depth: np.ndarray, seed: int, eye: tuple[float, ...] | None = None) -> float:
    """The most by which the bound of a cell exceeds the optical depth of a ray before it; depth: cubic cells'. eye: the
    only one that looks (z, y, x, 1), or (z, y, x, 0) towards it.
    """
    random = np.random.default_rng(seed)
    bound = (depths_from_outside([depth] * 3) if eye is None else before(depth, eye)).astype(float)
    size = np.array(depth.shape)
    along = random.normal(size=(400, 3))
    # some along the borders between cones
    along[:100, 0] = along[:100, 1] * random.choice([-1, 1], 100)
    target = random.uniform(1, size - 1, (400, 3))
    if eye is not None:
        along = target - eye[:3] if eye[3] else np.tile(-np.array(eye[:3]), (400, 1))
    along /= np.linalg.norm(along, axis=1)[:, None]
    start = target - along * 2 * size.max()
    if eye is not None and eye[3]:
        start[:] = eye[:3]
    place, passed, most = start, np.zeros(400), 0.0
    for _ in range(int(4 * size.max() / STEP)):
        place += along * STEP
        cell = np.floor(place).astype(int)
        within = ((cell >= 0) & (cell < size)).all(axis=1)
        z, y, x = cell[within].T
        most = max(most, float((bound[z, y, x] - passed[within]).max(initial=0.0)))
        passed[within] += STEP * depth[z, y, x]
    return most


def before(depth: np.ndarray, eye: tuple[float, ...]) -> np.ndarray:
    """`depths_before` of cubic cells; eye: (z, y, x, 1 or 0)."""
    return depths_before(depth.astype(np.uint16), [np.arange(256, dtype=np.uint8)] * 3, np.array(eye)[[2, 1, 0, 3]])


def blocks(seed: int) -> np.ndarray:
    """Random matter with holes, in blocks."""
    random = np.random.default_rng(seed)
    values = random.integers(0, 90, (3, 3, 3)) * (random.random((3, 3, 3)) > 0.2)
    return np.pad(np.kron(values, np.ones((3, 3, 3))), 1).astype(np.uint8)


@pytest.mark.parametrize("seed", range(2))
def test_no_ray_passes_less(seed: int) -> None:
    depth = blocks(seed)
    assert march(depth, seed) <= 90 * STEP * 4
    # not a trivial bound
    assert depths_from_outside([depth] * 3).max() > 30


EYES = {
    "far": (-30.0, 4.0, 17.0, 1.0),
    "near": (4.3, 12.5, 6.0, 1.0),
    "beside a corner": (14.0, -6.0, -9.0, 1.0),
    "behind": (5.0, 2.0, 40.0, 1.0),
    "parallel": (0.3, -1.0, 0.7, 0.0),
    "along an axis": (0.0, 0.0, 1.0, 0.0),
}


@pytest.mark.parametrize("name", EYES)
def test_no_ray_of_one_eye_passes_less(name: str) -> None:
    depth = blocks(3)
    assert march(depth, 3, EYES[name]) <= 90 * STEP * 4
    # more than for all eyes, which see every side
    found, everyone = before(depth, EYES[name]).astype(int), depths_from_outside([depth] * 3).astype(int)
    assert found.max() > 30 and found.sum() > 1.3 * everyone.sum()
    assert not before(depth, (5.0, 5.0, 5.0, 1.0)).any()


def test_slabs() -> None:
    depth = np.zeros((9, 21, 21), np.uint8)
    depth[3:-1, 1:-1, 1:-1] = 30
    # a layer beside what is transparent counts as transparent
    np.testing.assert_array_equal(depths_from_outside([depth] * 3)[:, 10, 10], [0, 0, 0, 0, 30, 60, 30, 0, 0])
    # cells that are short along some axis
    for thin in range(3):
        found = depths_from_outside([depth // 30 if axis == thin else depth for axis in range(3)])
        np.testing.assert_array_equal(found[:, 10, 10], [0, 0, 0, 0, 1, 2, 1, 0, 0])


def test_what_is_seen_along_a_tunnel_and_in_a_cavity(small_interiors: None) -> None:
    r, place = radius(), np.arange(SIDE) - (SIDE - 1) / 2
    across = np.hypot(place[:, None], place)[None]
    ball = hidden(inside(r - 22))
    # kernels, optical depth and cells reach 9 to 12 voxels
    assert ball[r < 10].all() and not ball[r > 12.5].any()
    tunnel = hidden(inside(np.maximum(r - 22, 2 - across)))
    assert 0 < tunnel.sum() < ball.sum() / 2 and not tunnel[:, (across < 6)[0]].any()
    # a closed cavity is hidden with what lies around it
    closed = inside(np.maximum(r - 22, 3 - r))
    np.testing.assert_array_equal(hidden(closed), ball)
    # a channel opens it
    channel = np.minimum(2 - across, -place[:, None, None])
    opened = hidden(inside(np.maximum(np.maximum(r - 22, 3 - r), channel)))
    assert 0 < opened.sum() < ball.sum() / 4 and not opened[r < 8].any()


@pytest.mark.parametrize("reach", [1, 2, 4])
def test_wider_kernels_reach_further(small_interiors: None, reach: int) -> None:
    r = radius(96)
    ball = hidden(inside(r - 46), reach=reach)
    # twice along the diagonal of as many cells of 2 voxels: around values, and around what depends on a voxel
    assert 46 - r[~ball].min() == pytest.approx(5 + 4 * 3**0.5 * reach, abs=1)


def test_no_thin_or_translucent_matter_hides(small_interiors: None) -> None:
    r = radius()
    assert not hidden(inside(np.abs(r - 16) - 3)).any()
    assert not hidden(inside(r - 22), replace(SOLID, points=((60, 0.0), (100, 0.05)))).any()
    # fog, 6 voxels thick, around an opaque core
    fog = replace(SOLID, points=((60, 0.0), (100, 0.05), (140, 0.05), (150, 0.9999)))
    core = hidden(np.where(r < 23, 120.0, 0.0) + 80 * np.clip(17 - r, 0, 1), fog)
    assert core[r < 2].all() and not core[r > 6].any()
    # values in a gap of the transfer function are transparent, whatever lies around
    opaque = ((60, 0.0), (100, 0.9999), (118, 0.9999)), ((122, 0.9999), (255, 0.9999))
    gap = replace(SOLID, points=(*opaque[0], (119, 0.0), (121, 0.0), *opaque[1]))
    layers = np.where(r < 23, 110.0, 0.0)
    layers[r < 20], layers[r < 18] = 120.0, 200.0
    assert hidden(layers, SOLID)[r < 11].all() and hidden(layers, gap)[r < 6].all()
    assert not hidden(layers, gap)[r > 8].any()
    assert not hidden(np.where(r < 23, 120.0, 0.0), gap).any()


def test_missing_and_masked_voxels_open_matter(small_interiors: None) -> None:
    r = radius()
    solid, hole = inside(r - 22), inside(r - 22)
    hole[: SIDE // 2, 22:26, 22:26] = np.nan
    through = hidden(hole)
    assert not through[: SIDE // 2, 22:26, 22:26].any() and through.sum() < hidden(solid).sum()
    masked = sg.Volume(solid.astype(np.float32)).masked(np.isfinite(hole))
    post = ValueClassifier.of(SOLID, "b-spline", masked.shape[::-1])
    found = HiddenInterior.of(masked, post, unit=1.0)
    assert found is not None and not found.inside((0, 0, 0), masked.shape)[: SIDE // 2, 22:26, 22:26].any()
    # voxels of half the reference length along any axis hide less
    unit = replace(SOLID, unit=2.0)
    few, many = hidden(solid, unit).sum(), hidden(solid).sum()
    assert 0 < few == hidden(solid, unit, spacing=(2, 1, 2)).sum() < many
    assert many == hidden(solid, unit, spacing=(2, 2, 2)).sum()


def test_only_bounded_values_are_hidden(small_interiors: None) -> None:
    samples = sg.Volume(inside(radius() - 22).astype(np.float32))
    for transfer, kernel, is_hidden in (
        (SOLID, "b-spline", True),
        (SOLID, "b-spline-free", False),
        (replace(SOLID, gradient=((0.0, 0.0), (10.0, 1.0))), "b-spline", False),
    ):
        post = ValueClassifier.of(transfer, kernel, samples.shape[::-1])
        assert (HiddenInterior.of(samples, post, 1.0) is not None) == is_hidden
    # voxels that may move
    flowing = replace(samples, vectors=np.zeros((*samples.shape, 3), np.float32))
    assert sg.extract(samples, SOLID).skipped_interior  # type: ignore[union-attr]
    assert not sg.extract(flowing, SOLID).skipped_interior  # type: ignore[union-attr]


@pytest.fixture
def ball(small_interiors: None) -> sg.Volume:
    """A ball with layers, a gap and a dent."""
    r = radius()
    samples = inside(np.maximum(r - 22, 5 - np.linalg.norm(np.indices(r.shape).T - [36, 24, 8], axis=-1).T))
    samples[r < 16] += 40 * np.sin(np.indices(r.shape).sum(axis=0))[r < 16]
    return sg.Volume(samples.astype(np.float32))


@pytest.fixture
def camera(ball: sg.Volume) -> sg.Camera:
    return sg.Camera.orbit(ball, azimuth=30, elevation=20, size=(32, 32))


def test_pictures_are_those_of_all_voxels(ball: sg.Volume, camera: sg.Camera, renderer: sg.Renderer) -> None:
    splats, whole = sg.extract(ball, SOLID), sg.extract(ball, SOLID, classification="post")
    assert len(splats) < 0.95 * len(whole)
    flat = sg.Camera.orthographic(camera.eye, (24, 24, 24), (0, 0, 1), 50, (32, 32))
    for view, settings in ((camera, sg.Settings()), (flat, sg.Settings(antialias="off"))):
        assert renderer.plan(splats, view, settings).splats is splats
        pixels = renderer.render(splats, view, settings).pixels
        assert np.abs(pixels - renderer.render(whole, view, settings).pixels).max() <= LIGHT


@pytest.mark.parametrize("parallel", [False, True])
def test_bricks_leave_out_what_the_eye_does_not_see(
    parallel: bool, ball: sg.Volume, camera: sg.Camera, renderer: sg.Renderer
) -> None:
    if parallel:
        camera = sg.Camera.orthographic(camera.eye, ball.center, (0, 0, 1), 50, (32, 32))
    bricks = Bricks.of(ball, ValueClassifier.of(SOLID, "b-spline", ball.shape[::-1]), 16)
    visible = bricks.without_hidden(camera, sg.Settings())
    # what turns away from the eye is left out, too
    count = sum(len(visible.records(brick)) for brick in range(len(bricks.low)))
    assert 0.3 * len(sg.extract(ball, SOLID)) < count < 0.95 * len(sg.extract(ball, SOLID))
    assert bricks.without_hidden(camera, sg.Settings()).hidden is visible.hidden
    assert bricks.without_hidden(camera, sg.Settings(occlusion="off")) is bricks
    image, off = (renderer.render_bricks(bricks, camera, sg.Settings(occlusion=how)) for how in ("auto", "off"))
    assert 0 < image.info["splats"] < off.info["splats"]
    assert np.abs(image.pixels - off.pixels).max() <= 2 * LIGHT


@pytest.mark.parametrize("seed", range(6))
def test_blocks_without_a_wanted_value_are_not_read(
    seed: int, small_interiors: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Their records are none, also beside missing samples and with values between others."""
    random = np.random.default_rng(seed)
    samples = inside(np.linalg.norm(np.indices((60, 64, 64)).T - 17, axis=-1).T - 14) + random.uniform(
        0, 30, (60, 64, 64)
    )
    samples[30:44, 50:60, 5:12] = (-100, -20, 0)[seed % 3]
    if seed > 2:
        samples[:20, :20, 50:][random.random((20, 20, 14)) < 0.01] = np.nan
    volume = sg.Volume(samples.astype(np.float32 if seed > 2 else np.int16))
    transfer = (SOLID, sg.Transfer([(60, 0.0), (100, 0.9999)], iso=[-20.0]))[seed % 2]
    post = ValueClassifier.of(transfer, "b-spline", volume.shape[::-1])
    reads, drawn = list[int](), list[list[np.ndarray]]()
    box = sg.Volume.box
    for is_known in (True, False):
        if not is_known:
            monkeypatch.setattr(hidden_interior, "_without_matter", lambda *_: np.zeros((8, 8, 8), bool))
        found = HiddenInterior.of(volume, post, 1.0, 1, np.array([-300.0, 20.0, 20.0, 1.0]))
        assert found is not None
        calls = list[int]()
        monkeypatch.setattr(sg.Volume, "box", lambda *a, calls=calls: (calls.append(1), box(*a))[1])
        bricks = replace(Bricks.of(volume, post, 16), hidden=found)
        drawn.append([bricks.records(n) for n in range(len(bricks.low))])
        reads.append(len(calls))
    assert reads[0] < 0.8 * reads[1] and all(np.array_equal(a, b) for a, b in zip(*drawn, strict=True))


@pytest.mark.parametrize("parallel", [False, True])
def test_wide_pixels_leave_out_less(small_interiors: None, renderer: sg.Renderer, parallel: bool) -> None:
    """Kernels of wide pixels reach further into the matter: fewer voxels are hidden, and the picture stays the same."""
    volume = sg.Volume(inside(radius(96) - 46).astype(np.float32))
    splats, whole = sg.extract(volume, SOLID), sg.extract(volume, SOLID, classification="post")
    settings = sg.Settings(antialias="supersample", samples=1)
    camera = sg.Camera.orbit(volume, azimuth=30, elevation=20, size=(120, 120))
    if parallel:
        camera = sg.Camera.orthographic(camera.eye, volume.center, (0, 0, 1), 150, (120, 120))
    reaches = []
    for view in (camera.resized((280, 280)), camera):
        drawn = select_splats(splats, settings, False, view)
        assert drawn.post is not None and len(splats) <= len(drawn) < len(whole)
        assert select_splats(splats, settings, False, view) is drawn
        reaches.append(drawn.skipped_interior)
    assert reaches == [1, 2]
    pixels = renderer.render(splats, camera, settings).pixels
    assert np.abs(pixels - renderer.render(whole, camera, settings).pixels).max() <= LIGHT


INTERIOR = {
    "clip": sg.Settings(clip=((0.0, 1.0, 0.0, 24.0),)),
    "mean": sg.Settings(blend="mean"),
    "xray": sg.Settings(blend="xray"),
    "occlusion": sg.Settings(occlusion="off"),
    "tolerance": sg.Settings(tolerance=1e-3),
    "ambient": sg.Settings(ambient_occlusion=0.5),
    "shadows": sg.Settings(shadows=0.5),
}


@pytest.mark.parametrize("name", INTERIOR)
def test_other_pictures_get_all_voxels(ball: sg.Volume, camera: sg.Camera, name: str) -> None:
    splats = sg.extract(ball, SOLID)
    assert splats.post is not None and splats.skipped_interior
    drawn = select_splats(splats, INTERIOR[name], False, camera)
    whole = sg.extract(ball, SOLID, classification="post-all" if name == "mean" else "post")
    assert drawn.post is not None and not drawn.skipped_interior
    assert len(drawn) == len(select_splats(whole, INTERIOR[name], False, camera))


def test_eyes_inside_and_wide_pixels_get_all_voxels(ball: sg.Volume, camera: sg.Camera) -> None:
    splats, settings = sg.extract(ball, SOLID), sg.Settings()
    assert select_splats(splats, settings, False, camera) is splats
    near = sg.Camera.look_at((24, -4, 24), (24, 24, 24), (0, 0, 1), size=(32, 32))
    cutting = sg.Camera.orthographic((24, 24, 24), (24, 48, 24), (0, 0, 1), 50, (32, 32))
    for view in (near, cutting, camera.resized((4, 4)), None):
        assert not select_splats(splats, settings, False, view).skipped_interior  # type: ignore[union-attr]


def test_too_many_values_are_classified_before_without_the_interior(
    ball: sg.Volume, camera: sg.Camera, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extract, "MOST_KEPT", 10_000)
    splats, whole = sg.extract(ball, SOLID), sg.extract(ball, SOLID, classification="pre")
    assert splats.post is None and splats.skipped_interior and len(splats) < len(whole)
    assert select_splats(splats, sg.Settings(), False, camera) is splats
    pictures = [renderer.render(drawn, camera, sg.Settings()) for drawn in (splats, whole)]
    assert pictures[0].pixels.max() > 0.5 and np.abs(pictures[0].pixels - pictures[1].pixels).max() <= LIGHT
    # the bound knows of what is left out
    bounds = [picture.info["error_bound"] for picture in pictures]
    assert bounds[0] > LIGHT and bounds[0] - bounds[1] == pytest.approx(LIGHT, rel=0.1)
    for changed in (*INTERIOR.values(), sg.Settings(classification="pre")):
        drawn = select_splats(splats, changed, False, camera)
        assert not drawn.skipped_interior and len(drawn) >= len(select_splats(whole, changed, False, camera))


def test_a_hollow_set_serves_no_other_transfer_function(ball: sg.Volume, camera: sg.Camera) -> None:
    splats = sg.extract(ball, SOLID)
    whole = sg.extract(ball, SOLID, classification="post")
    assert whole.holds(SOLID) and not splats.holds(SOLID)
    with pytest.raises(InputError, match="flow: expected all splats"):
        sg.Motion(flow=np.ones((len(splats), 3))).move(splats, 0.5)

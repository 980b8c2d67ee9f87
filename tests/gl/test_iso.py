"""Iso-surfaces: closed forms of a ball whose values fall along its radius; every technique and float64 agree."""

from __future__ import annotations

import itertools
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.distributed.render import PicturePart, join_parts
from splatgl.gl.shader import compose
from splatgl.planning import bricks
from splatgl.reference.depth_pick import depths, pick
from splatgl.reference.field import field_integral
from splatgl.transfer.regions import spline_crossings
from tests.helpers.memory import allow_any_memory

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE, CENTER, RADIUS = 26, np.array([12.7, 12.4, 12.2]), 8.0
CLEAR = [(0.0, 0.0), (20.0, 0.0)]
EXACT = sg.Settings(antialias="off", tolerance=1e-3)
# techniques, and the shape of compute shaders
WAYS = (("tiles", "processor"), ("quads", "processor"), ("tiles", "card"))


def ball(size: int = SIZE) -> sg.Volume:
    """Values that are 20 less the distance from the centre."""
    z, y, x = np.indices((size,) * 3)
    return sg.Volume((20 - np.linalg.norm(np.stack([x, y, z], axis=-1) - CENTER, axis=-1)).astype(np.float32))


def surface(*iso: Any, points: Any = CLEAR, **more: Any) -> sg.Transfer:
    return sg.Transfer(points, iso=iso or [(20 - RADIUS, "white", 1.0)], window=(0, 20), **more)


def parallel(size: int = 64, height: float = 22.0, away: tuple[float, float, float] = (0.4, -1.0, 0.3)) -> sg.Camera:
    toward = np.array(away) / np.linalg.norm(away)
    return sg.Camera.orthographic(CENTER + 40 * toward, CENTER, (0, 0, 1), height=height, size=(size, size))


def distance_of(camera: sg.Camera) -> np.ndarray:
    """Distances [H, W] of parallel rays from the ball's centre."""
    across, down = camera.slopes()
    x, y, _ = camera.eye_from_points(CENTER[None])[0]
    return np.asarray(np.hypot(across - x, (down - y)[:, None]))


@pytest.fixture
def draw(renderer: sg.Renderer, card: sg.Renderer) -> Any:
    def pixels(way: tuple[str, str], subject: Any, camera: sg.Camera, settings: sg.Settings = EXACT) -> np.ndarray:
        on = card if way[1] == "card" else renderer
        return on.render(subject, camera, settings.replace(technique=way[0])).pixels

    return pixels


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_a_ball_has_its_radius_and_light(draw: Any, way: tuple[str, str]) -> None:
    """Its silhouette to a fiftieth of a pixel, its light to the gradients' accuracy."""
    camera, splats = parallel(), sg.extract(ball(), surface())
    pixels = draw(way, splats, camera, sg.Settings(tolerance=1e-3))
    pitch = 22.0 / 64
    radius = np.sqrt(pixels[..., 3].sum() / np.pi)
    assert radius * pitch == pytest.approx(RADIUS, abs=pitch / 50)
    apart = distance_of(camera)
    inside = apart < RADIUS - 1
    cosine = np.sqrt(1 - (apart[inside] / RADIUS) ** 2)
    assert np.abs(draw(way, splats, camera)[inside, 1] - (0.3 + 0.7 * cosine)).max() < 5e-3


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_a_half_transparent_surface_is_crossed_exactly_twice(draw: Any, way: tuple[str, str]) -> None:
    """Wherever sheets end, from eyes all around."""
    splats = sg.extract(ball(), surface((20 - RADIUS, "red", 0.5)))
    for away, perspective in itertools.product([(0.4, -1.0, 0.3), (1.0, 0.02, 0.01)], (False, True)):
        camera = parallel(away=away)
        inside = distance_of(camera) < RADIUS - 0.3
        if perspective:
            toward = np.array(away) / np.linalg.norm(away)
            camera = sg.Camera.look_at(CENTER + 30 * toward, CENTER, (0, 0, 1), fov=40, size=(64, 64))
            inside &= distance_of(parallel(away=away, height=24.0)) < RADIUS - 0.8
        alpha = draw(way, splats, camera)[..., 3]
        assert np.abs(alpha[inside] - 0.75).max() < 1e-5
        assert set(np.round(alpha, 4).ravel()) <= {0.0, 0.75, 0.5}


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_a_thin_layer_is_crossed_twice_within_a_sheet(draw: Any, way: tuple[str, str]) -> None:
    """One plane of voxels, just below the largest value there."""
    samples = np.zeros((20, 20, 20), np.float32)
    samples[:, 10] = 1.0
    splats = sg.extract(sg.Volume(samples), sg.Transfer([(0, 0), (1, 0)], iso=[(0.97, "red", 0.5)]))
    middle = np.array([9.5, 9.5, 9.6])
    for away, sheets in itertools.product((40.0, 40.13, 40.25), (2, 4)):
        camera = sg.Camera.orthographic(middle - (0, away, 0), middle, (0, 0, 1), height=8, size=(8, 8))
        assert np.abs(draw(way, splats, camera, EXACT.replace(sheets=sheets))[..., 3] - 0.75).max() < 1e-5


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_surfaces_a_fiftieth_of_a_voxel_apart_are_both_drawn(draw: Any, way: tuple[str, str]) -> None:
    ramp = np.broadcast_to(np.arange(12, dtype=np.float32)[:, None], (12, 12, 12))
    look = sg.Transfer([(0, 0), (11, 0)], iso=[(5.4, "red", 0.5), (5.42, "white", 0.5)])
    splats, middle = sg.extract(sg.Volume(ramp), look), np.full(3, 5.5)
    for away in (30.0, 30.37, -30.0):
        camera = sg.Camera.orthographic(middle - (0, away, 0), middle, (0, 0, 1), height=4, size=(4, 4))
        assert np.abs(draw(way, splats, camera, EXACT.replace(sheets=2))[..., 3] - 0.75).max() < 1e-5


@pytest.mark.parametrize("way", WAYS)
def test_a_mesh_hides_what_lies_behind_it(draw: Any, way: tuple[str, str]) -> None:
    """A plane leaves a cap of the ball before it, whose rim tells the depth of the surface."""
    camera, height = parallel(away=(0.0, -1.0, 0.0)), 6.0
    corners = np.array([(-30, 0, -30), (60, 0, -30), (60, 0, 60), (-30, 0, 60)], float)
    corners[:, 1] = CENTER[1] - height
    plane = sg.Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), color="#0000ff")
    scene = sg.Scene([sg.Layer(ball(), surface((20 - RADIUS, "red", 1.0)))], meshes=[plane])
    pixels = draw(way, scene, camera, sg.Settings(tolerance=1e-3, shading="off"))
    radius = np.sqrt(pixels[..., 0].sum() / np.pi) * 22.0 / 64
    assert radius == pytest.approx(np.sqrt(RADIUS**2 - height**2), abs=0.03)


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_a_clip_plane_opens_it(draw: Any, way: tuple[str, str]) -> None:
    """Where it is cut, a half-transparent surface is crossed once."""
    camera = parallel(away=(0.0, -1.0, 0.0))
    splats = sg.extract(ball(), surface((20 - RADIUS, "red", 0.5)))
    pixels = draw(way, splats, camera, EXACT.replace(clip=[(0, 1, 0, CENTER[1])]))
    inside = distance_of(camera) < RADIUS - 0.3
    assert np.abs(pixels[inside, 3] - 0.5).max() < 1e-5


@pytest.mark.parametrize("way", [("quads", "processor"), WAYS[2], None])
def test_a_surface_in_a_mask_s_face_is_kept_as_its_matter_is(draw: Any, way: tuple[str, str] | None) -> None:
    """A ray that runs along the face: within a thousandth of a voxel it lies inside, beyond that outside."""
    half = np.broadcast_to(np.arange(SIZE) < 13, (SIZE,) * 3)
    masked = ball().masked(sg.Volume(half.astype(np.uint8)))
    splats = sg.extract(masked, surface((20 - RADIUS, "red", 0.5)))
    for beside, alpha in ((-0.1, 0.75), (0.0007, 0.75), (0.004, 0.0)):
        x, z = 12.5 + beside, 12.2
        camera = sg.Camera.orthographic((x, -20, z), (x, 0, z), (0, 0, 1), height=0.01, size=(1, 1))
        pixels = draw(way, splats, camera) if way else sg.reference.render(splats, camera, EXACT).pixels
        assert pixels[0, 0, 3] == pytest.approx(alpha, abs=1e-5)


REGIONS = ["box:8,16,0.5,1.2:#ff8800:0.2", "gaussian:12,18,0.2,1.1:lime:0.1"]
SUBJECTS = {
    "surfaces": surface((12.0, "red", 0.4), (14.5, "#00ff00", 0.5), (9.0, "", 0.3)),
    "with matter": surface((12.0, "red", 0.5), points=[(11.0, 0.0), (12.0, 0.0), (15.0, 0.4)]),
    "unshaded matter": surface((12.0, "red", 0.5), points=[(8.0, 0.0), (15.0, 0.1)], shading=False),
    "regions": surface((12.0, "red", 0.5), points=[(8.0, 0.0), (15.0, 0.1)], regions=REGIONS),
    "regions alone": surface((12.0, "red", 0.5), regions=REGIONS),
    "weighted": surface((12.0, "red", 0.5), points=[(8.0, 0.0), (15.0, 0.3)], gradient=[(0.0, 0.3), (1.2, 1.0)]),
}
CHANGES = {
    "plain": {},
    "light": {"light": "glossy", "ambient_occlusion": 0.5},
    "flat": {"shading": "off", "steps": 1, "sheets": 2},
    "clip": {"clip": [(0.2, 1.0, 0.1, 14.0)]},
}


# each pair in one of the ways, and each kind and each change in all
AGREEING = [
    (kind, change, WAYS[(i + j) % len(WAYS)]) for i, kind in enumerate(SUBJECTS) for j, change in enumerate(CHANGES)
]


@pytest.mark.turns(2)
@pytest.mark.few(5)
@pytest.mark.parametrize(("kind", "change", "way"), AGREEING)
def test_pictures_agree_with_float64(draw: Any, kind: str, change: str, way: tuple[str, str]) -> None:
    settings, camera = EXACT.replace(**CHANGES[change]), parallel(size=24)
    splats = sg.extract(ball(), SUBJECTS[kind])
    right = sg.reference.render(splats, camera, settings).pixels
    off = np.abs(draw(way, splats, camera, settings) - right).max(axis=-1)
    assert right[..., 3].max() > 0.5
    # at a rim, float32 may find or miss a pair of crossings
    assert np.sort(off.ravel())[-3] < 2e-4


@pytest.mark.parametrize("kind", ["surfaces", "with matter", "regions"])
def test_float64_agrees_with_the_field(kind: str) -> None:
    """Marched in small steps, with no sheets."""
    volume, camera = ball(), parallel(size=12)
    sheets = sg.reference.render(sg.extract(volume, SUBJECTS[kind]), camera, EXACT).pixels
    marched = field_integral(volume, SUBJECTS[kind], camera, steps_per_voxel=4).pixels
    inside = distance_of(camera) < RADIUS - 2
    # between sheets, regions are means over lines of value and gradient
    assert np.abs(sheets - marched)[inside].max() < (6e-3 if kind == "regions" else 4e-3)


def test_a_picture_within_memory_is_that_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--memory` reads a file in bricks."""
    allow_any_memory(monkeypatch)
    np.save(tmp_path / "ball.npy", ball().samples)
    options = ["--iso", "12:red", "--points", "0:0,20:0", "--size", "24", "--check", "0"]
    pictures = []
    for memory in ("1TiB", "1KB"):
        command = ["render", str(tmp_path / "ball.npy"), *options, "--memory", memory]
        assert main([*command, "-o", str(tmp_path / "a.npy")]) == 0
        assert ("drawn in 1 bricks" in capsys.readouterr().out) == (memory == "1KB")
        pictures.append(np.load(tmp_path / "a.npy"))
    assert pictures[0][..., 3].sum() > 50
    # at a rim, float32 may find or miss a pair of crossings
    assert np.sort(np.abs(pictures[0] - pictures[1]).max(axis=-1).ravel())[-3] < 1e-4


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", ["surfaces", "with matter", "regions"])
def test_bricks_and_parts_of_a_picture_agree_with_float64(
    kind: str, renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parts as workers draw them, between whose sheets surfaces pass."""
    monkeypatch.setattr(bricks, "BATCH", 200)
    volume, camera, settings = ball(), parallel(size=24), EXACT.replace(occlusion="off")
    right = sg.reference.render(sg.extract(volume, SUBJECTS[kind]), camera, settings).pixels
    found = bricks.bricks_of(volume, SUBJECTS[kind], settings)
    assert found is not None
    some = bricks.Bricks.of(volume, found.post, 8)
    whole = renderer.render_bricks(some, camera, settings)
    chosen = renderer.plan_bricks(some, camera, settings)
    assert chosen.resolved.sheets is not None and whole.info["bricks"] == 64
    shells = some.shells(chosen.resolved.sheets, chosen.view, 4)
    reached = [some.within(chosen.resolved.sheets, chosen.view, shell) for shell in shells]
    parts = [PicturePart.of(renderer.render_part(each, camera, settings), sum(each.found.values())) for each in reached]
    joined = reduce(partial(join_parts, chosen.program.appearance.join), parts)
    picture = renderer.render_joined(some, camera, settings, joined.whole, joined.splats)
    assert len(parts) == 4 and right[..., 3].max() > 0.5
    # at a rim, float32 may find or miss a pair of crossings
    assert np.sort(np.abs(whole.pixels - right).max(axis=-1).ravel())[-3] < 2e-4
    assert np.sort(np.abs(picture.pixels - whole.pixels).max(axis=-1).ravel())[-3] < 5e-5


@pytest.mark.few(2)
@pytest.mark.parametrize("way", [("quads", "processor"), *WAYS[::2]])
def test_layers_composite_at_their_depth(draw: Any, way: tuple[str, str]) -> None:
    """The surface of one layer within the fog of another, as in float64, and as one fog before and behind it."""
    fog = sg.Volume(np.ones((SIZE,) * 3, np.float32))
    layers = [sg.Layer(ball(), surface((12.0, "red", 0.5))), sg.Layer(fog, sg.Transfer([(0, 0.1), (1, 0.1)], "white"))]
    scene, camera = sg.Scene(layers), parallel(size=20, away=(0.0, -1.0, 0.0))
    settings = EXACT.replace(shading="off", background=None)
    drawn = draw(way, scene, camera, settings)
    right = sg.reference.render(scene, camera, settings).pixels
    assert np.abs(drawn - right).max() < 2e-3
    apart = distance_of(camera)
    inside = apart < RADIUS - 1
    half = np.sqrt(RADIUS**2 - apart[inside] ** 2)
    before = CENTER[1] - half + 0.5
    assert np.abs(drawn[inside, 3] - (1 - 0.25 * 0.9**SIZE)).max() < 1e-3
    # fog, surface, fog, surface, fog: what is red alone is light of the surfaces
    red = 0.5 * 0.9**before + 0.25 * 0.9 ** (before + 2 * half)
    assert np.abs((drawn[..., 0] - drawn[..., 1])[inside] - red).max() < 4e-3


@pytest.mark.parametrize("way", [("quads", "processor"), None])
def test_a_surface_of_a_layer_is_whole_wherever_parts_of_sheets_end(draw: Any, way: tuple[str, str] | None) -> None:
    """Its depth falls by a ten-thousandth of a sheet from a pixel to the next; all let half of the light pass."""
    z, _, x = np.indices((12, 8, 8))
    ramp = sg.Volume(z + x / 10)
    layers = [sg.Layer(ramp, surface((6.0, "red", 0.5))), sg.Layer(ramp, sg.Transfer([(0, 0), (15, 0.3)]))]
    camera = sg.Camera.orthographic((3.5, 3.5, -10), (3.5, 3.5, 8), (0, 1, 0), height=1 / 512, size=(2048, 1))

    def passed(scene: sg.Scene) -> np.ndarray:
        pixels = draw(way, scene, camera) if way else sg.reference.render(scene, camera, EXACT).pixels
        return 1 - np.asarray(pixels[..., 3])

    assert np.abs(passed(sg.Scene(layers)) / passed(sg.Scene(layers[1:])) - 0.5).max() < 2e-4


def test_depths_and_picks_lie_on_the_surface() -> None:
    volume, camera = ball(), parallel(size=32)
    apart = distance_of(camera)
    inside = apart < RADIUS - 1
    half = np.sqrt(RADIUS**2 - apart[inside] ** 2)
    # a surface that absorbs more than half of the light; values are linear between samples: off by 1/3R
    for opacity in (1.0, 0.6):
        transfer = surface((12.0, "red", opacity))
        off = np.abs(depths(volume, camera, 0.5, transfer=transfer)[inside] - (40 - half)) * half / RADIUS
        assert off.max() < 0.33 / RADIUS
    picked = pick(volume, camera, (16, 16), surface())
    assert picked is not None
    assert np.linalg.norm(np.array(picked.place) - CENTER) == pytest.approx(RADIUS, abs=0.05)


def test_crossings_of_a_spline() -> None:
    """Roots of the quadratic, where they are inside; as many as its signs tell."""
    rng = np.random.default_rng(5)
    q = rng.normal(size=(3, 4000))
    u = np.linspace(0, 1, 2001)[:, None]
    values = q[0] * (1 - u) ** 2 + 2 * q[1] * u * (1 - u) + q[2] * u**2
    changes = (np.diff(values > 0, axis=0)).sum(axis=0)
    first, second = spline_crossings(q)
    found = np.isfinite(first).astype(int) + np.isfinite(second)
    assert (found == changes).mean() > 0.998 and (found % 2 == changes % 2).all()
    for place in (first, second):
        some = np.isfinite(place)
        at = place[some]
        assert (at >= 0).all() and (at <= 1).all()
        sums = q[0, some] * (1 - at) ** 2 + 2 * q[1, some] * at * (1 - at) + q[2, some] * at**2
        assert np.abs(sums).max() < 1e-9
    assert (first <= second).all()


def test_nothing_is_compiled_without_surfaces() -> None:
    """The switch is off unless a transfer function has surfaces, and its twin reads nothing."""
    text = compose("sheet_close.frag", {"SHEETS": 2, "STEPS": 2}).source
    assert "iso_value" not in text and "iso_value" in compose("sheet_close.frag", {"ISO": 1, "STEPS": 2}).source
    volume = ball(12)
    camera = parallel(size=8)
    plain = sg.plan(sg.extract(volume, sg.Transfer([(8, 0), (15, 0.5)])), camera)
    assert (
        not plain.program.appearance.iso
        and sg.plan(sg.extract(volume, surface((15.0, "", 0.5))), camera).program.appearance.iso
    )


def test_few_voxels_are_kept() -> None:
    """Of a surface alone, those beside it."""
    assert len(sg.extract(ball(), surface())) < 0.4 * SIZE**3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: surface("300:teal:2"), "iso: expected VALUE"),
        (lambda: surface("300:nocolour"), "iso: expected VALUE"),
        (lambda: surface(*range(9)), "iso: expected at most 8 surfaces"),
        (lambda: surface(3.0, 3.0), "iso: expected surfaces of different values, got 3 twice"),
        (lambda: sg.extract(ball(8), surface(), threshold=0.1), "got threshold"),
        (lambda: sg.extract(ball(8), surface(), classification="pre"), "got classification pre"),
        (
            lambda: sg.plan(sg.extract(ball(), surface()), parallel(), sg.Settings(blend="mip")),
            "blend: expected composite",
        ),
    ],
)
def test_what_has_no_surface_is_refused_in_a_line(make: Any, message: str) -> None:
    with pytest.raises(sg.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)

"""Ambient occlusion and shadows: closed forms, the float64 reference, and nothing of them where they are off."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.geometry.grid import trilinear
from splatgl.planning.ambient_occlusion import BEFORE, CoarseGrid, LightVolume, RaySums, compute_sky, sky_directions
from tests.helpers.noise import GRIDS, views

pytestmark = pytest.mark.usefixtures("shared_programs")

PLAIN = sg.Settings(antialias="off", occlusion="off")
CUES: list[dict[str, Any]] = [{"ambient_occlusion": 1.0}, {"shadows": 1}, {"ambient_occlusion": 0.7, "shadows": 0.6}]


def cloud(grid: str = "sheared", seed: int = 5) -> sg.Volume:
    cells = np.random.default_rng(seed).random((14, 14, 14))
    for axis in (0, 1, 2):
        cells = (np.roll(cells, 1, axis) + 2 * cells + np.roll(cells, -1, axis)) / 4
    return sg.Volume((cells - cells.min()) / np.ptp(cells), **GRIDS[grid])


def block(samples: np.ndarray, opacity: float, spacing: Any = (1.0, 1.0, 1.0)) -> sg.Splats:
    """Voxels of value 1 with that opacity per mean spacing; all others are clear."""
    transfer = sg.Transfer([(0.4, 0.0), (0.6, opacity)], colormap="#808080", shading=False)
    return sg.extract(sg.Volume(samples.astype(np.float32), spacing=spacing), transfer, classification="pre")


def unit(*direction: float) -> np.ndarray:
    return np.array(direction) / np.linalg.norm(direction)


def test_directions_have_exact_means() -> None:
    """Over the sphere: 1, and of squares and fourth powers of cosines 1/3 and 1/5; half of an open half-space."""
    directions, weights = sky_directions()
    for n in (unit(1, 0, 0), unit(0.3, -0.5, 0.9), unit(1, 1, 1)):
        cosine = directions @ n
        for power, right in ((0, 1.0), (2, 1 / 3), (4, 1 / 5), (8, 1 / 9)):
            assert 2 * (weights * cosine**power).sum() == pytest.approx(right, abs=1e-12)
        # of which the first moment is 1/4; the share of the sky that is seen, weighted by cosines, 1
        assert (weights * np.abs(cosine)).sum() == pytest.approx(1 / 4, abs=0.008)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0.3, -0.5, 0.8), (-0.7, 0.7, 0.1), (1, 1, 1)])
def test_light_through_fog(direction: tuple[float, ...]) -> None:
    """exp(−σ d) from each cell's centre on, whatever the direction and the voxels' sides."""
    sigma, light = 0.05, unit(*direction)
    splats = block(np.ones((20, 24, 28)), -np.expm1(-sigma * 1.2), (1.0, 1.2, 1.44))
    coarse = CoarseGrid.of([(splats, ())])
    found = RaySums.of(coarse, light).transmittance(0.0, 1e9)
    index = np.argwhere(np.ones(found.shape))[:, ::-1]
    world = index @ coarse.cells.world_from_index.T + coarse.cells.origin
    low, high = np.full(3, -0.5) * (1, 1.2, 1.44), (np.array([28, 24, 20]) - 0.5) * (1, 1.2, 1.44)
    inside = ((world > low + 2) & (world < high - 2)).all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.where(light > 0, high - world, low - world) / light
    distance = np.where(light == 0, np.inf, ends).min(axis=1)
    right = np.exp(-sigma * distance)
    assert inside.sum() > 3000
    # a ray that passes near an edge is blurred by a cell
    off = np.abs(found.reshape(-1) - right)[inside]
    assert np.quantile(off, 0.98) < 0.03 and np.sqrt((off**2).mean()) < 0.01


def test_voxels_of_other_grids_lie_where_they_are() -> None:
    """Shared out among cells around each, their extinction is all there, about the same middle."""
    first = block(np.ones((6, 7, 8)), 0.3)
    other = sg.Volume(np.pad(np.ones((1, 1, 1)), 1).astype(np.float32), (0.7, 0.8, 0.9), origin=(2.1, 1.9, 1.3))
    second = sg.extract(other, sg.Transfer([(0.5, 0), (1, 0.2)], unit=1.0), classification="pre")
    alone, both = CoarseGrid.of([(first, ())]), CoarseGrid.of([(first, ()), (second, ())])
    assert alone.extinction.shape == both.extinction.shape
    added = (both.extinction - alone.extinction).astype(np.float64)
    index = np.stack(np.meshgrid(*map(np.arange, added.shape), indexing="ij"), axis=-1)[..., ::-1]
    world = index @ both.cells.world_from_index.T + both.cells.origin
    volume = abs(np.linalg.det(both.cells.world_from_index))
    middle = np.array([2.8, 2.7, 2.2])
    assert added.sum() * volume == pytest.approx(-np.log(0.8) * 0.7 * 0.8 * 0.9, rel=0.01)
    assert np.tensordot(added, world, 3) / added.sum() == pytest.approx(middle, abs=1e-4)


def test_open_planes_see_all_of_the_sky() -> None:
    """Of an opaque half-space a place at its surface sees half of the sphere, and a normal all of its sky; the other
    side none.
    """
    samples = np.zeros((48, 48, 48))
    samples[:24] = 1
    coarse = CoarseGrid.of([(block(samples, 0.999), ())])
    sky = compute_sky(coarse)
    height = (np.array([24.5 + BEFORE]) - coarse.cells.origin[2]) / coarse.cells.world_from_index[2, 2]
    middle = (np.array(sky.shape[2::-1]) - 1) / 2
    seen = trilinear(sky, np.array([[middle[0], middle[1], height[0]]]))[0]
    assert seen[3] == pytest.approx(0.5, abs=0.04)
    assert seen[3] + 2 * seen[2] == pytest.approx(1, abs=0.02)
    assert seen[3] - 2 * seen[2] == pytest.approx(0, abs=0.06)
    assert np.abs(seen[:2]).max() < 0.05


def test_corners_are_darker_and_edges_are_not() -> None:
    samples = np.zeros((40, 40, 40))
    samples[:10] = samples[:, :10] = 1
    splats = block(samples, 0.999)
    cues = LightVolume(((splats, ()),), splats.grid, 1.0, 0.0, None)
    up, into = np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]])
    corner, far = (cues.light_shares(np.array([[20.0, y, 9.5]]), up, into)[0][0] for y in (11.0, 34.0))
    # the half of a plane's sky that a wall leaves
    assert corner == pytest.approx(0.5, abs=0.06) and far > 0.9
    edge = cues.light_shares(np.array([[20.0, 9.0, 39.0]]), up, into)[0][0]
    assert edge > 0.97


def test_a_wall_casts_its_outline() -> None:
    """On a floor, by light from the side: the border of its shadow is right to half of a cell."""
    samples = np.zeros((40, 60, 60))
    samples[:4] = 1
    samples[4:20, 20:40, 28:32] = 1
    splats = block(samples, 0.9999)
    light = unit(-1, 0, 1)
    cues = LightVolume(((splats, ()),), splats.grid, 0.0, 1.0, light)
    normal, seen = np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]])

    def border(places: np.ndarray) -> float:
        share = np.array([cues.light_shares(place[None], normal, seen)[1][0] for place in places])
        assert share.min() < 0.05 and share.max() > 0.95
        return float(np.argmin(np.abs(share - 0.5)))

    # the top of the wall at z = 19.5 shades x up to 31.5 + 19.5 − z, at the place before the floor
    along = np.linspace(36, 59, 231)
    edge = along[int(border(np.stack([along, np.full(231, 30.0), np.full(231, 3.5)], axis=1)))]
    assert edge == pytest.approx(31.5 + (19.5 - 3.5 - BEFORE), abs=0.6)
    across = np.linspace(30, 50, 201)
    edge = across[int(border(np.stack([np.full(201, 40.0), across, np.full(201, 3.5)], axis=1)))]
    assert edge == pytest.approx(39.5, abs=0.6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("how", "technique"),
    [
        ({}, "quads"),
        ({"shading": "off"}, "tiles"),
        ({"classification": "pre"}, "quads"),
        ({"classification": "pre", "compositing": "splats"}, "tiles"),
        ({"clip": ((0.6, 0.8, 0.0, 9.0),)}, "tiles"),
    ],
)
def test_pictures_are_the_reference(how: dict[str, Any], technique: Any, renderer: sg.Renderer) -> None:
    """Within the error bound, where one is known."""
    splats = sg.extract(cloud(), sg.Transfer([(0.3, 0), (0.7, 0.5)], colormap="viridis"))
    for name, cue in zip(("fitted", "parallel"), CUES[1:], strict=True):
        camera = views(splats)[name]
        settings = PLAIN.replace(technique=technique, light="matte", **how, **cue)
        image = renderer.render(splats, camera, settings)
        off = np.abs(image.pixels - reference.render(splats, camera, settings).pixels)
        plain = renderer.render(splats, camera, settings.replace(ambient_occlusion=0, shadows=0)).pixels
        # a normal across the ray may be turned to either side
        assert (off > 2e-3).mean() < 1e-3 and off.max() < 0.05 and (plain - image.pixels).max() > 0.04
        bound = image.info["error_bound"]
        assert bound is None or (off <= bound).mean() > 0.999
        told = image.info["depth_cues"]
        assert (
            isinstance(told, dict) and told["seconds"] > 0 and "depth_cues" not in plain_info(renderer, splats, camera)
        )


def plain_info(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera) -> dict[str, object]:
    return dict(renderer.provenance(renderer.plan(splats, camera, PLAIN), camera, 0.0))


@pytest.mark.long
def test_layers_keep_light_off_each_other(renderer: sg.Renderer) -> None:
    """A layer in front of another, towards the light, shades it; the reference has the same."""
    solid = [sg.Transfer([(0.3, 0), (0.5, 0.8)], colormap=color) for color in ("gray", "hot")]
    low, high = cloud("cubes"), cloud("cubes", 6)
    moved = sg.Volume(high.samples, spacing=high.spacing, origin=(0.0, -3.0, 9.0))
    scene = sg.Scene([sg.Layer(low, solid[0]), sg.Layer(moved, solid[1])])
    camera = sg.Camera.orbit(scene, azimuth=20, elevation=20, size=(40, 40))
    settings = PLAIN.replace(ambient_occlusion=0.8, shadows=0.8, light="matte")
    image = renderer.render(scene, camera, settings)
    off = np.abs(image.pixels - reference.render(scene, camera, settings).pixels)
    assert (off > 4e-3).mean() < 2e-3 and off.max() < 0.05
    # where the lower one is seen alone, and was before
    alone = renderer.render(sg.Scene([sg.Layer(low, solid[0])]), camera, settings).pixels
    above = renderer.render(sg.Scene([sg.Layer(moved, solid[1])]), camera, settings).pixels
    mine = (alone[..., 3] > 0.9) & (above[..., 3] == 0)
    assert mine.sum() > 50
    assert (alone - image.pixels)[mine][:, :3].mean() > 0.01


def test_what_is_off_changes_no_program(renderer: sg.Renderer) -> None:
    splats = sg.extract(cloud(), sg.Transfer([(0.3, 0), (0.7, 0.5)]))
    camera = views(splats)["fitted"]
    plans = [renderer.plan(splats, camera, PLAIN.replace(**each)) for each in ({}, {"shadows": 0}, *CUES)]
    assert plans[0].key == plans[1].key and plans[0].resolved.cues is None
    assert len({each.program for each in plans}) == 4
    stronger = renderer.plan(splats, camera, PLAIN.replace(ambient_occlusion=0.5))
    assert stronger.program == plans[2].program and stronger.key != plans[2].key
    for how, said in (({"blend": "mip"}, "mip shows values"), ({"light_from": (0, 0)}, "the light is at the camera")):
        left = renderer.plan(splats, camera, PLAIN.replace(shadows=1, **how))
        assert left.resolved.cues is None and said in left.explain()


@pytest.mark.parametrize("value", [-0.1, 1.5, "dark", True, float("nan"), None])
def test_strengths_that_are_none(value: Any) -> None:
    for name in ("ambient_occlusion", "shadows"):
        with pytest.raises(sg.InputError, match=f"{name}: expected a strength from 0 to 1"):
            sg.Settings(**{name: value})


@pytest.mark.long
def test_commands_have_depth_cues(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "a.npy", cloud("cubes").samples.astype(np.float32))
    options = ["--size", "24", "--points", "0.4:0,0.6:0.8", "-o", str(tmp_path / "o.npy")]
    source, cues = str(tmp_path / "a.npy"), ["--ambient-occlusion", "0.8", "--shadows", "0.5"]
    assert main(["render", source, *cues, *options]) == 0
    assert "occlusion in 18×18×18 cells took" in capsys.readouterr().out
    same = sg.render(source, size=24, points=((0.4, 0), (0.6, 0.8)), ambient_occlusion=0.8, shadows=0.5)
    assert (np.load(tmp_path / "o.npy") == same.pixels).all()
    assert main(["render", source, *cues, "--memory", "200KB", *options]) == 2
    assert capsys.readouterr().err.startswith("splatgl: ambient occlusion: expected a volume that fits")
    assert main(["render", source, "--shadows", "2", *options]) == 2
    assert "--shadows: expected a strength" in capsys.readouterr().err

"""Depth maps: walls, balls, cut faces and meshes by closed forms, on every grid, in both projections."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.reference.depth_pick import depths
from tests.helpers.noise import GRIDS

pytestmark = pytest.mark.usefixtures("shared_programs")

# opaque within a ten-thousandth of a spacing behind its edge
WALL = sg.Transfer([(0.0, 0.0), (0.0, 1.0)], unit=1e-3, shading=False)
SIZE = (33, 27)


def placed(grid: str, size: int = 24) -> tuple[sg.Volume, np.ndarray]:
    """A grid without values, and the world places [D, H, W, 3] of its samples, from the middle."""
    volume = sg.Volume(np.zeros((size, size, size)), origin=(3.0, -2.0, 7.0), **GRIDS[grid])
    z, y, x = np.indices(volume.shape)
    places = np.stack([x, y, z], axis=-1) @ volume.world_from_index.T + volume.origin
    return volume, places - volume.center


def with_values(volume: sg.Volume, values: np.ndarray) -> sg.Volume:
    return sg.Volume(values, volume.spacing, volume.origin, volume.direction, name="made")


def seen(volume: sg.Volume, parallel: bool, azimuth: float = 25.0) -> sg.Camera:
    camera = sg.Camera.orbit(volume, azimuth, 20, size=SIZE)
    return camera.parallel(volume) if parallel else camera


def rays(camera: sg.Camera) -> tuple[np.ndarray, np.ndarray]:
    """Where rays are at depth 0, and what they gain per depth [H, W, 3], world units."""
    x, y = np.meshgrid(*camera.slopes())
    zero, one = np.zeros_like(x), np.ones_like(x)
    if camera.perspective:
        return np.zeros((*x.shape, 3)) + camera.eye, np.stack([x, y, one], axis=-1) @ camera.eye_from_world
    start = np.stack([x, y, zero], axis=-1) @ camera.eye_from_world + camera.eye
    return start, np.zeros((*x.shape, 3)) + camera.forward


def tilted(camera: sg.Camera, angle: float) -> np.ndarray:
    """A unit normal so many degrees from the view."""
    turn = np.radians(angle)
    return np.asarray(camera.forward * np.cos(turn) + camera.right * np.sin(turn))


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", list(GRIDS))
def test_a_wall_at_an_angle(grid: str, parallel: bool) -> None:
    """Values linear in the distance from a plane: the field is nearly linear, but beside the volume's faces."""
    empty, places = placed(grid)
    camera = seen(empty, parallel)
    normal = tilted(camera, 40)
    volume = with_values(empty, places @ normal)
    found = depths(volume, camera, 0.5, transfer=WALL)
    start, along = rays(camera)
    right = ((volume.center - start) @ normal) / (along @ normal)
    at = (start + along * right[..., None] - volume.origin) @ np.linalg.inv(volume.world_from_index).T
    # an edge, where two faces bend the field, is nearer than 0.4 voxels in one pixel
    inside, inner = (((at > rim) & (at < 23 - rim)).all(axis=-1) for rim in (0.4, 2.0))
    voxels = np.linalg.norm(along @ np.linalg.inv(volume.world_from_index).T, axis=-1)
    # rays that enter the block behind the plane meet it at its side
    off = np.abs(found - right) * voxels
    assert inner.sum() > 50 and off[inner].max() < 0.02 and off[inside].max() < 0.1
    assert np.isnan(found[0, 0]) and np.isfinite(found).sum() >= inside.sum()


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", list(GRIDS))
def test_a_ball(grid: str, parallel: bool) -> None:
    """To a tenth of a voxel where rays do not graze it."""
    empty, places = placed(grid, 30)
    radius = 14.0 if grid == "1:2:5" else 10.0
    camera = sg.Camera.orbit(empty, 25, 20, size=SIZE, zoom=4 if grid == "1:2:5" else 1)
    camera = camera.parallel(empty) if parallel else camera
    volume = with_values(empty, radius - np.linalg.norm(places, axis=-1))
    found = depths(volume, camera, 0.5, transfer=WALL)
    start, along = rays(camera)
    start = start - volume.center
    a, b, c = (along * along).sum(-1), (start * along).sum(-1), (start * start).sum(-1) - radius**2
    root = b * b - a * c
    right = (-b - np.sqrt(np.maximum(root, 0))) / a
    normal = (start + along * right[..., None]) / radius
    steep = -(normal * along).sum(-1) / np.sqrt(a)
    clear = (root > 0) & (steep > 0.5)
    assert clear.sum() > 20 and np.abs(found - right)[clear].max() < 0.1 * max(volume.spacing)
    assert np.isnan(found[root < -0.1 * a * radius**2]).all()


@pytest.mark.parametrize("parallel", [False, True])
@pytest.mark.parametrize("grid", list(GRIDS))
def test_a_cut_face(grid: str, parallel: bool) -> None:
    """A homogeneous block cut at 30° is met at the plane; fog, ln 2 over its extinction behind."""
    empty, _ = placed(grid)
    volume, camera = with_values(empty, np.ones(empty.shape)), seen(empty, parallel)
    normal = tilted(camera, 30)
    cut = [(*normal, float(normal @ volume.center))]
    start, along = rays(camera)
    right = ((volume.center - start) @ normal) / (along @ normal)
    at = (start + along * right[..., None] - volume.origin) @ np.linalg.inv(volume.world_from_index).T
    inside = ((at > 0) & (at < 23)).all(axis=-1)
    for opacity, behind in ((1.0, 0.0), (0.2, np.log(2) / -np.log(1 - 0.2))):
        look = sg.Transfer([(0.0, opacity)], unit=1e-3 if opacity == 1 else 1.0)
        found = depths(sg.Scene([sg.Layer(volume, look)], clip=cut), camera, 0.5)
        more = behind / np.linalg.norm(along, axis=-1)
        known = inside & np.isfinite(found)
        assert known.sum() > 40 and np.abs(found - right - more)[known].max() < 0.01 * min(volume.spacing)


def test_shares_and_extremes() -> None:
    """In fog the share decides; of a ramp along the view the largest value is at its end."""
    y = np.indices((20, 20, 20))[1]
    volume = sg.Volume(y + 1.0)
    camera = sg.Camera.orthographic((9.5, -10, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), 10, (5, 5))
    fog = sg.Transfer([(0.0, 0.1)], unit=1.0)
    for share in (0.0, 0.3, 0.8):
        found = depths(volume, camera, share, transfer=fog)
        assert np.abs(found - 9.5 - np.log(1 - share) / np.log(0.9)).max() < 1e-3
    assert np.isnan(depths(volume, camera, 0.95, transfer=fog)).all()
    assert np.abs(depths(volume, camera, "max", transfer=fog) - 29).max() < 0.6
    assert np.abs(depths(volume, camera, "min", transfer=fog) - 10).max() < 0.6
    peak = sg.Volume(5 - np.abs(y - 12.0))
    assert np.abs(depths(peak, camera, "max", transfer=fog) - 22).max() < 0.1
    # a largest value that is clear
    assert np.isnan(depths(peak, camera, "max", transfer=sg.Transfer([(3, 0.5), (4, 0.0)]))).all()


@pytest.mark.parametrize("classification", ["post", "pre"])
def test_layers_and_meshes(classification: Any) -> None:
    """Two fogs absorb together; a surface before them is met first, a clear one adds its opacity."""
    fog = sg.Transfer([(0.0, 0.1)], unit=1.0)
    blocks = [sg.Volume(np.ones((20, 20, 20))), sg.Volume(np.ones((10, 10, 10)), (2, 2, 2), (0.5, 0.5, 0.5))]
    camera = sg.Camera.orthographic((9.5, -10, 9.5), (9.5, 9.5, 9.5), (0, 0, 1), 4, (4, 4))
    settings = sg.Settings(classification=classification)
    both = sg.Scene([sg.Layer(each, fog) for each in blocks])
    half = -np.log(2) / np.log(0.9)
    assert np.abs(depths(both, camera, 0.5, settings) - 9.5 - half / 2).max() < 1e-3
    wall = [[0, 1.5, 0], [19, 1.5, 0], [19, 1.5, 19], [0, 1.5, 19]]
    for opacity, right in ((1.0, 11.5), (0.3, 9.5 + half / 2 + np.log(0.7) / np.log(0.9) / 2), (0.45, 11.5)):
        mesh = sg.Mesh(wall, [[0, 1, 2], [0, 2, 3]], opacity=opacity)
        scene = sg.Scene([sg.Layer(each, fog) for each in blocks], meshes=[mesh])
        # 2.0 behind the face, the fogs have absorbed 0.81² of the light
        right = 11.5 if 1 - (1 - opacity) * 0.81**2 >= 0.5 else right
        assert np.abs(depths(scene, camera, 0.5, settings) - right).max() < 2e-3


def test_surfaces_pass_what_they_do_not_hide() -> None:
    """Three surfaces of opacity one half: the share decides at which of them a ray ends."""
    wall = np.array([[0, 0, 0], [9, 0, 0], [9, 0, 9], [0, 0, 9]])
    meshes = [sg.Mesh(wall + np.array([0, y, 0]), [[0, 1, 2], [0, 2, 3]], opacity=0.5) for y in (2, 4, 6)]
    camera = sg.Camera.orthographic((4.5, -10, 4.5), (4.5, 4.5, 4.5), (0, 0, 1), 4, (4, 4))
    empty = sg.Layer(sg.Volume(np.zeros((10, 10, 10))), sg.Transfer([(1.0, 0.0), (2.0, 0.1)]))
    for share, right in ((0.49, 12), (0.51, 14), (0.74, 14), (0.76, 16), (0.87, 16)):
        assert np.abs(depths(sg.Scene([empty], meshes=meshes), camera, share) - right).max() < 1e-4
    assert np.isnan(depths(sg.Scene([empty], meshes=meshes), camera, 0.88)).all()


@pytest.mark.parametrize(
    ("samples", "known"),
    [
        (np.full((1, 1, 1), 2.0), True),
        (np.full((1, 6, 1), 2.0), True),
        (np.full((4, 4, 4), np.nan), False),
        (np.zeros((4, 4, 4)), False),
        (np.full((4, 4, 4), 2, np.uint8), True),
        (np.where(np.indices((4, 4, 4))[0] > 0, 2.0, np.nan), True),
    ],
)
def test_odd_volumes(samples: np.ndarray, known: bool) -> None:
    """One voxel, no values, none that is seen; eyes before and within."""
    volume = sg.Volume(samples)
    look = sg.Transfer([(1.0, 0.0), (1.5, 0.9)])
    for camera in (sg.Camera.orbit(volume, 30, 20, size=(9, 9)), sg.Camera.look_at((0, 0, 0), (0, 9, 1), (0, 0, 1))):
        for at in (0.5, "max"):
            found = depths(volume, camera.resized((9, 9)), at, transfer=look)
            assert found.shape == (9, 9) and np.isfinite(found).any() == known
            assert not known or np.nanmin(found) >= 0


def test_labels_and_colours_are_classified_before() -> None:
    """A label's edge is halfway to the next sample."""
    y = np.indices((12, 12, 12))[1]
    camera = sg.Camera.orthographic((5.5, -10, 5.5), (5.5, 5.5, 5.5), (0, 0, 1), 4, (4, 4))
    labels = sg.Volume(np.where(y > 5, 7, 3).astype(np.uint8), labels=(sg.data.volume.Label(7),))
    look = sg.Transfer([(0, 0)], labels=[(7, "#ff0000", 1.0)], unit=1e-3)
    assert np.abs(depths(labels, camera, 0.5, transfer=look) - 15.5).max() < 0.07


@pytest.mark.parametrize("at", [1.0, -0.1, "middle", float("nan")])
def test_what_is_refused(at: Any) -> None:
    volume = sg.Volume(np.ones((4, 4, 4)))
    with pytest.raises(InputError, match="at: expected a share from 0 to below 1, max or min"):
        depths(volume, sg.Camera.orbit(volume, size=(4, 4)), at)


@pytest.mark.long
def test_commands_write_depths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Alone, or beside the picture; the same in Python; as floats and grey; where alpha says that something is."""
    rng = np.random.default_rng(3)
    source = tmp_path / "a.npy"
    np.save(source, rng.random((16, 16, 16)).astype(np.float32))
    options = ["--size", "24x20", "--points", "0.5:0,0.6:0.9", "--clip", "x>0.4"]
    out, picture = tmp_path / "new" / "d.npy", tmp_path / "p.npy"
    assert main(["render", str(source), "--depth", str(out), *options]) == 0
    assert "depths" in capsys.readouterr().out and not (tmp_path / "a.png").exists()
    found = np.load(out)
    same = sg.depth_map(source, size="24x20", points=[(0.5, 0), (0.6, 0.9)], clip="x>0.4")
    assert found.dtype == np.float32 and np.array_equal(found, same.astype(np.float32), equal_nan=True)
    assert (
        main(
            [
                "render",
                str(source),
                "--depth",
                str(out),
                "-o",
                str(picture),
                "--quiet",
                *options,
                "--background",
                "transparent",
            ]
        )
        == 0
    )
    alpha = np.load(picture)[..., 3]
    assert (np.isfinite(found) == (alpha > 0.5)).mean() > 0.97 and np.isfinite(found).mean() > 0.1
    grey = tmp_path / "d.png"
    assert main(["render", str(source), "--depth", str(grey), "--depth-at", "0.1", "--quiet", *options]) == 0
    shown = sg.Image.load(grey)
    assert shown.pixels[..., 0].max() == pytest.approx(1) and shown.info["depth_at"] == 0.1
    assert main(["render", str(source), "--depth", str(source), *options]) == 2
    assert "expected another file than the source" in capsys.readouterr().err
    assert main(["render", str(source), "--depth", str(tmp_path / "d.jpg"), *options]) == 2
    assert main(["render", str(source), "--depth-at", "max", *options]) == 2
    assert "add --depth depth.npy" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".tif", ".exr"])
def test_float_files(suffix: str, tmp_path: Path) -> None:
    library: Any = pytest.importorskip({".tif": "tifffile", ".exr": "OpenEXR"}[suffix])
    path = tmp_path / f"d{suffix}"
    ball = sg.scenes.ball(12)
    right = sg.depth_map(ball, size=24, blend="mip")
    np.save(tmp_path / "b.npy", ball.samples)
    assert main(["render", str(tmp_path / "b.npy"), "--depth", str(path), "--size", "24", "--quiet"]) == 0
    read = library.imread(path) if suffix == ".tif" else library.File(str(path)).parts[0].channels["Z"].pixels
    assert read.shape == right.shape == (24, 24) and read.dtype == np.float32
    assert np.isnan(read[0, 0]) and 0 < np.nanmin(read) < np.nanmax(read)

"""Caps of cut meshes: areas and colours by closed forms, and the float64 reference."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.data.mesh import cap_mesh, cap_meshes, fill_outline
from splatgl.errors import InputError
from splatgl.scene.meshes import MeshFile
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.saving import save_scene
from splatgl.viewer.state import State
from tests.helpers.meshes import PLAIN, RED, cloud
from tests.helpers.points import write_ply

pytestmark = pytest.mark.usefixtures("shared_programs")

CLEAR = sg.Transfer([(0.0, 0.0)], colormap="viridis", window=(0, 24))
MIDDLE, RADIUS = np.full(3, 11.5), 8.0
UNLIT = PLAIN.replace(shading="off")
FRONT = (0.0, 1.0, 0.0, 12.0)


def ramp() -> sg.Volume:
    """Values that grow along x."""
    return sg.Volume(np.broadcast_to(np.arange(24, dtype=np.float32), (24, 24, 24)))


def sphere(radius: float = RADIUS, middle: Any = MIDDLE, sides: int = 96, **look: Any) -> sg.Mesh:
    """A closed surface whose corners lie on a sphere, on no plane through its middle."""
    turn, tilt = 2 * np.pi * np.arange(sides) / sides + 0.01, np.pi * (np.arange(sides) + 0.49) / sides
    ring = np.stack([np.outer(np.sin(tilt), f(turn)) for f in (np.cos, np.sin)], axis=-1)
    places = np.concatenate([ring, np.broadcast_to(np.cos(tilt)[:, None, None], (sides, sides, 1))], axis=-1)
    a = np.arange(sides * (sides - 1)).reshape(-1, sides)
    b = np.roll(a, -1, axis=1)
    quads = np.stack([a, b, b + sides, a + sides], axis=-1).reshape(-1, 4)
    ends = [[first, first + n, first + n + 1] for first in (0, sides * (sides - 1)) for n in range(1, sides - 1)]
    return sg.Mesh(places.reshape(-1, 3) * radius + middle, [*quads[:, :3], *quads[:, [0, 2, 3]], *ends], **look)


def joined(*meshes: sg.Mesh, **look: Any) -> sg.Mesh:
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first[:-1], strict=True)])
    return sg.Mesh(np.concatenate([mesh.vertices for mesh in meshes]), faces, **look)


def ahead(size: int = 64) -> sg.Camera:
    """Along y, 20 world units high."""
    return sg.Camera.orthographic(MIDDLE - (0, 60, 0), MIDDLE, (0, 0, 1), height=20, size=(size, size))


def places(size: int = 64) -> np.ndarray:
    """x of the pixels of `ahead`, less the middle's."""
    return (np.arange(size) + 0.5) * 20 / size - 10


@pytest.mark.parametrize("corners", [3, 5, 9, 40])
def test_outlines_are_filled_by_parity_without_gaps(corners: int) -> None:
    """Lines that cross one another: as many points as crossings of a ray tell; triangles meet side by side."""
    rng = np.random.default_rng(corners)
    around = rng.random((corners, 2))
    lines = np.stack([around, np.roll(around, -1, axis=0)], axis=1)
    points, faces = fill_outline(lines)
    a, b, c = (points[faces[:, n]] for n in range(3))
    area = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() / 2
    x, y = rng.random((2, 100_000, 1))
    (begin, low), (end, high) = lines.transpose(1, 2, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossed = ((low > y) != (high > y)) & (x < begin + (end - begin) * (y - low) / (high - low))
    assert area == pytest.approx((crossed.sum(axis=1) % 2).mean(), abs=5e-3) and area > 0.01
    sides, count = np.unique(
        np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2), axis=0, return_counts=True
    )
    assert count.max() <= 2
    # those of one triangle alone lie on the lines
    middle = points[sides[count == 1]].mean(axis=1)[:, None]
    along, away = lines[:, 1] - lines[:, 0], middle - lines[:, 0]
    share = np.clip((away * along).sum(axis=2) / (along**2).sum(axis=1), 0, 1)[..., None]
    assert np.linalg.norm(away - along * share, axis=2).min(axis=1).max() < 1e-9


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (0.48, -0.6, 0.64)])
def test_caps_of_spheres_are_discs(normal: tuple[float, float, float]) -> None:
    """Their area, also without shared vertices and beside an inner surface; nothing beside the sphere."""
    n = np.array(normal, float)
    ball, hollow = sphere(), joined(sphere(), sphere(3.0))
    soup = sg.Mesh(ball.vertices[ball.faces].reshape(-1, 3), np.arange(3 * len(ball)).reshape(-1, 3))
    for apart in (-4.0, 0.0, 2.0):
        plane = (*normal, float(n @ MIDDLE) + apart)
        cap = cap_mesh(ball, plane)
        assert cap.area == pytest.approx(np.pi * (RADIUS**2 - apart**2), rel=3e-3)
        assert np.abs(cap.vertices @ n - plane[3]).max() < 1e-12 and (cap.normals == n).all()
        assert cap_mesh(soup, plane).area == pytest.approx(cap.area, rel=1e-9)
        hole = np.pi * (9 - apart**2) if abs(apart) < 3 else 0.0
        assert cap_mesh(hollow, plane).area == pytest.approx(cap.area - hole, rel=3e-3)
    assert not len(cap_mesh(ball, (*normal, float(n @ MIDDLE) + 9.0)))
    # a quarter of the ball has two half discs
    across = np.cross(n, [0.36, 0.8, 0.48])
    across = across / np.linalg.norm(across)
    caps = cap_meshes(ball, [(*normal, float(n @ MIDDLE)), (*across.tolist(), float(across @ MIDDLE))] * 2)
    assert [cap.area for _, cap in caps] == pytest.approx([np.pi * RADIUS**2 / 2] * 2, rel=5e-3)


@pytest.mark.parametrize("way", ["quads", "tiles", "card", "reference"])
def test_a_cap_shows_the_field(way: str, renderer: sg.Renderer, card: sg.Renderer) -> None:
    """A disc, of the right area to one hundredth, in the colours of a linear field, unlit."""
    scene = sg.Scene([sg.Layer(ramp(), CLEAR)], [FRONT], [sphere(caps="volume", color=RED)])
    settings = sg.Settings(technique="quads" if way == "quads" else "auto")
    draw = reference.render if way == "reference" else (card if way == "card" else renderer).render
    pixels = draw(scene, ahead(), settings).pixels
    radius = np.sqrt(RADIUS**2 - 0.25)
    assert pixels[..., 3].sum() * (20 / 64) ** 2 == pytest.approx(np.pi * radius**2, rel=0.01)
    x, z = np.meshgrid(places(), places())
    inside = np.hypot(x, z) < radius - 0.5
    right = CLEAR.color(x[inside] + 11.5)
    # colours lie between entries of the map
    assert np.abs(pixels[inside, :3] - right).max() < 1e-3 and np.ptp(right[:, 1]) > 0.2
    assert (pixels[np.hypot(x, z) > radius + 0.5] == 0).all()


def test_plain_caps_are_lit_by_their_plane(renderer: sg.Renderer) -> None:
    """Whole towards the light; half of what lies behind shines through, as through the mesh."""
    layers = [sg.Layer(ramp(), CLEAR)]
    inside = np.hypot(*np.meshgrid(places(), places())) < RADIUS - 0.5
    for opacity in (1.0, 0.5):
        scene = sg.Scene(layers, [FRONT], [sphere(caps="plain", color=RED, opacity=opacity)])
        found, right = (draw(scene, ahead(), PLAIN).pixels for draw in (renderer.render, reference.render))
        assert np.abs(found - right)[inside].max() < 1e-5
        if opacity == 1:
            assert np.abs(found[32, 20:44, :3] - RED).max() < 1e-6
        assert found[32, 32, 3] == pytest.approx(1 - (1 - opacity) ** 2)
    open_scene = sg.Scene(layers, [FRONT], [sphere(clipped=True, color=RED)])
    assert np.abs(renderer.render(open_scene, ahead(), PLAIN).pixels[32, 20, :3] - RED).max() > 0.05


@pytest.mark.few(2)
@pytest.mark.parametrize("grid", ["cubes", "sheared", "1:2:5"])
@pytest.mark.parametrize("kind", ["amounts", "labels", "layers"])
def test_caps_among_clouds_are_the_reference(kind: str, grid: str, renderer: sg.Renderer) -> None:
    """Two planes, a mesh that reaches beyond the volume, and one that lets light through."""
    volume, look = cloud(grid), sg.Transfer([(0.3, 0), (0.7, 0.03)], colormap="viridis", shading=True)
    layers = [sg.Layer(volume, look)]
    if kind == "labels":
        labels = sg.Volume((volume.samples * 4).astype(np.uint8), volume.spacing, volume.origin, volume.direction)
        layers = [sg.Layer(labels.of_values("labels"), opacity=0.05)]
    if kind == "layers":
        layers.append(sg.Layer(cloud("1:2:5"), sg.Transfer([(0.4, 0), (0.9, 0.03)], "hot"), opacity=0.5))
    size, sides = np.ptp(volume.corners, axis=0), 24
    balls = [
        sphere(0.42 * size.min(), volume.center, sides, caps="volume", color=RED),
        sphere(0.4 * size.min(), volume.center + 0.4 * size, sides, caps="volume", color=RED, opacity=0.6),
    ]
    scene = sg.Scene(layers, ["y>0.45", "x+0.2*z<1.0"], balls)
    camera = sg.Camera.orbit(volume, 20, 25, size=(40, 32))
    found, right = (draw(scene, camera, PLAIN).pixels for draw in (renderer.render, reference.render))
    off = np.abs(found - right).max(axis=2)
    open_scene = sg.Scene(layers, ["y>0.45", "x+0.2*z<1.0"], [replaced(ball) for ball in balls])
    covered = np.abs(found - renderer.render(open_scene, camera, PLAIN).pixels).max(axis=2) > 0.05
    most, middle = {"labels": (0.1, 1e-5), "layers": (0.4, 2e-3)}.get(kind, (0.15, 1e-3))
    assert covered.sum() > 15
    # texels between which cubics lie; borders of labels may be a texel off, as in slices
    assert (off > 4e-3).sum() <= most * covered.sum() and np.median(off[covered]) < middle


def replaced(ball: sg.Mesh) -> sg.Mesh:
    return sg.Mesh(ball.vertices, ball.faces, ball.color, ball.opacity, clipped=True)


def test_planes_of_settings_have_caps_too(renderer: sg.Renderer) -> None:
    """The same picture as by those of the scene, which already has the mesh cut by others."""
    layers, ball = [sg.Layer(ramp(), CLEAR)], sphere(caps="volume")
    other = (0.6, 0.0, 0.8, 13.0)
    scenes = [sg.Scene(layers, clip, [ball]) for clip in ([other, FRONT], [other], [])]
    rest = [(), (FRONT,), (other, FRONT)]
    pictures = [
        renderer.render(scene, ahead(32), UNLIT.replace(clip=clip)).pixels
        for scene, clip in zip(scenes, rest, strict=True)
    ]
    assert all(np.abs(picture - pictures[0]).max() < 1e-6 for picture in pictures) and pictures[0].max() > 0.5
    # a scene of meshes that are cut already is drawn as it is
    again = sg.Scene(layers, [other, FRONT], scenes[0].meshes)
    assert np.abs(renderer.render(again, ahead(32), UNLIT).pixels - pictures[0]).max() < 1e-6


def write_ball(folder: Path) -> str:
    trimesh = pytest.importorskip("trimesh")
    ball = sphere(sides=24)
    trimesh.Trimesh(ball.vertices, ball.faces, process=False).export(folder / "ball.stl")
    np.save(folder / "ramp.npy", ramp().samples)
    return str(folder / "ramp.npy")


OPTIONS = [
    "--background",
    "transparent",
    "--clip",
    "y>0.52",
    "--size",
    "48",
    "--quiet",
    "--check",
    "0",
    "--points",
    "0:0,24:0",
    "--colormap",
    "viridis",
]


def test_command_line_scene_file_python_and_window_agree(tmp_path: Path, renderer: sg.Renderer) -> None:
    source, ball, out = write_ball(tmp_path), str(tmp_path / "ball.stl"), tmp_path / "o.npy"
    drawn = {}
    for caps in ("", "plain", "volume"):
        options = [*OPTIONS, "--mesh", f"{ball}:tomato", *(["--caps", caps] if caps else ["--clip-meshes"])]
        assert main(["render", source, *options, "-o", str(out)]) == 0
        drawn[caps] = np.load(out)
    assert np.abs(drawn["plain"] - drawn["volume"]).max() > 0.2 < np.abs(drawn["plain"] - drawn[""]).max()
    look = {"points": [(0, 0), (24, 0)], "colormap": "viridis", "size": 48, "clip": "y>0.52"}
    look["background"] = "transparent"
    mesh = sg.load_mesh(ball, "#ff6347")
    assert np.array_equal(sg.render(source, **look, meshes=mesh, caps="volume").pixels, drawn["volume"])
    scene = SceneFile(source).with_options(**look, meshes=MeshFile(ball, "tomato"), caps="volume")
    (tmp_path / "scene.toml").write_text(scene.to_toml(tmp_path))
    assert 'caps = "volume"' in (tmp_path / "scene.toml").read_text()
    assert np.array_equal(sg.render(tmp_path / "scene.toml").pixels, drawn["volume"])
    document = Document.open(SceneFile.from_toml(tmp_path / "scene.toml"))
    state = State.of(document, (48, 48))
    for caps in ("volume", "plain"):
        edited = replace(state, mesh_files=(replace(state.mesh_files[0], caps=caps),))
        name = Path(save_scene(edited, document, renderer.render, tmp_path).split()[-1])
        saved = SceneFile.from_toml(tmp_path / name)
        shown = np.load(tmp_path / name.with_suffix(".npy"))
        assert saved.meshes[0].caps == caps and np.array_equal(sg.render(tmp_path / name).pixels, shown)
        # from where it is seen, a half ball shows its cap
        assert (np.ptp(shown[shown[..., 3] > 0.9][:, 2]) > 0.1) == (caps == "volume")


def test_what_caps_refuse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, ball = write_ball(tmp_path), str(tmp_path / "ball.stl")
    sheet = sg.Mesh([[5, 0, 5], [15, 24, 5], [5, 24, 15]], [[0, 1, 2]], name="sheet", caps="plain")
    with pytest.raises(
        InputError, match="caps: expected meshes that are closed where planes cut them, got sheet, which"
    ):
        sg.Scene([sg.Layer(ramp(), CLEAR)], [FRONT], [sheet])
    assert len(sg.Scene([sg.Layer(ramp(), CLEAR)], meshes=[sheet]).meshes[0]) == 1
    with pytest.raises(InputError, match="caps: expected plain or volume, got 'all'"):
        sphere(sides=4, caps="all")
    out, cloud_file = tmp_path / "o.png", str(tmp_path / "points.ply")
    write_ply(Path(cloud_file), "ascii", {name: "float" for name in "xyz"}, [*(ramp().corners[:3]).T])
    for command, message in {
        f"{source} --mesh {ball} --caps all": "--caps: invalid choice: 'all'",
        f"{source} --caps plain --clip y>0.5": "--caps: expected a mesh to close, got none",
        f"{ball} --caps volume --clip y>0.5": "--caps: expected a volume, whose values are shown, got the mesh",
        f"{ball} --slice z": "slice: expected a volume, whose values are shown, got the mesh",
        f"{ball} --slice-plane z": "slice: expected a volume, whose values are shown, got the mesh",
        f"{cloud_file} --mesh {ball} --caps volume --clip y>0.5": "caps: expected a volume of voxels, got 3 points",
    }.items():
        with suppress(SystemExit):
            assert main(["render", *command.split(), "--quiet", "-o", str(out)]) == 2
        said = capsys.readouterr().err
        assert message in said and not out.exists() and said.strip().count("\n") == 0
    assert main(["render", ball, "--caps", "plain", "--clip", "y>0.5", "--size", "32", "-o", str(out)]) == 0

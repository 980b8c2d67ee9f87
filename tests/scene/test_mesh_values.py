"""Values of meshes as colours, colour bars of them, and meshes cut by planes: closed forms, the reference, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.annotations.bars import _bars
from splatgl.annotations.canvas import BLACK, AnnotationView, Canvas, ColorScale
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.geometry.clipping import check_planes
from splatgl.scene.meshes import MeshFile
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.transfer.colormaps import colormap
from splatgl.viewer.document import Document
from splatgl.viewer.hud import bar_of
from splatgl.viewer.state import State
from tests.helpers.meshes import PLAIN, along_y, block, cloud, knots

pytestmark = pytest.mark.usefixtures("shared_programs")

CLEAR = sg.Transfer([(0.0, 0.0), (1.0, 0.0)])
UNLIT = PLAIN.replace(shading="off")


def square(values: Any, **look: Any) -> sg.Mesh:
    """From 1.9 to 21.9 across +y; values of its corners, by x, then z."""
    corners = np.array([[1.9, 9, 1.9], [21.9, 9, 1.9], [1.9, 9, 21.9], [21.9, 9, 21.9]])
    return sg.Mesh(corners, [[0, 1, 2], [1, 3, 2]], values=values, **look)


def drawn(renderer: sg.Renderer, *meshes: sg.Mesh, **how: Any) -> np.ndarray:
    scene = sg.Scene([sg.Layer(block(), CLEAR)], meshes=meshes, **how)
    found = renderer.render(scene, along_y(), UNLIT).pixels
    right = reference.render(scene, along_y(), UNLIT).pixels
    assert (np.abs(found - right).max(axis=2) > 1e-4).mean() < 0.02
    return found


def test_values_are_interpolated_then_looked_up(renderer: sg.Renderer) -> None:
    """Of a ramp on two triangles: the map's own colours, which those of the corners do not mix to."""
    found = drawn(renderer, square([0, 8, 0, 8], colormap="cool-warm"))
    across = (np.arange(20) + 2 - 1.9) / 20
    table = colormap("cool-warm")
    at = across * 255
    right = np.stack([np.interp(at, np.arange(256), each) for each in table.T], axis=1)
    assert np.abs(found[10, 1:, :3] - right[1:]).max() < 2e-3
    mixed = table[0] + (table[-1] - table[0]) * across[:, None]
    assert np.abs(mixed - right).max() > 0.3


def test_windows_missing_values_and_several_maps(renderer: sg.Renderer) -> None:
    """Beyond the window the map's ends; of a missing value the plain colour; each mesh has its own map."""
    low = drawn(renderer, square([0, 8, 0, 8], colormap="hot", window=(6, 7)))
    assert np.abs(low[10, 2, :3] - colormap("hot")[0]).max() < 1e-6
    assert np.abs(low[10, 18, :3] - colormap("hot")[-1]).max() < 1e-6
    gone = drawn(renderer, square([0, 0, np.nan, 0], color=(0.2, 0.4, 0.6)))
    assert np.abs(gone[10, 10, :3] - (0.2, 0.4, 0.6)).max() < 1e-6
    front = square([3, 3, 3, 3], colormap="hot", opacity=0.5)
    back = sg.Mesh(
        front.vertices + np.array([0, 3, 0]), front.faces, values=[1, 2, 1, 2], colormap="cool-warm", window=(1, 2)
    )
    both = drawn(renderer, front, back)[10, 10, :3]
    alone = drawn(renderer, back)[10, 10, :3]
    middle = colormap("hot")[127] / 2 + colormap("hot")[128] / 2
    assert np.abs(both - (middle + alone) / 2).max() < 1e-5
    colored = square([0, 8, 0, 8], colors=np.full((4, 3), 255, np.uint8))
    assert not colored.mapped and np.abs(drawn(renderer, colored)[10, 10] - 1).max() < 1e-6
    assert square([5, 5, 5, 5]).ranged == (4.5, 5.5) and square([np.nan] * 4).ranged == (0.0, 1.0)


@pytest.mark.few(1)
@pytest.mark.parametrize("parallel", [False, True])
def test_meshes_with_values_are_the_reference(parallel: bool, renderer: sg.Renderer) -> None:
    """Lit, in a cloud, opaque and not, and cut."""
    volume = cloud("sheared")
    look = sg.Transfer([(0.3, 0), (0.7, 0.4)], colormap="viridis", shading=True)
    meshes = [
        sg.Mesh(m.vertices, m.faces, opacity=m.opacity, values=m.vertices[:, 0], colormap=name, clipped=n < 2)
        for n, (m, name) in enumerate(zip(knots(volume), ("hot", "viridis", "cool-warm"), strict=True))
    ]
    scene = sg.Scene([sg.Layer(volume, look)], "x<0.6", meshes)
    camera = sg.Camera.orbit(volume, 30, 20, size=(48, 40))
    camera = camera.parallel(scene) if parallel else camera
    found = renderer.render(scene, camera, PLAIN).pixels
    off = np.abs(found - reference.render(scene, camera, PLAIN).pixels).max(axis=2)
    assert (off > 2e-3).mean() < 0.006 and np.median(off) < 2e-5


def test_a_ball_is_cut_at_any_angle(renderer: sg.Renderer) -> None:
    """Its area is that of the cap; what is left lies behind the plane, and is the ball's own surface."""
    ball = sg.Mesh.of_points([[11.5, 11.5, 11.5]], 9.0)
    for normal in ([1, 0, 0], [0.3, -0.5, 0.8]):
        n = np.array(normal) / np.linalg.norm(normal)
        for apart in (-4.0, 2.5):
            (plane,) = check_planes([(*n, n @ np.full(3, 11.5) + apart)])
            cut = ball.cut([plane])
            corners = cut.vertices[cut.faces]
            area = np.linalg.norm(np.cross(*(corners[:, k] - corners[:, 0] for k in (1, 2))), axis=1).sum() / 2
            assert area == pytest.approx(2 * np.pi * 9 * (9 - apart), rel=0.03)
            beyond = cut.vertices @ n - plane[3]
            assert beyond.min() == pytest.approx(0, abs=1e-12)
            edge = np.linalg.norm(cut.vertices[np.abs(beyond) < 1e-9] - 11.5, axis=1)
            assert len(edge) > 20 and np.sqrt(81 - apart**2) * 0.97 < np.sqrt(edge**2 - apart**2).min()
            assert np.abs(np.linalg.norm(cut.normals, axis=2) - 1).max() < 1e-12
            out = ((corners - 11.5) * cut.normals).sum(axis=2) / np.linalg.norm(corners - 11.5, axis=2)
            assert np.abs(np.abs(out) - 1).max() < 0.01
    # a pixel's edge: the square ends where the plane passes, to float32
    edge = 9.25
    found = drawn(renderer, square(None, color=(1, 1, 1), clipped=True), clip=[(-1.0, 0.0, 0.5, -edge)])
    columns, rows = np.arange(20) + 2.0, 21.0 - np.arange(20)
    kept = -columns[None, :] + 0.5 * rows[:, None] >= -edge
    near = np.abs(-columns[None, :] + 0.5 * rows[:, None] + edge) < 1e-6
    assert ((found[..., 3] > 0.5) == kept)[~near].all() and 0.1 < kept.mean() < 0.9


def test_what_a_cut_keeps_is_unchanged() -> None:
    """Several planes; values, colours and opacity with it; nothing where all is cut off."""
    rng = np.random.default_rng(3)
    ball = sg.Mesh.of_points([[0, 0, 0]], 5.0, opacity=0.4, name="ball")
    colors = rng.integers(0, 255, (len(ball.vertices), 3)).astype(np.uint8)
    mesh = sg.Mesh(ball.vertices, ball.faces, opacity=0.4, values=2 * ball.vertices[:, 0] - ball.vertices[:, 2])
    cut = mesh.cut([(1, 0, 0, -2), (0, 0.6, 0.8, 0)])
    assert np.abs(cut.values - 2 * cut.vertices[:, 0] + cut.vertices[:, 2]).max() < 1e-12
    assert cut.window == mesh.ranged and cut.opacity == 0.4
    assert mesh.cut([(1, 0, 0, -99)]) is mesh and len(mesh.cut([(1, 0, 0, 99)])) == 0
    painted = sg.Mesh(ball.vertices, ball.faces, colors=colors).cut([(1, 0, 0, 0.01)])
    whole = {tuple(v.round(9)): tuple(c) for v, c in zip(ball.vertices, colors, strict=True)}
    kept = [(tuple(v.round(9)), tuple(c)) for v, c in zip(painted.vertices, painted.colors, strict=True)]
    same = [whole[v] == c for v, c in kept if v in whole]
    assert len(same) > 100 and all(same)


def test_planes_cut_meshes_that_are_to_be_cut(renderer: sg.Renderer) -> None:
    """By a scene's planes and by those of settings; in pictures, depths and under a pixel."""
    volume = block()
    wall = square(None, color=(1, 0, 0))
    cut = sg.Mesh(wall.vertices, wall.faces, color=(1, 0, 0), clipped=True)
    camera, settings = along_y(), UNLIT.replace(clip=[(1.0, 0.0, 0.0, 12.0)])
    layers = [sg.Layer(volume, CLEAR)]
    scenes = [sg.Scene(layers, meshes=[each]) for each in (wall, cut)]
    alpha = [renderer.render(each, camera, settings).pixels[10, :, 3] for each in scenes]
    assert alpha[0][1:].min() == 1 and (alpha[1] == (np.arange(20) >= 10)).all()
    scene = sg.Scene(layers, "x>0.5", [cut, wall])
    assert scene.meshes[0].vertices[:, 0].min() == pytest.approx(11.5) and scene.meshes[1] is wall
    assert sg.pick(sg.Scene(layers, "x>0.5", [cut]), camera, (5, 10)) is None
    found = sg.depth_map(volume, CLEAR, camera, settings, meshes=[cut])
    assert np.isnan(found[10, 5]) and found[10, 15] == pytest.approx(9 - (11.5 - 60))
    image = sg.render(
        volume, CLEAR, camera, UNLIT.replace(background=None), meshes=[wall], clip="x>0.5", clip_meshes=True
    ).pixels[10, :, 3]
    assert (image == (np.arange(20) >= 10)).all()


VTP = """<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData>
<Piece NumberOfPoints="5" NumberOfLines="1" NumberOfPolys="2">
<PointData {active}>{points}</PointData><CellData>{cells}</CellData>
<Points>
<DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 4 0 0 4 3 0 0 3 0 9 9 9</DataArray></Points>
<Lines><DataArray type="Int64" Name="connectivity" format="ascii">3 4</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">2</DataArray></Lines>
<Polys><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3 0 1 4</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4 7</DataArray></Polys></Piece></PolyData></VTKFile>"""


def array(name: str, text: str, kind: str = "Float32", components: int = 1) -> str:
    return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="ascii">{text}</DataArray>'


def numbers(mesh: sg.Mesh) -> np.ndarray:
    """Its values, which it has."""
    assert mesh.values is not None
    return mesh.values


def vtp(folder: Path, points: str = "", cells: str = "", active: str = "") -> str:
    pytest.importorskip("vtk", reason="reads them")
    (folder / "a.vtp").write_text(VTP.format(points=points, cells=cells, active=active))
    return str(folder / "a.vtp")


def test_numbers_of_vtk_files(tmp_path: Path) -> None:
    """Of points: the first, the active one, one by name, lengths of vectors; tubes have those of their points."""
    both = array("Normals", "0 0 1 " * 5, components=3) + array("a", "1 2 3 4 5") + array("b", "5 4 3 2 nan")
    speed = array("v", "3 4 0 0 0 2 0 1 0 1 0 0 0 0 0", components=3)
    found = sg.load_mesh(vtp(tmp_path, both + speed))
    assert found.mapped and found.quantity == "a" and numbers(found)[:5].tolist() == [1, 2, 3, 4, 5]
    assert found.ranged == (1, 5) and set(numbers(found)[5:]) == {4.0, 5.0}
    other = sg.load_mesh(vtp(tmp_path, both, active='Scalars="b"'), "hot", 0.5)
    assert (other.quantity, other.colormap, other.opacity) == ("b", "hot", 0.5) and np.isnan(numbers(other)[4])
    assert numbers(sg.load_mesh(vtp(tmp_path, speed), array="v"))[:5].tolist() == [5, 2, 1, 1, 0]
    assert sg.load_mesh(vtp(tmp_path, speed)).values is None
    plain = sg.load_mesh(vtp(tmp_path, both), "#ff0000")
    assert not plain.mapped and plain.color == (1.0, 0.0, 0.0)
    colors = array("c", "255 0 0 " * 5, "UInt8", 3)
    assert (sg.load_mesh(vtp(tmp_path, colors + both, active='Scalars="c"')).colors == (255, 0, 0)).all()
    with pytest.raises(InputError, match="array: expected one of Normals, a, b, got 'c'"):
        sg.load_mesh(vtp(tmp_path, both), array="c")
    with pytest.raises(InputError, match=r"a\.vtp: numbers at its points or cells, for the colour map hot, got none"):
        sg.load_mesh(vtp(tmp_path), "hot")


def test_numbers_of_cells(tmp_path: Path) -> None:
    """Each polygon has its own, over smooth normals; VTK counts lines before polygons."""
    found = sg.load_mesh(vtp(tmp_path, cells=array("n", "7 8 9", "Int32") + array("vtkGhostType", "0 0 0", "UInt8")))
    corners = numbers(found)[found.faces]
    assert corners[:3].tolist() == [[9.0] * 3, [8.0] * 3, [8.0] * 3] and (corners[3:] == 7).all()
    assert found.quantity == "n" and found.normals.shape == (len(found), 3, 3)
    turned = sg.Mesh(found.vertices, found.faces, frame="LPS", corner_normals=found.normals).placed("RAS")
    assert np.abs(turned.normals - found.normals * (-1, -1, 1)).max() < 1e-12


def test_properties_of_ply_files(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.creation.icosphere(1)
    ball.vertex_attributes["odd"] = np.ones(len(ball.vertices), np.float32)
    ball.vertex_attributes["quality"] = ball.vertices[:, 2].astype(np.float32)
    ball.export(tmp_path / "b.ply")
    found = sg.load_mesh(tmp_path / "b.ply")
    assert found.quantity == "quality" and np.abs(found.values - found.vertices[:, 2]).max() < 1e-6
    assert sg.load_mesh(tmp_path / "b.ply", array="odd").values.tolist() == [1.0] * len(found.vertices)
    header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "c.ply").write_text(header + "property float scalar_t\nend_header\n0 0 0 3\n9 0 0 5\n")
    cloud = sg.load_mesh(tmp_path / "c.ply")
    assert cloud.quantity == "scalar_t" and sorted(set(cloud.values)) == [3.0, 5.0]
    with pytest.raises(InputError, match="array: expected one of odd, quality, got 'x1'"):
        sg.load_mesh(tmp_path / "b.ply", array="x1")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a.vtp:hot", MeshFile("a.vtp", "hot")),
        ("a.vtp:hot=p.q:0.5", MeshFile("a.vtp", "hot", 0.5, array="p.q")),
        ("a.vtp:=t", MeshFile("a.vtp", array="t")),
        ("b/a.vtp:red", MeshFile("b/a.vtp", "red")),
    ],
)
def test_meshes_in_words(text: str, found: MeshFile) -> None:
    assert MeshFile.read(text) == found


def test_scene_files_and_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Arrays, windows and cuts are kept in scene files; a mesh alone has the colour bar of its values."""
    source = vtp(tmp_path, array("a", "1 2 3 4 5") + array("b", "5 4 3 2 1"))
    mesh = MeshFile(source, "hot", array="b", window=(1.0, 4.0), clip=True)
    path = tmp_path / "scene.toml"
    path.write_text(SceneFile(source, meshes=(mesh,)).to_toml(tmp_path))
    assert SceneFile.from_toml(path).meshes == (mesh,)
    opened = mesh.open()
    assert (
        opened.clipped
        and opened.window == (1.0, 4.0)
        and ColorScale.of([opened]) == (ColorScale("hot", 1.0, 4.0, "b"),)
    )
    out = tmp_path / "o.npy"
    options = ["-o", str(out), "--size", "96", "--check", "0", "--quiet", "--background", "transparent"]
    assert main(["render", source, *options]) == 0
    plain = np.load(out)
    assert main(["render", source, "--annotate", "colorbar", *options]) == 0
    barred = np.load(out)
    assert (barred != plain).any()
    assert main(["render", source, "--clip", "x<0.3", "--clip-meshes", *options]) == 0
    assert 0 < (np.load(out)[..., 3] > 0).sum() < (plain[..., 3] > 0).sum()
    for bad in ("array = 3", "window = [3, 1]", 'window = "a"', 'clip = "yes"'):
        path.write_text(f'volume = "a.vtp"\n[[mesh]]\nfile = "a.vtp"\n{bad}\n')
        with pytest.raises(InputError, match=f"{bad.split()[0]}: expected"):
            SceneFile.from_toml(path)
    assert main(["render", source, "--mesh", f"{source}:nosuch", *options]) == 2
    assert "a colour such as #e8dcc8 or red, or a colour map such as viridis, got 'nosuch'" in capsys.readouterr().err
    for look in ({"values": [1, 2]}, {"values": "a"}, {"window": (3, 3)}, {"corner_normals": np.zeros((1, 3))}):
        with pytest.raises(InputError, match=f"{next(iter(look))}: expected"):
            sg.Mesh(np.eye(3), [[0, 1, 2]], **look)


# --- surfaces beside lines --------------------------------------------------------------------------------------------


def flow() -> sg.Volume:
    """Distances from the middle, and a rotation."""
    z, y, x = np.indices((12, 12, 12)) - 5.5
    distance = np.sqrt(x**2 + y**2 + z**2).astype(np.float32)
    return sg.Volume(distance, vectors=np.stack([-y, x, 0 * x + 1], axis=-1).astype(np.float32), quantity="pressure")


def bars_of(scene: OpenScene) -> list[str]:
    """Titles of the colour bars of its picture, or the reason for none."""
    canvas = Canvas(np.zeros((200, 200, 4), np.float32), BLACK)
    view = AnnotationView(scene.annotated_subject, scene.legend[1], scene.camera)
    return [bar.label for bar in _bars(canvas, view)] or canvas.notes


@pytest.mark.parametrize(
    ("options", "opacity", "bars"),
    [
        ({"iso": "4:red"}, 1.0, ["no colour bar of this picture"]),
        ({"iso": 4}, 1.0, ["pressure"]),
        ({"iso": "4:red", "streamlines": 5}, 1.0, ["speed"]),
        ({"iso": "4:red:0.3", "streamlines": 5}, 0.3, ["speed"]),
        ({"iso": "4:red:0.3", "arrows": 5}, 0.3, ["speed"]),
        ({"streamlines": 5}, None, ["pressure", "speed"]),
    ],
)
def test_surfaces_beside_lines(options: dict[str, Any], opacity: float | None, bars: list[str]) -> None:
    """Surfaces have the opacity that is asked for, and the bars are of what is drawn, in commands and in the window."""
    file = SceneFile("flow", held=flow(), view=ViewOptions(size=(64, 64))).with_options(**options)
    scene = OpenScene.of(file, file.open())
    assert [surface.opacity for surface in scene.transfer.iso] == ([] if opacity is None else [opacity])
    assert bars_of(scene) == bars
    document = Document.open(file, quiet=True)
    assert [surface.opacity for surface in document.layers[0].transfer.iso] == [s.opacity for s in scene.transfer.iso]
    valued, transfer = bar_of(State.of(document, (64, 64)), document)
    assert ColorScale.of(document.meshes) == scene.annotated_subject.scales
    assert (valued, transfer.iso) == (document.volume, scene.transfer.iso)


def test_a_value_that_no_sample_passes_is_noted() -> None:
    notes = SceneFile("flow", held=flow()).with_options(iso=[4, 40], streamlines=5).open().notes
    assert notes == ("no surface at 40: pressure has values from 0.866025 to 9.52628",)
    assert SceneFile("flow", held=flow()).with_options(iso=4).open().notes == ()


def test_the_bar_of_a_hidden_volume_is_that_of_a_visible_one() -> None:
    other = SceneFile("b", held=sg.Volume(np.indices((6, 6, 6))[0] * 1.0, name="b"))
    file = SceneFile("a", held=replace(flow(), name="a"), visible=False, layers=(other,))
    scene = OpenScene.of(file, file.open())
    assert bars_of(scene) == ["b"] and scene.legend[1].color_range == sg.default_transfer(other.open()).color_range
    document = Document.open(file, quiet=True)
    assert bar_of(State.of(document, (64, 64)), document)[0] is document.layers[1].volume

"""Meshes in pictures of volumes: closed forms, the float64 reference, files, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.errors import InputError
from splatgl.reference.layers import crossings
from splatgl.reference.rays import Pixels
from splatgl.scene.meshes import MeshFile
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.lighting import AMBIENT, DIFFUSE, LIGHTS
from tests.helpers.meshes import PLAIN, RED, along_y, block, cloud, knots

pytestmark = pytest.mark.usefixtures("shared_programs")

OPACITY = 0.05
FOG = sg.Transfer([(0.0, OPACITY)], colormap="gray", window=(0, 2), unit=1.0)
GRAY = float(linear_from_srgb(0.5))


def disc(y: float, radius: float, **look: Any) -> sg.Mesh:
    """Across +y, around the middle of a block; its corners lie on no pixel's ray."""
    turn = 2 * np.pi * np.arange(64) / 64 + 0.013
    ring = np.stack([11.5 + radius * np.cos(turn), np.full(64, y), 11.5 + radius * np.sin(turn)], axis=1)
    faces = [[0, 1 + n, 1 + (n + 1) % 64] for n in range(64)]
    return sg.Mesh(np.concatenate([[[11.617, y, 11.571]], ring]), faces, **look)


def closed_form(meshes: list[sg.Mesh]) -> np.ndarray:
    """Light [4] of a ray along y through fog from −.5 to 23.5 and discs."""
    light, clear, last = np.zeros(4), 1.0, -0.5
    ends = sorted((float(mesh.vertices[0, 1]), mesh) for mesh in meshes)
    for y, mesh in [*ends, (23.5, None)]:
        fog = 1 - (1 - OPACITY) ** (y - last)
        light += clear * fog * np.array([GRAY, GRAY, GRAY, 1])
        clear, last = clear * (1 - fog), y
        if mesh is not None:
            light += clear * mesh.opacity * np.array([*mesh.color, 1])
            clear *= 1 - mesh.opacity
    return light


@pytest.mark.few(1)
@pytest.mark.parametrize("opacities", [[1.0], [0.4], [0.4, 0.3, 1.0], [0.0, 0.5]])
@pytest.mark.parametrize("depth", [7.0, 9.37])
def test_discs_in_fog(opacities: list[float], depth: float, renderer: sg.Renderer) -> None:
    """A volume in front weakens a surface; behind an opaque one it ends; others add up in the order of their depths."""
    meshes = [disc(depth + 5.3 * n, 9, color=RED, opacity=each) for n, each in enumerate(opacities)]
    scene, right = sg.Scene([sg.Layer(block(), FOG)], meshes=meshes[::-1]), closed_form(meshes)
    found = renderer.render(scene, along_y(), PLAIN).pixels
    assert np.abs(found[8:12, 8:12] - right).max() < 5e-5
    # beside the discs
    assert np.abs(found[0, 0] - closed_form([])).max() < 5e-5
    assert np.abs(reference.render(scene, along_y(), PLAIN).pixels[8:12, 8:12] - right).max() < 5e-5


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("layers", "classification", "parallel"),
    [(1, "post", True), (1, "pre", False), (2, "post", False), (2, "pre", True)],
)
def test_meshes_in_clouds_are_the_reference(
    layers: int, classification: Any, parallel: bool, renderer: sg.Renderer
) -> None:
    """But for pixels at edges, which a rasteriser may give to the other side."""
    look = sg.Transfer([(0.3, 0), (0.7, 0.4)], colormap="viridis", shading=True)
    volumes = [cloud("sheared"), cloud("1:2:5")][:layers]
    scene = sg.Scene([sg.Layer(each, look) for each in volumes], meshes=knots(volumes[0]))
    camera = sg.Camera.orbit(scene, 30, 20, size=(48, 40))
    camera = camera.parallel(scene) if parallel else camera
    settings = PLAIN.replace(classification=classification, compositing="sheets")
    found = renderer.render(scene, camera, settings)
    right = reference.render(scene, camera, settings).pixels
    off = np.abs(found.pixels - right).max(axis=2)
    without = renderer.render(sg.Scene(scene.layers), camera, settings).pixels
    assert (np.abs(found.pixels - without).max(axis=2) > 0.05).mean() > 0.01
    assert (off > 2e-3).mean() < 0.004 and np.median(off) < 2e-5
    assert found.info["triangles"] == sum(map(len, scene.meshes))


@pytest.mark.long
def test_eyes_inside_meshes(renderer: sg.Renderer) -> None:
    """A ball around the eye, one through its plane, and one behind it."""
    volume = block()
    eye = np.array([11.3, 11.2, 11.1])
    camera = sg.Camera.look_at(eye, eye + np.array([0.1, 1, 0.2]), (0, 0, 1), 70, (24, 20))
    balls = [([eye], 2.0, 0.5), ([eye + np.array([3, 0, 1])], 1.5, 1.0), ([eye - np.array([0, 5, 0])], 2.0, 1.0)]
    meshes = [sg.Mesh.of_points(at, radius, opacity=opacity, color=RED) for at, radius, opacity in balls]
    scene = sg.Scene([sg.Layer(volume, FOG)], meshes=meshes)
    found, right = renderer.render(scene, camera, PLAIN).pixels, reference.render(scene, camera, PLAIN).pixels
    off = np.abs(found - right).max(axis=2)
    assert (off > 2e-3).mean() < 0.01 and np.median(off) < 2e-5
    plain = renderer.render(sg.Scene([sg.Layer(volume, FOG)]), camera, PLAIN).pixels
    assert np.abs(found - plain).max() > 0.2


def test_far_sides_of_meshes_around_the_eye(renderer: sg.Renderer) -> None:
    """Below the tip of a tetrahedron each ray crosses one side; the base is the farthest, as other sides end behind."""
    corners = np.array([[-4, -1, 0.5], [4, -1, 0.5], [0, 31, 0.5], [0, 15, 8.5]], float)
    tent = sg.Mesh(corners, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], opacity=0.4)
    scene = sg.Scene([sg.Layer(block(), sg.Transfer([(0.0, 0.0)]))], meshes=[tent])
    for height in np.linspace(7.0, 8.3, 6):
        camera = sg.Camera.look_at((0.01, 15.02, height), (0.01, 15.02, 0), (0, 1, 0), fov=120, size=(16, 16))
        picture = renderer.render(scene, camera, PLAIN).pixels
        assert np.abs(picture[..., 3] - 0.4).max() < 1e-4
        assert np.abs(picture - reference.render(scene, camera, PLAIN).pixels).max() < 1e-4


def test_rays_cross_balls_where_spheres_are() -> None:
    """Distances and normals of a fine ball against the closed form of a sphere."""
    ball = sg.Mesh.of_points([[0, 30, 0]], 5.0, color=(1, 1, 1))
    camera = sg.Camera.look_at((0, 0, 0), (0, 1, 0), (0, 0, 1), 15, (32, 32))
    distance, light, _ = crossings([ball], camera, Pixels.of((32, 32), np.arange(32 * 32)), LIGHTS["head"])
    x, y = np.meshgrid(*camera.slopes())
    ray = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    along = ray @ [0, 0, 30]
    inside = along**2 - (900 - 25)
    hit = inside > 6.0
    assert hit.sum() > 300
    for n, sign in enumerate((-1, 1)):
        assert np.abs(distance[hit, n] - (along + sign * np.sqrt(np.abs(inside)))[hit]).max() < 0.2
    normal = ray[hit] * distance[hit, :1] - [0, 0, 30]
    cosine = np.abs((normal * ray[hit]).sum(axis=1)) / np.linalg.norm(normal, axis=1)
    assert np.abs(light[hit, 0, 0] - AMBIENT - DIFFUSE * cosine).max() < 0.01
    assert np.isinf(distance[inside < -3.0]).all()


def test_edges_are_sharp_and_round_things_smooth() -> None:
    """A cube's corners have the normals of its sides, a ball's those of the sphere."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    cube = sg.Mesh(corners, [three for a, b, c, d in sides for three in ([a, b, c], [a, c, d])])
    assert (np.sort(np.abs(cube.normals), axis=2) == [0, 0, 1]).all()
    ball = sg.Mesh.of_points([[0, 0, 0]], 1.0)
    assert np.abs(ball.normals - ball.vertices[ball.faces]).max() < 0.02


def test_spheres_and_tubes_have_their_radius() -> None:
    points = sg.Mesh.of_points([[0, 0, 0], [5, 1, 2]], 1.5)
    assert len(points) == 640 and np.abs(np.linalg.norm(points.vertices[162:] - [5, 1, 2], axis=1) - 1.5).max() < 1e-12
    line = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 1, 0]])
    tube = sg.Mesh.of_lines([line, [[3, 3, 3]]], 0.25)
    assert len(tube) == 2 * 8 * 2 and tube.faces.max() == len(tube.vertices) - 1
    middle = tube.vertices.reshape(3, 8, 3).mean(axis=1)
    assert np.abs(middle - line[[0, 1, 3]]).max() < 1e-12
    assert np.abs(np.linalg.norm(tube.vertices.reshape(3, 8, 3) - middle[:, None], axis=2) - 0.25).max() < 1e-12


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vertices": [[0, 0, np.nan]] * 3}, "vertices: expected finite"),
        ({"vertices": [[0, 0]] * 3}, r"vertices: expected an array \[N, 3\]"),
        ({"faces": [[0, 1, 3]]}, "faces: expected numbers of 3 vertices"),
        ({"faces": "abc"}, "faces: expected an array"),
        ({"opacity": 1.5}, "opacity: expected a number from 0 to 1"),
        ({"color": "redd"}, "color: expected #rrggbb"),
        ({"color": (1, 2, 3)}, "color: expected #rrggbb"),
        ({"colors": [[1, 2, 3]]}, "colors: expected one for each"),
    ],
)
def test_meshes_that_are_none(change: dict[str, Any], message: str) -> None:
    good: dict[str, Any] = {"vertices": np.eye(3), "faces": [[0, 1, 2]]}
    with pytest.raises(InputError, match=message):
        sg.Mesh(**{**good, **change})


def test_colors_of_meshes_have_names() -> None:
    good: dict[str, Any] = {"vertices": np.eye(3), "faces": [[0, 1, 2]]}
    assert sg.Mesh(**good, color="teal").color == sg.Mesh(**good, color="#008080").color


def test_what_meshes_refuse(renderer: sg.Renderer) -> None:
    scene = sg.Scene([sg.Layer(block(size=6), FOG)], meshes=[disc(3, 2)])
    with pytest.raises(InputError, match="meshes: expected blend composite, got mip"):
        renderer.render(scene, along_y(), PLAIN.replace(blend="mip"))
    with pytest.raises(InputError, match="layers composite in sheets"):
        renderer.render(scene, along_y(), PLAIN.replace(compositing="splats", classification="pre"))


def tetrahedron() -> tuple[np.ndarray, np.ndarray]:
    vertices = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4.0]])
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.mark.parametrize("ending", [".ply", ".stl", ".obj", ".off", ".glb"])
def test_files_of_trimesh(ending: str, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    vertices, faces = tetrahedron()
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / f"a{ending}")
    found = sg.load_mesh(tmp_path / f"a{ending}", opacity=0.5)
    corners = found.vertices[found.faces]
    right = vertices[faces]
    assert len(found) == 4 and found.opacity == 0.5 and found.name == f"a{ending}"
    assert np.abs(np.sort(corners.mean(axis=1), axis=0) - np.sort(right.mean(axis=1), axis=0)).max() < 1e-6


def test_colours_and_frames_of_files(tmp_path: Path) -> None:
    """Colours of vertices; the side to which x and y point, which 3D Slicer writes into a comment."""
    trimesh = pytest.importorskip("trimesh")
    vertices, faces = tetrahedron()
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [9, 8, 7, 255]], np.uint8)
    trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False).export(tmp_path / "a.ply")
    found = sg.load_mesh(tmp_path / "a.ply")
    assert found.colors is not None and {tuple(each) for each in found.colors} == {tuple(each[:3]) for each in colors}
    assert sg.load_mesh(tmp_path / "a.ply", color=(1, 0, 0)).colors is None
    data = bytearray(trimesh.Trimesh(vertices, faces).export(file_type="stl"))
    data[:40] = b"3D Slicer output. SPACE=LPS".ljust(40)
    (tmp_path / "a.stl").write_bytes(bytes(data))
    slicer = sg.load_mesh(tmp_path / "a.stl")
    assert slicer.frame == "LPS"
    volume = sg.Volume(np.ones((4, 4, 4), np.float32), frame="RAS")
    (placed,) = sg.Scene([sg.Layer(volume, FOG)], meshes=[slicer]).meshes
    assert isinstance(placed, sg.Mesh)
    assert (placed.vertices == slicer.vertices * np.array([-1, -1, 1])).all() and slicer.placed("LPS") is slicer


def test_vtk_files(tmp_path: Path) -> None:
    """Polygons and strips as triangles, lines as tubes, in several pieces, with offsets of VTK's own form."""
    pytest.importorskip("vtk", reason="reads them")
    points = "0 0 0  4 0 0  4 4 0  0 4 0  0 0 4"

    def array(name: str, numbers: str) -> str:
        return f'<DataArray type="Int64" format="ascii" Name="{name}">{numbers}</DataArray>'

    def cells(name: str, numbers: str, ends: str) -> str:
        return f"<{name}>{array('connectivity', numbers)}{array('offsets', ends)}</{name}>"

    piece = f"""<Piece NumberOfPoints="5" NumberOfPolys="2" NumberOfStrips="1" NumberOfLines="1">
    <Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">{points}</DataArray></Points>
    {cells("Polys", "0 1 2 3 0 1 4", "4 7")}{cells("Strips", "0 1 3 2", "4")}{cells("Lines", "0 4", "2")}</Piece>"""
    head = '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>'
    path = tmp_path / "a.vtp"
    path.write_text(head + piece * 2 + "</PolyData></VTKFile>")
    found = sg.load_mesh(path, radius=0.5)
    assert len(found) == 2 * (2 + 1 + 2 + 16)
    assert found.faces.max() == len(found.vertices) - 1 and len(found.vertices) == 2 * (5 + 16)
    assert np.isclose(np.ptp(found.vertices[10:26, :2], axis=0), 1.0).all()
    path.write_text(head + piece.replace("0 1 2 3 0 1 4", "0 1 2 3 0 1 9") + "</PolyData></VTKFile>")
    with pytest.raises(InputError, match=r"a\.vtp: Polys: expected numbers of 5 points, got 0 to 9"):
        sg.load_mesh(path)


def test_legacy_vtk_files(tmp_path: Path) -> None:
    """The same triangles as in XML."""
    vtk = pytest.importorskip("vtk")
    source = vtk.vtkCubeSource()
    source.Update()
    meshes = []
    for name, writer in (("a.vtk", vtk.vtkPolyDataWriter()), ("a.vtp", vtk.vtkXMLPolyDataWriter())):
        writer.SetFileName(str(tmp_path / name))
        writer.SetInputData(source.GetOutput())
        writer.Write()
        meshes.append(sg.load_mesh(tmp_path / name))
    assert len(meshes[0]) == 12
    np.testing.assert_array_equal(meshes[0].vertices, meshes[1].vertices)
    np.testing.assert_array_equal(meshes[0].faces, meshes[1].faces)
    with pytest.raises(InputError, match="a surface: --mesh"):
        sg.load(tmp_path / "a.vtk")


def test_points_of_files(tmp_path: Path) -> None:
    """A PLY without faces has a ball at each point, in its colour."""
    trimesh = pytest.importorskip("trimesh")
    points = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 5.0]])
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [9, 8, 7, 255]], np.uint8)
    trimesh.PointCloud(points, colors=colors).export(tmp_path / "a.ply")
    found = sg.load_mesh(tmp_path / "a.ply", radius=0.5)
    assert len(found) == 3 * 320 and found.colors is not None
    for n, (point, color) in enumerate(zip(points, colors, strict=True)):
        some = slice(n * 162, (n + 1) * 162)
        assert np.abs(np.linalg.norm(found.vertices[some] - point, axis=1) - 0.5).max() < 1e-6
        assert (found.colors[some] == color[:3]).all()
    assert 0 < np.ptp(sg.load_mesh(tmp_path / "a.ply").vertices[:162, 0]) < 0.5


def test_meshes_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A source that is a mesh is drawn, lit, in a view that is fitted to it; its depths too."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box((40.0, 20.0, 10.0)).apply_translation((5, 6, 7))
    box.export(tmp_path / "a.stl")
    out, depth = tmp_path / "o.npy", tmp_path / "d.npy"
    options = ["-o", str(out), "--size", "60x40", "--quiet", "--orthographic", "--azimuth", "0", "--elevation", "0"]
    assert main(["render", str(tmp_path / "a.stl"), *options, "--height", "16", "--depth", str(depth)]) == 0
    picture, far = np.load(out), np.load(depth)
    shown = far[20, 30] == far
    # 24 × 16 world units, of which the box takes all and 10
    assert shown[8:32].all() and not np.isfinite(far[:7]).any()
    view: Any = {"size": (60, 40), "orthographic": True, "height": 16.0, "azimuth": 0.0, "elevation": 0.0}
    alone = sg.render(tmp_path / "a.stl", **view, background="transparent")
    assert alone.pixels[20, 30, 3] == pytest.approx(1) and not alone.pixels[:7].any()
    assert np.ptp(picture[10:30, 5:55], axis=(0, 1)).max() < 1e-5
    assert (
        main(["animate", str(tmp_path / "a.stl"), "-o", str(tmp_path / "o.gif"), "--frames", "2", "--size", "16"]) == 0
    )
    for command in (["info"], ["render", "--workers", "1"]):
        assert main([command[0], str(tmp_path / "a.stl"), *command[1:]]) == 2
        assert "mesh" in capsys.readouterr().err
    (tmp_path / "b.stl").write_bytes(b"solid")
    assert main(["render", str(tmp_path / "b.stl"), *options]) == 2
    told = capsys.readouterr().err
    assert "b.stl" in told and told.count("\n") == 1


@pytest.mark.parametrize(
    "options",
    ["--scissors=0,0 1,0 1,1", "--preset=ct-bone", "--iso=3", "--clip=x>0.5", "--crop=1:,:,:", "--only-labels=3"],
)
def test_options_of_volumes_do_nothing_to_meshes(
    options: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Refused in a line: presets drew the box that stands in for a volume, others changed nothing."""
    trimesh = pytest.importorskip("trimesh")
    source, out = str(tmp_path / "a.stl"), str(tmp_path / "o.npy")
    trimesh.creation.box((4.0, 2.0, 1.0)).export(source)
    assert main(["render", source, "-o", out, "--size", "8", options]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"splatgl: {options.partition('=')[0]}: expected a volume") and told.count("\n") == 1
    scene = tmp_path / "s.toml"
    scene.write_text('volume = "a.stl"\n[transfer]\npoints = [[0, 1.0]]\n')
    pictures = [sg.render(x, size=8, azimuth=0, background="black").pixels for x in (source, scene)]
    assert np.array_equal(*pictures)
    scene.write_text('volume = "a.stl"\nscissors = ["0,0 1,0 1,1"]\n')
    with pytest.raises(InputError, match="scissors: expected a volume"):
        sg.render(scene, size=8)


def test_tracks(tmp_path: Path) -> None:
    nibabel = pytest.importorskip("nibabel")
    lines = [np.array([[0, 0, 0], [10, 0, 0]], np.float32), np.array([[0, 5, 0], [0, 5, 10], [5, 5, 10]], np.float32)]
    tracks = nibabel.streamlines.Tractogram(lines, affine_to_rasmm=np.eye(4))
    nibabel.streamlines.save(tracks, str(tmp_path / "a.tck"))
    found = sg.load_mesh(tmp_path / "a.tck", radius=0.5)
    assert found.frame == "RAS" and len(found) == 16 * 3
    assert np.allclose(found.vertices[:8].mean(axis=0), 0) and np.isclose(np.ptp(found.vertices[:8, 1]), 1.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.ply", b"ply\nformat", "header: expected a PLY header with a format"),
        ("a.stl", b"\0" * 90, "a mesh|at least one triangle"),
        ("a.obj", b"hello", "a mesh|at least one triangle"),
        ("a.vtp", b"<VTKFile type='ImageData'></VTKFile>", "type: expected a VTKFile of PolyData"),
        ("a.vtp", b"", "cannot be read as a mesh"),
        ("a.xyz", b"1 2 3", "expected a mesh: .glb, .obj, .off"),
        ("a.tck", b"mrtrix", "tracks"),
    ],
)
def test_damaged_files(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as told:
        sg.load_mesh(path)
    assert "\n" not in str(told.value) and name in str(told.value)
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(InputError, match="got a folder"):
        sg.load_mesh(tmp_path / "folder.ply")


def test_options_of_meshes() -> None:
    assert MeshFile.read("a.ply") == MeshFile("a.ply")
    assert MeshFile.read("b/a.ply:red:0.5") == MeshFile("b/a.ply", "red", 0.5)
    assert MeshFile.read("a.ply:#00ff00") == MeshFile("a.ply", "#00ff00")
    assert MeshFile.read("a.ply:0.25") == MeshFile("a.ply", "", 0.25)


def test_commands_draw_meshes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--mesh`, a scene file's [[mesh]], and `sg.render` draw the same picture."""
    trimesh = pytest.importorskip("trimesh")
    vertices, faces = tetrahedron()
    trimesh.Trimesh(vertices * 3, faces, process=False).export(tmp_path / "a.ply")
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((16, 16, 16)).astype(np.float32))
    options = ["--size", "40", "--quiet", "--check", "0", "--points", "0.5:0,0.9:0.1"]
    out, source = tmp_path / "o.npy", str(tmp_path / "a.npy")
    assert main(["render", source, "-o", str(out), "--mesh", f"{tmp_path / 'a.ply'}:tomato:0.5", *options]) == 0
    first = np.load(out)
    scene = SceneFile(source, meshes=(MeshFile(str(tmp_path / "a.ply"), "tomato", 0.5),))
    (tmp_path / "s.toml").write_text(scene.to_toml(tmp_path))
    assert 'file = "a.ply"' in (tmp_path / "s.toml").read_text()
    assert main(["render", str(tmp_path / "s.toml"), "-o", str(out), *options]) == 0
    assert (np.load(out) == first).all()
    mesh = sg.load_mesh(tmp_path / "a.ply", color="#ff6347", opacity=0.5)
    same = sg.render(source, size=40, points=((0.5, 0), (0.9, 0.1)), meshes=[mesh])
    assert (same.pixels == first).all()
    assert main(["render", source, "-o", str(out), "--mesh", f"{tmp_path / 'a.ply'}:nocolour", *options]) == 2
    assert "expected a colour such as" in capsys.readouterr().err
    (tmp_path / "s.toml").write_text('volume = "a.npy"\n[[mesh]]\ncolor = "red"\n')
    assert main(["render", str(tmp_path / "s.toml"), "-o", str(out)]) == 2
    assert "[[mesh]] 1: expected the key file" in capsys.readouterr().err

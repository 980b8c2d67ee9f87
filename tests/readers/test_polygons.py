"""Polygons of OBJ, OFF, PLY and GLB: indices, objects, colours of vertices, faces, materials; damage."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import splatgl as sg
from splatgl.data.mesh import Mesh
from splatgl.errors import InputError

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
RAISED = "v 0 0 5\nv 1 0 5\nv 0 1 5\n"


def put(path: Path, content: str | bytes) -> Mesh:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return sg.load_mesh(path)


def triangles(mesh: Mesh) -> np.ndarray:
    """Corners [N, 3, 3] of all triangles, in an order of their own."""
    corners = mesh.vertices[mesh.faces]
    return corners[np.lexsort(corners.mean(axis=1).T.round(6))]


def seen(mesh: Mesh) -> set[tuple[int, ...]]:
    """The colours of all corners."""
    assert mesh.colors is not None
    return {tuple(color) for color in mesh.colors[mesh.faces].reshape(-1, 3).tolist()}


@pytest.mark.parametrize("names", [("", ""), ("o a\n", "o b\n"), ("g a\n", "g b\n")])
@pytest.mark.parametrize("relative", [False, True])
def test_faces_of_several_objects(tmp_path: Path, names: tuple[str, str], relative: bool) -> None:
    """Numbers count all vertices of a file from 1, or back from the last one so far."""
    first, second = ("f -4 -3 -2 -1\n", "f -3/1 -2/1 -1/1\n") if relative else ("f 1 2 3 4\n", "f 5 6 7\n")
    mesh = put(tmp_path / "a.obj", f"{names[0]}{QUAD}{first}{names[1]}{RAISED}vt 0 0\n{second}")
    assert len(mesh) == 3 and np.allclose(sorted(np.ptp(triangles(mesh)[..., 2], axis=1)), 0)
    assert set(triangles(mesh)[..., 2].ravel()) == {0.0, 5.0} and triangles(mesh)[..., 2].sum() == 15


def test_lines_and_joined_lines(tmp_path: Path) -> None:
    assert len(put(tmp_path / "a.obj", QUAD + "f 1 2 \\\n3 4 # all\n\n")) == 2
    tubes = put(tmp_path / "b.obj", QUAD + "l 1 2 3\n")
    assert len(tubes) == 32


@pytest.mark.parametrize("reference", ["f 1 2 9", "f 0 1 2", "f -9 1 2", "f 1/7 2/7 3/7", "l 1 12"])
def test_corners_that_are_no_vertices(tmp_path: Path, reference: str) -> None:
    (tmp_path / "a.mtl").write_text("newmtl a\nKd 1 0 0\n")
    with pytest.raises(InputError, match=r"a\.obj: faces: expected .* got"):
        put(tmp_path / "a.obj", f"mtllib a.mtl\nusemtl a\nvt 0 0\n{QUAD}{reference}\n")
    with pytest.raises(InputError, match="faces: expected corners among 3 vertices, got 0 to 7"):
        put(tmp_path / "a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")


def test_materials_of_obj(tmp_path: Path) -> None:
    """Faces have the colour of their material, or of its picture at their corners; a missing library is none."""
    Image.fromarray(np.uint8([[RED, GREEN], [BLUE, (255, 255, 255)]])).save(tmp_path / "p.png")
    (tmp_path / "größe.mtl").write_text(
        "newmtl red one\nKd 1 0 0\nd 1\nnewmtl p\nKd 1 1 1\nmap_Kd p.png\n", encoding="latin-1"
    )
    head = "mtllib größe.mtl\nusemtl red one\n".encode("latin-1")
    two = put(tmp_path / "a.obj", head + f"{QUAD}f 1 2 3 4\nusemtl none\n{RAISED}f 5 6 7\n".encode())
    assert seen(two) == {RED, (200, 200, 200)}
    places = "vt .25 .75\nvt .75 .75\nvt .75 .25\nvt .25 1.25\n"
    picture = put(tmp_path / "b.obj", head + f"usemtl p\n{QUAD}{places}f 1/1 2/2 3/3 4/4\n".encode())
    assert seen(picture) == {RED, GREEN, (255, 255, 255), BLUE}
    (tmp_path / "b.mtl").write_text("newmtl blue\nKd 0 0 1\n")
    several = put(tmp_path / "e.obj", f"mtllib gone.mtl b.mtl\nusemtl blue\n{QUAD}f 1 2 3\n")
    assert seen(several) == {BLUE}
    assert put(tmp_path / "c.obj", f"mtllib gone.mtl\nusemtl a\n{QUAD}f 1 2 3\n").colors is None
    assert seen(put(tmp_path / "d.obj", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\n")) == {RED, GREEN, BLUE}


@pytest.mark.parametrize(
    ("head", "points", "faces", "colors"),
    [
        ("OFF", ["", "", "", ""], ["3 0 1 2 255 0 0", "3 0 2 3 0 0 255"], {RED, BLUE}),
        ("OFF", ["", "", "", ""], ["3 0 1 2 1.0 0 0", "3 0 2 3 0 0 1.0 1.0"], {RED, BLUE}),
        ("OFF", ["", "", "", ""], ["4 0 1 2 3 0 255 0 255"], {GREEN}),
        ("COFF", [" 255 0 0 255", " 0 255 0 255", " 0 0 255 255", " 0 0 255 255"], ["4 0 1 2 3"], {RED, GREEN, BLUE}),
        ("COFF", [" 1. 0 0 1", " 0 1. 0 1", " 0 0 1 1", " 0 0 1 1"], ["4 0 1 2 3"], {RED, GREEN, BLUE}),
        ("CNOFF", [" 0 0 1 255 0 0"] * 4, ["4 0 1 2 3"], {RED}),
        ("NOFF", [" 0 0 1"] * 4, ["4 0 1 2 3"], None),
        ("OFF # one line", ["", "", "", ""], ["4 0 1 2 3"], None),
    ],
)  # fmt: skip
def test_colours_of_off(
    tmp_path: Path, head: str, points: list[str], faces: list[str], colors: set[tuple[int, ...]] | None
) -> None:
    rows = [f"{x} {y} {z}{more}" for (x, y, z), more in zip(CORNERS, points, strict=True)]
    mesh = put(tmp_path / "a.off", "\n".join([head, "", f"4 {len(faces)} 0", *rows, *faces, ""]))
    assert len(mesh) == 2 and triangles(mesh)[..., 2].max() == 0
    assert (mesh.colors is None) if colors is None else seen(mesh) == colors


def write_ply(path: Path, form: str, faces: list[list[int]], colors: list[tuple[int, int, int]]) -> Path:
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form)
    names = "property uchar red\nproperty uchar green\nproperty uchar blue\n" * bool(colors)
    head = f"ply\nformat {form} 1.0\nelement vertex 5\nproperty float x\nproperty double y\nproperty float z\n"
    head += (
        f"element face {len(faces)}\nproperty int flags\nproperty list uchar int vertex_indices\n{names}end_header\n"
    )
    points, rgb = [*CORNERS, (0, 0, 7)], [tuple(color) for color in colors] or [()] * len(faces)
    if order is None:
        rows = [" ".join(map(str, point)) for point in points]
        rows += [" ".join(map(str, [1, len(face), *face, *color])) for face, color in zip(faces, rgb, strict=True)]
        path.write_text(head + "\n".join(rows) + "\n")
        return path
    data = b"".join(struct.pack(f"{order}fdf", *point) for point in points)
    for face, color in zip(faces, rgb, strict=True):
        data += struct.pack(f"{order}iB{len(face)}i{len(color)}B", 1, len(face), *face, *color)
    path.write_bytes(head.encode() + data)
    return path


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    "faces", [[[0, 1, 2, 3]], [[0, 1, 2, 3], [0, 2, 4]], [[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3, 4], [0, 1, 4]]]
)
def test_ply_of_polygons_with_colours(tmp_path: Path, form: str, faces: list[list[int]]) -> None:
    """Faces of any number of corners, each in its colour, or without one."""
    colors = [RED, BLUE][: len(faces)]
    mesh = sg.load_mesh(write_ply(tmp_path / "a.ply", form, faces, colors))
    assert len(mesh) == sum(len(face) - 2 for face in faces) and seen(mesh) == set(colors)
    assert mesh.colors is not None
    plain = sg.load_mesh(write_ply(tmp_path / "b.ply", form, faces, []))
    assert plain.colors is None and np.allclose(triangles(plain), triangles(mesh))
    red = [
        triangle
        for triangle, color in zip(mesh.faces, mesh.colors[mesh.faces[:, 0]], strict=True)
        if tuple(color) == RED
    ]
    assert len(red) == len(faces[0]) - 2
    with pytest.raises(InputError, match="faces: expected corners among 5 vertices"):
        sg.load_mesh(write_ply(tmp_path / "c.ply", form, [*faces, [0, 1, 5]], []))
    data = (tmp_path / "a.ply").read_bytes()
    (tmp_path / "d.ply").write_bytes(data[: -len(data) // 16])
    with pytest.raises(InputError, match="cut short"):
        sg.load_mesh(tmp_path / "d.ply")


@pytest.mark.parametrize("ending", ["ply", "obj", "off", "stl", "glb"])
def test_meshes_are_those_of_trimesh(ending: str, tmp_path: Path) -> None:
    """Places of a turned box and ball, and colours of vertices where the format has them."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.util.concatenate(
        [trimesh.creation.icosphere(2), trimesh.creation.box((1, 2, 3)).apply_translation((4, 0, 0))]
    )
    mesh.apply_transform(trimesh.transformations.rotation_matrix(1.0, (0.1, 0.5, 0.9)))
    mesh.visual.vertex_colors = np.random.default_rng(2).integers(0, 256, (len(mesh.vertices), 4), np.uint8)
    mesh.export(tmp_path / f"a.{ending}")
    found = sg.load_mesh(tmp_path / f"a.{ending}")
    right = mesh.triangles[np.lexsort(mesh.triangles_center.T.round(6))]
    assert np.abs(np.sort(triangles(found), axis=1) - np.sort(right, axis=1)).max() < 1e-5
    if ending not in ("off", "stl"):
        near = [int(np.linalg.norm(mesh.vertices - vertex, axis=1).argmin()) for vertex in found.vertices]
        assert found.colors is not None
        assert np.abs(found.colors.astype(int) - mesh.visual.vertex_colors[near, :3]).max() <= 1


def test_parts_and_materials_of_glb(tmp_path: Path) -> None:
    """Each part lies where its node does, in the colour of its material, its picture or its vertices."""
    trimesh = pytest.importorskip("trimesh")
    visual, box = trimesh.visual, trimesh.creation.box

    def part(**material: Any) -> Any:
        mesh = box()
        places = np.zeros((len(mesh.vertices), 2))
        mesh.visual = visual.TextureVisuals(uv=places, material=visual.material.PBRMaterial(**material))
        return mesh

    green = box()
    green.visual.vertex_colors = (*GREEN, 255)
    picture = Image.new("RGB", (2, 2), BLUE)
    scene = trimesh.Scene()
    for n, mesh in enumerate((part(baseColorFactor=[255, 0, 0, 255]), part(baseColorTexture=picture), green, box())):
        scene.add_geometry(mesh, transform=trimesh.transformations.translation_matrix((3 * n, 0, 0)))
    (tmp_path / "a.glb").write_bytes(scene.export(file_type="glb"))
    found = sg.load_mesh(tmp_path / "a.glb")
    assert len(found) == 48 and found.colors is not None
    for n, color in enumerate((RED, BLUE, GREEN, (200, 200, 200))):
        near = np.abs(found.vertices[:, 0] - 3 * n) < 1
        assert (found.colors[near] == color).all()

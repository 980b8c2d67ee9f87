"""Iso-surfaces of a volume as meshes and mesh files: marching cubes, slab by slab. Extra `surface`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.mesh import Mesh
from splatgl.data.volume import Slab, Volume
from splatgl.errors import expected, import_extra
from splatgl.fileio import write_file
from splatgl.transfer.colormaps import colormap, interpolate_map

EXTRA = "surface"
# formats: endings of files, and the text that readers find the frame in
SAVED = (".stl", ".ply", ".obj", ".glb")
# voxels of a slab
SLAB = 1 << 23
# bytes of the text with which a binary STL begins
HEADER = 80


def iso_mesh(
    volume: Volume, value: float, progress: Callable[[int, int], None] = lambda done, total: None, slab: int = SLAB
) -> Mesh:
    """The surface where samples, linear between voxels, pass a value: world units, in the volume's frame; triangles are
    counter-clockwise seen from below the value. It is open at the volume's ends, and beside missing or masked voxels.

    progress: gets the numbers of slabs done and of all. slab: voxels that are read at a time. Raises InputError for
    labels, points, and a value that no sample passes.
    """
    measure = import_extra("skimage.measure", "surfaces", "scikit-image", EXTRA)
    if volume.labels is not None or volume.points is not None:
        got = "points" if volume.points is not None else "labels"
        raise expected(f"surface of {volume.name or 'a volume'}", "amounts", got, "--values amounts reads numbers so")
    depth, height, width = volume.shape
    if min(volume.shape) < 2:
        size = "×".join(map(str, volume.shape[::-1]))
        raise expected(f"surface of {volume.name or 'a volume'}", "at least two voxels along each axis", size)
    planes = max(slab // (height * width), 1)
    vertices, faces, count, total = [np.zeros((0, 3))], [np.zeros((0, 3), np.int64)], 0, -(-depth // planes)
    for number, part in enumerate(volume.slabs(planes, halo=1), 1):
        places, triangles = _march(measure, volume, part, value)
        vertices.append(places)
        faces.append(triangles + count)
        count += len(places)
        progress(number, total)
    if not count:
        raise expected(f"{volume.name or 'volume'}: iso", "a value that its samples pass", f"{value:g}")
    # slabs share a plane of samples
    places, names = np.unique(np.concatenate(vertices), axis=0, return_inverse=True)
    triangles = names.reshape(-1)[np.concatenate(faces)]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    if np.linalg.det(volume.world_from_index) < 0:
        triangles = triangles[:, ::-1]
    world = places @ volume.world_from_index.T + volume.origin
    return Mesh(world, triangles[distinct], name=volume.name, frame=volume.frame, unit=volume.unit)


def _march(measure: Any, volume: Volume, part: Slab, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [N, 3] (x, y, z), grid indices, and faces [M, 3] between a slab's planes and the one behind it."""
    first = part.start
    samples = np.asarray(part.samples[part.before :], np.float32)
    known = np.isfinite(samples)
    if volume.masks:
        known &= volume.kept((first, 0, 0), (first + len(samples), *volume.shape[1:]))
    nothing = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    inside = samples[known]
    if min(samples.shape) < 2 or not inside.size or not inside.min() <= value < inside.max():
        return nothing
    mask = None if known.all() else known
    samples = np.where(known, samples, np.float32(value))
    try:
        places, triangles, _, _ = measure.marching_cubes(samples, value, mask=mask)
    except RuntimeError:
        # scikit-image's way to say that there are no triangles
        return nothing
    places = places + np.array([first, 0.0, 0.0])
    return places[:, ::-1], np.asarray(triangles, np.int64)


def save_meshes(meshes: Sequence[Mesh], path: Path) -> None:
    """Writes surfaces in their colours and opacities as a .glb file, in their unit and axes. Raises InputError if it
    cannot be written.
    """
    trimesh = import_extra("trimesh", "surfaces", "trimesh", EXTRA)
    scene = trimesh.Scene()
    for number, mesh in enumerate(meshes):
        # glTF's colours of vertices are linear; corners of a vertex have the same colour
        rgba = np.ones((len(mesh.vertices), 4))
        rgba[mesh.faces.reshape(-1), :3] = _light_of(mesh).reshape(-1, 3)
        rgba[:, 3] = mesh.opacity
        colors = np.rint(np.clip(rgba, 0, 1) * 255).astype(np.uint8)
        part = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colors, process=False)
        scene.add_geometry(part, geom_name=f"{number} {mesh.name}".strip())
    write_file(path, bytes(scene.export(file_type="glb")))


def _light_of(mesh: Mesh) -> np.ndarray:
    """Linear RGB [M, 3, 3] of the corners of triangles, also of values in a colour map."""
    if not mesh.mapped or mesh.values is None:
        return mesh.shades
    low, high = mesh.ranged
    found = interpolate_map(colormap(mesh.colormap), np.clip((mesh.values - low) / (high - low), 0, 1))
    plain = np.isnan(mesh.values)[:, None]
    return np.where(plain, np.asarray(mesh.color, np.float64), np.nan_to_num(found))[mesh.faces]


def save_mesh(mesh: Mesh, path: Path) -> None:
    """Writes an .stl, .ply, .obj or .glb file, whole or not at all; unit and frame are in its header, where 3D Slicer
    states the frame. Vertices stay in the mesh's unit and axes, also in .glb.
    """
    trimesh = import_extra("trimesh", "surfaces", "trimesh", EXTRA)
    words = [f"SPACE={mesh.frame}"] * bool(mesh.frame) + [f"UNIT={mesh.unit}"] * bool(mesh.unit)
    note, kind = " ".join(["splatgl", *words]), path.suffix.lower()
    signed = {"tree_postprocessor": lambda tree: tree["asset"].update(generator=note)} if kind == ".glb" else {}
    data = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(file_type=kind[1:], **signed)
    data = data.encode() if isinstance(data, str) else bytes(data)
    if kind == ".stl":
        data = note.encode("ascii", "replace")[:HEADER].ljust(HEADER) + data[HEADER:]
    elif kind == ".ply":
        head, _, rest = data.partition(b"element vertex")
        data = head + f"comment {note}\n".encode() + b"element vertex" + rest
    elif kind == ".obj":
        data = f"# {note}\n".encode() + data
    write_file(path, data)

"""The right picture: splats drawn in float64, by exact line integrals instead of textured quads.

It honours blend, kernel, antialias, attenuation, shading, order and background, and leaves out what only
approximates: align, footprint, target, tolerance. Slow and exact: it is what pictures are judged by.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from splatgl.data.image import Image
from splatgl.gl.uniforms import AMBIENT, DIFFUSE
from splatgl.splat.affine import View
from splatgl.splat.ahead import ahead
from splatgl.splat.camera import Camera
from splatgl.splat.fill import filled_depth
from splatgl.splat.order import back_to_front, order_for
from splatgl.splat.plan import Plan, plan
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings
from splatgl.splat.tabulated import tabulated
from splatgl.truth.blend import ADD, Band, Part, pixels
from splatgl.truth.extent import Boxes, pixel_boxes
from splatgl.truth.pairs import Row, Values, values

# samples of the picture worked on at once: their numbers fit into 16 bits, which sort fast
BAND = 1 << 16

Progress = Callable[[Iterator[tuple[int, int]], int], Iterator[tuple[int, int]]]


def render(
    splats: Splats,
    camera: Camera,
    settings: Settings | None = None,
    row: str = "row1",
    progress: Progress | None = None,
) -> Image:
    """The same picture as `Renderer.render`, float64 [H, W, 4], linear premultiplied, row 0 on top.

    row: "row1" (correct) or another of Table 1, "row2" … "row5", with its error; row4 is what `align="ray"`
    draws, row5 `align="grid"`; on voxels that are not cubes there are rows 1, 4 and 5. progress wraps the
    iteration over bands of the picture (bands, how many). Raises InputError for a row that there is not.
    [M98 Table 1]
    """
    started = time.perf_counter()
    settings = settings or Settings()
    splats = ahead(splats, camera)
    chosen = plan(splats, camera, settings.but(align="ray", primitive="auto"))
    fine = camera.resized((camera.size[0] * chosen.samples, camera.size[1] * chosen.samples))
    scene = _Scene(splats, fine, chosen, row)

    # band after band; every sample of a pixel is in the same one
    height = max(1, BAND // fine.size[0] // chosen.samples) * chosen.samples
    bands = [(top, min(top + height, fine.size[1])) for top in range(0, fine.size[1], height)]
    drawn = [scene.band(band) for band in (progress(iter(bands), len(bands)) if progress else bands)]
    picture = _resolve(np.concatenate(drawn), camera.size, chosen)
    return Image(picture, _provenance(splats, camera, chosen, row, time.perf_counter() - started))


class _Scene:
    """What every band needs, made once: places, boxes, order and colours of all splats."""

    def __init__(self, splats: Splats, camera: Camera, chosen: Plan, row: str) -> None:
        program = chosen.program
        self.camera, self.plan = camera, chosen
        view = View.of(splats.grid, camera, tabulated(chosen.kernel.name), program.antialias, chosen.beyond)
        voxel = view.voxels(splats.records["position"])
        self.row = Row.of(view, row, voxel, splats.grid)
        self.boxes: Boxes = pixel_boxes(view, self.row.name, voxel, camera)
        self.order = np.arange(len(splats))
        if len(splats) and program.blend == "composite":
            self.order = back_to_front(splats, order_for(splats, camera))[::-1]
        self.color = splats.records["color"].astype(np.float64)
        if program.shading:
            self.color *= head_light(splats, camera, voxel)[:, None]
        depth = splats.records["optical_depth"].astype(np.float64)
        # mip shows opacity over the transfer function's reference length
        self.depth = -np.expm1(-depth * splats.unit / splats.grid.mean_spacing) if program.blend == "mip" else depth
        self.coverage = self.row.coverage() if program.attenuation == "opacity" else np.ones(len(splats))
        if program.attenuation == "fill":
            self.depth = filled(splats, view, voxel, self.row.coverage())

    def band(self, band: tuple[int, int]) -> np.ndarray:
        """float64 [rows, width, 4]."""
        width = self.camera.size[0]
        gathered = Band.empty((band[1] - band[0]) * width)
        for found in values(self.row, self.boxes, self.order, band, self.camera):
            if len(found.splat):
                ADD[self.plan.program.blend](gathered, self._part(found))
        return pixels(gathered, self.plan.program.blend).reshape(-1, width, 4)

    def _part(self, found: Values) -> Part:
        value = found.integral.value
        if self.plan.program.blend == "mip":
            value = value / found.integral.peak
        splat = found.splat
        return Part(found.pixel, self.depth[splat] * value, self.color[splat], self.coverage[splat])


def filled(splats: Splats, view: View, voxel: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    """Optical depth [N] of voxels [3, N], attenuated by how much of their pixel their matter fills."""
    ray = voxel if view.perspective else np.array([[0.0], [0.0], [1.0]])
    length = np.sqrt((ray * ray).sum(axis=0))
    along = np.linalg.inv(view.eye_from_index) @ (ray / np.where(length > 0, length, 1.0))
    widths = np.linalg.norm(view.eye_from_index, axis=0)
    depth = splats.records["optical_depth"].astype(np.float64)
    pixel = np.where(view.widened(voxel[2])[1], view.pixel(voxel[2]), 0.0)
    return filled_depth(depth, along, widths, pixel, coverage, splats.runs)


def head_light(splats: Splats, camera: Camera, voxel: np.ndarray) -> np.ndarray:
    """[N]: 0.3 + 0.7 |n·l|, l from the voxels [3, N] (eye axes) towards the eye; 1 where there is no gradient."""
    normal = camera.eye_from_world @ splats.records["normal"].astype(np.float64).T
    towards = voxel if camera.perspective else np.array([[0.0], [0.0], [1.0]])
    lengths = [np.sqrt((each * each).sum(axis=0)) for each in (normal, towards)]
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = np.abs((normal * towards).sum(axis=0)) / lengths[0] / lengths[1]
        # at the eye itself any direction is towards it; the view's is taken
        cosine = np.where(lengths[1] > 0, cosine, np.abs(normal[2]) / lengths[0])
    return np.where(lengths[0] > 0, AMBIENT + DIFFUSE * np.minimum(cosine, 1.0), 1.0)


def _resolve(samples: np.ndarray, size: tuple[int, int], chosen: Plan) -> np.ndarray:
    """The mean of each pixel's samples, over the background."""
    n = chosen.samples
    mean = samples.reshape(size[1], n, size[0], n, 4).mean(axis=(1, 3))
    if chosen.background is None or chosen.program.blend == "xray":
        return np.asarray(mean)
    return np.asarray(mean + (1 - mean[..., 3:]) * np.array([*chosen.background, 1.0]))


def _provenance(splats: Splats, camera: Camera, chosen: Plan, row: str, seconds: float) -> dict[str, object]:
    program = chosen.program
    return {
        "scene": splats.name,
        "splats": len(splats),
        "size": list(camera.size),
        "projection": "perspective" if camera.perspective else "orthographic",
        "eye": [float(x) for x in camera.eye],
        "forward": [float(x) for x in camera.forward],
        "blend": program.blend,
        "kernel": chosen.kernel.name,
        "row": row,
        "antialias": program.antialias,
        "samples": chosen.samples,
        "attenuation": program.attenuation,
        "shading": program.shading,
        "background": None if chosen.background is None else list(chosen.background),
        "renderer": "float64 reference",
        "seconds": round(seconds, 6),
    }

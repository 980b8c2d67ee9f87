"""Error of each attenuation form against supersampling: RMSE by scene and by voxels a pixel (m).

    .venv/bin/python scripts/benchmarks/attenuation.py [--data FOLDER] [--csv FILE] [--picture FILE.png]

The reference is the image supersampled until no splat lies beyond z_k, averaged in linear premultiplied
light. Real volumes are used if FOLDER (or the environment's SPLATGL_DATA) contains them.
"""

from __future__ import annotations

import argparse
import csv
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import splatgl as sg
from splatgl.data.scenes import SCENES
from splatgl.scene.view import ViewOptions

# voxels classified before, splats one by one
SPLATS = sg.Settings.like("0.1")
FORMS = ("opacity", "optical-depth", "fill")
STRETCHES = (1.0, 1.1, 2.0, 4.0, 8.0, 16.0)
# width of the synthetic volumes across the view, voxels
WIDTH = 192
# larger images are drawn at PICTURE pixels; supersampled ones not at all beyond LARGEST
PICTURE, LARGEST = 400, 16000
REAL = {"CT stent": ("stent_ct_128x128x256.nrrd", None), "CT head": ("visible_male_128x256x256_uint8.raw", "ct-bone")}


@dataclass(frozen=True)
class Row:
    """RMSE of each form against supersampling, at one scale of one scene."""

    scene: str
    stretch: float
    size: int
    samples: int
    rmse: tuple[float, ...]

    def __str__(self) -> str:
        best = min(self.rmse)
        errors = "  ".join(f"{error:.4f}{'*' if error <= best * 1.01 else ' '}" for error in self.rmse)
        return f"{self.scene:12} {self.stretch:5.1f} {self.size:5} {self.samples:4}    {errors}"


def matter(cells: np.ndarray, opacity: float) -> sg.Splats:
    """White splats of the set cells, all of one opacity."""
    transfer = sg.Transfer([(0.5, 0), (0.5, opacity)], shading=False, unit=1.0, colormap="white")
    return sg.extract(sg.Volume(cells.astype(np.uint8)), transfer, classification="pre")


def wall(opacity: float) -> sg.Splats:
    return matter(np.ones((1, WIDTH, WIDTH)), opacity)


def thick_edge() -> sg.Splats:
    """40 layers of opacity 0.99 that end half way across."""
    cells = np.zeros((40, WIDTH, WIDTH))
    cells[:, :, : WIDTH // 2 + 1] = 1
    return matter(cells, 0.99)


def dots() -> sg.Splats:
    return matter(np.random.default_rng(5).random((48, WIDTH, WIDTH)) < 0.002, 0.99)


def threads() -> sg.Splats:
    rng = np.random.default_rng(5)
    cells = np.zeros((64, WIDTH, WIDTH))
    for _ in range(60):
        start, step = rng.uniform(0, cells.shape), rng.normal(size=3) * [0.3, 1, 1]
        line = start + np.arange(-150, 150, 0.5)[:, None] * step / np.linalg.norm(step)
        inside = np.rint(line[((line > 0) & (line < np.array(cells.shape) - 1)).all(axis=1)]).astype(int)
        cells[tuple(inside.T)] = 1
    return matter(cells, 0.9)


SYNTHETIC: dict[str, Callable[[], sg.Splats]] = {
    "wall 0.99": lambda: wall(0.99),
    "wall 0.5": lambda: wall(0.5),
    "wall 0.1": lambda: wall(0.1),
    "thick edge": thick_edge,
    "dots": dots,
    "threads": threads,
    "fog": lambda: matter(np.ones((48, WIDTH, WIDTH)), 0.02),
}


def scenes(data: Path | None) -> Iterator[tuple[str, sg.Splats, sg.Camera]]:
    for name, make in SYNTHETIC.items():
        splats = make()
        middle = splats.corners.mean(axis=0)
        # slightly oblique, so that no row of voxels aligns with pixels
        yield name, splats, sg.Camera.look_at(middle + np.array([30.0, -60, -400]), middle, (0, -1, 0), fov=26)
    for name in ("tunnel", "terrain", "nerve"):
        yield name, *seen(SCENES[name](), None)
    for name, (file, preset) in REAL.items():
        if data is not None and (data / file).exists():
            yield name, *seen(sg.load(data / file), preset)


def seen(volume: sg.Volume, preset: str | None) -> tuple[sg.Splats, sg.Camera]:
    transfer = sg.preset(preset, volume) if preset else sg.default_transfer(volume)
    splats = sg.extract(volume, transfer, classification="pre")
    return splats, ViewOptions().camera(volume, splats)


def at_stretch(splats: sg.Splats, camera: sg.Camera, stretch: float) -> sg.Camera:
    """The camera with a resolution at which a voxel at the middle is 1/stretch pixels wide."""
    depth = camera.eye_from_points(splats.corners)[:, 2]
    middle = float(depth.mean()) if depth.min() > 0 else 0.7 * float(depth.max())
    size = round(camera.extent * middle / (stretch * splats.grid.mean_spacing))
    return camera.resized((min(max(size, 4), PICTURE),) * 2)


def samples_for(splats: sg.Splats, camera: sg.Camera) -> int:
    """Samples per axis that bring every splat before z_k."""
    farthest = camera.eye_from_points(splats.corners)[:, 2].max()
    narrowest = float(np.linalg.svd(splats.grid.world_from_index, compute_uv=False)[-1])
    return max(1, math.ceil(float(camera.pixel_pitch(farthest)) / narrowest))


def measure(renderer: sg.Renderer, data: Path | None) -> Iterator[Row]:
    for name, splats, base in scenes(data):
        for stretch in STRETCHES:
            camera = at_stretch(splats, base, stretch)
            samples = samples_for(splats, camera)
            if samples > 64 or samples * camera.size[0] > LARGEST:
                continue
            truth = SPLATS.replace(antialias="supersample", samples=samples)
            right = renderer.render(splats, camera, truth).pixels
            drawn = [renderer.render(splats, camera, SPLATS.replace(attenuation=form)).pixels for form in FORMS]
            rmse = tuple(float(np.sqrt(((each - right) ** 2).mean())) for each in drawn)
            yield Row(name, stretch, camera.size[0], samples, rmse)


def picture(renderer: sg.Renderer, path: Path) -> None:
    """Rows: thick edge, threads, tunnel, nerve at m = 4; columns: each form, and the reference."""
    rows, side = [], 220
    for name, splats, base in scenes(None):
        if name not in ("thick edge", "threads", "tunnel", "nerve"):
            continue
        camera = at_stretch(splats, base, 4.0)
        truth = SPLATS.replace(antialias="supersample", samples=samples_for(splats, camera))
        asked = [*(SPLATS.replace(attenuation=form) for form in FORMS), truth]
        shown = [renderer.render(splats, camera, s.replace(background=(0, 0, 0))).pixels for s in asked]
        index = np.arange(side) * camera.size[0] // side
        rows.append(
            np.concatenate([np.pad(p[index][:, index], ((0, 4), (0, 4), (0, 0)), constant_values=1) for p in shown], 1)
        )
    sg.Image(np.concatenate(rows)[:-4, :-4]).save(path)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    parser.add_argument("--picture", type=Path, help="draw what each form shows, instead of measuring")
    args = parser.parse_args()
    with sg.Renderer() as renderer:
        if args.picture:
            picture(renderer, args.picture)
            return
        print(f"{'scene':12} {'m':>5} {'size':>5} {'k':>4}    RMSE of {', '.join(FORMS)}; * within 1 % of the best")
        rows = []
        for row in measure(renderer, args.data and Path(args.data)):
            print(row, flush=True)
            rows.append(row)
    worst = [max(row.rmse[n] for row in rows) for n in range(len(FORMS))]
    print("largest over all:", ", ".join(f"{form} {error:.4f}" for form, error in zip(FORMS, worst, strict=True)))
    if args.csv:
        with args.csv.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["scene", "m", "size", "samples", *FORMS])
            writer.writerows([row.scene, row.stretch, row.size, row.samples, *row.rmse] for row in rows)


if __name__ == "__main__":
    main()

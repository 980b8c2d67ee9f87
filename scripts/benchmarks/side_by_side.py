"""Real volumes by splats of version 0.1, by splats classified after reconstruction, by VTK, and by their field.

Prints the RMSE of each column against two fields: what the b-spline reconstructs, which is shown, and what trilinear
interpolation does, which VTK draws. Without VTK its columns are left out. SPLATGL_DATA names the folder of the volumes.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.vtk_peers import Peer
from PIL import Image as Pillow
from PIL import ImageDraw, ImageFont

import splatgl as sg
from splatgl.reference.field import field_integral
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions

# pixels of a picture, and of one volume's; samples along each side of a pixel, samples a voxel of the field, height of
# the letters' row
SIDE, LARGE, SAMPLES, STEPS, HEAD = 144, 240, 2, 2, 20
COLORS = 256
BLACK = (0.0, 0.0, 0.0)
FIELDS = ("b-spline", "trilinear")
BEFORE, AFTER, FIELD = "splats, version 0.1", "splats, now", "the field, marched"
PEERS = {"VTK, CPU": "cpu", "VTK, OpenGL": "gpu"}
# options of a scene by file; z of the Visible Male runs downwards
VOLUMES: dict[str, tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "tooth": (
        "tooth.nhdr",
        {},
        {"points": ((450, 0), (600, 0.07), (900, 0.07), (980, 0.9)), "colormap": "ivory", "window": (400, 1150)},
        {"azimuth": 30, "elevation": 15, "zoom": 1.3},
    ),
    "head, MRI": (
        "head_mri_160x232x160.nii.gz",
        {},
        {"points": ((50, 0), (90, 0.6)), "colormap": "flesh", "window": (-60, 230)},
        {"azimuth": 35, "elevation": 5, "zoom": 1.3},
    ),
    "head, CT: bone": (
        "visible_male_128x256x256_uint8.raw",
        {"spacing": (1.57774, 0.995861, 1.00797)},
        {"preset": "ct-bone"},
        {"azimuth": 40, "elevation": -5, "zoom": 1.5, "up": (0, 0, -1)},
    ),
    "chest, CT: bone": (
        "lung_ct_115x157x129.mha",
        {},
        {"preset": "ct-bone"},
        {"azimuth": 20, "elevation": 10, "zoom": 1.25},
    ),
    "carotid, MRA": (
        "carotid_76x49x45_scalar_and_velocity.vtk",
        {},
        {"points": ((170, 0), (240, 0.7)), "colormap": "fire", "window": (0, 450)},
        {"azimuth": 30, "elevation": 20, "zoom": 1.3},
    ),
    "neuron": ("neuron_a_409x415x119.tif", {}, {}, {"zoom": 1.4}),
    "hurricane Isabel, wind": (
        "isabel/isabel_windspeed_t30.nrrd",
        {},
        {"points": ((22, 0), (45, 0.6)), "colormap": "inferno", "window": (15, 70)},
        {"azimuth": 20, "elevation": 50, "zoom": 1.3},
    ),
}


def drawn(renderer: sg.Renderer, volume: sg.Volume, transfer: sg.Transfer, camera: sg.Camera) -> dict[str, np.ndarray]:
    """Pictures [H, W, 4] of a volume by column, the field's aside."""
    found = {}
    splats = sg.extract(volume, transfer)
    for name, settings in ((BEFORE, sg.Settings.like("0.1")), (AFTER, sg.Settings())):
        found[name] = renderer.render(splats, camera, settings, verify_bound=False).pixels
    settings = sg.Settings(antialias="supersample", samples=SAMPLES)
    for name, mapper in PEERS.items() if find_spec("vtk") else ():
        with closing(Peer(mapper, (volume, transfer), camera, settings)) as peer:
            found[name] = peer.frame()[0].pixels
    return found


def side_by_side(target: Path, *names: str) -> None:
    """Writes the picture: a row for each volume, a column for each method. names: some of VOLUMES, all if empty."""
    folder = os.environ.get("SPLATGL_DATA")
    if not folder:
        sys.exit("SPLATGL_DATA: expected the folder of the volumes, got nothing")
    chosen = {name: VOLUMES[name] for name in names or VOLUMES}
    if missing := [file for file, *_ in chosen.values() if not (Path(folder) / file).exists()]:
        sys.exit(f"{folder}: expected the volumes, {', '.join(missing)} missing")
    if not find_spec("vtk"):
        print("VTK left out: not installed (pip install splatgl[vtk])")
    side = LARGE if len(chosen) == 1 else SIDE
    subjects, fields, rows = {}, {}, []
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool, sg.Renderer() as renderer:
        for label, (file, load, transfer, view) in chosen.items():
            scene = SceneFile(str(Path(folder) / file), load, transfer, ViewOptions(size=(side, side), **view))
            volume = scene.open()
            content = volume, scene.transfer_for(volume), scene.view.camera(volume, volume)
            subjects[label] = content
            fields[label] = [pool.submit(field_integral, *content, name, STEPS, SAMPLES) for name in FIELDS]
        for label, content in subjects.items():
            rows.append(_compared(label, drawn(renderer, *content), fields[label]))
    Pillow.fromarray(np.concatenate([_head(side), *rows])).quantize(COLORS).save(target, optimize=True)


def _compared(label: str, pictures: dict[str, np.ndarray], fields: list[Future[sg.Image]]) -> np.ndarray:
    """A row of pictures, the field's last; prints the others' RMSE."""
    shown, other = (field.result().pixels for field in fields)
    for name, pixels in {**pictures, FIELD: shown}.items():
        errors = [np.sqrt(np.square(pixels - field).mean()) for field in (shown, other)]
        told = ", ".join(f"{field} {error:.4f}" for field, error in zip(FIELDS, errors, strict=True))
        print(f"{label}: {name}: {told}", flush=True)
    return _row(label, {**pictures, FIELD: shown})


def _row(label: str, pictures: dict[str, np.ndarray]) -> np.ndarray:
    """uint8 [H, W, 3]: the pictures on black, below their volume's name."""
    parts = [sg.Image(pixels.astype(np.float32)).over(BLACK).straight()[..., :3] for pixels in pictures.values()]
    row = np.rint(np.concatenate(parts, 1) * 255).astype(np.uint8)
    return np.concatenate([_bar(0, [label], row.shape[1]), row])


def _head(side: int) -> np.ndarray:
    """uint8 [HEAD, W, 3]: the columns' names."""
    names = [BEFORE, AFTER, *(PEERS if find_spec("vtk") else ()), FIELD]
    return _bar(48, names, side * len(names))


def _bar(gray: int, words: list[str], width: int) -> np.ndarray:
    """uint8 [HEAD, width, 3]: a word for each picture below."""
    picture = Pillow.new("RGB", (width, HEAD), (gray,) * 3)
    for column, word in enumerate(words):
        ImageDraw.Draw(picture).text(
            (width // len(words) * column + 4, 2), word, (230, 230, 230), ImageFont.load_default(12)
        )
    return np.asarray(picture)

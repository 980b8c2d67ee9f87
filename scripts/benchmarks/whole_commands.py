"""Whole commands, from a file to its picture: `splatgl render FILE` beside a VTK script that reads and draws the same.

    .venv/bin/python scripts/benchmarks/whole_commands.py [--data FOLDER] [--rounds N] [--size N] [--more] [--csv FILE]

Both start Python, read the file with their own reader, classify by the same opacities and colours, draw from the same
place and write a PNG; VTK (extra `vtk`) by its ray caster for the CPU, at half-voxel steps. Without VTK its rows are
left out. Commands take turns, after one that fills the caches of Python and of the driver. Processor seconds are those
of all threads, which other programs hardly change; wall seconds are the least. Errors are RMSE of the PNG's linear
colours on the default background from the field of the values, in 256 pixels of 4×4 rays each.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rows import tell

from splatgl.data.color import linear_from_srgb
from splatgl.planning.resolve import select_splats
from splatgl.reference.field import kept_field_integral
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.lighting import AMBIENT, DIFFUSE

FILES = (
    "tooth.nhdr",
    "head_mri_160x232x160.nii.gz",
    "stent_ct_128x128x256.nrrd",
    "lung_ct_115x157x129.mha",
    "neuron_a_409x415x119.tif",
    "visible_male_128x256x256_uint8.raw",
    "carotid_76x49x45_scalar_and_velocity.vtk",
    "isabel/isabel_windspeed_t31.nrrd",
)
# pixels that are compared with the field, and rays along the sides of each
PIXELS, RAYS = 256, 4
# a colour that differs by less from the background counts as background
UNSEEN = 0.005
# nodes of the colour function
COLORS = 256
# what VTK's script does, with as few imports as it needs
VTK = """
import json, os, sys
import vtk
job = json.load(open(sys.argv[1]))
readers = {".nii.gz": vtk.vtkNIFTIImageReader, ".nhdr": vtk.vtkNrrdReader, ".nrrd": vtk.vtkNrrdReader,
           ".mha": vtk.vtkMetaImageReader, ".tif": vtk.vtkTIFFReader, ".raw": vtk.vtkImageReader2,
           ".vtk": vtk.vtkStructuredPointsReader}
reader = next(made for ending, made in readers.items() if job["file"].endswith(ending))()
reader.SetFileName(job["file"])
if job["file"].endswith(".raw"):
    reader.SetFileDimensionality(3)
    reader.SetFileLowerLeft(1)
    reader.SetDataExtent(*(n for count in job["shape"] for n in (0, count - 1)))
    reader.SetDataScalarTypeToUnsignedChar()
if job["file"].endswith(".tif"):
    reader.SetOrientationType(1)
reader.Update()
image = reader.GetOutput()
if job["file"].endswith(".nii.gz") and reader.GetRescaleSlope() not in (0, 1):
    scaled = vtk.vtkImageShiftScale()
    scaled.SetInputData(image)
    scaled.SetScale(reader.GetRescaleSlope())
    scaled.SetShift(reader.GetRescaleIntercept() / reader.GetRescaleSlope())
    scaled.SetOutputScalarTypeToFloat()
    scaled.Update()
    image = scaled.GetOutput()
image.SetSpacing(*job["spacing"])
image.SetOrigin(0, 0, 0)
opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
for node in job["opacity"]:
    opacity.AddPoint(*node)
for node in job["color"]:
    color.AddRGBPoint(*node)
looks = vtk.vtkVolumeProperty()
looks.SetScalarOpacity(opacity)
looks.SetScalarOpacityUnitDistance(job["unit"])
looks.SetColor(color)
looks.SetInterpolationTypeToLinear()
looks.SetShade(job["shaded"])
looks.SetAmbient(job["light"][0])
looks.SetDiffuse(job["light"][1])
mapper = vtk.vtkFixedPointVolumeRayCastMapper()
mapper.SetInputData(image)
mapper.SetSampleDistance(min(job["spacing"]) / 2)
mapper.SetAutoAdjustSampleDistances(0)
mapper.SetInteractiveSampleDistance(min(job["spacing"]) / 2)
mapper.SetNumberOfThreads(os.cpu_count())
volume, renderer, window = vtk.vtkVolume(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
volume.SetMapper(mapper)
volume.SetProperty(looks)
matrix = vtk.vtkMatrix4x4()
matrix.DeepCopy(job["matrix"])
volume.SetUserMatrix(matrix)
renderer.AddVolume(volume)
light = vtk.vtkLight()
light.SetLightTypeToHeadlight()
light.SetAmbientColor(1.0, 1.0, 1.0)
renderer.AddLight(light)
window.SetOffScreenRendering(1)
window.SetAlphaBitPlanes(1)
window.SetMultiSamples(0)
window.SetSize(job["size"], job["size"])
window.AddRenderer(renderer)
view = renderer.GetActiveCamera()
view.SetPosition(*job["eye"])
view.SetFocalPoint(*job["target"])
view.SetViewUp(*job["up"])
view.SetParallelProjection(job["height"] is not None)
if job["height"] is None:
    view.SetViewAngle(job["fov"])
else:
    view.SetParallelScale(job["height"] / 2)
renderer.ResetCameraClippingRange()
window.Render()
shown = vtk.vtkWindowToImageFilter()
shown.SetInput(window)
shown.SetInputBufferTypeToRGBA()
shown.ReadFrontBufferOff()
writer = vtk.vtkPNGWriter()
writer.SetInputConnection(shown.GetOutputPort())
writer.SetFileName(job["output"])
writer.Write()
"""


@dataclass(frozen=True)
class Row:
    """A file by one way: processor seconds, the median, minimum and maximum of its rounds; the least wall seconds; and
    the RMSE from the field.
    """

    file: str
    way: str
    processor: float
    low: float
    high: float
    wall: float
    error: float

    def __str__(self) -> str:
        times = f"{self.processor:6.2f} s ({self.low:.2f} … {self.high:.2f}), wall {self.wall:6.2f} s"
        return f"{self.file:42} {self.way:12} {times}, off by {self.error:.2g}"


class Truth:
    """What some pixels of a scene's default picture show by the field of its values; picture: its PNG."""

    def __init__(self, scene: OpenScene, size: int, picture: Path) -> None:
        camera, settings = scene.camera.resized((size, size)), scene.settings
        drawn = select_splats(scene.splats, settings, moving=False, camera=camera)
        self.background = np.array(settings.ground or (0.0, 0.0, 0.0))
        shown = _colors(picture)[:, :3]
        seen = np.flatnonzero((np.abs(linear_from_srgb(shown) - self.background) > UNSEEN).any(axis=1))
        self.pixels = seen[np.linspace(0, len(seen) - 1, min(PIXELS, len(seen))).astype(int)]
        light = kept_field_integral(drawn, camera, self.pixels, RAYS, settings.replace(background=None))
        self.light = self._shown(light)

    def _shown(self, light: np.ndarray) -> np.ndarray:
        """Premultiplied colours [P, 4] on the background: [P, 3]."""
        return np.asarray(light[:, :3] + (1 - light[:, 3:]) * self.background)

    def error(self, path: Path, is_linear: bool) -> float:
        """The RMSE of a PNG: of linear premultiplied colours and their opacity, or of sRGB on the background."""
        pixels = _colors(path)[self.pixels]
        shown = self._shown(pixels) if is_linear else linear_from_srgb(pixels[:, :3])
        return float(np.sqrt(((shown - self.light) ** 2).mean()))


def _colors(path: Path) -> np.ndarray:
    """The pixels of a PNG, [P, 4], from 0 to 1."""
    return np.asarray(Image.open(path).convert("RGBA")).reshape(-1, 4) / 255


def vtk_job(path: Path, scene: OpenScene, size: int, output: Path) -> dict[str, Any]:
    """What VTK's script needs to know: the same view and transfer function, with linear colours."""
    volume, transfer, camera = scene.volume, scene.transfer, scene.camera.resized((size, size))
    low, high = float(np.nanmin(volume.samples)), float(np.nanmax(volume.samples))
    nodes = sorted({low, high, *(value for value, _ in transfer.points)})
    values = np.linspace(low, high, COLORS)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = volume.direction, volume.origin
    return {
        "file": str(path),
        "output": str(output),
        "size": size,
        "shape": volume.shape[::-1],
        "spacing": list(volume.spacing),
        "matrix": matrix.ravel().tolist(),
        "opacity": [(value, float(transfer.opacity(value))) for value in nodes],
        "color": [(value, *rgb) for value, rgb in zip(values.tolist(), transfer.color(values).tolist(), strict=True)],
        "unit": transfer.unit or min(volume.spacing),
        "shaded": transfer.shading,
        "light": (AMBIENT, DIFFUSE),
        "eye": camera.eye.tolist(),
        "target": (camera.eye + 100 * camera.forward).tolist(),
        "up": (-camera.eye_from_world[1]).tolist(),
        "fov": float(2 * np.degrees(np.arctan(camera.extent / 2))),
        # of a parallel view
        "height": None if camera.perspective else camera.extent,
    }


def seconds(command: Sequence[str], **options: Any) -> tuple[float, float]:
    """Processor seconds of all threads, and wall seconds, of a command; Python caches bytecode, as installed. options:
    of subprocess.run.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, **{"check": True, "capture_output": True, "env": environment, **options})
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, wall


def measure(data: Path, rounds: int, size: int, has_more: bool, folder: Path) -> Iterator[Row]:
    """has_more: also measures one sample a pixel, and splats one by one."""
    script, peers = folder / "vtk_command.py", importlib.util.find_spec("vtk") is not None
    script.write_text(VTK)
    more = {"one sample": ["--antialias", "off"], "like 0.1": ["--like", "0.1"]} if has_more else {}
    for file in FILES:
        scene, name = OpenScene.read(SceneFile(str(data / file))), Path(file).name
        render = [sys.executable, "-m", "splatgl", "render", str(data / file), "--size", f"{size}", "--quiet"]
        pictures = {way: folder / f"{name}.{way}.png" for way in ("default", *more, "VTK, CPU")}
        ways = {way: [*render, *more.get(way, []), "-o", str(pictures[way])] for way in ("default", *more)}
        if peers:
            job = folder / f"{name}.json"
            job.write_text(json.dumps(vtk_job(data / file, scene, size, pictures["VTK, CPU"])))
            ways["VTK, CPU"] = [sys.executable, str(script), str(job)]
        for command in ways.values():
            seconds(command)
        truth = Truth(scene, size, pictures["default"])
        turns = [{way: seconds(command) for way, command in ways.items()} for _ in range(rounds)]
        for way in ways:
            found, walls = zip(*(turn[way] for turn in turns), strict=True)
            error = truth.error(pictures[way], way.startswith("VTK"))
            yield Row(name, way, statistics.median(found), min(found), max(found), min(walls), error)


def main() -> None:
    parser = argparse.ArgumentParser(
        allow_abbrev=False, description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--rounds", type=int, default=5, help="times each command is measured (5)")
    parser.add_argument("--size", type=int, default=512, help="pixels of the picture's side (512)")
    parser.add_argument("--more", action="store_true", help="also measure one sample a pixel, and --like 0.1")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    parser.add_argument("--pictures", type=Path, help="keep the pictures in this folder")
    args = parser.parse_args()
    if args.data is None:
        parser.error("no real volumes: --data FOLDER")
    with tempfile.TemporaryDirectory() as folder:
        kept = args.pictures or Path(folder)
        kept.mkdir(parents=True, exist_ok=True)
        tell(measure(Path(args.data), args.rounds, args.size, args.more, kept), args.csv)


if __name__ == "__main__":
    main()

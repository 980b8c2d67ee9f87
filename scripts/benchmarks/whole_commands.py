"""Whole commands, from a file to its picture: `splatgl render FILE` beside a VTK script that reads and draws the same.

    .venv/bin/python scripts/benchmarks/whole_commands.py [--data FOLDER] [--rounds N] [--size N] [--csv FILE]

Both start Python, read the file with their own reader, classify by the same opacities and colours, draw from the same
place and write a PNG; VTK (extra `bench`) by its ray caster for the CPU, at half-voxel steps. Without VTK its rows are
left out. Commands take turns; compare ratios.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
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
from rows import tell

from splatgl.data.color import srgb_from_linear
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.lighting import AMBIENT, DIFFUSE
from splatgl.splat.opaque_bounds import Opaque

FILES = (
    "tooth.nhdr",
    "head_mri_160x232x160.nii.gz",
    "stent_ct_128x128x256.nrrd",
    "lung_ct_115x157x129.mha",
    "neuron_a_409x415x119.tif",
    "visible_male_128x256x256_uint8.raw",
)
# nodes of the colour function
COLORS = 256
# what VTK's script does, with as few imports as it needs
VTK = """
import json, os, sys
import vtk
job = json.load(open(sys.argv[1]))
readers = {".nii.gz": vtk.vtkNIFTIImageReader, ".nhdr": vtk.vtkNrrdReader, ".nrrd": vtk.vtkNrrdReader,
           ".mha": vtk.vtkMetaImageReader, ".tif": vtk.vtkTIFFReader, ".raw": vtk.vtkImageReader2}
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
view.SetViewAngle(job["fov"])
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
    """A file by one way: median, minimum and maximum of its rounds in seconds, and the median over VTK's."""

    file: str
    way: str
    median: float
    low: float
    high: float
    ratio: float

    def __str__(self) -> str:
        return f"{self.file:36} {self.way:12} {self.median:7.2f} s ({self.low:.2f} … {self.high:.2f})  {self.ratio:.2f}"


def vtk_job(path: Path, size: int, output: Path) -> dict[str, Any]:
    """What VTK's script needs to know: the same view and transfer function."""
    scene = SceneFile(str(path))
    volume = scene.open()
    transfer = scene.transfer_for(volume)
    camera = scene.view.camera(volume, Opaque(volume, transfer)).resized((size, size))
    low, high = float(np.nanmin(volume.samples)), float(np.nanmax(volume.samples))
    nodes = sorted({low, high, *(value for value, _ in transfer.points)})
    values = np.linspace(low, high, COLORS)
    shown = srgb_from_linear(transfer.color(values)).tolist()
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
        "color": [(value, *rgb) for value, rgb in zip(values.tolist(), shown, strict=True)],
        "unit": transfer.unit or min(volume.spacing),
        "shaded": transfer.shading,
        "light": (AMBIENT, DIFFUSE),
        "eye": camera.eye.tolist(),
        "target": (camera.eye + 100 * camera.forward).tolist(),
        "up": (-camera.eye_from_world[1]).tolist(),
        "fov": float(2 * np.degrees(np.arctan(camera.extent / 2))),
    }


def seconds(command: Sequence[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


def measure(data: Path, rounds: int, size: int, folder: Path) -> Iterator[Row]:
    script, peers = folder / "vtk_command.py", importlib.util.find_spec("vtk") is not None
    script.write_text(VTK)
    for name in FILES:
        render = [sys.executable, "-m", "splatgl", "render", str(data / name), "--size", f"{size}", "--quiet"]
        ways = {
            "default": [*render, "-o", str(folder / f"{name}.png")],
            "one sample": [*render, "--antialias", "off", "-o", str(folder / f"{name}.one.png")],
            "like 0.1": [*render, "--like", "0.1", "-o", str(folder / f"{name}.splats.png")],
        }
        if peers:
            job = folder / f"{name}.json"
            job.write_text(json.dumps(vtk_job(data / name, size, folder / f"{name}.vtk.png")))
            ways = {"VTK, CPU": [sys.executable, str(script), str(job)], **ways}
        times: dict[str, list[float]] = {way: [] for way in ways}
        for command in ways.values():
            seconds(command)
        for _ in range(rounds):
            for way, command in ways.items():
                times[way].append(seconds(command))
        base = statistics.median(times["VTK, CPU"]) if peers else float("nan")
        for way, found in times.items():
            median = statistics.median(found)
            yield Row(name, way, median, min(found), max(found), median / base)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("SPLATGL_DATA"), help="folder of real volumes")
    parser.add_argument("--rounds", type=int, default=5, help="times each command is measured (5)")
    parser.add_argument("--size", type=int, default=512, help="pixels of the picture's side (512)")
    parser.add_argument("--csv", type=Path, help="also write the rows here")
    parser.add_argument("--pictures", type=Path, help="keep the pictures in this folder")
    args = parser.parse_args()
    if args.data is None:
        parser.error("no real volumes: --data FOLDER")
    with tempfile.TemporaryDirectory() as folder:
        kept = args.pictures or Path(folder)
        kept.mkdir(parents=True, exist_ok=True)
        tell(measure(Path(args.data), args.rounds, args.size, kept), args.csv)


if __name__ == "__main__":
    main()

"""VTK's ray casters, and PyVista's plotter, on the same scene: same camera, opacities and colours; each in a process.

Differences: they interpolate samples along rays between voxels and classify the result, whereas splats
classify voxels and blend the result; their light is parallel and leaves ambient light alone where there is no
gradient; the CPU's caster interpolates the light of samples, not their gradients, and ends a ray at an opacity of
0.992; the OpenGL caster writes 8 bits.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected, missing_extra
from splatgl.geometry.camera import Camera
from splatgl.planning.scene import Layer, Scene
from splatgl.splat.lighting import AMBIENT, DIFFUSE
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

# blends of splats, and what VTK's mappers call them
BLENDS = {
    "composite": "Composite",
    "mip": "MaximumIntensity",
    "minip": "MinimumIntensity",
}
MAPPERS = {"cpu": "vtkFixedPointVolumeRayCastMapper", "gpu": "vtkGPUVolumeRayCastMapper"}
# samples along a ray for each voxel
STEPS_PER_VOXEL = 2
# nodes of the colour function
COLORS = 512
# width of an opacity step, as a fraction of the value range, which sets the resolution of VTK's texture
STEP = 1e-3
# full scale of the CPU's caster, and of the OpenGL caster
FULL, FULL_8 = 32767.0, 255.0
# timeout for a peer to start or to draw, seconds
PATIENCE = 900.0


class PeerProcess:
    """A process that draws one scene whenever it is asked to. serve: runs there, with a pipe and the scene."""

    def __init__(self, serve: Callable[..., None], *scene: Any) -> None:
        spawn = multiprocessing.get_context("spawn")
        self.pipe, theirs = spawn.Pipe()
        self.process = spawn.Process(target=serve, args=(theirs, *scene), daemon=True)
        self.process.start()

    def ask(self) -> Any:
        """What the process sends once it has drawn. Raises InputError if it ended or hangs."""
        try:
            self.pipe.send(True)
            if not self.pipe.poll(PATIENCE):
                raise EOFError
            return self.pipe.recv()
        except (EOFError, OSError) as error:
            raise expected("peer", "a frame by VTK", "none: its process ended or hangs") from error

    def close(self) -> None:
        """Ends the process."""
        self.process.terminate()
        self.process.join()
        self.pipe.close()


class Peer(PeerProcess):
    """A VTK mapper that draws one scene. Close it after use."""

    def __init__(self, mapper: str, content: tuple[Volume, Transfer], camera: Camera, settings: Settings) -> None:
        """mapper: of MAPPERS. Raises InputError if VTK is not installed or the scene cannot be converted."""
        if find_spec("vtk") is None:
            raise missing_extra("peers", "vtk", "vtk")
        volume, transfer = content
        _check(volume, transfer, camera, settings)
        shaded = transfer.shading if settings.shading == "auto" else settings.shading == "on"
        samples = settings.samples if settings.antialias == "supersample" else 1
        fine = camera.resized((camera.size[0] * samples, camera.size[1] * samples))
        scene = (
            np.asarray(volume.samples),
            volume.spacing,
            volume.origin,
            volume.direction,
            transfer,
            shaded,
            fine,
            settings.blend,
            samples,
        )
        super().__init__(_serve, MAPPERS[mapper], scene)

    def frame(self) -> tuple[Image, float]:
        """A finished frame, linear premultiplied, and the seconds it took with its pixels read back. Raises InputError
        as `ask`.
        """
        sums, full, seconds = self.ask()
        return Image(sums.astype(np.float32) / np.float32(full), {"blend": "composite"}), seconds


class PlotterPeer(PeerProcess):
    """A PyVista plotter that draws the layers of a scene, and takes a screenshot. Close it after use."""

    def __init__(self, layers: Sequence[Layer], camera: Camera, settings: Settings, on_cpu: bool = False) -> None:
        """on_cpu: casts rays by the processor. Raises InputError if PyVista is not installed."""
        if find_spec("pyvista") is None:
            raise missing_extra("peers", "pyvista", "pyvista")
        super().__init__(_serve_plotter, layers, camera, settings, on_cpu)


def plotter_of(layers: Sequence[Layer], camera: Camera, settings: Settings, on_cpu: bool) -> Any:
    """A plotter that shows the layers off screen. on_cpu: its volumes are cast by the processor."""
    import vtk

    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    plotter = Scene(layers).to_pyvista(camera, settings, off_screen=True)
    for actor in plotter.renderer.GetVolumes() if on_cpu else ():
        actor.GetMapper().SetRequestedRenderModeToRayCast()
    plotter.show(auto_close=False)
    return plotter


def _serve_plotter(pipe: Any, layers: Sequence[Layer], camera: Camera, settings: Settings, on_cpu: bool) -> None:
    """Draws a frame for every message, and answers with the screenshot's shape."""
    plotter = plotter_of(layers, camera, settings, on_cpu)
    while True:
        pipe.recv()
        for actor in plotter.renderer.GetVolumes():
            actor.Modified()
        plotter.render()
        pipe.send(np.array(plotter.screenshot(return_img=True)).shape)


def _check(volume: Volume, transfer: Transfer, camera: Camera, settings: Settings) -> None:
    """Raises InputError for features without a counterpart in VTK."""
    for fine, this, got in (
        (settings.blend in BLENDS, f"blend {', '.join(BLENDS)}", settings.blend),
        (volume.color is None, "colours by value", "colours per voxel"),
        (not transfer.needs_gradients, "opacities by value", "opacities by gradient"),
        (camera.perspective, "perspective", "parallel rays"),
        (settings.ground is None, "no background", "a background"),
    ):
        if not fine:
            raise expected("peers", this, got)


def _serve(pipe: Any, mapper: str, scene: Sequence[Any]) -> None:
    """Draws a frame for every message: sums of its samples, their full scale, and the seconds it took."""
    *scene, k = scene
    frame = _frame(mapper, scene)
    while True:
        pipe.recv()
        started = time.perf_counter()
        drawn = frame()
        # sums of samples, which are integers
        height, width = drawn.shape[0] // k, drawn.shape[1] // k
        sums = drawn.reshape(height, k, width, k, 4).sum(axis=(1, 3), dtype=np.uint32) if k > 1 else drawn
        full = FULL_8 if drawn.dtype == np.uint8 else FULL
        pipe.send((sums, full * k * k, time.perf_counter() - started))


def _frame(mapper_name: str, scene: Sequence[Any]) -> Callable[[], np.ndarray]:
    """A function that draws: uint8 [H, W, 4], or uint16 of at most FULL, row 0 on top."""
    import vtk

    # suppress VTK's messages on missing displays
    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)
    samples, spacing, origin, direction, transfer, shaded, camera, blend = scene
    mapper = getattr(vtk, mapper_name)()
    mapper.SetSampleDistance(min(spacing) / STEPS_PER_VOXEL)
    mapper.SetAutoAdjustSampleDistances(0)
    getattr(mapper, f"SetBlendModeTo{BLENDS[blend]}")()
    if "FixedPoint" in mapper_name:
        mapper.SetInteractiveSampleDistance(min(spacing) / STEPS_PER_VOXEL)
        mapper.SetNumberOfThreads(os.cpu_count() or 1)
    volume, renderer, window = vtk.vtkVolume(), vtk.vtkRenderer(), vtk.vtkRenderWindow()
    volume.SetMapper(mapper)
    _place(vtk, volume, samples, spacing, origin, direction)
    volume.SetProperty(_volume_property(vtk, samples, transfer, shaded, min(spacing)))
    renderer.AddVolume(volume)
    light = vtk.vtkLight()
    light.SetLightTypeToHeadlight()
    # black unless set
    light.SetAmbientColor(1.0, 1.0, 1.0)
    renderer.AddLight(light)
    window.SetOffScreenRendering(1)
    window.SetAlphaBitPlanes(1)
    window.SetMultiSamples(0)
    width, height = camera.size
    window.SetSize(width, height)
    window.AddRenderer(renderer)
    view = renderer.GetActiveCamera()
    view.SetPosition(*camera.eye)
    view.SetFocalPoint(*(camera.eye + 100 * camera.forward))
    view.SetViewUp(*(-camera.eye_from_world[1]))
    view.SetViewAngle(2 * np.degrees(np.arctan(camera.extent / 2)))
    renderer.ResetCameraClippingRange()

    def frame() -> np.ndarray:
        # an unmodified scene would not be redrawn
        volume.Modified()
        view.Modified()
        window.Render()
        return _cast_pixels(vtk, mapper) if "FixedPoint" in mapper_name else _window_pixels(vtk, window)

    return frame


def _window_pixels(vtk: Any, window: Any) -> np.ndarray:
    """Pixels of a window, uint8 [H, W, 4]."""
    from vtk.util.numpy_support import vtk_to_numpy

    width, height = window.GetSize()
    pixels = vtk.vtkUnsignedCharArray()
    window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, pixels)
    return np.array(vtk_to_numpy(pixels).reshape(height, width, 4)[::-1])


def _cast_pixels(vtk: Any, mapper: Any) -> np.ndarray:
    """Pixels of the CPU's ray caster, uint16 [H, W, 4].

    The window shows these stretched by M / (M - 1) and interpolated.
    """
    from vtk.util.numpy_support import vtk_to_numpy

    image = mapper.GetRayCastImage()
    (width, height), (across, down) = image.GetImageMemorySize(), image.GetImageInUseSize()
    memory = vtk.vtkUnsignedShortArray()
    memory.SetVoidArray(image.GetImage(), width * height * 4, 1)
    (left, low), (columns, rows) = image.GetImageOrigin(), image.GetImageViewportSize()
    drawn = np.zeros((rows, columns, 4), np.uint16)
    drawn[low : low + down, left : left + across] = vtk_to_numpy(memory).reshape(height, width, 4)[:down, :across]
    return drawn[::-1]


def _place(vtk: Any, volume: Any, samples: np.ndarray, spacing: Any, origin: Any, direction: Any) -> None:
    """Sets the volume's image and matrix; outer samples extend to the box of the voxels, half a voxel farther."""
    from vtk.util.numpy_support import numpy_to_vtk

    native = np.pad(samples, 1, mode="edge").astype(samples.dtype.newbyteorder("="))
    image = vtk.vtkImageData()
    image.SetDimensions(*native.shape[::-1])
    image.SetSpacing(*spacing)
    image.SetOrigin(*(-step for step in spacing))
    image.GetPointData().SetScalars(numpy_to_vtk(native.ravel(), deep=True))
    volume.GetMapper().SetInputData(image)
    # an image's own directions are ignored by the CPU's caster, cropping at half voxels by the other
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = direction, origin
    matrix, inverse = vtk.vtkMatrix4x4(), np.linalg.inv(place)
    matrix.DeepCopy(place.ravel().tolist())
    volume.SetUserMatrix(matrix)
    for axis, count in enumerate(samples.shape[::-1]):
        for side, end in ((1, -0.5), (-1, count - 0.5)):
            plane = vtk.vtkPlane()
            plane.SetOrigin(*(place[:3, 3] + place[:3, axis] * spacing[axis] * end))
            plane.SetNormal(*(side * inverse[axis, :3]))
            volume.GetMapper().AddClippingPlane(plane)


def _volume_property(vtk: Any, samples: np.ndarray, transfer: Transfer, shaded: bool, spacing: float) -> Any:
    """vtkVolumeProperty of the transfer function: its unit length, linear colours, the same head light."""
    opacity, color = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    nodes = [value for value, _ in transfer.points]
    low, high = float(np.nanmin(samples)), float(np.nanmax(samples))
    # a duplicate node is a step: move the first of the two down slightly
    steps = [value - STEP * (high - low) for value in nodes if nodes.count(value) > 1]
    for value in sorted({low, high, *nodes, *steps}):
        opacity.AddPoint(value, float(transfer.opacity(value)))
    values = np.linspace(low, high, COLORS)
    for value, shade in zip(values.tolist(), transfer.color(values).tolist(), strict=True):
        color.AddRGBPoint(value, *shade)
    prop = vtk.vtkVolumeProperty()
    prop.SetScalarOpacity(opacity)
    prop.SetScalarOpacityUnitDistance(transfer.unit or spacing)
    prop.SetColor(color)
    prop.SetInterpolationTypeToLinear()
    prop.SetShade(shaded)
    prop.SetAmbient(AMBIENT)
    prop.SetDiffuse(DIFFUSE)
    prop.SetSpecular(0.0)
    return prop

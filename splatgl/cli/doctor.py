"""Describes this machine's OpenGL, and checks each technique against the float64 reference."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import numpy as np

from splatgl import reference
from splatgl.data.mesh import Mesh
from splatgl.data.scenes import ball
from splatgl.data.volume import Label, Volume
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.gl.context import ContextInfo, context_info, egl_devices, open_context
from splatgl.gl.renderer import Renderer, open_renderer
from splatgl.gl.selfcheck import SelfCheck, run_checks
from splatgl.opengl import OpenGL
from splatgl.planning.bricks import required_bricks
from splatgl.planning.scene import Layer, Scene
from splatgl.platforms import BACKENDS
from splatgl.readers import load
from splatgl.readers.contents import identify
from splatgl.splat.extract import extract
from splatgl.splat.motion import Motion
from splatgl.splat.settings import Settings, Technique
from splatgl.transfer.presets import default_transfer

PACKAGES = ("splatgl", "moderngl", "numpy", "glfw", "pyrr", "Pillow")
# largest error of a correct driver; voxels across the ball, and pixels a side
MAX_ERROR, VOXELS, SIDE = 1e-3, 10, 24
# so few degrees that its streaks equal the still image
TURNING = Motion(spin=np.array([0.0, 0.0, 0.001]))
BRICKS = "bricks"


def report(opengl: OpenGL, file: str | None = None) -> tuple[str, bool]:
    """Report as text, and whether images of `opengl` are correct. file: of which the header is described, "" for none,
    for a report of a fault; None: no report of one.

    They are not correct if no context opens, if float32 blending or filtering is wrong, or if an image differs from the
    float64 reference.
    """
    lines, ok = _check_backend(opengl)
    parts = [["versions", *_versions(PACKAGES if file is None else _installed())], ["backends", *_backends()], lines]
    if file:
        parts.append(["file", *describe_header(file)])
    return "\n\n".join("\n".join(part) for part in parts), ok


def _versions(packages: Sequence[str]) -> list[str]:
    width = max(map(len, packages))
    lines = [f"  {'Python':{width}} {platform.python_version()} on {platform.platform()}"]
    return lines + [f"  {name:{width}} {_version(name) or 'not installed'}" for name in packages]


def _installed() -> tuple[str, ...]:
    """The core packages, and those of the extras that are installed."""
    names = (re.split(r"[^\w.-]", line)[0] for line in requires("splatgl") or ())
    extras = {name for name in names if name not in (*PACKAGES, "splatgl") and _version(name)}
    return (*PACKAGES, *sorted(extras, key=str.lower))


def describe_header(path: str) -> list[str]:
    """Lines that describe a file without its name, its texts and its values; how it is rejected, if it is."""
    source = Path(path)
    lines = [f"  ends in    {''.join(source.suffixes[-2:]) or 'nothing'}"]
    if source.is_file():
        lines.append(f"  bytes      {source.stat().st_size:,}, {identify(source) or 'contents of no known kind'}")
    try:
        volume = load(path)
    except InputError as error:
        text = str(error)
        for word in filter(None, (path, source.name, source.stem)):
            text = text.replace(word, "FILE")
        return [*lines, f"  refused    {text}"]
    x, y, z = volume.spacing
    return [
        *lines,
        f"  samples    {' × '.join(map(str, volume.shape))} {volume.samples.dtype}, "
        f"{len(volume.channels) or 1} channels, {volume.times} times, {len(volume.labels or ())} labels",
        f"  spacing    {x:g} × {y:g} × {z:g} {volume.unit or 'of no unit'}, frame {volume.frame or 'unknown'}",
        f"  direction  {np.round(volume.direction, 3).tolist()}",
        f"  colours    {volume.color is not None}, vectors {volume.vectors is not None}",
    ]


def _backends() -> list[str]:
    """Result of each backend, and of each EGL device if there are several."""
    candidates = [OpenGL(name, gpu=False) for name in BACKENDS]
    devices = egl_devices()
    if len(devices) > 1:
        candidates[:1] = [OpenGL("egl", number, gpu=False) for number in devices]
    return list(map(_outcome, candidates))


def _outcome(opengl: OpenGL) -> str:
    """Line with the renderer, or the reason why there is none."""
    label = opengl.backend if opengl.device is None else f"{opengl.backend} {opengl.device}"
    try:
        ctx = open_context(opengl)
    except InputError as error:
        return f"  {label:9} {error}"
    try:
        info = context_info(ctx)
    finally:
        ctx.release()
    return f"  {label:9} {info.renderer}, OpenGL {info.version}" + (", software" if info.software else "")


def _check_backend(opengl: OpenGL) -> tuple[list[str], bool]:
    """Lines with limits and checks of a backend, and whether all required checks pass."""
    try:
        ctx = open_context(opengl)
    except InputError as error:
        return [f"nothing can be rendered: {error}"], False
    try:
        try:
            info, checks = context_info(ctx), run_checks(ctx)
        finally:
            ctx.release()
        image_lines, right = _check_images(opengl)
    except Exception as error:
        return [f"pictures are WRONG on this driver: {_first_line(error)}"], False
    ok = right and all(check.passed for check in checks if check.required)
    lines = [
        f"rendering with {info.backend}: {info.renderer}",
        f"  vendor {info.vendor}, OpenGL {info.version}, GLSL {info.glsl}",
        f"  textures up to {info.max_texture_size}², {info.max_samples} samples, "
        f"uniform blocks of {info.max_uniform_block} bytes",
        *(check_line(check) for check in checks),
        *image_lines,
        "",
        "pictures are right" if ok else "pictures are WRONG on this driver",
    ]
    return lines, ok


def _check_images(opengl: OpenGL) -> tuple[list[str], bool]:
    """Lines with the techniques of the context and the error of each image, and whether all are correct."""
    with open_renderer(opengl) as renderer:
        tiles = renderer.tiles is True
        results = {name: _check_image(renderer, name, *image) for name, image in _images(tiles).items()}
    enabled = "compute shaders: draws by tiles, quads and streaks"
    if not tiles:
        enabled = (
            "no compute shaders (OpenGL 4.3): draws sheets by tiles, splats by quads and streaks, which are slower"
        )
    return [f"  {enabled}", *(line for line, _ in results.values())], all(right for _, right in results.values())


Subject = Volume | Scene


def _images(tiles: bool) -> dict[str, tuple[Subject, Settings, Motion | None]]:
    """Subject, settings and motion of each image by name. tiles: whether techniques include tiles."""
    volume = ball(VOXELS)
    inside = (volume.samples > np.median(volume.samples)).astype(np.uint8)
    segments = Volume(inside, name="segments", labels=(Label(1, "inside", "#c04020"),))
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    triangle = Mesh(np.array([low, high, (low[0], high[1], high[2])]), np.array([[0, 1, 2]]))
    plain, like = Settings(), Settings.like("0.1")
    techniques: tuple[Technique, ...] = ("quads", "tiles") if tiles else ("quads",)
    both = Scene([Layer(volume), Layer(segments, default_transfer(segments))])
    by_technique = {
        "sheets": (volume, plain),
        "maximum": (volume, plain.replace(blend="mip")),
        "splats": (volume, like),
        "boxes": (segments, plain),
    }
    return {
        "default": (volume, plain, None),
        **{
            f"{name} by {technique}": (subject, settings.replace(technique=technique), None)
            for name, (subject, settings) in by_technique.items()
            for technique in techniques
        },
        "streaks": (volume, like.replace(motion="exact"), TURNING),
        "layers": (both, plain, None),
        "meshes": (Scene([Layer(volume)], meshes=[triangle]), plain, None),
        BRICKS: (volume, plain, None),
    }


def _check_image(
    renderer: Renderer, name: str, subject: Subject, settings: Settings, motion: Motion | None
) -> tuple[str, bool]:
    """Line with the error of an image, and whether it equals the float64 reference."""
    volume = ball(VOXELS)
    camera = Camera.orbit(volume, azimuth=30, elevation=20, size=(SIDE, SIDE))
    splats = subject if isinstance(subject, Scene) else extract(subject, default_transfer(subject))
    try:
        if name == BRICKS:
            assert isinstance(subject, Volume)
            bricks = required_bricks(subject, default_transfer(subject), settings)
            drawn = renderer.render_bricks(bricks, camera, settings)
        else:
            drawn = renderer.render(splats, camera, settings, motion, verify_bound=False)
    except Exception as error:
        return f"  {name:18} FAILED {_first_line(error)}", False
    truth = reference.render(splats, camera, settings.replace(technique="auto", motion="off")).pixels
    difference = float(np.abs(drawn.pixels - truth).max()) if np.isfinite(drawn.pixels).all() else np.inf
    check = SelfCheck(name, difference, 0.0, MAX_ERROR, required=True)
    return check_line(check), check.passed


def _first_line(error: Exception) -> str:
    """First line of any error: a driver may fail anywhere."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def check_line(check: SelfCheck) -> str:
    """Text of a check; a failed optional check is reported as a property of the target."""
    word = "ok" if check.passed else ("WRONG" if check.required else "coarse")
    return f"  {check.name:18} {word:6} {check.got:.6f}, exact {check.answer:.6f}"


MEASURED_PACKAGES = ("splatgl", "moderngl", "numpy", "Pillow", "matplotlib", "flip-evaluator", "vtk")


def machine(info: ContextInfo) -> dict[str, object]:
    """Processor, system, GL_RENDERER and library versions, as plain values."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 0,
        "system": platform.platform(),
        "python": platform.python_version(),
        "renderer": info.renderer,
        "opengl": info.version,
        "backend": info.backend,
        "software": info.software,
        "versions": {name: number for name in MEASURED_PACKAGES if (number := _version(name))},
    }


def _processor() -> str:
    """Name of the processor from Linux, else from Python."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""

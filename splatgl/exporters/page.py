"""A page that turns in a browser: one file with the splats, the shaders of OpenGL in WebGL 2, and the first picture.

What the page draws is drawn here, too, by the same shaders, and compared with the default picture; the page states it.
"""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from splatgl import __version__
from splatgl.annotations.bars import MOST_LETTERS, MOST_TICKS, ticks
from splatgl.data.color import srgb_from_linear
from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.exporters.layers import quantize
from splatgl.fileio import format_bytes
from splatgl.geometry.camera import Camera
from splatgl.gl.features import FRAME, frame_block, style_block
from splatgl.gl.quantized import SETTINGS, draw_quantized, quantized_plan, quantized_switches
from splatgl.gl.shader import compose, declared_switches
from splatgl.planning.plan import Plan
from splatgl.scene.draw import DrawOptions, SubjectView, draw
from splatgl.scene.open_scene import OpenScene
from splatgl.splat.kernels import Kernel
from splatgl.splat.quantized import CLASSES, QUANTIZED_ROW, QuantizedSplats
from splatgl.splat.settings import Settings

# texels along a side of the page's footprint table, as in the paper
TABLE = 256
# digits of numbers in the page; bars that fit over a picture
DIGITS, MOST_BARS = 9, 3


@dataclass(frozen=True, eq=False)
class WebPage:
    """A page and what is told of it. image: by the default method. pixels: what the page draws of that view. rmse: of
    both in sRGB, levels of 255, over all pixels.
    """

    html: str
    splats: QuantizedSplats
    image: Image
    pixels: np.ndarray
    rmse: float
    notes: tuple[str, ...]

    def summary(self, path: Path) -> str:
        """A line on size and error."""
        count = f"{len(self.splats):,} splats"
        count += f" of {self.splats.found:,} voxels" if self.splats.found > len(self.splats) else ""
        size = format_bytes(len(self.html.encode()))
        return f"{path}: {size}, {count}, RMSE {self.rmse:.1f} levels of 255 from the default picture"


def page_settings(settings: Settings) -> Settings:
    """The settings of a page: those of quantised splats, in the scene's light and antialiasing. Raises InputError for
    blends that pages do not have.
    """
    if not settings.hides:
        raise expected("blend of a page", "composite", settings.blend)
    given = {name: value for name, value in vars(SETTINGS).items() if name in SETTINGS.given}
    off = settings.antialias == "off"
    return settings.replace(
        **{**given, "antialias": "off" if off else "paper", "ambient_occlusion": 0.0, "shadows": 0.0}
    )


def make_page(scene: OpenScene | SubjectView, how: DrawOptions, most: int, bits: int, command: str) -> WebPage:
    """The page of a scene. most: splats; bits: of values; command: that made it."""
    settings, notes = page_settings(scene.settings), list[str]()
    for name in ("ambient_occlusion", "shadows"):
        if getattr(scene.settings, name):
            notes.append(f"{name.replace('_', ' ')} is in the first picture alone")
    splats = quantize(scene, settings, most, bits, notes)
    image = draw(scene, how)
    with how.renderer() as renderer:
        pixels = draw_quantized(renderer, splats, scene.camera, settings)
    ground = np.array(scene.settings.ground or (0.0, 0.0, 0.0))
    shown = [over(each, ground) for each in (image.pixels, pixels)]
    rmse = 255 * float(np.sqrt(np.mean((shown[0] - shown[1]) ** 2)))
    page = WebPage("", splats, image, pixels, rmse, tuple(notes))
    planned = quantized_plan(splats, scene.camera, settings)
    return WebPage(_html(scene, page, planned, command), splats, image, pixels, rmse, tuple(notes))


def over(pixels: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """sRGB [H, W, 3] from 0 to 1 of linear premultiplied pixels over a background."""
    return srgb_from_linear(np.clip(pixels[..., :3] + (1 - pixels[..., 3:]) * ground, 0, 1))


def _html(scene: OpenScene | SubjectView, page: WebPage, planned: Plan, command: str) -> str:
    """The text of a page."""
    here = files("splatgl.exporters")
    data, planes = page.splats.packed()
    settings = planned.settings
    described = _described(scene, page.splats, planned) | {"planes": planes}
    title = _title(scene, page.splats)
    width, height = scene.camera.size
    axes = described["letters"]
    sides = [
        (f"{axis}{sign}", f"from {side} {axes[axis]}")
        for axis in range(3)
        for sign, side in (("-", "low"), ("+", "high"))
    ]
    background = scene.settings.ground
    return Template(here.joinpath("page.html").read_text("utf-8")).substitute(
        version=__version__,
        title=escape(title),
        label=escape(f"Volume rendering of {title}", quote=True),
        width=width,
        height=height,
        picture=b64encode(page.image.encoded(Path("x.png"), 8, background)).decode(),
        window="" if any(not layer.own for layer in page.splats.layers) else "disabled",
        sides="".join(f'<option value="{value}">{escape(text)}</option>' for value, text in sides),
        antialias="" if settings.antialias == "off" else "checked",
        about=_about(scene, page, command),
        scene=_json(described),
        shaders=_json(web_shaders(planned)),
        splats=b64encode(data).decode(),
        script=here.joinpath("page.js").read_text("utf-8"),
    )


def _json(value: Any) -> str:
    """JSON inside of a script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def _title(scene: OpenScene | SubjectView, splats: QuantizedSplats) -> str:
    """The title of a scene, or its name."""
    if isinstance(scene, SubjectView):
        return str(
            scene.info.get("source") or ", ".join(layer.name for layer in splats.layers if layer.name) or "splatgl"
        )
    stated = next((name.partition("=")[2] for name in scene.file.annotate if name.startswith("title=")), "")
    return stated or Path(scene.file.volume).name


def _about(scene: OpenScene | SubjectView, page: WebPage, command: str) -> str:
    """Terms and descriptions: error, provenance, command."""
    splats = page.splats
    joined = f", joined from {splats.found:,} voxels" if splats.found > len(splats) else ""
    levels = f"RMSE {page.rmse:.1f} levels of 255 (sRGB) over the first view, against the default method"
    rows = {
        "Difference": f"{levels}, whose picture is shown first and printed. "
        "The page classifies voxels before reconstruction and composites splat by splat.",
        "Splats": f"{len(splats):,}{joined}, quantised",
        "Source": str(scene.info.get("source", "")) if isinstance(scene, SubjectView) else Path(scene.file.volume).name,
        "Layers": ", ".join(layer.name for layer in splats.layers if layer.name) if len(splats.layers) > 1 else "",
        "Notes": "; ".join((*page.notes, *page.image.notes)),
        "Made by": f"splatgl {__version__}",
        "Command": command,
    }
    return "\n".join(f"<dt>{name}</dt><dd>{escape(text)}</dd>" for name, text in rows.items() if text)


def web_shaders(planned: Plan) -> dict[str, list[str]]:
    """Texts of vertex and fragment shaders for WebGL 2: with antialiasing, without it, and of the screen."""
    texts = {
        "screen": [
            compose("whole.vert", {}, is_web=True).source,
            compose("screen.frag", {"OVERLAY": 0}, is_web=True).source,
        ]
    }
    for name, is_on in (("on", True), ("off", False)):
        switches = {**quantized_switches(planned), "ANTIALIAS": is_on}
        stages = ("splat.vert", "splat.frag")
        declared = frozenset[str]().union(*map(declared_switches, stages))
        known = {switch: value for switch, value in switches.items() if switch in declared}
        texts[name] = [compose(stage, known, declared, is_web=True).source for stage in stages]
    return texts


def radial_footprint(kernel: Kernel, count: int = TABLE) -> list[float]:
    """F/F(0) at `count` distances from 0 to R."""
    value = kernel.footprint(np.linspace(0, kernel.radius, count)) / kernel.footprint(np.zeros(()))
    return np.round(value, DIGITS).tolist()


def camera_json(camera: Camera) -> dict[str, Any]:
    """A camera as page.js has it."""
    axes, eye = camera.eye_from_world.tolist(), camera.eye.tolist()
    return {
        "eye": eye,
        "axes": axes,
        "extent": camera.extent,
        "perspective": camera.perspective,
        "size": list(camera.size),
    }


def _described(scene: OpenScene | SubjectView, splats: QuantizedSplats, planned: Plan) -> dict[str, Any]:
    """The scene for page.js, without its splats."""
    outline, camera = planned.splats, scene.camera
    center = outline.corners.mean(axis=0)
    depth = float(camera.eye_from_points(center)[2])
    # an eye within the scene turns about what it looks at
    reach = depth if depth > 0 or not camera.perspective else float(np.ptp(outline.corners, axis=0).max())
    target = camera.eye + camera.forward * max(reach, 1e-6)
    grid, unit, axes = splats.grid, "", "xyz"
    if isinstance(scene, OpenScene):
        unit = scene.volume.unit
    block = frame_block(outline, planned)
    return {
        "count": len(splats),
        "row": QUANTIZED_ROW,
        "classes": CLASSES,
        "step": splats.step,
        "grid": {
            "matrix": grid.world_from_index.tolist(),
            "origin": grid.origin.tolist(),
            "spacing": grid.mean_spacing,
            "last": np.rint(outline.index_bounds[1]).tolist(),
        },
        "frame": {
            "size": FRAME.itemsize,
            "near": float(block["near"]),
            "offsets": {name: int(field[1]) for name, field in (FRAME.fields or {}).items()},
        },
        "style": b64encode(style_block(outline, planned).tobytes()).decode(),
        "footprint": radial_footprint(planned.kernel),
        "layers": [
            {"name": layer.name, "own": layer.own, "table": b64encode(layer.table.astype("<f4").tobytes()).decode()}
            for layer in splats.layers
        ],
        "bars": _bars(scene, splats),
        "letters": list(axes),
        "camera": camera_json(camera),
        "target": target.tolist(),
        "unit": unit,
        "background": None if scene.settings.ground is None else list(scene.settings.ground),
    }


def _bars(scene: OpenScene | SubjectView, splats: QuantizedSplats) -> list[dict[str, Any]]:
    """Colour bars of the layers with values; of a single one, titled by its quantity."""
    bars = []
    for number, layer in enumerate(splats.layers[:MOST_BARS]):
        if layer.own:
            continue
        title = layer.name
        if isinstance(scene, OpenScene) and len(splats.layers) == 1:
            title = scene.annotated_subject.value_name or title
        low, high = layer.span
        if low < high:
            title = title if len(title) <= MOST_LETTERS else f"{title[: MOST_LETTERS - 1]}…"
            ends = {"low": low, "high": high, "first": layer.low, "last": layer.high}
            bars.append({"layer": number, "title": title, "ticks": ticks(low, high, MOST_TICKS), **ends})
    return bars

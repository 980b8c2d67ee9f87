"""A page that turns in a browser: one file with the splats, the shaders of OpenGL in WebGL 2, and the first picture.

What the page draws is drawn here, too, by the same shaders, and compared with the default picture; the page states it.
"""

from __future__ import annotations

import json
from base64 import b64encode
from dataclasses import dataclass, replace
from functools import cached_property
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
from splatgl.exporters.layers import join_layers, layers_of
from splatgl.fileio import format_bytes
from splatgl.geometry.camera import Camera
from splatgl.gl.features import FRAME, frame_block, style_block
from splatgl.gl.passes import QUANTIZED_SWITCHES, draw_quantized
from splatgl.gl.program import splat_switches
from splatgl.gl.shader import compose, declared_switches
from splatgl.planning.plan import Plan, plan
from splatgl.planning.scene import Scene
from splatgl.scene.draw import DrawOptions, SubjectView, draw
from splatgl.scene.open_scene import OpenScene
from splatgl.splat.kernels import radial_table
from splatgl.splat.quantized import CLASSES, QUANTIZED_ROW, JoinedMatter, QuantizedSplats
from splatgl.splat.settings import Settings

# texels along a side of the page's footprint table, as in the paper
TABLE = 256
# digits of numbers in the page; bars that fit over a picture
DIGITS, MOST_BARS = 9, 3


def page_settings(settings: Settings) -> Settings:
    """The settings of a page: the paper's hardware path in half floats, in the scene's light and antialiasing. Raises
    InputError for blends that pages do not have.
    """
    if settings.join not in ("over", "max"):
        raise expected("blend of a page", "composite or mip", settings.blend)
    return settings.replace(
        classification="pre",
        compositing="splats",
        align="ray",
        footprint="table",
        table_bits=16,
        attenuation="opacity",
        antialias="off" if settings.antialias == "off" else "paper",
        technique="quads",
        target="rgba16f",
        order="back-to-front",
        ambient_occlusion=0.0,
        shadows=0.0,
    )


@dataclass(frozen=True, eq=False)
class WebPage:
    """A page of a scene. command: that made it. planned: of what it draws. image: by the default method. pixels: what
    it draws of that view. notes: on what it does not draw.
    """

    scene: OpenScene | SubjectView
    command: str
    matter: JoinedMatter
    splats: QuantizedSplats
    planned: Plan
    image: Image
    pixels: np.ndarray
    notes: tuple[str, ...]

    @classmethod
    def of(cls, scene: OpenScene | SubjectView, how: DrawOptions, most: int, bits: int, command: str) -> WebPage:
        """The page of a scene. most: splats; bits: of values."""
        notes = [
            f"no {name.replace('_', ' ')} but in the first picture"
            for name in ("ambient_occlusion", "shadows")
            if getattr(scene.settings, name)
        ]
        settings = page_settings(scene.settings)
        matter = join_layers(scene, settings, most, notes)
        splats = QuantizedSplats.of(matter, bits)
        # a page draws its own annotations
        bare = replace(scene, file=replace(scene.file, annotate=())) if isinstance(scene, OpenScene) else scene
        image, planned = draw(bare, how), plan(matter.outline, scene.camera, settings)
        with how.renderer() as renderer:
            pixels = draw_quantized(renderer.passes, splats, planned)
        return cls(scene, command, matter, splats, planned, image, pixels, tuple(notes))

    @cached_property
    def rmse(self) -> float:
        """Root mean square difference of both pictures over all pixels, sRGB levels of 255."""
        ground = np.array(self.scene.settings.ground or (0.0, 0.0, 0.0))
        one, two = (over(each, ground) for each in (self.image.pixels, self.pixels))
        return 255 * float(np.sqrt(np.mean((one - two) ** 2)))

    @property
    def is_maximum(self) -> bool:
        """Whether pixels show the largest of their splats."""
        return not self.scene.settings.hides

    @property
    def summary(self) -> str:
        """A line on size and error."""
        size, count = format_bytes(len(self.html.encode())), self.matter.counted(" splats")
        return f"{size}, {count}, RMSE {self.rmse:.1f} levels of 255 from the default picture"

    def __repr__(self) -> str:
        return f"<WebPage: {self.summary}>"

    def _repr_html_(self) -> str:
        """The page in a frame, which notebooks show, and keep when they are saved."""
        style, about = "width: 100%; height: 45rem; border: 0", escape(repr(self))
        return f'<iframe title="{about}" srcdoc="{escape(self.html)}" style="{style}" allowfullscreen></iframe>'

    @cached_property
    def source(self) -> str:
        """The name of the file."""
        if isinstance(self.scene, OpenScene):
            return Path(self.scene.file.volume).name
        return str(self.scene.info.get("source") or "")

    @cached_property
    def html(self) -> str:
        """The text of the page."""
        here, (width, height) = files("splatgl.exporters"), self.scene.camera.size
        names = [layer.name for layer in self.splats.layers if layer.name]
        annotated = self.scene.file.annotate if isinstance(self.scene, OpenScene) else ()
        stated = [name.removeprefix("title=") for name in annotated if name.startswith("title=")]
        title = escape(next(iter(stated), "") or self.source or ", ".join(names) or "splatgl")
        return Template(here.joinpath("page.html").read_text("utf-8")).substitute(
            version=__version__,
            title=title,
            width=width,
            height=height,
            picture=b64encode(self.image.encoded(Path("x.png"), 8, self.scene.settings.ground)).decode(),
            window="" if any(not layer.own for layer in self.splats.layers) else "disabled",
            antialias="" if self.planned.settings.antialias == "off" else "checked",
            about=self._about(names),
            scene=_json(self._described()),
            shaders=_json(web_shaders(self.planned)),
            splats=b64encode(self.splats.packed()).decode(),
            script=here.joinpath("page.js").read_text("utf-8"),
        )

    def _about(self, names: list[str]) -> str:
        """Terms and descriptions: error, provenance, command. names: of the layers."""
        joins = "shows the largest opacity and colour" if self.is_maximum else "composites splat by splat"
        levels = f"RMSE {self.rmse:.1f} levels of 255 (sRGB) over the first view, against the default method"
        rows = {
            "Difference": f"{levels}, whose picture is shown first and printed. "
            f"The page classifies voxels before reconstruction and {joins}.",
            "Splats": self.matter.counted(joined=", joined from ") + ", quantised",
            "Source": self.source,
            "Layers": ", ".join(names) if len(self.splats.layers) > 1 else "",
            "Notes": "; ".join((*self.notes, *self.image.notes)),
            "Made by": f"splatgl {__version__}",
            "Command": self.command,
        }
        return "\n".join(f"<dt>{name}</dt><dd>{escape(text)}</dd>" for name, text in rows.items() if text)

    def _described(self) -> dict[str, Any]:
        """The scene for page.js, without its splats."""
        outline, splats, grid = self.planned.splats, self.splats, self.matter.grid
        camera, ground, layers = self.scene.camera, self.scene.settings.ground, layers_of(self.scene)
        depth = float(camera.eye_from_points(outline.corners.mean(axis=0))[2])
        # an eye within the scene turns about what it looks at
        reach = depth if depth > 0 or not camera.perspective else float(np.ptp(outline.corners, axis=0).max())
        block = frame_block(outline, self.planned)
        return {
            "count": len(splats),
            "row": QUANTIZED_ROW,
            "classes": CLASSES,
            "step": splats.step,
            "maximum": self.is_maximum,
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
            "style": _base64(style_block(outline, self.planned)),
            "footprint": np.round(radial_table(self.planned.kernel, TABLE)[0, :, 0], DIGITS).tolist(),
            "layers": [
                {"name": layer.name, "own": layer.own, "table": _base64(layer.table.astype("<f4"))}
                for layer in splats.layers
            ],
            "bars": self._bars(),
            "letters": [*"xyz"],
            "camera": camera_json(camera),
            "target": (camera.eye + camera.forward * max(reach, 1e-6)).tolist(),
            "unit": layers.world.unit if isinstance(layers, Scene) else "",
            "background": None if ground is None else list(ground),
        }

    def _bars(self) -> list[dict[str, Any]]:
        """Colour bars of the layers with values, titled by their names; that of a single volume, which the heading
        names, by its quantity.
        """
        bars, layers = [], self.splats.layers
        for number, layer in enumerate(layers[:MOST_BARS]):
            title, (low, high) = layer.name, layer.span
            if layer.own or low >= high:
                continue
            if isinstance(self.scene, OpenScene) and len(layers) == 1:
                title = self.scene.annotated_subject.value_name.removeprefix(self.scene.volume.name).strip()
            title = title if len(title) <= MOST_LETTERS else f"{title[: MOST_LETTERS - 1]}…"
            ends = {"low": low, "high": high, "first": layer.low, "last": layer.high}
            bars.append({"layer": number, "title": title, "ticks": ticks(low, high, MOST_TICKS), **ends})
        return bars


def over(pixels: np.ndarray, ground: np.ndarray) -> np.ndarray:
    """sRGB [H, W, 3] from 0 to 1 of linear premultiplied pixels over a background."""
    return srgb_from_linear(np.clip(pixels[..., :3] + (1 - pixels[..., 3:]) * ground, 0, 1))


def _json(value: Any) -> str:
    """JSON inside of a script element."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("</", "<\\/")


def _base64(array: np.ndarray) -> str:
    return b64encode(array.tobytes()).decode()


def web_shaders(planned: Plan) -> dict[str, list[str]]:
    """Texts of vertex and fragment shaders for WebGL 2: with antialiasing, without it, and of the screen."""
    stages = ("splat.vert", "splat.frag")
    declared = frozenset[str]().union(*map(declared_switches, stages))
    switches = {
        name: on for name, on in {**splat_switches(planned.program), **QUANTIZED_SWITCHES}.items() if name in declared
    }

    def texts(antialias: bool) -> list[str]:
        chosen = {**switches, "ANTIALIAS": antialias}
        return [compose(stage, chosen, declared, is_web=True).source for stage in stages]

    screen = [compose(*stage, is_web=True).source for stage in (("whole.vert", {}), ("screen.frag", {"OVERLAY": 0}))]
    return {"screen": screen, "on": texts(True), "off": texts(False)}


def camera_json(camera: Camera) -> dict[str, Any]:
    """A camera as page.js has it."""
    axes, how = camera.eye_from_world.tolist(), {"extent": camera.extent, "perspective": camera.perspective}
    return {"eye": camera.eye.tolist(), "axes": axes, **how, "size": list(camera.size)}

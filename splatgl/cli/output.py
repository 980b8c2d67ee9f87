"""The files of `splatgl render`, and what it prints of pictures: a summary, or JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from splatgl.cli.options import name_of
from splatgl.data.color import srgb_from_linear
from splatgl.data.image import JPEG, MAPS, SAVED, Image, require_library
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source
from splatgl.scene.open_scene import OpenScene
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import FOV
from splatgl.transfer.transfer import EXTENT, Transfer

# points of a transfer function that fit in a line; of more, the first and the last are listed
SHOWN = 3


@dataclass(frozen=True)
class OutputOptions:
    """Files of a picture of a source, and what is printed of it. ref: the picture to compare with. same: whether
    several pictures share camera and look. sheet: file of one picture of all.
    """

    source: str
    output: str | None = None
    bits: int = 8
    json: bool = False
    quiet: bool = False
    depth: str | None = None
    depth_at: float | str | None = None
    ref: str | None = None
    same: bool = False
    sheet: str | None = None

    @property
    def path(self) -> Path:
        """The file of the picture."""
        return Path(self.output or f"{name_of(self.source)}.png")

    @property
    def is_quiet(self) -> bool:
        """Whether neither notes nor progress are printed."""
        return self.quiet or self.json

    def report(self, image: Image, scene: OpenScene) -> str:
        """Text on the rendered picture: JSON, a summary, or nothing."""
        if self.json:
            return as_json(self.source, self.path, image, scene)
        if self.quiet:
            return ""
        return (slice_summary if scene.file.slices else summary)(self.path, image, scene)

    def check(self, files: Sequence[str]) -> None:
        """Raises InputError, before any work, for a picture or depths that cannot be written. files: of the scene."""
        check_output(self.path, SAVED)
        require_library(self.path.suffix.lower())
        check_source(self.path, self.source, *files)
        if self.depth is None:
            if self.depth_at is not None:
                raise expected("--depth-at", "a file for the depths", "none", "add --depth depth.npy")
            return
        path = Path(self.depth)
        check_output(path, MAPS)
        require_library(path.suffix.lower())
        check_source(path, self.source, *files, self.output, self.ref)
        if self.output is not None and path.absolute() == self.path.absolute():
            raise expected("--depth", "another file than -o", str(path))


def summary(output: Path, image: Image, scene: OpenScene) -> str:
    """Lines on size and blend, transfer function, view, and time and accuracy."""
    info, (height, width, _) = image.info, image.pixels.shape
    # without the versions in brackets
    by = str(info["renderer"]).partition(" (")[0]
    wide = info.get("unmasked")
    return "\n".join(
        [
            f"{output}: {width}×{height} pixels, {info['blend']} of {_drawn(image)}{_behind(image, output)}",
            f"transfer function: {_transfer(scene.file, scene.volume, scene.transfer)}",
            f"view: {_view(scene.file, scene.volume, image)}",
            f"time: {info['seconds']:.2f} s by {by}{_cues(image)}",
            f"accuracy: {replace(image, drawn=None).accuracy.summary}",
            *[f"edges next to {wide:,} missing samples may be a voxel too wide, as they are not masked"] * bool(wide),
        ]
    )


def as_json(source: str, output: Path, image: Image, scene: OpenScene) -> str:
    """A line of JSON on a picture."""
    info, camera, transfer = image.info, scene.camera, scene.transfer
    names = ("blend", "background", "splats", "renderer", "seconds", "tolerance", "tolerance_met", "error_bound")
    record: dict[str, object] = {
        "source": source,
        "output": str(output),
        "size": list(image.pixels.shape[1::-1]),
        "dpi": info.get("dpi"),
        **{name: info.get(name) for name in names},
        "triangles": info.get("triangles", 0),
        **{name: info[name] for name in ("slices", "pitch") if name in info},
        "checked": info.get("checked"),
        "camera": {
            "eye": camera.eye.tolist(),
            "forward": camera.forward.tolist(),
            "up": (-camera.eye_from_world[1]).tolist(),
            "perspective": camera.perspective,
            "extent": camera.extent,
        },
        "transfer": {
            **{name: getattr(transfer, name) for name in ("points", "colormap", "window")},
            "length": transfer.length(scene.volume),
        },
        "notes": [*_texts(info.get("notes")), *_texts(info.get("not_annotated"))],
        "error": None,
    }
    return json.dumps(record, allow_nan=False, ensure_ascii=False, default=float)


def _texts(value: object) -> list[str]:
    return [str(text) for text in value] if isinstance(value, list | tuple) else []


def slice_summary(output: Path, image: Image, scene: OpenScene) -> str:
    """Lines on the size and scale of slices, colours, and time."""
    info, (height, width, _) = image.info, image.pixels.shape
    slices, unit = info["slices"], scene.volume.unit or "units"
    count = len(slices) if isinstance(slices, list) else 0
    return "\n".join(
        [
            f"{output}: {width}×{height} pixels, {count} slice{'s' * (count != 1)}{_behind(image, output)}",
            f"colours: {_colors(scene.scene.painter('slice').layers[0].transfer, scene.volume)}",
            f"{info['pitch']:.4g} {unit} a pixel; drawn in {info['seconds']:.2f} s",
        ]
    )


def _drawn(image: Image) -> str:
    splats, triangles = (int(str(image.info.get(name, 0))) for name in ("splats", "triangles"))
    text = [f"{splats:,} splats"] if splats or not triangles else []
    return " and ".join([*text, *([f"{triangles:,} triangles"] if triangles else [])])


def _cues(image: Image) -> str:
    """Text on the time of ambient occlusion and shadows."""
    cues = image.info.get("depth_cues")
    if not isinstance(cues, dict):
        return ""
    return f"; occlusion in {'×'.join(map(str, cues['cells']))} cells took {cues['seconds']:.2f} s"


def _behind(image: Image, output: Path) -> str:
    """Text on the background, if it is visible."""
    color = image.info["background"]
    if isinstance(color, list):
        rgb = "#" + "".join(f"{round(c * 255):02x}" for c in srgb_from_linear(color))
        return " on " + {"#000000": "black", "#ffffff": "white"}.get(rgb, rgb)
    if image.pixels[..., 3].min() == 1:
        return ""
    return " on black, as JPEG has no alpha" if output.suffix.lower() in JPEG else ", transparent around"


def _transfer(scene: SceneFile, volume: Volume, transfer: Transfer) -> str:
    """Text on opacities, colours, their range, and the threshold."""
    if volume.points is not None:
        return f"opacity {transfer.opacity(np.array([1.0]))[0]:g} of a surface of points, in their colours"
    why = ", the mean spacing" if transfer.unit is None else ", by the extent" * (transfer.unit == EXTENT)
    per = f" per {transfer.length(volume):.4g}{' ' * bool(volume.unit)}{volume.unit}{why}"
    if len(volume.channels) > 1:
        return f"channels {', '.join(channel.name for channel in volume.channels)}; opacities{per}"
    if transfer.labels:
        names = {label.number: label.name for label in volume.labels or ()}
        labels = [f"{number} {names.get(number, '')}".strip() + f" {color}" for number, color, _ in transfer.labels]
        more = f", … ({len(labels)})" if len(labels) > SHOWN else ""
        return f"labels {', '.join(labels[:SHOWN])}{more}; opacities{per}"
    points = [f"{opacity:g} at {value:g}" for value, opacity in transfer.points]
    text = ", ".join(points) if len(points) <= SHOWN else f"{points[0]} … {points[-1]} ({len(points)} points)"
    name = scene.transfer.get("preset")
    scaled = "logarithmic " if transfer.logarithmic else ""
    colours = _colors(transfer, volume)
    return (
        (f"preset {name}, " if name else "")
        + f"opacity {text}{per}; {scaled}colours {colours}"
        + ("; weighted by the gradient" if transfer.gradient else "")
        + (f"; regions {', '.join(map(str, transfer.regions))}" if transfer.regions else "")
        + (f"; threshold {scene.threshold:g}" if scene.threshold else "")
    )


def _colors(transfer: Transfer, volume: Volume) -> str:
    """Text on a colour map and the values that it spans."""
    if volume.color is not None:
        return "those of the volume"
    if transfer.labels:
        return f"those of {len(transfer.labels)} labels"
    low, high = transfer.color_range
    of = transfer.colormap if "," not in transfer.colormap else f"{transfer.colormap.count(',') + 1} colours"
    return f"{of} over {low:g} … {high:g}"


def _view(scene: SceneFile, volume: Volume, image: Image) -> str:
    """Text on azimuth and elevation, or the eye, and on other options of the view."""
    view, orbit = scene.view, scene.view.orbit(volume)
    if orbit is not None:
        text = f"azimuth {orbit[0]:g}°, elevation {orbit[1]:g}°"
        text += f", zoom {view.zoom:g}" if view.zoom is not None else ""
    else:
        eye = image.info["eye"]
        text = "from the eye " + (", ".join(f"{x:g}" for x in eye) if isinstance(eye, list) else "")
    if image.info["projection"] == "orthographic":
        return text + ", parallel rays"
    fov = next(fov for fov in (view.fov, volume.hints.fov, FOV) if fov is not None)
    return f"{text}, fov {fov:g}°"

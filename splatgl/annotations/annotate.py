"""`annotated`: draws annotations over an image, `LiveOverlay` over each frame of a view. `ANNOTATIONS`: all kinds."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import numpy as np

import splatgl.annotations as package
from splatgl.annotations.canvas import (
    BLACK,
    AnnotatedSubject,
    Annotation,
    AnnotationView,
    Canvas,
    Rect,
    Touched,
    ink_on,
)
from splatgl.coercion import public
from splatgl.data.color import Color, srgb_from_linear
from splatgl.data.figure import Figure
from splatgl.data.image import Image, density
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.camera import Camera
from splatgl.transfer.transfer import Transfer

# smallest side of an annotated image, pixels
LEAST_SIDE = 64


@public
def annotated(
    image: Image | Any,
    volume: Volume | AnnotatedSubject,
    transfer: Transfer | Any,
    camera: Camera | Any,
    annotate: Sequence[str],
    ground: Color | None = None,
    steady: bool = False,
) -> Image:
    """The image under annotations: "scale", "colorbar", "legend", "axes", "directions", "box", "title=TEXT" and
    "time=TEXT". "scale=20um:bottom-left:4px:white" states the bar's length, corner, thickness and colour.

    ground: linear RGB behind a transparent image, for the colour of text. Letters are 8 points high where the image
    states its dots per inch. steady: places do not depend on the image, as in movies. An X-ray is scaled to its
    maximum. Edges behind the box lie behind a transparent image. info: "annotated", and "not_annotated", the reasons
    for omissions. Raises InputError for unknown names and for images with a side below 64 pixels.
    """
    names = check(annotate)
    height, width = image.pixels.shape[:2]
    check_size(names, (width, height))
    check_time(names)
    blend, scale = str(image.info.get("blend", "")), 1.0
    info, pixels = dict(image.info), image.pixels
    if blend == "xray":
        scale = 1 / image.white
        info |= {"blend": "xray over scale", "scale": scale}
        pixels = pixels * np.float32(scale)
    subject = volume if isinstance(volume, AnnotatedSubject) else AnnotatedSubject.of(volume)
    view = AnnotationView(subject, transfer, camera, blend, pixels, scale)
    layer, behind = (Canvas.over(pixels, ground, density(info)) for _ in range(2))
    compose(replace(layer, picture=None) if steady else layer, view, names)
    draw_behind(behind, view, names)
    figure = Figure(pixels, behind.marks or (), layer.marks or ())
    pixels = pixels + (1 - pixels[..., 3:]) * behind.pixels if behind.marks else pixels
    pixels = layer.pixels + (1 - layer.pixels[..., 3:]) * pixels
    info |= {"annotated": list(names), "not_annotated": list(layer.notes)}
    return replace(image, pixels=pixels.astype(np.float32), info=info, figure=figure)


def on_ground(image: Image, ground: Color | None) -> Image:
    """An annotated image, no sums, over its background, if it was drawn without it for the edges behind the box."""
    names = image.info["annotated"]
    is_over_lines = isinstance(names, list) and any(row.lines for row in _rows(names))
    if ground is None or image.is_sum or image.info.get("background") is not None or not is_over_lines:
        return image
    pixels = image.pixels + (1 - image.pixels[..., 3:]) * np.array([*ground, 1.0], np.float32)
    figure = None if image.figure is None else replace(image.figure, ground=ground)
    return replace(image, pixels=pixels, info={**image.info, "background": list(ground)}, figure=figure)


def omission_notes(image: Image) -> list[str]:
    """Reasons for the missing annotations of an annotated image."""
    notes = image.info["not_annotated"]
    return [str(note) for note in notes] if isinstance(notes, list) else []


def compose(layer: Canvas, view: AnnotationView, names: Sequence[str]) -> None:
    """Draws annotations on an empty canvas, without lines behind the image."""
    rows = _rows(names)
    for row in rows:
        if row.lines is not None:
            row.lines[0](layer, view)
    for row in rows:
        row.draw(layer, replace(view, text=text_of(names, row.name) or ""))


def draw_behind(layer: Canvas, view: AnnotationView, names: Sequence[str]) -> None:
    """Draws the lines behind the image."""
    for row in _rows(names):
        if row.lines is not None:
            row.lines[1](layer, view)


def _rows(names: Sequence[str]) -> list[Annotation]:
    return [row for row in ANNOTATIONS.values() if text_of(names, row.name) is not None]


def default_names(subject: AnnotatedSubject) -> tuple[str, ...]:
    """Annotations of a window by default: scale bar, axes, and directions of a patient."""
    return tuple(row.name for row in ANNOTATIONS.values() if row.default and (subject.frame or not row.needs_frame))


def parse_annotations(text: str) -> tuple[str, ...]:
    """Annotations from a list with commas; a comma before a space is part of a title. Raises InputError as `check`."""
    return check(tuple(part.strip() for part in re.split(r",(?! )", text)))


def check(annotate: Sequence[str]) -> tuple[str, ...]:
    """The annotations. Raises InputError for an unknown one, a repeated one, and a title without text."""
    rows = sorted(ANNOTATIONS.values(), key=lambda row: bool(row.example))
    known = ", ".join(f"'{row.name}={row.example}'" if row.example else row.name for row in rows)
    if isinstance(annotate, str) or not all(isinstance(text, str) for text in annotate):
        raise expected("annotate", f"a list of names: {known}", repr(annotate)[:80])
    names = []
    for request in annotate:
        name, equals, text = request.partition("=")
        row = ANNOTATIONS.get(name)
        if row is None or (equals and not row.example):
            raise expected("annotate", known, repr(request)[:80])
        if not text.strip() and (row.needs_text or equals):
            raise expected("annotate", f"a text after '{name}='", "none", f"such as '{name}={row.example}'")
        if row.check is not None:
            row.check(text.strip())
        names.append(name)
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise expected("annotate", "each name once", f"{repeated[0]} {names.count(repeated[0])} times")
    return tuple(annotate)


def check_size(annotate: Sequence[str], size: tuple[int, int]) -> None:
    """Raises InputError for an image too small for annotations."""
    if annotate and min(size) < LEAST_SIDE:
        option = "measure" if tuple(annotate) == ("measures",) else "annotate"
        fix = f"draw a larger one, or leave --{option} out"
        raise expected(option, f"a picture of at least {LEAST_SIDE}×{LEAST_SIDE}", f"{size[0]}×{size[1]}", fix)


def check_time(annotate: Sequence[str]) -> None:
    """Raises InputError for a time without text, which only movies can fill in."""
    if text_of(annotate, "time") == "":
        raise expected("annotate", "'time=TEXT'", "'time'")


def with_time(annotate: Sequence[str], volume: Volume, number: int) -> tuple[str, ...]:
    """The annotations, with the text of a time point of a volume of several where the time has none."""
    time = f"time={volume.time_text(number)}" if volume.times > 1 else "time"
    return tuple(time if name == "time" else name for name in annotate)


def text_of(annotate: Sequence[str], name: str) -> str | None:
    """Text of an annotation, "" if it has none; None if it is not requested."""
    return next((text.partition("=")[2].strip() for text in annotate if text.partition("=")[0] == name), None)


def _draw_time(layer: Canvas, view: AnnotationView) -> None:
    (width, height), pad, (wide, tall) = layer.size, layer.pad, layer.text_size(view.text)
    if view.text:
        lefts, tops = (pad, width - pad - wide), (pad, height - pad - tall)
        layer.write(view.text, [(left, top) for top in tops for left in lefts], "time")


def _draw_title(layer: Canvas, view: AnnotationView) -> None:
    """Draws the title in the middle of the top, below the time where both do not fit."""
    (width, _), pad, (wide, tall) = layer.size, layer.pad, layer.text_size(view.text)
    lefts = ((width - wide) // 2, pad, width - pad - wide)
    layer.write(view.text, [(left, top) for top in (pad, pad + tall) for left in lefts], "title")


ROWS = (
    Annotation("time", "time", "The time of the volume, in a corner.", _draw_time, 0, example="3h"),
    Annotation("title", "title", "A title, at the top.", _draw_title, 1, example="Head", needs_text=True),
)


_MODULES = [import_module(f"{package.__name__}.{info.name}") for info in iter_modules(package.__path__)]
_ALL: list[Annotation] = [row for module in _MODULES for row in getattr(module, "ROWS", ())]
# the ROWS of all modules of this package by name, by rank
ANNOTATIONS = {row.name: row for row in sorted(_ALL, key=lambda row: row.rank)}
# sizes of the volume's box that a view with a box is fitted to: its numbers lie around it
ROOM = ANNOTATIONS["box"].room


# entries of the table from linear light to sRGB: only the darkest few 8-bit steps are missed
STEPS = 4096
SRGB = np.round(srgb_from_linear(np.arange(STEPS + 1) / STEPS) * 255).astype(np.uint8)


class LiveOverlay:
    """Draws overlays; reuses buffers, text and colour bars of earlier frames."""

    def __init__(self) -> None:
        self.layer: Canvas | None = None
        self.pixels = np.zeros((0, 0, 4), np.uint8)
        self.notes: tuple[str, ...] = ()

    def draw(
        self,
        subject: AnnotatedSubject,
        transfer: Transfer,
        camera: Camera,
        annotate: Sequence[str],
        ground: Color = BLACK,
        blend: str = "composite",
        above: int = 0,
    ) -> np.ndarray:
        """uint8 [H, W, 4], sRGB with straight alpha, of the camera's size; valid until the next call. above: the height
        of a text at the upper left that stays free, pixels.

        annotate: names as of `annotated`. ground: linear RGB behind the image, for the colour of text. Sets `notes`,
        the reasons for omissions. Edges behind the box are dashed; X-rays have no colour bar. Raises InputError for
        unknown names.
        """
        names, layer = check(annotate), self._cleared(camera.size, ground)
        layer.taken.extend([Rect(0, 0, layer.pad + 1, above)] * (above > 0))
        view = AnnotationView(subject, transfer, camera, blend)
        draw_behind(layer, view, names)
        compose(layer, view, names)
        self.notes = tuple(layer.notes)
        for part in layer.touched:
            _encode(layer.pixels, self.pixels, part)
        return self.pixels

    def _cleared(self, size: tuple[int, int], ground: Color) -> Canvas:
        ink = ink_on(np.asarray(ground))
        if self.layer is None or self.layer.size != size:
            self.layer = Canvas(np.zeros((size[1], size[0], 4), np.float32), ink)
            self.pixels = np.zeros((size[1], size[0], 4), np.uint8)
            return self.layer
        for part in self.layer.touched:
            for buffer in (self.layer.pixels, self.pixels):
                if isinstance(part, np.ndarray):
                    buffer.reshape(-1, 4)[part] = 0
                else:
                    rect = part[0] if isinstance(part, tuple) else part
                    buffer[rect.top : rect.bottom, rect.left : rect.right] = 0
        self.layer = Canvas(self.layer.pixels, ink, scratch=self.layer.scratch)
        return self.layer


def _encode(linear: np.ndarray, coded: np.ndarray, part: Touched) -> None:
    if isinstance(part, np.ndarray):
        coded.reshape(-1, 4)[part] = _srgb(linear.reshape(-1, 4)[part])
        return
    rect, patch = part if isinstance(part, tuple) else (part, None)
    place = (slice(rect.top, rect.bottom), slice(rect.left, rect.right))
    coded[place] = _srgb(linear[place]) if patch is None else _srgb_of_patch(_Patch(patch))


@dataclass(frozen=True)
class _Patch:
    """A patch, hashed by its identity: texts and bars are cached arrays."""

    pixels: np.ndarray = field(compare=False)
    number: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "number", id(self.pixels))


@lru_cache(maxsize=256)
def _srgb_of_patch(patch: _Patch) -> np.ndarray:
    return _srgb(patch.pixels)


def _srgb(linear: np.ndarray) -> np.ndarray:
    """uint8 sRGB with straight alpha of linear, premultiplied pixels [..., 4]."""
    alpha = linear[..., 3:]
    straight = linear[..., :3] * (STEPS / np.maximum(alpha, 1e-6))
    shades = SRGB[np.minimum(straight + 0.5, STEPS).astype(np.int16)]
    return np.concatenate([shades, (alpha * 255 + 0.5).astype(np.uint8)], axis=-1)

"""`annotated`: draws the annotations that are asked for over an image. Its check boxes: `panel_sections.OVER`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from splatgl.annotations import axes, bounding_box, color_bar, scale_bar
from splatgl.annotations.canvas import Canvas, Color, Rect, Subject
from splatgl.annotations.color_bar import ColorBar
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.transfer import Transfer


def annotated(
    image: Image,
    volume: Volume | Subject,
    transfer: Transfer,
    camera: Camera,
    annotate: Sequence[str],
    ground: Color | None = None,
    steady: bool = False,
) -> Image:
    """The picture under annotations: "scale", "colorbar", "axes", "directions", "box", "title=TEXT", "time=TEXT".

    ground: linear RGB that a transparent picture will lie on, for the colour of text. steady: places do not depend on
    what the picture shows, as in movies. An X-ray is scaled to its maximum. Edges behind the box lie behind what a
    transparent picture shows. info: "annotated", and "not_annotated", the reasons of what is left out. InputError for
    unknown names and for pictures with a side below 64 pixels.
    """
    asked = check(annotate)
    height, width = image.pixels.shape[:2]
    check_size(asked, (width, height))
    check_time(asked)
    blend, info, pixels = str(image.info.get("blend", "")), dict(image.info), image.pixels
    if blend == "xray":
        scale = 1 / (float(pixels.max()) or 1.0)
        info |= {"blend": "xray over scale", "scale": scale}
        pixels = pixels * np.float32(scale)
    subject = volume if isinstance(volume, Subject) else Subject.of(volume)
    layer = Canvas.over(pixels, ground)
    bars = _bars(layer, subject, transfer, pixels, info) if "colorbar" in asked else []
    compose(replace(layer, picture=None) if steady else layer, subject, camera, asked, bars)
    if "box" in asked:
        behind = Canvas.over(pixels, ground)
        bounding_box.draw_behind(behind, subject, camera)
        pixels = pixels + (1 - pixels[..., 3:]) * behind.pixels
    over = layer.pixels + (1 - layer.pixels[..., 3:]) * pixels
    return Image(over.astype(np.float32), {**info, "annotated": list(asked), "not_annotated": list(layer.notes)})


def on_ground(image: Image, ground: Color | None) -> Image:
    """An annotated picture that was drawn without its background, on it."""
    if ground is None or image.info.get("background") is not None or "box" not in _names(image):
        return image
    pixels = image.pixels + (1 - image.pixels[..., 3:]) * np.array([*ground, 1.0], np.float32)
    return Image(pixels, {**image.info, "background": list(ground)})


def _names(image: Image) -> list[str]:
    names = image.info["annotated"]
    return [str(name) for name in names] if isinstance(names, list) else []


def compose(layer: Canvas, subject: Subject, camera: Camera, asked: Sequence[str], bars: Sequence[ColorBar]) -> None:
    """Draws what is asked for on an empty layer, but for edges behind the box."""
    if "box" in asked:
        bounding_box.draw_edges(layer, subject, camera)
    _write(layer, text_of(asked, "time"), text_of(asked, "title"))
    for bar in bars:
        color_bar.draw(layer, bar)
    if "scale" in asked:
        scale_bar.draw(layer, subject, camera)
    if "axes" in asked:
        axes.draw_triad(layer, camera)
    if "directions" in asked:
        axes.draw_directions(layer, subject, camera)
    if "box" in asked:
        bounding_box.draw_numbers(layer, subject, camera)


def left_out(image: Image) -> list[str]:
    """Why annotations of an annotated picture are not there."""
    notes = image.info["not_annotated"]
    return [str(note) for note in notes] if isinstance(notes, list) else []


def _write(layer: Canvas, time: str | None, title: str | None) -> None:
    """The time in a corner, and the title in the middle, below the time where both don't fit; where nothing is."""
    (width, height), pad = layer.size, layer.pad
    for what, text in (("time", time), ("title", title)):
        if not text:
            continue
        wide, tall = layer.text_size(text)
        lefts = [pad, width - pad - wide] if what == "time" else [(width - wide) // 2, pad, width - pad - wide]
        tops = [pad, height - pad - tall] if what == "time" else [pad, pad + tall]
        rect = layer.place([Rect(x, y, x + wide, y + tall) for y in tops for x in lefts], what)
        if rect is not None:
            layer.text(text, rect.left, rect.top)


def _bars(
    layer: Canvas, subject: Subject, transfer: Transfer, pixels: np.ndarray, info: dict[str, object]
) -> list[ColorBar]:
    """The colour bars of a picture, of its volume and of meshes; none, with a note, if there are none."""
    of_meshes = scale_bars(subject, layer.size[1])
    if subject.empty and of_meshes:
        return of_meshes
    bar = _bar(layer, subject, transfer, pixels, info)
    return of_meshes if bar is None else [bar, *of_meshes]


def scale_bars(subject: Subject, height: int) -> list[ColorBar]:
    """The colour bars of meshes in a picture of that height."""
    return [color_bar.of_scale(each, round(color_bar.TALL * height)) for each in subject.scales]


def _bar(
    layer: Canvas, subject: Subject, transfer: Transfer, pixels: np.ndarray, info: dict[str, object]
) -> ColorBar | None:
    """The colour bar of a volume; None, with a note, if there is none."""
    blend, rows = str(info.get("blend", "")), round(color_bar.TALL * layer.size[1])
    if blend.startswith("xray") and not subject.colored:
        bar = color_bar.of_sums(pixels, float(str(info["scale"])), rows)
    else:
        bar = bar_of(subject, transfer, blend, rows)
    if bar is None:
        why = "the voxels have colours of their own" if subject.colored else "there is one value only"
        layer.notes.append(f"no colour bar: {why}")
    return bar


def bar_of(subject: Subject, transfer: Transfer, blend: str, rows: int) -> ColorBar | None:
    """The colour bar of values; None for volumes with colours, and one value."""
    return None if subject.colored else color_bar.of_values(transfer, subject.value_name, blend, rows)


NAMES = ("scale", "colorbar", "axes", "directions", "box", "title", "time")
# those that take a text
TEXTS = ("title", "time")
KNOWN = "scale, colorbar, axes, directions, box, title=TEXT, time"
# sizes of the box that a view is fitted to: its numbers lie around it
ROOM = 1.25
# smallest side of a picture, in pixels
LEAST_SIDE = 64


def parsed(text: str) -> tuple[str, ...]:
    """The annotations in a list; a comma that a space follows belongs to a title. InputError as `check`."""
    return check(tuple(part.strip() for part in re.split(r",(?! )", text)))


def check(asked: Sequence[str]) -> tuple[str, ...]:
    """The annotations asked for. InputError for an unknown one, a repeated one, and a title without text."""
    if isinstance(asked, str) or not all(isinstance(one, str) for one in asked):
        raise expected("annotate", f"a list of names: {KNOWN}", repr(asked)[:80])
    names = []
    for one in asked:
        name, equals, text = one.partition("=")
        if name not in NAMES or (equals and name not in TEXTS):
            raise expected("annotate", KNOWN, repr(one)[:80])
        if not text.strip() and (name == "title" or equals):
            raise expected("annotate", f"a text after '{name}='", "none", f"such as '{name}={EXAMPLES[name]}'")
        names.append(name)
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise expected("annotate", "each name once", f"{twice[0]} {names.count(twice[0])} times")
    return tuple(asked)


EXAMPLES = {"title": "Head", "time": "3h"}


def check_size(asked: Sequence[str], size: tuple[int, int]) -> None:
    """InputError for a picture too small for annotations."""
    if asked and min(size) < LEAST_SIDE:
        fix = "draw a larger one, or leave --annotate out"
        raise expected("annotate", f"a picture of at least {LEAST_SIDE}×{LEAST_SIDE}", f"{size[0]}×{size[1]}", fix)


def text_of(asked: Sequence[str], name: str) -> str | None:
    """The text given with an annotation, "" if none; None if it is not asked for."""
    return next((one.partition("=")[2].strip() for one in asked if one.partition("=")[0] == name), None)


def check_time(asked: Sequence[str]) -> None:
    """InputError for a time without text: a still picture has none of its own."""
    if text_of(asked, "time") == "":
        raise expected("annotate", "'time=TEXT'", "'time'")

"""`annotated`: a picture with annotations laid over it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from splatgl.app.annotations import axes, color_bar, scale_bar
from splatgl.app.annotations.layer import Color, Layer, Rect
from splatgl.app.annotations.request import check, check_size, check_time, text_of
from splatgl.app.annotations.subject import Subject
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.view.camera import Camera


def annotated(
    image: Image,
    volume: Volume | Subject,
    transfer: Transfer,
    camera: Camera,
    annotate: Sequence[str],
    ground: Color | None = None,
) -> Image:
    """The picture under annotations: "scale", "colorbar", "axes", "directions", "title=TEXT", "time=TEXT".

    ground: linear RGB that a transparent picture will lie on, for the colour of text. An X-ray is scaled to its
    maximum. info: "annotated", and "not_annotated", the reasons of what is left out. InputError for unknown names
    and for pictures with a side below 64 pixels.
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
    layer, subject = Layer.over(pixels, ground), volume if isinstance(volume, Subject) else Subject.of(volume)
    _write(layer, text_of(asked, "time"), text_of(asked, "title"))
    if "colorbar" in asked:
        _colors(layer, subject, transfer, pixels, info)
    if "scale" in asked:
        scale_bar.draw(layer, subject, camera)
    if "axes" in asked:
        axes.draw_triad(layer, camera)
    if "directions" in asked:
        axes.draw_directions(layer, subject, camera)
    over = layer.pixels + (1 - layer.pixels[..., 3:]) * pixels
    return Image(over.astype(np.float32), {**info, "annotated": list(asked), "not_annotated": list(layer.notes)})


def left_out(image: Image) -> list[str]:
    """Why annotations of an annotated picture are not there."""
    notes = image.info["not_annotated"]
    return [str(note) for note in notes] if isinstance(notes, list) else []


def _write(layer: Layer, time: str | None, title: str | None) -> None:
    """The time at the upper left, and the title in the middle, below the time where both don't fit."""
    top = layer.pad
    for what, text in (("time", time), ("title", title)):
        if not text:
            continue
        wide, tall = layer.text_size(text)
        left = layer.pad if what == "time" else (layer.size[0] - wide) // 2
        rect = Rect(left, top, left + wide, top + tall)
        if any(rect.meets(other) for other in layer.taken):
            rect = Rect(left, top + tall, left + wide, top + 2 * tall)
        if layer.reserve(rect, what):
            layer.text(text, rect.left, rect.top)


def _colors(layer: Layer, subject: Subject, transfer: Transfer, pixels: np.ndarray, info: dict[str, object]) -> None:
    rows = round(color_bar.TALL * layer.size[1])
    if subject.colored:
        layer.notes.append("no colour bar: the voxels have colours of their own")
        return
    if str(info.get("blend", "")).startswith("xray"):
        bar = color_bar.of_sums(pixels, float(str(info["scale"])), rows)
    else:
        bar = color_bar.of_values(transfer, subject.name, str(info.get("blend", "")), rows)
    if bar is None:
        layer.notes.append("no colour bar: there is one value only")
        return
    color_bar.draw(layer, bar)

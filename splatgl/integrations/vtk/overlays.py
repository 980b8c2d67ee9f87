"""Draws what VTK lays over a picture, scalar bars and texts, and ends pictures of sums as VTK does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from splatgl.annotations.canvas import BLACK, Canvas, Rect
from splatgl.data.color import Color, linear_from_srgb, srgb_from_linear
from splatgl.data.image import Image
from splatgl.integrations.vtk.scene import DRAWN_OVER, items, list_differences, renderer_of
from splatgl.scene.mixing import LINEAR
from splatgl.splat.settings import BLENDS

# VTK's orientation of an upright bar
UPRIGHT = 1
# VTK's coordinate systems of the display, of pixels of a viewport, and of its shares
DISPLAY, VIEWPORT, SHARES = 0, 2, 3
# places of the eight texts of a vtkCornerAnnotation: shares of the free width from the left and height from the top
CORNERS = ((0.0, 1.0), (1.0, 1.0), (0.0, 0.0), (1.0, 0.0), (0.5, 1.0), (1.0, 0.5), (0.0, 0.5), (0.5, 0.0))
# height of a corner's text before its scaling, as a share of the picture's smaller side
CORNER_TEXT = 0.2
# smallest font, pixels; margin of a corner, pixels; share of a bar's thickness left to its colours
LEAST_FONT, MARGIN, BAR = 6, 5, 0.375


def finish(image: Image, x: Any, background: Color | None) -> Image:
    """The picture of a plotter with its scalar bars and texts; sums become grey display values, as VTK shows them.

    info["notes"] lists the differences from the plotter's own picture.
    """
    pixels, info = (
        image.pixels,
        {**image.info, "notes": (*list_differences(x, str(image.info.get("mixing", LINEAR))), *image.notes)},
    )
    if BLENDS[str(info["blend"])].unbounded:
        pixels, info = _gray_sums(pixels, background), {**info, "blend": "additive"}
    canvas = Canvas(np.zeros_like(pixels), BLACK)
    for prop in items(renderer_of(x).GetViewProps()):
        if prop.GetVisibility():
            _draw(canvas, prop, renderer_of(x))
    return replace(image, pixels=canvas.pixels + (1 - canvas.pixels[..., 3:]) * pixels, info=info)


def _gray_sums(pixels: np.ndarray, background: Color | None) -> np.ndarray:
    """Sums [H, W, 4] as linear light of display values from 0 to 1, over the background or black."""
    shares = np.clip(pixels[..., 3:], 0.0, 1.0)
    values = shares + (1 - shares) * srgb_from_linear(np.array(background or BLACK))
    return np.concatenate([linear_from_srgb(values), np.ones_like(shares)], axis=2).astype(np.float32)


def _draw(canvas: Canvas, prop: Any, renderer: Any) -> None:
    """Draws a prop if it is a scalar bar or a text."""
    kind = next((kind for kind in DRAWN_OVER if prop.IsA(kind)), "")
    if kind == "vtkScalarBarActor":
        _draw_bar(canvas, prop)
    elif kind == "vtkCornerAnnotation":
        for number, place in enumerate(CORNERS):
            if prop.GetText(number):
                _write_corner(canvas, prop, str(prop.GetText(number)), place)
    elif kind == "vtkTextActor" and prop.GetInput():
        looks, at = prop.GetTextProperty(), prop.GetPositionCoordinate()
        x, y = _place(at, renderer, canvas.size)
        pen = _pen(canvas, looks.GetFontSize(), looks)
        lines = str(prop.GetInput()).split("\n")
        wide = max(pen.text_size(line)[0] for line in lines)
        tall = pen.text_size(lines[0])[1]
        left = x - (0.0, 0.5, 1.0)[looks.GetJustification()] * wide
        top = canvas.size[1] - y - (1.0, 0.5, 0.0)[looks.GetVerticalJustification()] * tall * len(lines)
        for number, line in enumerate(lines):
            pen.text(line, round(left), round(top) + number * tall)


def _place(at: Any, renderer: Any, size: tuple[int, int]) -> tuple[float, float]:
    """Place of a text in pixels from the left and the bottom of a picture of `size`."""
    x, y = at.GetValue()[:2]
    if at.GetCoordinateSystem() == SHARES:
        return x * size[0], y * size[1]
    wide, tall = renderer.GetSize()
    if at.GetCoordinateSystem() not in (DISPLAY, VIEWPORT):
        x, y = at.GetComputedDisplayValue(renderer)
    # places are in the pixels of the plotter
    return (x * size[0] / wide, y * size[1] / tall) if wide and tall else (x, y)


def _write_corner(canvas: Canvas, prop: Any, text: str, place: tuple[float, float]) -> None:
    """Writes a text of a vtkCornerAnnotation in the size that VTK would choose."""
    free = CORNER_TEXT * min(canvas.size)
    size = free ** prop.GetNonlinearFontScaleFactor() * prop.GetLinearFontScaleFactor()
    pen, lines = _pen(canvas, min(size, prop.GetMaximumFontSize()), prop.GetTextProperty()), text.split("\n")
    tall = pen.text_size(lines[0])[1]
    for number, line in enumerate(lines):
        left = MARGIN + place[0] * (canvas.size[0] - 2 * MARGIN - pen.text_size(line)[0])
        top = MARGIN + place[1] * (canvas.size[1] - 2 * MARGIN - tall * len(lines)) + number * tall
        pen.text(line, round(left), round(top))


def _pen(canvas: Canvas, height: float, looks: Any) -> Canvas:
    """The canvas with a font and a colour. looks: vtkTextProperty."""
    red, green, blue = linear_from_srgb(np.clip(looks.GetColor(), 0.0, 1.0)).tolist()
    return replace(canvas, ink=(red, green, blue), font=max(LEAST_FONT, round(height)))


def _draw_bar(canvas: Canvas, bar: Any) -> None:
    """Draws a scalar bar in the box that VTK gives it: its colours, with numbers and title beside or above."""
    if bar.GetLookupTable() is None:
        return
    (width, height), (x, y) = canvas.size, bar.GetPosition()
    left, bottom = round(x * width), round((1 - y) * height)
    wide, tall = round(bar.GetWidth() * width), round(bar.GetHeight() * height)
    pen = _pen(canvas, bar.GetLabelTextProperty().GetFontSize(), bar.GetLabelTextProperty())
    title, line = str(bar.GetTitle() or ""), pen.text_size("0")[1]
    shares = np.linspace(0.0, 1.0, max(bar.GetNumberOfLabels(), 2))
    # a format of C, or from VTK 9.6 on of std::format
    write = bar.GetLabelFormat().format if "{" in bar.GetLabelFormat() else bar.GetLabelFormat().__mod__
    texts = [write(value).strip() for value in _values(bar.GetLookupTable(), shares).tolist()]
    if bar.GetOrientation() == UPRIGHT:
        long, thick = tall - line * bool(title), max(2, round(BAR * wide))
        colors = _colors(bar.GetLookupTable(), long)[::-1, None]
        rect = Rect(left, bottom - long, left + thick, bottom)
        for share, text in zip(shares.tolist(), texts, strict=True):
            pen.text(text, rect.right + 2, round(bottom - share * long - line / 2))
        pen.text(title, left, rect.top - line - line // 2)
    else:
        thick = max(2, round(BAR * tall))
        colors = _colors(bar.GetLookupTable(), wide)[None]
        rect = Rect(left, bottom - thick, left + wide, bottom)
        for share, text in zip(shares.tolist(), texts, strict=True):
            pen.text(text, round(left + share * wide - pen.text_size(text)[0] / 2), rect.top - line)
        pen.text(title, round(left + (wide - pen.text_size(title)[0]) / 2), rect.top - 2 * line)
    shape = rect.bottom - rect.top, rect.right - rect.left
    canvas.blend_mask(np.ones(shape, np.float32), np.broadcast_to(colors, (*shape, 3)), (rect.left, rect.top))


def _values(table: Any, shares: np.ndarray) -> np.ndarray:
    """Values at shares [N] of the range of a colour table."""
    low, high = table.GetRange()
    if getattr(table, "UsingLogScale", bool)() and low > 0:
        return np.asarray(low * (high / low) ** shares)
    return np.asarray(low + shares * (high - low))


def _colors(table: Any, count: int) -> np.ndarray:
    """Linear RGB [N, 3] of a colour table from its least to its largest value."""
    colors = np.zeros((count, 3))
    for number, value in enumerate(_values(table, (np.arange(count) + 0.5) / count).tolist()):
        rgb = [0.0, 0.0, 0.0]
        table.GetColor(value, rgb)
        colors[number] = rgb
    return linear_from_srgb(colors)

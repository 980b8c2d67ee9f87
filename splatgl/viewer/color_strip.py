"""`ColorStrip`: the colours of values, and their colour points, which the mouse adds, moves, recolours and removes.
Extra `gui`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from imgui_bundle import imgui

from splatgl.data.color import srgb_from_linear
from splatgl.transfer.transfer import Transfer
from splatgl.transfer.transfer_nodes import ColorPoints, color_points, with_color_points

# number of colours in the strip; radius of a point at a content scale of 1, screen units
COLORS, POINT = 64, 5.0
PICKER = "##color of a value"
HINT = "double click for a colour here; click a point to recolour it; drag moves, right click or ctrl+click removes"
# values with their opacities or colours, in order
Points = Sequence[Any]


def code_of(color: np.ndarray | list[float]) -> str:
    """#rrggbb of sRGB from 0 to 1."""
    return "#" + bytes(np.rint(255 * np.clip(color, 0.0, 1.0)).astype(np.uint8)).hex()


def move_point(points: Points, number: int, value: float, other: float | str) -> Points:
    """The points with one at another value, between its neighbours. other: its opacity or colour."""
    low = points[number - 1][0] if number else -np.inf
    high = points[number + 1][0] if number + 1 < len(points) else np.inf
    return (*points[:number], (float(np.clip(value, low, high)), other), *points[number + 1 :])


def add_point(points: Points, value: float, other: float | str) -> tuple[Points, int]:
    """The points with one more, and its number."""
    number = int(np.searchsorted([value for value, _ in points], value))
    return (*points[:number], (value, other), *points[number:]), number


def remove_point(points: Points, number: int) -> Points:
    """The points without one; the last one is never removed."""
    return points if len(points) == 1 else (*points[:number], *points[number + 1 :])


class ColorStrip:
    """Draws the strip and holds what outlasts a frame."""

    def __init__(self) -> None:
        # the drawn colours, and their key
        self.colored: object = None
        self.colors: list[imgui.ImVec4] = []
        # points as they were edited, and the transfer function that has them: text would round them in each frame
        self.made: Transfer | None = None
        self.points: ColorPoints = ()
        # the point whose colour is picked, and whether the held one was moved
        self.picked, self.moved = 0, False

    def draw(self, transfer: Transfer, span: tuple[float, float], room: tuple[float, float], high: float) -> Transfer:
        """The strip; returns the edited transfer function. span: values at its ends; room: its left end and width,
        screen units; high: its height.
        """
        top = imgui.get_cursor_screen_pos().y
        self._paint(transfer, span, room, (top, high))
        points = self.points if transfer == self.made else color_points(transfer)
        edited = self._edit_points(points, span, room, (top, high))
        imgui.set_cursor_screen_pos((room[0], top))
        imgui.invisible_button("##colors", (room[1], high))
        if imgui.is_item_hovered():
            value = _value_at(imgui.get_mouse_pos().x, span, room)
            imgui.set_tooltip(f"{value:.4g}\n{HINT}")
            if edited is points and imgui.is_mouse_double_clicked(imgui.MouseButton_.left):
                color = srgb_from_linear(np.clip(transfer.color(np.array(value)), 0.0, 1.0))
                edited, _ = add_point(points, value, code_of(color))
        edited = self._pick(edited, span)
        if edited is points:
            return transfer
        self.made, self.points = with_color_points(transfer, edited), edited
        return self.made

    def _paint(
        self, transfer: Transfer, span: tuple[float, float], room: tuple[float, float], rows: tuple[float, float]
    ) -> None:
        """Draws the colours. rows: the strip's top and height."""
        if (transfer, span) != self.colored:
            values = span[0] + (np.arange(COLORS) + 0.5) / COLORS * (span[1] - span[0])
            colors = srgb_from_linear(np.clip(transfer.color(values), 0.0, 1.0))
            self.colors = [imgui.ImVec4(*(float(part) for part in (*rgb, 1.0))) for rgb in colors]
            self.colored = transfer, span
        pen, step = imgui.get_window_draw_list(), room[1] / COLORS
        for number, color in enumerate(self.colors):
            left = room[0] + number * step
            corners = imgui.ImVec2(left, rows[0]), imgui.ImVec2(left + step + 1, rows[0] + rows[1])
            pen.add_rect_filled(*corners, int(imgui.get_color_u32(color)))

    def _edit_points(
        self, points: ColorPoints, span: tuple[float, float], room: tuple[float, float], rows: tuple[float, float]
    ) -> ColorPoints:
        """The points after mouse input; draws those within the span."""
        radius, edited = POINT * imgui.get_style().font_scale_main, points
        for number, (value, code) in enumerate(points):
            place = room[0] + (value - span[0]) / (span[1] - span[0]) * room[1]
            if not room[0] <= place <= room[0] + room[1]:
                continue
            imgui.set_cursor_screen_pos((place - radius, rows[0]))
            imgui.invisible_button(f"##color {number}", (2 * radius, rows[1]))
            self._mark(place, rows[0] + rows[1] / 2, radius, code)
            if edited is points:
                edited = self._edit_point(points, number, span, room)
        return edited

    def _edit_point(
        self, points: ColorPoints, number: int, span: tuple[float, float], room: tuple[float, float]
    ) -> ColorPoints:
        """The points after input to the last widget, one of them."""
        removes = imgui.is_item_clicked(imgui.MouseButton_.right)
        removes |= imgui.get_io().key_ctrl and imgui.is_item_clicked(imgui.MouseButton_.left)
        if removes:
            return remove_point(points, number)
        if imgui.is_item_activated():
            self.moved = False
        if imgui.is_item_active() and imgui.is_mouse_dragging(imgui.MouseButton_.left):
            self.moved = True
            return move_point(points, number, _value_at(imgui.get_mouse_pos().x, span, room), points[number][1])
        if imgui.is_item_deactivated() and not self.moved:
            self.picked = number
            imgui.open_popup(PICKER)
        if imgui.is_item_hovered():
            imgui.set_tooltip(f"{points[number][0]:.5g}: {points[number][1]}")
        return points

    def _mark(self, x: float, y: float, radius: float, code: str) -> None:
        pen = imgui.get_window_draw_list()
        rgb = [part / 255 for part in bytes.fromhex(code[1:])]
        for size, color in ((radius, (0.0, 0.0, 0.0)), (radius - 1, (1.0, 1.0, 1.0)), (radius - 2, tuple(rgb))):
            pen.add_circle_filled(imgui.ImVec2(x, y), size, int(imgui.get_color_u32(imgui.ImVec4(*color, 1.0))))

    def _pick(self, points: ColorPoints, span: tuple[float, float]) -> ColorPoints:
        """The points after input to the picker of a colour and its value, if it is open."""
        if not imgui.begin_popup(PICKER):
            return points
        number = min(self.picked, len(points) - 1)
        rgb = [part / 255 for part in bytes.fromhex(points[number][1][1:])]
        changed, color = imgui.color_picker3("##color", rgb, imgui.ColorEditFlags_.no_side_preview)
        if changed:
            points = move_point(points, number, points[number][0], code_of(list(color)))
        moved, value = imgui.drag_float("value", points[number][0], (span[1] - span[0]) / (4 * COLORS), format="%.5g")
        points = move_point(points, number, value, points[number][1]) if moved else points
        if imgui.button("one more"):
            following = points[number + 1][0] if number + 1 < len(points) else span[1]
            points, _ = add_point(points, (points[number][0] + following) / 2, points[number][1])
        imgui.set_item_tooltip("Adds a point of this colour, halfway to the next one.")
        imgui.same_line()
        if imgui.button("remove"):
            points = remove_point(points, number)
            imgui.close_current_popup()
        imgui.end_popup()
        return points


def _value_at(x: float, span: tuple[float, float], room: tuple[float, float]) -> float:
    """The value at a place of the screen."""
    return float(span[0] + np.clip((x - room[0]) / room[1], 0.0, 1.0) * (span[1] - span[0]))

"""`PresetGallery`: the presets as pictures of the open volume; `TransferShift`: moves a transfer function along the
values. Extra `gui`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from imgui_bundle import imgui

from splatgl.data.volume import Volume, subsample
from splatgl.gl.context import current
from splatgl.gl.renderer import Renderer
from splatgl.planning.scene import Layer, Scene
from splatgl.transfer.presets import PRESETS, build_transfer, grouped_presets
from splatgl.transfer.statistics import Statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.panel_sections import label_left, show_tip
from splatgl.viewer.thumbnails import MOST_VOXELS, draw_small, reduce_volume
from splatgl.viewer.trackball import Pose

# side of a picture at a content scale of 1, screen units; its pixels; pictures in a row
SIDE, PIXELS, PER_ROW = 84.0, 96, 3
EDITED = "(edited)"


class PresetGallery:
    """A list of presets. is_open: whether the list is shown, so that pictures are wanted."""

    def __init__(self) -> None:
        self.volume: Volume | None = None
        self.transfers: dict[str, Transfer] = {}
        # the volume of the pictures, by whether they are quick ones
        self.small: dict[bool, Volume] = {}
        # names of presets whose pictures are to be drawn, quick ones first, and the textures of those that are
        self.missing: list[tuple[str, bool]] = []
        self.textures: dict[str, Any] = {}
        self.is_open = False

    def draw(self, transfer: Transfer, volume: Volume, stats: Statistics) -> Transfer:
        """The list, with the active preset marked; returns the chosen transfer function. stats: of the volume."""
        if volume is not self.volume:
            self._begin(volume, stats)
        active = next((name for name, each in self.transfers.items() if each == transfer), EDITED)
        was_open = self.is_open
        self.is_open = imgui.begin_combo(label_left("preset"), active, imgui.ComboFlags_.height_largest)
        show_tip("Opacities and colours for a kind of data.")
        if not self.is_open:
            return transfer
        if not was_open:
            # from the view that is shown now
            self.missing = [(name, is_quick) for is_quick in (True, False) for name in self.transfers]
        for title, names in grouped_presets().items():
            imgui.separator_text(title)
            for number, name in enumerate(names):
                if number % PER_ROW:
                    imgui.same_line()
                if self._draw_picture(name, name == active):
                    transfer = self.transfers[name]
                    imgui.close_current_popup()
        imgui.end_combo()
        return transfer

    def _draw_picture(self, name: str, active: bool) -> bool:
        """A button with the picture of a preset and its name; whether it is clicked."""
        side = SIDE * imgui.get_style().font_scale_main
        imgui.begin_group()
        if active:
            imgui.push_style_color(imgui.Col_.button, imgui.get_style_color_vec4(imgui.Col_.check_mark))
        texture = self.textures.get(name)
        if texture is None:
            clicked = imgui.button(f"##{name}", (side, side))
        else:
            padding = imgui.get_style().frame_padding
            size = imgui.ImVec2(side - 2 * padding.x, side - 2 * padding.y)
            clicked = imgui.image_button(f"##{name}", imgui.ImTextureRef(texture.glo), size)
        if active:
            imgui.pop_style_color()
            if imgui.is_window_appearing():
                imgui.set_scroll_here_y()
        # longer names stand in two lines
        text = name if imgui.calc_text_size(name).x <= side else "-\n".join(name.rsplit("-", 1))
        top, below = imgui.get_item_rect_min().y, imgui.get_item_rect_max().y
        show_tip(
            PRESETS[name].about,
            around=(top, below + imgui.get_text_line_height_with_spacing() + imgui.calc_text_size(text).y),
        )
        imgui.text(text)
        imgui.end_group()
        return clicked

    def _begin(self, volume: Volume, stats: Statistics) -> None:
        """Starts with another volume."""
        self.volume, self.small, self.missing = volume, {}, []
        self.transfers = {name: build_transfer(each, stats, volume) for name, each in PRESETS.items()}
        self.close()

    def render_next(self, renderer: Renderer, pose: Pose, ctx: Any) -> bool:
        """Draws the next missing picture while the list is open; whether there was one. ctx: of the window."""
        if not self.is_open or not self.missing or self.volume is None:
            return False
        name, is_quick = self.missing.pop(0)
        if not self.small:
            # of a volume that takes long to halve, every so many voxels
            step = int(np.ceil((self.volume.count / MOST_VOXELS) ** (1 / 3)))
            small = reduce_volume(self.volume) or subsample(self.volume, step)
            self.small = {False: small, True: subsample(small, 2)}
        scene = Scene([Layer(self.small[is_quick], self.transfers[name])])
        image = draw_small(renderer, scene, pose.resized((PIXELS, PIXELS)).camera, is_quick)
        with current(ctx):
            old = self.textures.pop(name, None)
            self.textures[name] = ctx.texture((PIXELS, PIXELS), 4, np.ascontiguousarray(image.samples8()).tobytes())
            if old is not None:
                old.release()
        return True

    def close(self) -> None:
        """Frees the pictures. The context of the window must be current."""
        for texture in self.textures.values():
            texture.release()
        self.textures = {}


class TransferShift:
    """A slider that moves points and window along the values; it returns to 0 after the drag. before: the transfer
    function at the start of the drag.
    """

    def __init__(self) -> None:
        self.before: Transfer | None = None
        self.value = 0.0

    def draw(self, transfer: Transfer, spread: float) -> Transfer:
        """The slider; returns the moved transfer function. spread: length of the range of values."""
        changed, value = imgui.slider_float(label_left("shift"), self.value, -spread / 2, spread / 2, "%.4g")
        show_tip("Moves all points and the colours along the values.")
        if imgui.is_item_activated():
            self.before = transfer
        if changed and self.before is not None:
            self.value, transfer = value, shifted(self.before, value)
        if imgui.is_item_deactivated():
            self.before, self.value = None, 0.0
        return transfer


def shifted(transfer: Transfer, by: float) -> Transfer:
    """The transfer function with its points and its window moved along the values. On a logarithmic scale they are
    multiplied by the same factor, which moves the first point by `by`.
    """
    first = transfer.points[0][0]
    if transfer.logarithmic:
        factor = max(first + by, first * 1e-3) / first
        points = tuple((value * factor, opacity) for value, opacity in transfer.points)
        window = tuple(value * factor for value in transfer.window) if transfer.window else None
    else:
        points = tuple((value + by, opacity) for value, opacity in transfer.points)
        window = tuple(value + by for value in transfer.window) if transfer.window else None
    return replace(transfer, points=points, window=window)


def with_gradient(transfer: Transfer, begin: float, end: float) -> Transfer:
    """The transfer function with its weights of gradients between two of them, in their form, a ramp by default; with
    none where the second is not above the first.
    """
    if end <= begin:
        return replace(transfer, gradient=())
    nodes = transfer.gradient or ((0.0, 0.0), (1.0, 1.0))
    first, length = nodes[0][0], nodes[-1][0] - nodes[0][0]
    if length == 0:
        nodes, first, length = ((0.0, 0.0), (1.0, 1.0)), 0.0, 1.0
    share = (end - begin) / length
    return replace(transfer, gradient=tuple((begin + (at - first) * share, weight) for at, weight in nodes))

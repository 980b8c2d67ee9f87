"""Sections of the panel: view, slices, clipping, layers and movies."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from imgui_bundle import imgui
from numpy.typing import ArrayLike

from splatgl.annotations.annotate import ANNOTATIONS, text_of
from splatgl.annotations.canvas import AnnotatedSubject
from splatgl.annotations.text import legible, plain
from splatgl.annotations.world_lines import measure_text
from splatgl.data.color import linear_from_srgb, srgb_from_linear, srgb_of_name
from splatgl.data.volume import Volume
from splatgl.geometry.clipping import Plane
from splatgl.gl.screen import GROUNDS
from splatgl.scene.view import along
from splatgl.viewer.clip_tool import set_cuts
from splatgl.viewer.commands import (
    ANATOMY,
    Command,
    Copy,
    Effect,
    Open,
    OpenOption,
    WindowRequest,
    add_plane,
    is_enabled,
    is_ticked,
    name_of,
    toggle_name,
    with_ground,
)
from splatgl.viewer.document import Document
from splatgl.viewer.hud import background_of, plane_color
from splatgl.viewer.movie_track import FORMS, MOTIONS, Movie
from splatgl.viewer.recorder import Recording
from splatgl.viewer.slice_planes import STRAIGHT, with_slices
from splatgl.viewer.state import MOST_PLANES, THEMES, ClipState, State

# share of the panel's width that labels at the left of widgets take
LABELS = 0.3
# least width of a tooltip at a content scale of 1, screen units, and the share of the window below which it is above
TIP, LOW = 260.0, 0.7


def capitalized(text: str) -> str:
    """A text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def shorten(text: str, room: float) -> str:
    """A text, or as much of its start as fits into `room`, screen units, with an ellipsis behind it."""
    if imgui.calc_text_size(text).x <= room:
        return text
    ends = range(1, len(text))
    return text[: bisect_right(ends, room, key=lambda end: imgui.calc_text_size(f"{text[:end]}…").x)].rstrip() + "…"


def label_left(text: str) -> str:
    """Draws a label at the left of the next widget, which fills the rest of the line; returns the widget's name."""
    room = imgui.get_content_region_avail().x
    imgui.align_text_to_frame_padding()
    imgui.text(text)
    imgui.same_line(imgui.get_style().window_padding.x + LABELS * room)
    imgui.set_next_item_width(-1.0)
    return f"##{text}"


# margin around dialogs, screen units
AROUND = 8.0


def begin_dialog(name: str, room: tuple[int, int], wide: float, high: float = 0.0) -> bool:
    """Begins a dialog in the middle of the room; returns whether it is shown. wide, high: screen units at a content
    scale of 1, limited by the room; 0: as high as its content.
    """
    scale = imgui.get_style().font_scale_main
    size = [min(side * scale, most - 2 * AROUND) for side, most in zip((wide, high), room, strict=True)]
    imgui.set_next_window_pos((room[0] / 2, room[1] / 2), imgui.Cond_.always, (0.5, 0.5))
    imgui.set_next_window_size((size[0], size[1]))
    flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_move
    return imgui.begin_popup_modal(name, None, flags)[0]


def show_tip(text: str, at_once: bool = False, around: tuple[float, float] | None = None) -> None:
    """The tooltip of the last widget, while the cursor rests on it: in lines of the panel's width, below or above the
    widget, so that it covers no picture. at_once: of a widget that is hovered. around: top and bottom of what the
    cursor is over, instead of the widget's.
    """
    if not at_once and not imgui.is_item_hovered(imgui.HoveredFlags_.for_tooltip):
        return
    place = imgui.get_window_pos()
    top, below = around or (imgui.get_item_rect_min().y, imgui.get_item_rect_max().y)
    wide = max(imgui.get_window_width(), TIP * imgui.get_style().font_scale_main)
    left = min(place.x, imgui.get_io().display_size.x - wide)
    is_low = below > imgui.get_io().display_size.y * LOW
    imgui.set_next_window_pos((left, top if is_low else below), imgui.Cond_.always, (0.0, float(is_low)))
    imgui.set_next_window_size_constraints((0.0, 0.0), (wide, imgui.get_io().display_size.y))
    if imgui.begin_tooltip():
        imgui.push_text_wrap_pos(wide - 2 * imgui.get_style().window_padding.x)
        imgui.text_unformatted(text)
        imgui.pop_text_wrap_pos()
        imgui.end_tooltip()


class CommandWidgets:
    """Buttons and checkboxes that run commands. effects: collected until the window performs them. recording: the
    movie that is being drawn. idle: commands that have nothing to do, beside those that the state tells.
    """

    def __init__(self, commands: Iterable[Command]) -> None:
        self.commands = {command.id: command for command in commands}
        self.effects: list[Effect] = []
        self.recording: Recording | None = None
        self.idle: frozenset[str] = frozenset()

    def is_enabled(self, command: Command, state: State, document: Document) -> bool:
        """Whether a command does something now."""
        return command.id not in self.idle and is_enabled(command, state, document)

    def menu_item(self, command: Command, state: State, document: Document) -> State:
        """The state after a click on a command's row of a menu: ticked if it is on, grey where it does nothing."""
        is_on, title = is_ticked(command, state), capitalized(command.title)
        enabled = self.is_enabled(command, state, document)
        clicked = imgui.menu_item(title, ", ".join(command.keys[:1]), is_on, enabled)[0]
        return self.run(command.id, state, document) if clicked else state

    def run(self, name: str, state: State, document: Document) -> State:
        """The state after a command."""
        state, effects = self.commands[name](state, document)
        self.effects += effects
        return state

    def describe(self, name: str, text: str = "") -> None:
        """Sets the tooltip of the last widget: a text, by default the command's title, and its first key."""
        command = self.commands[name]
        key = f" ({command.keys[0]})" if command.keys else ""
        show_tip(f"{text or capitalized(command.title)}{key}.")

    def button(
        self, name: str, label: str, state: State, document: Document, text: str = "", wide: float = 0.0
    ) -> State:
        """The state after a click, if there is one. text: of the tooltip; wide: width, 0: that of the label."""
        clicked = imgui.button(label, (wide, 0.0))
        self.describe(name, text)
        return self.run(name, state, document) if clicked else state

    def checkbox(self, name: str, label: str, on: bool, state: State, document: Document) -> State:
        """The state after a click, if there is one. on: whether it is ticked."""
        clicked = imgui.checkbox(label, on)[0]
        self.describe(name)
        return self.run(name, state, document) if clicked else state


def draw_menus(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The menu bar, with all commands and their first keys; returns the state after the chosen one."""
    if not imgui.begin_menu_bar():
        return state
    for name, commands in groupby(widgets.commands.values(), key=lambda command: command.menu):
        if imgui.begin_menu(name):
            group = 0
            for (number, submenu), listed in groupby(commands, key=lambda command: (command.group, command.submenu)):
                if number != group:
                    imgui.separator()
                    group = number
                if not submenu or imgui.begin_menu(submenu):
                    for command in listed:
                        state = widgets.menu_item(command, state, document)
                    if submenu:
                        imgui.end_menu()
            imgui.end_menu()
    imgui.end_menu_bar()
    return state


def draw_files(state: State, document: Document, widgets: CommandWidgets, recent: Sequence[str]) -> State:
    """Buttons of file dialogs, and the recent files, paths."""
    tip = "A volume or a scene; several files are a time series"
    state = widgets.button("open", "open...", state, document, tip)
    imgui.same_line()
    state = widgets.button("add-layer", "add...", state, document)
    imgui.same_line()
    tip = "A scene, a picture or its floats, by the name's ending"
    state = widgets.button("save-as", "save as...", state, document, tip)
    imgui.align_text_to_frame_padding()
    imgui.text("copy as")
    for form in Copy:
        imgui.same_line()
        state = widgets.button(f"copy-{form.value.lower()}", form.value, state, document)
    for number, path in enumerate(recent):
        name = shorten(plain(Path(path).name), imgui.get_content_region_avail().x)
        if imgui.selectable(f"{name}##{number}", False)[0]:
            widgets.effects.append(Open((path,)))
        show_tip(legible(path))
    if recent and imgui.small_button("forget these"):
        widgets.effects.append(WindowRequest.FORGET_RECENT)
    return state


def draw_file_options(state: State, document: Document, widgets: CommandWidgets) -> None:
    """Lists of the file's arrays and channels, which open the chosen one."""
    for option in state.file_options:
        now = option.selected(document.scene.load)
        changed, chosen = imgui.combo(label_left(option.option), now, [plain(text) for text in option.texts])
        show_tip("Other volumes of the file: opens one, with the same view and settings.")
        if changed and chosen != now:
            widgets.effects.append(OpenOption(option.option, option.values[chosen][0]))


def draw_clipping(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    state = widgets.checkbox("handles", "handles", state.cuts.shown, state, document)
    imgui.same_line()
    state = widgets.checkbox("cuts", "cut", state.cuts.active, state, document)
    cuts = _box(state.cuts, document.volume)
    state = set_cuts(state, document, _planes(cuts, document.volume))
    if len(state.cuts.planes) < MOST_PLANES:
        state = _more(state, document)
    if state.cuts.any:
        imgui.same_line()
        state = widgets.button("uncut", "no cuts", state, document)
    return state


def _box(cuts: ClipState, volume: Volume) -> ClipState:
    """Ends of the sides of the box, in voxels as --crop counts them."""
    for axis, size in enumerate(volume.shape[::-1]):
        low, high = (round(share * size) for share in cuts.sides[axis])
        name = label_left("xyz"[axis])
        changed, begin, end = imgui.drag_int_range2(name, low, high, max(size / 400, 0.2), 0, size)
        show_tip(f"Voxels along {'xyz'[axis]} that the box keeps, as in --crop: drag, or ctrl+click.")
        if changed and begin < end:
            sides = list(cuts.sides)
            sides[axis] = max(begin, 0) / size, min(end, size) / size
            cuts = replace(cuts, sides=tuple(sides), active=True)
    return cuts


def _planes(cuts: ClipState, volume: Volume) -> ClipState:
    """Place of each plane along its normal, and buttons that flip and remove it."""
    corners, unit = volume.corners, volume.unit or "units"
    for number, plane in enumerate(cuts.planes):
        imgui.push_id(number)
        along = corners @ np.array(plane[:3])
        imgui.push_style_color(imgui.Col_.slider_grab, imgui.ImVec4(*plane_color(cuts, number)))
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.55)
        ends = float(along.min()), float(along.max())
        changed, place = imgui.slider_float("##place", plane[3], *ends, f"%.4g {unit}")
        imgui.pop_style_color()
        show_tip("Normal {:.3g}, {:.3g}, {:.3g}: keeps the side that it points to.".format(*plane[:3]))
        if changed:
            cuts = replace(cuts.with_plane(number, (*plane[:3], place)), active=True)
        imgui.same_line()
        if imgui.button("flip"):
            cuts = cuts.with_plane(number, [-each for each in plane])
        imgui.same_line()
        removed = imgui.button("remove")
        imgui.pop_id()
        if removed:
            return cuts.without(number)
    return cuts


def _more(state: State, document: Document) -> State:
    """Buttons that add a plane."""
    imgui.align_text_to_frame_padding()
    imgui.text("plane")
    normals: dict[str, Plane | None] = {"view": None, "x": (1, 0, 0, 0), "y": (0, 1, 0, 0), "z": (0, 0, 1, 0)}
    for name, normal in normals.items():
        imgui.same_line()
        if imgui.button(f"+ {name}"):
            state = add_plane(state, document, normal and normal[:3])
        towards = "that faces you (ctrl+x)" if normal is None else f"across world {name}"
        show_tip(f"One more plane {towards}.")
    return state


# share of the panel's width that a slider of opacity takes beside a name, and digits of its step
OPACITY, DIGITS = 0.26, 3


def pick_opacity(opacity: float, room: float, left: float = 0.0) -> float:
    """Slider of an opacity on the line of the last widget; returns the chosen one. room: width of the line; left: place
    of the slider, 0: behind the last widget.
    """
    imgui.same_line(left)
    imgui.set_next_item_width(room * OPACITY)
    changed, value = imgui.slider_float("##opacity", opacity, 0.0, 1.0, "%.2f")
    show_tip("A factor on its opacities.")
    return round(float(np.clip(value, 0.0, 1.0)), DIGITS) if changed else opacity


def pick_color(color: str | ArrayLike) -> str | None:
    """Field of a colour, a name or linear RGB; returns "#rrggbb" if another one is chosen."""
    imgui.same_line()
    if isinstance(color, str):
        coded = [part / 255 for part in srgb_of_name(color)]
    else:
        coded = list(map(float, srgb_from_linear(np.clip(np.array(color), 0.0, 1.0))))
    flags = imgui.ColorEditFlags_.no_inputs | imgui.ColorEditFlags_.no_label
    changed, picked = imgui.color_edit3("colour", coded, flags)
    if not changed:
        return None
    return "#{:02x}{:02x}{:02x}".format(*(round(255 * min(max(part, 0.0), 1.0)) for part in picked))


def draw_slices(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    state = widgets.checkbox("slices", "slices", state.slices.shown, state, document)
    imgui.same_line()
    state = widgets.checkbox("slice-colors", "colours of values", state.slices.colored, state, document)
    imgui.same_line()
    state = widgets.checkbox("slices-in-space", "in the picture", bool(state.slice_planes), state, document)
    slices = state.slices
    state = widgets.checkbox("linked-crosshair", "linked crosshair", slices.shown and slices.linked, state, document)
    slices, volume = state.slices, document.volume
    if slices.shown:
        turns = [f"turn-slices-{axis}" for axis in "xyz"]
        for name, wide in _flow([*turns, "straighten-slices"], 4):
            text = f"turn {name[-1]}" if name in turns else "straight"
            state = widgets.button(name, text, state, document, wide=wide)
        slices = state.slices
    if slices.shown and slices.turn == STRAIGHT:
        index = list(slices.index(volume))
        for axis, size in enumerate(volume.shape[::-1]):
            changed, place = imgui.slider_int(f"{label_left('xyz'[axis])}slice", index[axis], 0, size - 1)
            if changed:
                index[axis] = place
                slices = slices.at(index, volume)
    return state if slices == state.slices else with_slices(state, slices, volume)


def draw_view(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    volume, frame = document.volume, document.volume.frame
    order = ("front", "back", "left", "right", "top", "bottom")
    for view, wide in _flow(order, 3 if frame else 6):
        label = f"{ANATOMY[view] if frame else along(view, volume).upper()}##view"
        tip = f"{name_of(view, volume)}, as {'3D Slicer' if frame else 'ParaView'} names it"
        state = widgets.button(view, label, state, document, tip, wide)
    ticked = {"orthographic": not state.pose.camera.perspective}
    ticked |= {"turntable": state.turntable, "fullscreen": state.fullscreen}
    for name, _ in _flow(list(ticked), 3):
        command = "projection" if name == "orthographic" else name
        state = widgets.checkbox(command, name, ticked[name], state, document)
        if name == "orthographic" and state.pose.camera.perspective:
            show_tip(f"Perspective, {state.pose.fov:.3g} degrees from the top to the bottom (p).")
    state = _ground(_over(state, document, widgets))
    changed, chosen = imgui.combo(label_left("panel"), THEMES.index(state.theme), list(THEMES))
    return replace(state, theme=THEMES[chosen]) if changed else state


def _over(state: State, document: Document, widgets: CommandWidgets) -> State:
    """Annotations of the picture."""
    rows = {row.name: row for row in ANNOTATIONS.values() if row.key and (document.volume.frame or not row.needs_frame)}
    for name, _ in _flow(list(rows), 3):
        if imgui.checkbox(name, text_of(state.annotate, name) is not None)[0]:
            state = replace(state, annotate=toggle_name(state.annotate, name))
        show_tip(f"{rows[name].about[:-1]} ({rows[name].key}).")
    return widgets.checkbox("probe", "value under the cursor", state.probe, state, document)


def _ground(state: State) -> State:
    """Background of the picture."""
    names = [*GROUNDS, "a colour"]
    has_color = state.settings.ground is not None
    changed, chosen = imgui.combo(
        label_left("background"), len(GROUNDS) if has_color else GROUNDS.index(state.ground), names
    )
    if changed and chosen < len(GROUNDS):
        return with_ground(state, GROUNDS[chosen])
    if changed:
        return replace(state, settings=state.settings.replace(background=background_of(state)))
    if has_color:
        coded = srgb_from_linear(np.array(state.settings.ground))
        changed, color = imgui.color_edit3("colour", list(map(float, coded)))
        if changed:
            linear = linear_from_srgb(np.clip(np.array(color), 0.0, 1.0))
            return replace(state, settings=state.settings.replace(background=tuple(map(float, linear))))
    return state


def _flow(names: Sequence[str], per_row: int) -> Iterator[tuple[str, float]]:
    """Yields the names, whose widgets stand in rows of `per_row` equal columns, and the width of a column."""
    style = imgui.get_style()
    step = (imgui.get_content_region_avail().x + style.item_spacing.x) / per_row
    for number, name in enumerate(names):
        if number % per_row:
            imgui.same_line(style.window_padding.x + step * (number % per_row))
        yield name, step - style.item_spacing.x


def draw_measures(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    for name, is_angle in (("measure", False), ("angle", True)):
        on = state.ruler.active and state.ruler.angle == is_angle
        state = widgets.checkbox(name, "angle" if is_angle else "distance", on, state, document)
        imgui.same_line()
    imgui.text_disabled("click on points")
    measures, style, room = list(state.measures), imgui.get_style(), imgui.get_content_region_avail().x
    for number, measure in enumerate(state.measures):
        imgui.push_id(number)
        imgui.set_next_item_width(room * 0.4)
        changed, name = imgui.input_text_with_hint("##name", "name", measure.name)
        measures[number] = replace(measure, name=name) if changed else measure
        imgui.same_line()
        imgui.text(plain(measure_text(replace(measure, name=""), AnnotatedSubject.of(document.volume))))
        # the button ends with the widgets above
        imgui.same_line(style.window_padding.x + room - imgui.calc_text_size("remove").x - 2 * style.frame_padding.x)
        removed = imgui.button("remove")
        imgui.pop_id()
        if removed:
            del measures[number]
            break
    return state if tuple(measures) == state.measures else state.with_measures(tuple(measures))


SECTIONS = {"View": draw_view, "Slices": draw_slices, "Clipping": draw_clipping, "Measures": draw_measures}


# sizes of movies beside that of the picture
SIZES = ((1280, 720), (1920, 1080), (3840, 2160), (1024, 1024))
# lowest and highest values of the numbers
DEGREES, SECONDS, RATES = (-3600.0, 3600.0), (0.1, 3600.0), (1.0, 120.0)


def draw_record(state: State, document: Document, widgets: CommandWidgets) -> State:
    """The section's controls; returns the edited state."""
    movie = _motion(state.movie)
    if movie.motion == "keyframes":
        state = widgets.button("keyframe", "add this view", replace(state, movie=movie), document)
        movie = _keyframes(state.movie)
    movie = _format(movie if state.times < 2 else _series(movie), state)
    state = state if movie == state.movie else replace(state, movie=movie)
    state = widgets.button("preview", "stop" if state.preview else "preview", state, document)
    if widgets.recording is None:
        for name, label in (("record", "record"), ("record-as", "record as...")):
            imgui.same_line()
            state = widgets.button(name, label, state, document)
    state = widgets.button("copy-movie", "copy as command", state, document)
    if widgets.recording is not None:
        imgui.progress_bar(widgets.recording.share, (-1.0, 0.0), widgets.recording.text)
        state = widgets.button("cancel-recording", "cancel", state, document)
    return state


def _motion(movie: Movie) -> Movie:
    """How the camera moves, and for how long."""
    changed, chosen = imgui.combo(label_left("camera"), MOTIONS.index(movie.motion), list(MOTIONS))
    movie = replace(movie, motion=MOTIONS[chosen]) if changed else movie
    if movie.motion == "turntable":
        movie = _number(movie, "degrees", 1.0, DEGREES, "%.4g", "Of the whole movie, counter-clockwise from above.")
    if movie.motion != "keyframes":
        movie = _number(movie, "seconds", 0.05, SECONDS, "%.4g s", "Of the whole movie.")
    return _number(movie, "fps", 0.2, RATES, "%.4g frames/s", f"{movie.count} frames in all.", "rate")


def _number(
    movie: Movie, name: str, step: float, ends: tuple[float, float], form: str, tip: str, label: str = ""
) -> Movie:
    changed, value = imgui.drag_float(label_left(label or name), getattr(movie, name), step, *ends, form)
    show_tip(f"{tip} Drag, or ctrl+click.")
    value = float(f"{min(max(value, ends[0]), ends[1]):.4g}")
    change: dict[str, Any] = {name: value}
    return replace(movie, **change) if changed else movie


def _keyframes(movie: Movie) -> Movie:
    """The time of each keyframe, and buttons that exchange and remove them."""
    for number, key in enumerate(movie.keyframes):
        imgui.push_id(number)
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.4)
        changed, time = imgui.drag_float("##time", key.time, 0.02, 0.0, SECONDS[1], f"{number + 1}: %.2f s")
        show_tip("When the camera is there: drag, or ctrl+click.")
        movie = movie.timed(number, float(f"{time:.4g}")) if changed else movie
        imgui.same_line()
        imgui.begin_disabled(number + 1 == len(movie.keyframes))
        later = imgui.button("later")
        imgui.end_disabled()
        show_tip("Exchanges it with the next one.")
        imgui.same_line()
        removed = imgui.button("remove")
        imgui.pop_id()
        if later or removed:
            return movie.swapped(number) if later else movie.without(number)
    return movie


def _series(movie: Movie) -> Movie:
    """Whether the time points of a series are shown, and written into the picture."""
    _, series = imgui.checkbox("all time points", movie.series)
    show_tip("Else all frames show this time point.")
    imgui.same_line()
    imgui.begin_disabled(not series)
    _, stamped = imgui.checkbox("time in the picture", movie.stamped)
    imgui.end_disabled()
    return replace(movie, series=series, stamped=stamped)


def _format(movie: Movie, state: State) -> Movie:
    """Kind of file, and size."""
    forms = list(FORMS)
    _, form = imgui.combo(label_left("format"), forms.index(movie.form), list(FORMS.values()))
    here, sizes = state.pose.camera.size, (None, *SIZES)
    texts = [f"{here[0]} x {here[1]}, as shown", *(f"{width} x {height}" for width, height in SIZES)]
    _, size = imgui.combo(label_left("size"), sizes.index(movie.size), texts)
    return replace(movie, form=forms[form], size=sizes[size])

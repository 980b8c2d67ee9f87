"""Section of the panel that records movies. Extra `gui`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from splatgl.viewer.document import Document
from splatgl.viewer.movie_track import FORMS, MOTIONS, Movie
from splatgl.viewer.panel_sections import CommandWidgets, label_left
from splatgl.viewer.state import State

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
    imgui.set_item_tooltip(f"{tip} Drag, or ctrl+click.")
    value = float(f"{min(max(value, ends[0]), ends[1]):.4g}")
    change: dict[str, Any] = {name: value}
    return replace(movie, **change) if changed else movie


def _keyframes(movie: Movie) -> Movie:
    """The time of each keyframe, and buttons that exchange and remove them."""
    for number, key in enumerate(movie.keyframes):
        imgui.push_id(number)
        imgui.set_next_item_width(imgui.get_content_region_avail().x * 0.4)
        changed, time = imgui.drag_float("##time", key.time, 0.02, 0.0, SECONDS[1], f"{number + 1}: %.2f s")
        imgui.set_item_tooltip("When the camera is there: drag, or ctrl+click.")
        movie = movie.timed(number, float(f"{time:.4g}")) if changed else movie
        imgui.same_line()
        imgui.begin_disabled(number + 1 == len(movie.keyframes))
        later = imgui.button("later")
        imgui.end_disabled()
        imgui.set_item_tooltip("Exchanges it with the next one.")
        imgui.same_line()
        removed = imgui.button("remove")
        imgui.pop_id()
        if later or removed:
            return movie.swapped(number) if later else movie.without(number)
    return movie


def _series(movie: Movie) -> Movie:
    """Whether the time points of a series are shown, and written into the picture."""
    _, series = imgui.checkbox("all time points", movie.series)
    imgui.set_item_tooltip("Else all frames show this time point.")
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

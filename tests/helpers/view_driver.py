"""A viewer in a process of its own, for tests: it lives on, and answers a line of JSON to every line of JSON.

python view_driver.py SOURCE FOLDER '{"backend": "egl", …}'
"""

from __future__ import annotations

import ctypes
import ctypes.util
import json
import os
import queue
import sys
import threading
import time
import warnings
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np

from splatgl.errors import InputError, InputWarning
from splatgl.gl.context import current
from splatgl.gl.renderer import Renderer
from splatgl.readers import ome_zarr
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.transfer_nodes import color_points
from splatgl.viewer import adaptive_quality, hud, trackball
from splatgl.viewer.adaptive_quality import REST
from splatgl.viewer.commands import LeaveDocument, WindowRequest
from splatgl.viewer.document import Document
from splatgl.viewer.jobs import Jobs
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.loading import Files
from splatgl.viewer.show import start_reading
from splatgl.viewer.state import History, LayerStyle
from splatgl.viewer.trackball import Pointer
from splatgl.viewer.viewer import Options, Viewer

DOUBLE = trackball.DOUBLE
PAGE = os.sysconf("SC_PAGE_SIZE")
# seconds after which something hangs: no picture takes as long on a machine that many share
PATIENCE = 240.0

# those that are not freed yet; a list of all objects would hold what other threads are making
LAYERS: WeakSet[LayerSplats] = WeakSet()


def told(viewer: Viewer) -> dict[str, Any]:
    """What the window shows, in plain values."""
    state, frame, camera = viewer.state, viewer.painter.frame, viewer.state.pose.camera
    names = (
        "turning",
        "blur",
        "compare",
        "hud",
        "help",
        "panel",
        "ground",
        "message",
        "time",
        "times",
        "playing",
    )
    return {
        **{name: getattr(state, name) for name in names},
        "beyond": state.show_zk,
        "threshold": state.style.threshold,
        "asked": [question.text for question in viewer.panel.panel.questions.waiting] if viewer.panel else [],
        "hidden": sorted(state.style.hidden),
        "names": state.style.names,
        "focused": bool(viewer.panel and viewer.panel.focused),
        "layers": viewer.document.with_styles(state.styles, state.mesh_files, state.settings).names,
        "extinction": state.style.extinction,
        "eye": camera.eye.tolist(),
        "axes": camera.eye_from_world.tolist(),
        "size": camera.size,
        "extent": camera.extent,
        "perspective": camera.perspective,
        "pivot": state.pose.pivot.tolist(),
        "middle": viewer.document.middle.tolist(),
        "settings": asdict(state.settings),
        "cuts": asdict(state.cuts),
        "annotate": state.annotate,
        "turntable": state.turntable,
        "probe": state.probe,
        "ruler": asdict(state.ruler),
        "measures": [asdict(measure) for measure in state.measures],
        "slices": asdict(state.slices),
        "panes": [
            {"axis": pane.axis, "box": pane.box, "room": pane.room}
            for pane in viewer.slices.panes(state, viewer.document, viewer.view)
        ],
        "fullscreen": viewer.window.before is not None,
        "points": state.style.stated.points,
        "window": state.style.stated.window,
        "colors": color_points(state.style.stated),
        "iso": state.style.stated.iso,
        "regions": list(map(str, state.style.stated.regions)),
        "source": viewer.document.scene.volume,
        "splats": viewer.document.counts[0],
        "level": frame and str(frame.level),
        "full": bool(frame and frame.full),
        "seconds": frame and frame.seconds,
        "blurred": bool(frame and frame.blurred),
        "hud lines": hud.full_lines(state, viewer.document, frame, viewer.busy),
        "words": viewer.painter.words,
        "title": hud.progress_text(frame),
        "size of picture": viewer.painter.pixels.shape,
        "paths": viewer.painter.overlay.paths if viewer.painter.overlay else (),
        "reference": viewer.reference.image is not None,
        "closed": viewer.closed,
        "megabytes": int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20,
        "textures": len(viewer.screen.textures),
        "documents": len(LAYERS),
        "recent": viewer.recent.paths,
        "scale": viewer.window.scale,
        "place": viewer.panel and viewer.panel.panel.place,
        "marks": [sprite.place for sprite in viewer._marks().sprites],
        "dialog": viewer.dialogs.process is not None or bool(viewer.panel and viewer.panel.panel.popup),
        "pictures": len(viewer.panel.panel.gallery.textures) if viewer.panel else 0,
        "plot": viewer.panel and (viewer.panel.panel.curve.box, viewer.panel.panel.curve.range),
    }


def settled(viewer: Viewer) -> bool:
    frame = viewer.painter.frame
    still = frame is not None and frame.full and viewer.refiner.drawn == viewer.wanted() and not viewer.dirty
    shown = not viewer.files.times or viewer.files.time == viewer.state.time
    threads = viewer.slices.jobs, viewer.reference.jobs, viewer.readout.jobs
    return still and shown and not viewer.busy and not any(jobs.busy for jobs in threads)


def arrived(viewer: Viewer) -> None:
    """Waits for all that hands have done so far: the X server answers after it has sent those events."""
    glfw = viewer.window.glfw
    name = ctypes.util.find_library("X11")
    assert name
    library = ctypes.CDLL(name)
    library.XSync.argtypes = [ctypes.c_void_p, ctypes.c_int]
    library.XSync(glfw.get_x11_display(), 0)


def until(viewer: Viewer, reached: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not reached() and not viewer.closed and time.monotonic() < end:
        viewer.step(0.01)


def nudged(viewer: Viewer) -> dict[str, Any]:
    """The wheel is turned, and again while the picture is being drawn in full. same: that picture did not come."""
    shown: list[Any] = []
    interrupted = viewer._is_interrupted

    def turned_again(inputs: int, is_full: bool) -> bool:
        if not shown and is_full:
            shown.append(viewer.painter.frame)
            viewer.mouse("wheel", Pointer((120.0, 90.0), notches=1.0))
        return interrupted(inputs, is_full)

    viewer._is_interrupted = turned_again  # type: ignore[method-assign, assignment]
    viewer.mouse("wheel", Pointer((120.0, 90.0), notches=1.0))
    until(viewer, lambda: bool(shown))
    viewer._is_interrupted = interrupted  # type: ignore[method-assign]
    return {**told(viewer), "same": viewer.painter.frame is shown[0]}


def clicked(viewer: Viewer, place: tuple[float, float]) -> dict[str, Any]:
    """The panel is clicked while the picture is drawn in full. before, during: its places; pictures: begun in full."""
    panel, interrupted, draw = viewer.panel, viewer._is_interrupted, viewer.painter.draw
    clicks, began, during = [1, 0], [], []

    def beneath(inputs: int, is_full: bool) -> bool:
        if clicks and is_full:
            viewer.raw("button", 0, clicks.pop(0), 0)
        ended = interrupted(inputs, is_full)
        during.append(panel.panel.place)
        return ended

    def noting(state: Any, document: Any, level: Any, *rest: Any) -> Any:
        began.append(str(level))
        return draw(state, document, level, *rest)

    viewer.raw("cursor", *place)
    viewer.step(0.0)
    before = panel.panel.place
    viewer._is_interrupted, viewer.painter.draw = beneath, noting  # type: ignore[method-assign, assignment]
    viewer.touch()
    viewer.refiner.drawn = ()
    until(viewer, lambda: settled(viewer))
    viewer._is_interrupted, viewer.painter.draw = interrupted, draw  # type: ignore[method-assign]
    return {**told(viewer), "before": before, "during": during[-1], "pictures": began.count("in full")}


def answer(viewer: Viewer, ask: dict[str, Any]) -> dict[str, Any]:
    """Does one thing and says how the window is then."""
    what = ask["do"]
    if what == "settle":
        arrived(viewer)
        viewer.step(0.0)
        until(viewer, lambda: settled(viewer))
        # what a thread had just finished
        viewer.step(0.0)
        until(viewer, lambda: settled(viewer))
    elif what == "look":
        # one picture after the events that are waiting
        viewer.step(0.02)
    elif what == "stop":
        # the turning ends right after a frame of less quality: at the finest level that is quick enough, few are
        until(viewer, lambda: viewer.painter.frame is not None and not viewer.painter.frame.full)
        viewer.state = replace(viewer.state, turning=False)
        return answer(viewer, {"do": "settle"})
    elif what == "double":
        # seconds between the presses of a double click: a busy machine may bring the second one late
        trackball.DOUBLE = ask["within"]
        if viewer.panel is not None:
            io = viewer.panel.io
            io.mouse_double_click_time, io.mouse_single_click_delay = ask["within"], 2 * ask["within"]
    elif what == "nudge":
        return nudged(viewer)
    elif what == "hurry":
        # a drag on the panel during one slow frame
        start, stop, after = ask["places"]
        for kind, *values in (("cursor", *start), ("button", 0, 1, 0), ("cursor", *stop), ("button", 0, 0, 0)):
            viewer.raw(kind, *values)
        viewer.raw("cursor", *after)
        return answer(viewer, {"do": "settle"})
    elif what == "hesitate":
        # a drag on the panel that rests halfway, whose end is there before the panel sees it
        start, middle, stop = ask["places"]
        for events in ((("cursor", *start), ("button", 0, 1, 0)), (("cursor", *middle),)):
            for kind, *values in events:
                viewer.raw(kind, *values)
            until(viewer, lambda: not viewer.panel.waiting)
            viewer.step(0.0)
        time.sleep(REST)
        viewer.raw("cursor", *stop)
        viewer.raw("button", 0, 0, 0)
        return answer(viewer, {"do": "settle"})
    elif what == "click":
        return clicked(viewer, tuple(ask["place"]))
    elif what == "set":
        # what neither keys nor the panel ask for, or not at once
        settings = viewer.state.settings.replace(**ask.get("settings", {}))
        slices = replace(viewer.state.slices, place=tuple(ask.get("place", viewer.state.slices.place)))
        changes = {"settings": settings, "slices": slices, **ask.get("state", {})}
        viewer.state = replace(viewer.state, **changes).edit(**ask.get("style", {}))
        answers = {"SAVE_AND_LEAVE": LeaveDocument(saves=True), "LEAVE": LeaveDocument()}
        viewer.effects += [answers.get(name) or WindowRequest[name] for name in ask.get("effects", ())]
        viewer.touch()
        viewer.step(0.0)
        until(viewer, lambda: not viewer.extractor.jobs.busy)
        viewer.step(0.0)
    elif what == "fail":
        # an OpenGL error in the window's own context, as after the loss of it
        with current(viewer.screen.ctx):
            ctypes.CFUNCTYPE(None, ctypes.c_uint)(viewer.screen.loader.load_opengl_function("glEnable"))(0xFFFF)
        viewer.refresh()
        try:
            viewer.step(0.0)
        except InputError as error:
            return {"message": str(error)}
    elif what == "paste":
        return {"text": viewer.window.glfw.get_clipboard_string(None).decode()}
    elif what == "shot":
        np.save(ask["path"], viewer.shot())
    elif what == "reset":
        document, scene = viewer.document, viewer.document.scene
        styles = [LayerStyle(base, scene.threshold, number=number) for number, base in viewer.bases.items()]
        document = document.with_styles(styles, document.mesh_files, scene.settings)
        viewer.state = viewer.state.opened(document)
        viewer.state = type(viewer.state).of(document, viewer.view.size)
        viewer.history = History(viewer.state)
        viewer.closed = False
        if viewer.panel is not None:
            # whether a list is open or not, which Escape cannot know: a click may close it in the same moment
            viewer.panel.panel.closes = 1
        viewer.dialogs.close()
        # the press before is not the first of a double click
        viewer.input.camera.mouse = trackball.Mouse()
        trackball.DOUBLE = DOUBLE
        until(viewer, lambda: settled(viewer))
    elif what == "turn":
        # many pictures, each from elsewhere
        for number in range(ask["times"]):
            viewer.mouse("move", Pointer((100.0 + number % 40, 90.0)))
            viewer.step(0.0)
    elif what == "request":
        # as a window manager does
        viewer.window.glfw.set_window_should_close(viewer.window.handle, True)
        return answer(viewer, {"do": "settle"})
    elif what == "close":
        viewer.window.glfw.set_window_should_close(viewer.window.handle, True)
        viewer.step(0.0)
    return told(viewer)


def noted(viewer: Viewer) -> tuple[list[list[float]], list[str]]:
    """The eyes and levels of all pictures that are drawn from now on."""
    eyes: list[list[float]] = []
    levels: list[str] = []
    draw = viewer.painter.draw

    def noting(state: Any, document: Any, level: Any, *rest: Any) -> Any:
        eyes.append(state.pose.camera.eye.tolist())
        levels.append(str(level))
        return draw(state, document, level, *rest)

    viewer.painter.draw = noting  # type: ignore[method-assign, assignment]
    return eyes, levels


def asked_first(viewer: Viewer, folder: Path) -> Any:
    """Keeps the first frame that is shown in first.npy; returns what showed frames before."""
    show = viewer.window.show

    def kept() -> None:
        np.save(folder / "first.npy", viewer.screen.read(viewer.window.size))
        viewer.window.show = show  # type: ignore[method-assign]
        show()

    viewer.window.show = kept  # type: ignore[method-assign]
    return show


def counted() -> None:
    """Has layers counted from now on."""
    made = LayerSplats.__init__

    def noted(layer: LayerSplats, *args: Any, **options: Any) -> None:
        made(layer, *args, **options)
        LAYERS.add(layer)

    LayerSplats.__init__ = noted  # type: ignore[assignment, method-assign]


def main() -> None:
    counted()
    source, folder, asked = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    lines: queue.Queue[str] = queue.Queue()
    threading.Thread(target=lambda: [lines.put(line) for line in sys.stdin], daemon=True).start()
    backend = asked.pop("backend", "window")
    if "free" in asked:
        # bytes of memory that documents may take
        vars(adaptive_quality)["budget"] = partial(int, asked.pop("free"))
    if "whole" in asked:
        # bytes of samples that are read at once
        vars(ome_zarr)["WHOLE"] = asked.pop("whole")
    # as the command does, which prints notes on files by itself
    warnings.simplefilter("ignore", InputWarning)
    scene = SceneFile.from_toml(Path(source)) if source.endswith(".toml") else SceneFile(source)
    with Renderer(backend) as renderer:
        behind = asked.pop("behind", False)
        files = Files(Jobs(lambda: None), tuple(asked.pop("watched", ())), lambda: scene, time.monotonic())
        options = Options(folder=Path(folder), **asked)
        if behind:
            # the window is there before its file is read
            viewer = Viewer(Document.placeholder(scene), renderer, options, start_reading(scene))
        else:
            viewer = Viewer(Document.open(scene), renderer, options, files)
        if asked.get("panel") and viewer.panel is not None:
            # also in a window in which it lies over the picture
            viewer.state = replace(viewer.state, panel=True)
        eyes, levels = noted(viewer)
        first = asked_first(viewer, Path(folder))
        until(viewer, lambda: settled(viewer))
        viewer.window.show = first  # type: ignore[method-assign]
        print(json.dumps({**told(viewer), "eyes": eyes, "levels": levels}), flush=True)
        ask = {"do": ""}
        while ask["do"] not in ("end", "close"):
            try:
                ask = json.loads(lines.get(timeout=0.005))
                print(json.dumps(answer(viewer, ask)), flush=True)
            except queue.Empty:
                # a window that was told to quit lives on, so that it can tell
                if not viewer.closed:
                    viewer.step(0.005)
        viewer.close()


if __name__ == "__main__":
    main()

"""What a window cannot draw, save or name is said, and ends nothing."""

from __future__ import annotations

import gc
import os
import pickle
import platform
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.text import legible, plain, text_box
from splatgl.gl.target import Interrupted
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.kernels import KERNELS
from splatgl.splat.splats import check_now, checked, in_parts
from splatgl.transfer.transfer_nodes import with_color_points
from splatgl.viewer import hud
from splatgl.viewer.adaptive_quality import FULL, STRIDES, IdleTrim
from splatgl.viewer.commands import Copy, WindowRequest
from splatgl.viewer.document import Document
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.jobs import ExtractedPart, Extractor, FinishedJob, JobCancelled, JobKind, Jobs
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.reference_view import Reference
from splatgl.viewer.saving import copy_text, render_scene, save_as, save_picture, save_scene, scene_of, try_save
from splatgl.viewer.state import LayerStyle, State
from splatgl.viewer.viewer import Viewer
from tests.helpers.blobs import SIZE, blob
from tests.helpers.memory import resident_mebibytes
from tests.helpers.window import MISSING, Window


@pytest.fixture
def document(tmp_path: Path) -> Document:
    np.save(tmp_path / "blob.npy", blob(48).samples)
    return Document.open(SceneFile(str(tmp_path / "blob.npy"), transfer={"points": ((4.0, 0.0), (30.0, 0.6))}))


def no_memory(*_: object) -> sg.Image:
    raise MemoryError


def test_no_memory_is_said(document: Document, tmp_path: Path) -> None:
    state = State.of(document, SIZE)
    assert try_save(partial(save_picture, state, document, no_memory, tmp_path)) == ("not enough memory", False)
    assert try_save(partial(save_as, state, document, no_memory, tmp_path / "a.png"))[0] == "not enough memory"
    done = FinishedJob(JobKind.REFERENCE, error=MemoryError())
    reference = Reference(cast(Any, SimpleNamespace(collect=lambda: [done])))
    assert reference.collect() and reference.note == "no reference: not enough memory"
    assert sorted(os.listdir(tmp_path)) == ["blob.npy"]


@pytest.mark.parametrize("error", [MemoryError, Interrupted])
def test_a_scene_is_saved_though_its_picture_is_not(document: Document, tmp_path: Path, error: type[Exception]) -> None:
    """As it has the edits, which are saved with it."""

    def fail(*_: object) -> sg.Image:
        raise error

    state = State.of(document, SIZE).edit(threshold=0.01)
    message, done = try_save(partial(save_scene, state, document, fail, tmp_path))
    assert done and message.startswith("saved scene-001.toml") and "scene-001.npy" in message
    assert save_scene(state, document, fail, tmp_path, has_picture=False) == "saved scene-002.toml"
    assert sorted(os.listdir(tmp_path)) == ["blob.npy", "scene-001.toml", "scene-002.toml"]
    assert SceneFile.from_toml(tmp_path / "scene-001.toml").threshold == 0.01


def test_too_many_splats_are_a_scene_without_a_picture(
    document: Document, renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    style = LayerStyle(document.styles[0].base, 0.001)
    document = document.with_styles((style,), (), sg.Settings())
    document.extract(2)
    monkeypatch.setattr("splatgl.viewer.layer_splats.MOST_KEPT", 100)
    assert document.exceeds_budget
    state = State.of(document, SIZE)
    assert "too many" in try_save(partial(save_picture, state, document, renderer.render, tmp_path))[0]
    said = save_scene(state, document, renderer.render, tmp_path)
    assert said.startswith("saved scene-001.toml") and "splatgl render" in said
    assert sorted(os.listdir(tmp_path)) == ["blob.npy", "scene-001.toml"] and 1 not in document.extracted
    assert SceneFile.from_toml(tmp_path / "scene-001.toml").threshold == 0.001


def test_a_copy_draws_the_same_picture(
    document: Document, renderer: sg.Renderer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit, as Python, as a command and as a scene file; a title holds what quotes text in these."""
    monkeypatch.chdir(tmp_path)
    state = State.of(document, SIZE)
    state = replace(
        state, pose=state.pose.spun(20.0, np.array([0.0, 0.0, 1.0])), annotate=("axes", 'title=a\'"""\\n b')
    ).edit(extinction=0.37, base=with_color_points(state.style.base, ((0.1, "#ff0000"), (0.5, "#ffe0a0"))))
    shown = document.with_styles(state.styles, (), state.settings)
    wanted = render_scene(scene_of(state, document), shown, renderer.render).pixels
    space: dict[str, Any] = {}
    exec(copy_text(Copy.PYTHON, state, document), space)
    assert np.array_equal(space["image"].pixels, wanted)
    scene = copy_text(Copy.SCENE, state, document)
    assert (tmp_path / "scene.toml").read_text() == scene
    (tmp_path / "scene.toml").unlink()
    write = copy_text(Copy.COMMAND, state, document).removesuffix("splatgl render scene.toml -o picture.png\n")
    subprocess.run(["sh", "-c", write], check=True)
    assert (tmp_path / "scene.toml").read_text() == scene


@pytest.mark.parametrize("name", ["/", ".", "x" * 300 + ".png", "x" * 300, "a.xyz", "none/a.png"])
def test_names_that_cannot_be(document: Document, renderer: sg.Renderer, tmp_path: Path, name: str) -> None:
    save = partial(save_as, State.of(document, SIZE), document, renderer.render, tmp_path / name)
    message, done = try_save(save)
    assert message and not done and not message.startswith("saved")
    assert sorted(os.listdir(tmp_path)) == ["blob.npy"]


@pytest.mark.long
def test_what_is_shown_is_not_overwritten(renderer: sg.Renderer, tmp_path: Path) -> None:
    """Neither a volume, a layer, a mask nor another time point, by whatever name; others beside these may be."""
    paths = {name: str(tmp_path / f"{name}.npy") for name in ("a", "layer", "mask", "later")}
    for path in paths.values():
        np.save(path, blob(8).samples)
    layer = SceneFile(paths["layer"], mask=(f"{paths['mask']}:outside",))
    document, later = Document.open(SceneFile(paths["a"], layers=(layer,))), SceneFile(paths["later"])
    state = State.of(document, SIZE)
    os.link(tmp_path / "layer.npy", tmp_path / "link.npy")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}

    def said(name: str) -> str:
        return try_save(partial(save_as, state, document, renderer.render, tmp_path / name, times=(later,)))[0]

    for taken in (*paths, "link"):
        assert "what is shown" in said(f"{taken}.npy")
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    for _ in range(2):
        assert said("b.npy") == "saved b.npy"


def test_hidden_parts_are_not_extracted(renderer: sg.Renderer, tmp_path: Path) -> None:
    for name, side in (("a", 48), ("b", 40)):
        np.save(tmp_path / f"{name}.npy", blob(side).samples)
    document = Document.open(SceneFile(str(tmp_path / "a.npy"), layers=(SceneFile(str(tmp_path / "b.npy")),)))
    state = State.of(document, SIZE)
    state = state.with_style(0, replace(state.styles[0], visible=False))
    document = document.with_styles(state.styles, state.mesh_files, state.settings)
    for stride in STRIDES:
        document.extract(stride)
    assert 1 in document.extracted
    screen = SimpleNamespace(put=lambda name, pixels: None)
    frame = FrameRenderer(cast(Any, screen), renderer).draw(state, document, FULL, False, lambda: False)
    assert 1 not in document.layers[0].by_stride and 1 in document.layers[1].shells and frame.hidden == 0
    # what is told is of what is drawn
    told = " ".join(hud.full_lines(state, document, frame, None))
    assert f"{len(document.layers[1].finest):,} of {40**3:,} voxels" in told


def test_too_many_splats_of_one_layer_are_not_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor those of the other one at that stride, over and over."""
    for name, low in (("a", 0), ("b", 20)):
        np.save(tmp_path / f"{name}.npy", blob(48).samples * (blob(48).samples > low))
    document = Document.open(SceneFile(str(tmp_path / "a.npy"), layers=(SceneFile(str(tmp_path / "b.npy")),)))
    for stride in STRIDES[1:]:
        document.extract(stride)
    first, second = (len(document.layers[number].at(2)) for number in (0, 1))
    assert first != second and not document.is_complete
    monkeypatch.setattr("splatgl.viewer.layer_splats.MOST_KEPT", 4 * (first + second))
    assert (
        document.exceeds_budget and document.is_complete and sum(layer.exceeds_budget for layer in document.layers) == 1
    )


def test_another_picture_is_not_called_refined(document: Document) -> None:
    """Neither while it is refused, nor once its extraction has failed."""
    state = State.of(document, SIZE)
    told = hud.short_lines(state, document, None, "the picture before")
    assert told[-1] == "the picture before"
    stale = cast(Any, Viewer.pending_reason).fget
    refiner, extractor = SimpleNamespace(refused=("x",)), Extractor(lambda: None)
    viewer = SimpleNamespace(coming=None, refiner=refiner, extractor=extractor, wanted=lambda: ("x",))
    assert stale(viewer) and not stale(SimpleNamespace(**{**vars(viewer), "wanted": lambda: ("y",)}))
    viewer.coming = document
    assert not stale(viewer)
    extractor.failed = document
    assert stale(viewer)


def test_progress_of_layers_is_of_all_their_voxels(document: Document, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where each volume is extracted in one part."""
    document = Document.open(replace(document.scene, layers=(document.scene,)))
    extractor, found = Extractor(lambda: None), list[float]()
    shell = LayerSplats.shell

    def noted(layer: LayerSplats, *args: Any) -> sg.Splats:
        found.append(extractor.part.begin)
        return shell(layer, *args)

    monkeypatch.setattr(LayerSplats, "shell", noted)
    extractor.wanted = document
    extractor._extract(document, [4, 2])
    counts = [layer.volumes[STRIDES.index(stride)].count for stride in (4, 2) for layer in document.drawn_layers]
    assert len(counts) == 4
    assert np.allclose(found, np.cumsum([0, *counts])[:-1] / sum(counts))


def test_progress_moves_while_one_part_is_extracted() -> None:
    """By the pace of the stride before, and ever slower where it takes longer than that."""
    part = ExtractedPart(0.2, 0.6, begun=100.0, voxels=1000, pace=0.01)
    shares = [part.share(100.0 + seconds) for seconds in (0.0, 5.0, 9.0, 12.0, 100.0, 1e4)]
    assert np.allclose(shares[:2], [0.2, 0.4])
    assert (np.diff(shares) > 0).all() and 0.59 < shares[-1] < 0.6
    assert replace(part, done=0.9).share(100.0) == pytest.approx(0.56)


def test_a_window_that_closes_ends_extraction_between_its_parts(document: Document) -> None:
    """Threads that work on parts are waited for when the process ends."""
    extractor, seen = Extractor(lambda: None), list[int]()
    extractor.wanted = document

    def work(part: slice) -> None:
        seen.append(part.start)
        extractor.wanted = None
        # not all are done before a busy machine goes on with the thread that waits for them
        time.sleep(0.001)

    def extract(*_: Any) -> None:
        in_parts(1000, 1, work)

    with pytest.raises(JobCancelled):
        extractor._extract(cast(Any, SimpleNamespace(exceeds_budget=False, drawn_layers=(), extract=extract)), [4])
    assert len(seen) < 1000


def test_a_reference_is_drawn_by_a_process_that_ends_at_once(
    document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is that of this process; one that is dropped ends in the midst of a band, as others that cannot be drawn."""
    reference = Reference(Jobs(lambda: None))
    document.extract(1)

    def request(width: int, settings: sg.Settings) -> None:
        reference.request(document, document.home((width, width)).camera, settings)

    def wait(reached: Callable[[], bool]) -> None:
        end = time.monotonic() + 120
        while not reached():
            reference.collect()
            assert time.monotonic() < end
            time.sleep(0.01)

    request(12, sg.Settings())
    assert reference.wanted is not None
    wanted = reference.wanted
    wait(lambda: reference.image is not None)
    assert reference.image is not None and not reference.note
    right = sg.reference.render(*wanted).pixels
    assert np.array_equal(reference.image.pixels, right)
    request(2000, sg.Settings())
    wait(lambda: reference.process is not None)
    process = reference.process
    assert process is not None
    reference.forget()
    process.wait(1.0)
    wait(lambda: not reference.jobs.all)
    assert reference.image is None and not reference.note and reference.process is None
    monkeypatch.setitem(KERNELS, "own", cast(Any, lambda: None))
    request(12, sg.Settings())
    wait(lambda: reference.note.startswith("no reference: another process"))


@pytest.mark.parametrize("is_wanted", [True, False])
def test_a_reference_whose_process_ends_within_its_news_is_none(
    document: Document, monkeypatch: pytest.MonkeyPatch, is_wanted: bool
) -> None:
    """As it is killed while it writes a picture."""
    reference = Reference(Jobs(lambda: None))
    wanted = reference.wanted = document.layers[0].at(1), document.home((6, 4)).camera, sg.Settings()

    def cut(self: Reference, process: Any, wanted: Any) -> None:
        self.wanted = wanted if is_wanted else None
        process.kill()
        pickle.loads(pickle.dumps(np.zeros(9))[:-9])

    monkeypatch.setattr(Reference, "_await", cut)
    with pytest.raises(sg.InputError if is_wanted else JobCancelled):
        reference._draw(wanted)


def test_references_of_layers_go_to_the_process(document: Document) -> None:
    layered = Document.open(replace(document.scene, layers=(document.scene,)))
    layered.extract(1)
    camera, (subject, settings) = layered.home((6, 4)).camera, layered.subject_at(1, sg.Settings())
    sent = pickle.loads(pickle.dumps(subject))
    pictures = [sg.reference.render(each, camera, settings).pixels for each in (subject, sent)]
    assert np.array_equal(*pictures) and pictures[0].any()


def test_a_message_stands_below_the_axes_of_a_narrow_picture(document: Document) -> None:
    """As they are at its top, where the scale takes the bottom."""
    painter = FrameRenderer.__new__(FrameRenderer)
    painter.words, painter.corner, painter.frame = (), "top left", None
    for width, scale, least in ((155, 1.0, 100), (310, 2.0, 200), (310, 1.0, 0)):
        state = replace(State.of(document, (width, 480)), annotate=("axes", "scale"), message="light matte")
        (text,) = painter._overlay(state, document, scale, "").texts
        assert least <= text.above <= 1.2 * least


def test_a_message_is_seen_over_texts_that_fill_the_picture(document: Document) -> None:
    """So that nobody waits for a picture that is refused without seeing why."""
    painter, size = FrameRenderer.__new__(FrameRenderer), (240, 480)
    painter.words, painter.corner, painter.frame = ("a line of all that is known",) * 90, "top left", None
    state = replace(State.of(document, size), hud="full", annotate=("axes",), message="light matte")
    words, message = painter._overlay(state, document, 1.0, "").texts
    assert text_box(words, size, 1.0)[3] > size[1] - 20 and text_box(message, size, 1.0)[3] <= size[1]


def test_a_click_is_handled_before_it_is_shown(document: Document, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a frame each for its press, its release and the list that it opens; what it changes comes first."""
    backend = pytest.importorskip("splatgl.viewer.imgui_backend", reason="needs the extra gui")
    calls = SimpleNamespace(new_frame=lambda: None, render=lambda: None)
    calls.backends = SimpleNamespace(opengl3_new_frame=lambda: None)
    monkeypatch.setattr(backend, "imgui", calls)
    gui = backend.Gui.__new__(backend.Gui)
    gui.owed, gui.waiting, gui.focused, gui.cursor = 0, [], False, (0.0, 0.0)
    gui.until_field = 0
    gui.panel = SimpleNamespace(covers=lambda x, y: True, widgets=SimpleNamespace(effects=[]), is_opening=False)
    gui.io = SimpleNamespace(add_mouse_button_event=lambda *given: None, add_key_event=lambda *given: None)
    monkeypatch.setattr(backend, "MODIFIERS", ())
    monkeypatch.setattr(gui, "_navigate", lambda is_shown: None)
    state, drawn = State.of(document, SIZE), list[State]()

    def draw(now: State, changes: int) -> State:
        drawn.append(now)
        return replace(now, message="changed") if len(drawn) == changes else now

    for changes, count in ((0, 3), (2, 2)):
        drawn.clear()
        for action in (1, 0):
            gui.event("button", 0, action, 0)
        changed = gui._handle_events(state, partial(draw, changes=changes))
        assert len(drawn) == count and changed.message == ("changed" if changes else "") and not gui.waiting
    assert gui.owed == 1


def test_a_click_is_shown_between_two_portions(monkeypatch: pytest.MonkeyPatch) -> None:
    """With what it changes; a new input cancels a full picture instead, and no preview."""
    view = Viewer.__new__(Viewer)
    view.window = window = cast(Any, SimpleNamespace(wait=lambda seconds: None, closing=False))
    view.panel, view.effects = SimpleNamespace(touched=False), []
    shown: list[int] = []

    def redisplay(self: Viewer) -> None:
        self.dirty -= 1
        shown.append(self.dirty)

    monkeypatch.setattr(Viewer, "_redisplay", redisplay)
    view.inputs, view.dirty, view.told = 3, 2, view.now()
    assert not view._is_interrupted(3) and shown == [1, 0]
    view.dirty = 3
    assert view._is_interrupted(2) and not view._is_interrupted(2, is_full=False) and len(shown) == 2
    assert not view._is_interrupted(3, is_full=False) and len(shown) == 2
    # over the panel, its widgets follow the mouse
    view.panel.touched = True
    assert not view._is_interrupted(2, is_full=False) and shown == [1, 0, 2, 1]
    window.closing = True
    assert view._is_interrupted(3, is_full=False)


def test_a_frame_of_the_panel_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever checks, and would end, the extraction of the picture during which it is drawn."""
    view, state = Viewer.__new__(Viewer), cast(Any, SimpleNamespace(panel=True, help=False))
    for name, value in {"_marks": lambda self: None, "_idle": frozenset, "drawn_size": SIZE}.items():
        monkeypatch.setattr(Viewer, name, value)
    view.state, view.document, view.effects = state, cast(Any, None), []
    view.screen = cast(Any, SimpleNamespace(draw=lambda *_: None, mark=lambda *_: None))
    view.painter = cast(Any, SimpleNamespace(look=lambda *_: None, frame=None))
    view.window, view.reference = cast(Any, SimpleNamespace(size=SIZE)), cast(Any, None)
    view.recent, view.recorder = cast(Any, None), cast(Any, SimpleNamespace(running=None))

    def frame(*_: object) -> State:
        check_now()
        return state

    panel = SimpleNamespace(widgets=SimpleNamespace(effects=[]))
    view.panel = SimpleNamespace(panel=panel, frame=frame, waiting=[], owed=0)

    def end() -> None:
        raise Interrupted

    with checked(end):
        view._compose()
        with pytest.raises(Interrupted):
            check_now()


def test_text_goes_on_while_a_picture_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the share that is extracted, or the seconds of the picture; not between two portions that follow quickly."""
    view, written = Viewer.__new__(Viewer), list[str]()
    view.window = cast(Any, SimpleNamespace(wait=lambda seconds: None, closing=False, scale=1.0))
    monkeypatch.setattr(Viewer, "busy", property(lambda self: busy.pop() if busy else None))
    monkeypatch.setattr(Viewer, "pending_reason", None)
    write = lambda state, document, scale, doing, note: written.append(doing)  # noqa: E731
    view.painter = cast(Any, SimpleNamespace(compared=lambda *_: "", write=write))
    view.recorder, view.reference = cast(Any, SimpleNamespace(running=None)), cast(Any, None)
    view.state = view.document = view.panel = cast(Any, None)
    view.effects, view.inputs, view.dirty, view.drawing = [], 3, 0, "refining"
    busy = ["extracting 7%"]
    view.told = view.now()
    for waited in (1.0, 0.0, 2.0):
        view.told -= waited
        view.begun = view.now() - 4.2
        assert not view._is_interrupted(3)
    assert written == ["extracting 7%", "refining, 4 s"]


def test_a_window_that_closes_draws_nothing_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A picture that is given up for it is the last thing, and the next step does not wait."""
    view = Viewer.__new__(Viewer)
    view.window = cast(Any, SimpleNamespace(wait=lambda seconds: None, fill=print, closing=False, size=(8, 8)))
    view.panel, view.effects, view.dirty, view.closed = None, [], 0, False
    view.state = cast(Any, SimpleNamespace(fullscreen=False))
    done: list[str] = []
    for name in ("collect", "_advance", "_fill", "perform", "_compare", "show"):
        monkeypatch.setattr(Viewer, name, lambda self, name=name: done.append(name))
    monkeypatch.setattr(Viewer, "_draw", lambda self: self.effects.append(WindowRequest.QUIT))
    view.step(0.0)
    assert done == ["collect", "_advance", "_fill", "perform", "_fill"] and view._seconds_until_due() == 0


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other allocators give back by themselves, or never")
def test_memory_below_what_is_kept_goes_back() -> None:
    small = [np.ones(2**13) for _ in range(3000)]
    kept, most = small[-50:], resident_mebibytes()
    del small
    sweep = IdleTrim(0.0, owns_process=True)
    sweep.look(object(), True, 1.0)
    assert gc.get_freeze_count() > 10_000
    sweep.close()
    assert not gc.get_freeze_count()
    assert most - resident_mebibytes() > 100 and len(kept) == 50


def test_names_with_bytes_that_are_no_letters() -> None:
    assert legible("caf\udce9 ×") == "caf? ×" and plain("caf\udce9 ×") == "caf? x"


@pytest.mark.long
@pytest.mark.skipif(bool(MISSING), reason="needs Xvfb and xdotool")
def test_a_file_with_such_a_name_opens(tmp_path: Path) -> None:
    pytest.importorskip("imgui_bundle", reason="needs the extra gui: pip install splatgl[gui]")
    np.save(tmp_path / "first.npy", blob().samples)
    strange = os.fsdecode(b"caf\xe9.npy")
    try:
        np.save(tmp_path / "plain.npy", blob(20).samples)
        (tmp_path / "plain.npy").rename(tmp_path / strange)
    except OSError:
        pytest.skip("no such names in this file system")
    window = Window(tmp_path / strange, tmp_path, size=(500, 400), panel=True)
    assert window.ask("settle")["full"] and window.key("?")["help"]
    window.end()

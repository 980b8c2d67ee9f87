"""What is read behind the window: no job is lost, and what arrives goes with what the window shows by then."""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from splatgl.geometry.scissors import Scissors
from splatgl.gl.renderer import Renderer
from splatgl.scene.meshes import MeshFile, read_meshes
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.viewer.adaptive_quality import STRIDES, Refiner
from splatgl.viewer.clip_tool import set_cuts
from splatgl.viewer.commands import (
    COMMANDS,
    NO_FILE,
    WITHOUT_FILE,
    LeaveDocument,
    Open,
    OpenOption,
    WindowRequest,
    ask_for_files,
    ask_to_leave,
    is_enabled,
)
from splatgl.viewer.document import Document
from splatgl.viewer.files import Recent, Watch
from splatgl.viewer.jobs import Extractor, FinishedJob, JobKind, Jobs
from splatgl.viewer.loading import AddedFiles, Files, Loaded, OpenedFile, open_document
from splatgl.viewer.measure_tool import under_cursor
from splatgl.viewer.saving import render_scene, save_as, scene_of
from splatgl.viewer.state import ClipState, History, State, stated_transfers
from splatgl.viewer.viewer import CHANGED, CUTS_ENDED, LEAVING, Options, Viewer
from tests.helpers.blobs import LONGEST, SIZE, blob


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, side in (("a", 24), ("b", 20)):
        np.save(tmp_path / f"{name}.npy", blob(side).samples)
    (tmp_path / "m.off").write_text("OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n")
    return tmp_path


def files(watched: tuple[str, ...] = (), reopen: Any = None) -> Files:
    return Files(Jobs(lambda: None), watched, reopen, 0.0)


class WithoutWindow(Viewer):
    """A viewer without a window, and what it says."""

    def __init__(self, document: Document, files: Files) -> None:
        state = State.of(document, SIZE)
        self.document, self.state, self.home, self.files, self.history = (
            document,
            state,
            state.pose,
            files,
            History(state),
        )
        self.coming, self.effects = None, []
        self.said: list[Any] = []
        self.freed: list[State] = []
        self.bases = stated_transfers(document.styles)
        self.options, self.recent, self.panel = Options(), Recent(), None
        self.extractor, self.refiner = Extractor(lambda: None), Refiner(document.counts, 100, 0.033)
        self.window: Any = SimpleNamespace(size=SIZE, scale=1.0, closing=False)
        self.renderer: Any = SimpleNamespace(free=lambda: self.freed.append(self.state), render=None)
        self.before = self.after = None
        self.warned = False
        self.dialogs = cast(Any, SimpleNamespace(take=lambda browser: (), kind=""))
        self.inputs, self.dirty, self.touched, self.last_error = 0, 1, 0.0, ("", "")
        self.closed = False

    def say(self, message: str, topic: str = "") -> None:
        self.said.append(message)
        self.state = replace(self.state, message=message)


def all_done(found: Files) -> list[FinishedJob]:
    assert found.jobs.wait(LONGEST)
    return found.jobs.collect()


def test_what_waits_is_replaced_by_its_kind_alone(folder: Path) -> None:
    """A file and a mesh that are dropped while finer voxels are read are both read after these, the file's newest."""
    pytest.importorskip("trimesh")
    found, gate = files(), threading.Event()
    found._read(JobKind.REFINE, "reading finer voxels", lambda: cast(Loaded, gate.wait(LONGEST)))
    for name in ("a.npy", "b.npy", "m.off"):
        found.open([str(folder / name)], Settings())
    assert [name for _, name in found.jobs.all] == [
        "reading finer voxels",
        "opening b.npy",
        "reading m.off",
    ] and found.opening == "b.npy"
    gate.set()
    done = all_done(found)
    assert [each.error for each in done] == [None] * 3 and isinstance(done[2].value, AddedFiles)
    for each in done:
        found.finish(each.kind)
    assert found.opening == ""


def test_meshes_stay_with_what_is_read_meanwhile(folder: Path) -> None:
    """Finer voxels, time points and changed files were asked for before the mesh was there."""
    pytest.importorskip("trimesh")
    document = Document.open(SceneFile(str(folder / "a.npy")))
    mesh = MeshFile(str(folder / "m.off"))
    for kind, news in (
        (JobKind.REFINE, replace(document)),
        (JobKind.TIME_POINT, Document.open(SceneFile(str(folder / "b.npy")))),
        (JobKind.RELOAD, Document.open(SceneFile(str(folder / "a.npy")))),
    ):
        viewer = WithoutWindow(document, files())
        viewer.apply(FinishedJob(JobKind.ADD, AddedFiles((), (mesh,), read_meshes([mesh]))))
        assert not document.meshes
        viewer.apply(FinishedJob(kind, (news, 1) if kind is JobKind.TIME_POINT else news))
        assert viewer.document is not document and viewer.state.mesh_files == (mesh,)
        shown = viewer.document.with_styles(viewer.state.styles, viewer.state.mesh_files, viewer.state.settings)
        assert len(shown.meshes) == 1 and shown.volume is news.volume


def test_finer_voxels_of_what_is_no_longer_shown_are_not_taken(folder: Path) -> None:
    """Of another document; another file is taken whatever is shown, and an edited document stays the same."""
    shown, other = (Document.open(SceneFile(str(folder / f"{name}.npy"))) for name in "ab")
    viewer = WithoutWindow(shown, files())
    viewer.apply(FinishedJob(JobKind.REFINE, other))
    assert viewer.document is shown
    finer = replace(shown)
    viewer.document = shown.with_styles((replace(shown.styles[0], extinction=2.0),), (), shown.scene.settings)
    viewer.apply(FinishedJob(JobKind.REFINE, finer))
    assert viewer.document.layers == finer.layers
    viewer.apply(FinishedJob(JobKind.RELOAD, other))
    assert viewer.document.scene is other.scene


@pytest.mark.parametrize("kind", ["rising", "labels"])
def test_time_points_have_the_look_of_their_series(kind: str, folder: Path) -> None:
    """The first one is empty: all are seen by the values of the widest; segments are those of each time point."""
    rising, edge = blob(12).samples.astype(np.float32), np.indices((12, 12, 12))[2] < 6
    labels = np.where(rising > rising.max() / 4, np.where(edge, 3, 8), 0).astype(np.uint8)
    for n in range(3):
        step = rising * n if kind == "rising" else labels * (n > 0) + np.uint8(n > 1) * (labels == 8)
        np.save(folder / f"s{n}.npy", step)
    found = files()
    viewer = WithoutWindow(Document.open(SceneFile(str(folder / "a.npy"))), found)
    found.open([str(folder / f"s{n}.npy") for n in range(3)], Settings())
    drawn = []
    for number in (0, 2):
        if number:
            viewer.state = replace(viewer.state, time=number)
            found.show_time(number)
        (done,) = all_done(found)
        viewer.apply(done)
        drawn.append(viewer.state.styles[0].stated)
        assert viewer.state.times == 3 and not viewer.history.has_unsaved_edits(viewer.state)
    # opacities refer to the length in the first
    alone = replace(Document.open(SceneFile(str(folder / "s2.npy"))).styles[0].stated, unit=1.0)
    if kind == "rising":
        assert drawn[0] == drawn[1] == alone
    else:
        assert not drawn[0].labels and drawn[1] == alone and [number for number, *_ in alone.labels] == [3, 9]
    # a changed file is read again in the look of the series
    found.reopen, found.watch = (lambda: SceneFile(str(folder / "s0.npy"))), Watch.of((str(folder / "s0.npy"),), 0.0)
    os.utime(folder / "s0.npy", (1, 1))
    found.check(viewer.state, 1e9)
    found.check(viewer.state, 2e9)
    (done,) = all_done(found)
    assert done.error is None and done.value.styles[0].stated == drawn[0]


def test_a_time_point_that_is_not_there_leaves_the_one_that_is_shown(folder: Path) -> None:
    found = files()
    viewer = WithoutWindow(Document.open(SceneFile(str(folder / "a.npy"))), found)
    found.times = tuple(SceneFile(str(folder / name)) for name in ("a.npy", "b.npy", "c.npy"))
    viewer.state = replace(viewer.state, times=3, time=2, playing=True)
    found.show_time(2)
    (done,) = all_done(found)
    viewer.apply(done)
    assert (viewer.state.time, viewer.state.playing, found.time) == (0, False, 0) and "c.npy" in viewer.said[0]
    # one that is there
    viewer.state = replace(viewer.state, time=1)
    found.show_time(1)
    (done,) = all_done(found)
    viewer.apply(done)
    assert (viewer.state.time, found.time, done.kind) == (1, 1, JobKind.TIME_POINT) and viewer.document.volume.shape[
        0
    ] == 20
    # one that is given up
    viewer.state, viewer.effects, viewer.dirty = replace(viewer.state, time=0), [WindowRequest.CANCEL], 1
    gate = threading.Event()
    found._read(JobKind.TIME_POINT, "reading time 0", lambda: cast(Loaded, gate.wait(LONGEST)))
    viewer.perform()
    gate.set()
    assert (viewer.state.time, found.jobs.busy, viewer.closed) == (1, None, False)
    # what waited for a file that is given up goes on
    layer = replace(viewer.document.layers[0], stand_in=cast(Any, SimpleNamespace(finer=lambda: None)))
    viewer.document, viewer.effects = replace(viewer.document, pool={0: layer}), [WindowRequest.CANCEL]
    gate = threading.Event()
    found._open("b.npy", lambda: cast(OpenedFile, gate.wait(LONGEST)))
    viewer.perform()
    assert [kind for kind, _ in found.jobs.all] == [JobKind.REFINE] or found.jobs.wait(LONGEST)
    gate.set()
    assert all_done(found)[0].kind is JobKind.REFINE
    # time points are drawn with the buffers of those before; another file frees these
    assert not viewer.freed
    found.open([str(folder / "b.npy")], Settings())
    (done,) = all_done(found)
    viewer.apply(done)
    assert len(viewer.freed) == 1


def test_a_job_that_is_told_has_ended() -> None:
    """Whoever is woken by it finds nothing running, or a file would stay to be opened for good."""
    found, seen = files(), []
    found.jobs.wake = lambda: seen.append(found.jobs.all)
    for _ in range(20):
        found._open("b.npy", lambda: cast(OpenedFile, None))
        (done,) = all_done(found)
        found.finish(done.kind)
        assert found.opening == ""
    assert seen == [[]] * 20


def test_a_failed_extraction_that_is_taken_back_is_over(folder: Path) -> None:
    """The picture is that of the state again: nothing is said, and nothing redrawn."""
    document = Document.open(SceneFile(str(folder / "a.npy")))
    for stride in STRIDES:
        document.extract(stride)
    viewer = WithoutWindow(document, files())
    viewer.state = replace(viewer.state, settings=viewer.state.settings.replace(classification="pre"))
    viewer._follow_state(False)
    assert viewer.coming is not None and viewer.extractor.jobs.wait(LONGEST)
    viewer.coming.layers[0].by_stride.clear()
    viewer.coming.layers[0].shells.clear()
    viewer.extractor.failed, viewer.extractor.why = viewer.coming, "not enough memory"
    viewer._follow_state(False)
    assert viewer.said[-1] == "not enough memory" and viewer.document is document
    viewer.state = replace(viewer.state, settings=document.scene.settings)
    viewer._follow_state(False)
    assert viewer.coming is None and viewer.document.layers == document.layers


def test_other_channels_have_their_own_looks(folder: Path) -> None:
    """Of a time point, or a changed file, with fewer channels than before."""
    tifffile = pytest.importorskip("tifffile")
    documents = []
    for count in (3, 2):
        path, samples = folder / f"{count}.tif", np.stack([blob().samples] * count, axis=1).astype(np.uint8)
        tifffile.imwrite(path, samples, imagej=True, metadata={"axes": "ZCYX"})
        documents.append(open_document(SceneFile(str(path), {"channel": "all"}))[0])
    assert [len(each.styles) for each in documents] == [3, 2]
    viewer = WithoutWindow(documents[0], files())
    viewer.history.note(replace(viewer.state, selected=2))
    viewer.state = replace(viewer.state, selected=2)
    viewer.apply(FinishedJob(JobKind.TIME_POINT, (documents[1], 1)))
    assert len(viewer.state.styles) == 2 and viewer.state.selected == 0
    # steps of the others cannot be taken back, and nothing is lost that was edited
    assert viewer.history.undo(viewer.state).message == "nothing to undo"
    assert not viewer.history.has_unsaved_edits(viewer.state)


def test_a_change_while_another_file_is_read_is_seen_afterwards(folder: Path) -> None:
    path = folder / "a.npy"
    found = files((str(path),), lambda: SceneFile(str(path)))
    gate = threading.Event()
    found._open("b.npy", lambda: cast(OpenedFile, gate.wait(LONGEST)))
    os.utime(path, (1, 1))
    state = State.of(Document.open(SceneFile(str(path))), SIZE)
    found.check(state, 1e9)
    assert [name for _, name in found.jobs.all] == ["opening b.npy"]
    gate.set()
    for each in all_done(found):
        found.finish(each.kind)
    found.check(state, 2e9)
    assert [each.kind for each in all_done(found)] == [JobKind.RELOAD]
    # of a file that is opened, from before it is read
    found.open([str(path)], Settings())
    (done,) = all_done(found)
    os.utime(path, (2, 2))
    found.follow(done.value)
    found.finish(done.kind)
    found.check(state, 3e9)
    assert [each.kind for each in all_done(found)] == [JobKind.RELOAD]


def test_another_size_is_no_step(folder: Path) -> None:
    """What was undone can be redone in a window of another size."""
    state = State.of(Document.open(SceneFile(str(folder / "a.npy"))), SIZE)
    history = History(state)
    edited = state.edit(extinction=2.0)
    history.note(edited)
    back = history.undo(edited)
    small = replace(back, pose=back.pose.resized((60, 40)))
    history.resize(back.pose, small.pose)
    history.note(small)
    again = history.redo(small)
    assert again.style.extinction == 2.0 and again.pose.camera.size == (60, 40) and len(history.past) == 1


@pytest.mark.parametrize(
    ("missing", "note"),
    [(24, "nothing to show: all samples are NaN"), (12, "50 % of the samples are NaN, and not drawn")],
)
def test_samples_that_are_missing_are_said(folder: Path, missing: int, note: str) -> None:
    samples = blob(24).samples.astype(np.float32)
    samples[:missing] = np.nan
    np.save(folder / "gaps.npy", samples)
    viewer = WithoutWindow(Document.open(SceneFile(str(folder / "a.npy"))), files())
    viewer.files.open([str(folder / "gaps.npy")], Settings())
    for done in all_done(viewer.files):
        viewer.apply(done)
    assert viewer.state.message == note


# --- edits and other files ------------------------------------------------------------------------------------------


@pytest.fixture
def edited(folder: Path) -> WithoutWindow:
    """A viewer of a volume whose transfer function is edited and not saved."""
    viewer = WithoutWindow(Document.open(SceneFile(str(folder / "a.npy"))), files())
    viewer.state = viewer.state.edit(extinction=2.0)
    return viewer


def applied(viewer: WithoutWindow) -> None:
    """Shows what was being read."""
    for done in all_done(viewer.files):
        viewer.apply(done)


def with_questions(viewer: WithoutWindow) -> list[Any]:
    """Gives the viewer a panel; returns what it asks."""
    asked: list[Any] = []
    viewer.panel = SimpleNamespace(panel=SimpleNamespace(questions=SimpleNamespace(ask=asked.append)))
    return asked


def test_edits_are_asked_for_before_another_file_is_opened(edited: WithoutWindow, folder: Path) -> None:
    """By a drop, the dialog, a recent file, a scene, another channel; what only adds loses nothing."""
    asked, path = with_questions(edited), str(folder / "b.npy")
    (folder / "s.toml").write_text('volume = "b.npy"')
    for opens in (Open((path,)), OpenOption("channel", "1")):
        edited.perform_one(opens)
        assert asked.pop() == ask_to_leave(opens) and not edited.files.jobs.busy and not asked
    edited.drop([str(folder / "s.toml")])
    assert asked.pop() == ask_to_leave(Open((str(folder / "s.toml"),)))
    edited.open([str(folder / "m.off")], are_alone=False)
    assert not asked and edited.files.jobs.busy
    all_done(edited.files)
    # saved ones are not lost
    edited.history.mark_saved(edited.state)
    edited.perform_one(Open((path,)))
    assert not asked and edited.files.opening == "b.npy"


def test_dropped_segmentations_are_added(edited: WithoutWindow, folder: Path) -> None:
    """By their names without a question; two values beside a volume are a segment, too."""
    asked, samples = with_questions(edited), np.zeros((20, 20, 20), np.uint8)
    samples[5:12, 5:12, 5:12] = 1
    for name in ("head_seg.npy", "liver.npy"):
        np.save(folder / name, samples)
    edited.drop([str(folder / "liver.npy")])
    assert asked.pop().answers[2][1] == Open((str(folder / "liver.npy"),), adds=True)
    edited.drop([str(folder / "head_seg.npy")])
    edited.perform_one(Open((str(folder / "liver.npy"),), adds=True))
    applied(edited)
    assert not asked and [len(style.base.labels) for style in edited.state.styles] == [0, 1, 1]


def test_the_question_about_edits_tells_of_a_recording(edited: WithoutWindow) -> None:
    """Closing cancels it, whatever is done about the edits."""
    asked = with_questions(edited)
    edited.window.stay, edited.recorder = lambda: None, cast(Any, SimpleNamespace(running=None))
    for running, is_told in ((None, False), (object(), True)):
        edited.recorder.running, edited.warned = cast(Any, running), False
        edited._quit()
        assert ("movie" in asked.pop().text) is is_told and not edited.closed


def test_segmentations_that_come_with_a_volume_are_its_labels(edited: WithoutWindow, folder: Path) -> None:
    """They are no time points; a mask is a segment, through which the volume is seen; the file is read again so."""
    samples = blob(20).samples
    for name, values in (("b_seg", samples > samples.max() / 2), ("mask_ct", samples)):
        np.save(folder / f"{name}.npy", values.astype(np.uint8))
    paths = [str(folder / f"{name}.npy") for name in ("b_seg", "b", "mask_ct")] + [str(folder / "m.off")]
    edited._replace(Open(tuple(paths)))
    applied(edited)
    document = edited.document
    assert document.names == ("b", "b_seg", "mask_ct") and edited.state.times == 0 and document.mesh_files
    assert [len(style.base.labels) for style in edited.state.styles] == [0, 1, 0]
    assert edited.state.style.opacity < 0.5
    assert edited.files.reopen is not None and len(edited.files.reopen().layers) == 2


def test_several_volumes_for_an_empty_window_are_asked_for(folder: Path) -> None:
    """They are a series, or layers of one scene."""
    viewer = WithoutWindow(Document.placeholder(SceneFile("")), files())
    paths = tuple(str(folder / f"{name}.npy") for name in "ab")
    asked = with_questions(viewer)
    viewer.drop(paths)
    assert asked == [ask_for_files(paths)] and not viewer.files.jobs.busy
    opens, adds, _ = (effect for _, effect in asked.pop().answers)
    assert opens == Open(paths)
    viewer.perform_one(adds)
    applied(viewer)
    assert viewer.document.names == ("a", "b") and viewer.state.times == 0
    viewer.perform_one(opens)
    applied(viewer)
    assert viewer.state.times == 2


def test_an_empty_window_waits_for_a_file(folder: Path) -> None:
    """What needs one says so; bad files do not close it, and the first takes the default settings."""
    viewer = WithoutWindow(Document.placeholder(SceneFile("")), files())
    assert viewer.document.is_empty and not Document.placeholder(SceneFile("a.npy")).is_empty and viewer.busy is None
    commands = {command.id: command for command in COMMANDS}
    assert {name for name, each in commands.items() if is_enabled(each, viewer.state, viewer.document)} == WITHOUT_FILE
    for name in ("screenshot", "plane", "slices", "help"):
        state, effects = commands[name](viewer.state, viewer.document)
        assert not effects and state.message == (NO_FILE if name != "help" else "")
        assert not (state.slices.shown or state.cuts.planes)
    viewer.drop([str(folder / "missing.npy")])
    applied(viewer)
    assert not viewer.closed and viewer.document.is_empty
    viewer.perform_one(Open((str(folder / "m.off"), str(folder / "b.npy")), adds=True))
    applied(viewer)
    assert viewer.document.volume.name == "b" and viewer.state.settings.background is not None
    assert viewer.state.mesh_files


def test_without_the_panel_a_second_drop_leaves_edits(edited: WithoutWindow, folder: Path) -> None:
    edited.drop([str(folder / "b.npy")])
    assert edited.state.message == LEAVING and not edited.files.jobs.busy
    # a key later, it asks again
    edited.state = replace(edited.state, message="")
    edited.drop([str(folder / "b.npy")])
    assert edited.state.message == LEAVING and not edited.files.jobs.busy
    edited.drop([str(folder / "b.npy")])
    assert edited.files.opening == "b.npy"


def test_planes_of_the_file_before_end_where_they_leave_nothing(edited: WithoutWindow, folder: Path) -> None:
    """Nothing is picked in what they leave, which ends no window."""
    plane = (0.0, 0.0, 1.0, 21.0)
    edited.state = set_cuts(edited.state, edited.document, ClipState(planes=(plane,)))
    assert edited.state.settings.clip == (plane,)
    edited._replace(Open((str(folder / "b.npy"),)))
    applied(edited)
    assert edited.state.message == CUTS_ENDED and edited.state.settings.clip == () == edited.state.cuts.planes
    clipped = replace(edited.state, settings=edited.state.settings.replace(clip=(plane,)))
    assert under_cursor(clipped, edited.document, (60.0, 40.0)) is None


def test_undo_shows_the_document_before_with_its_edits(edited: WithoutWindow, folder: Path) -> None:
    """And redo the next one, with what was done to it; a file opened instead ends that."""
    edited.history.note(edited.state)
    edited.perform_one(LeaveDocument(Open((str(folder / "b.npy"),))))
    applied(edited)
    assert edited.document.volume.name == "b" and edited.state.style.extinction == 1.0
    edited.state = edited.state.edit(extinction=3.0)
    for _ in range(2):
        edited.perform_one(WindowRequest.UNDO)
    assert edited.document.volume.name == "a" and edited.state.style.extinction == 2.0
    assert edited.history.has_unsaved_edits(edited.state) and edited.state.message == "a is shown again"
    edited.perform_one(WindowRequest.UNDO)
    assert edited.state.style.extinction == 1.0
    edited.perform_one(WindowRequest.UNDO)
    assert edited.state.message == "nothing to undo"
    for factor, name in ((2.0, "a"), (1.0, "b"), (3.0, "b")):
        edited.perform_one(WindowRequest.REDO)
        assert (edited.state.style.extinction, edited.document.volume.name) == (factor, name)
    assert edited.document.extracted


def test_a_document_that_takes_too_much_memory_is_not_kept(
    edited: WithoutWindow, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("splatgl.viewer.viewer.budget", lambda: edited.document.bytes - 1)
    edited.perform_one(LeaveDocument(Open((str(folder / "b.npy"),))))
    applied(edited)
    edited.perform_one(WindowRequest.UNDO)
    assert edited.document.volume.name == "b" and edited.state.message == "nothing to undo"


@pytest.mark.parametrize("is_written", [True, False])
def test_a_scene_is_saved_before_another_file_is_opened(
    edited: WithoutWindow, folder: Path, is_written: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Unless it cannot be: then it stays."""

    def save(name: str, work: Any, is_scene: bool) -> None:
        if is_written:
            edited.history.mark_saved(edited.state)

    monkeypatch.setattr(edited, "_save", save)
    edited.perform_one(LeaveDocument(Open((str(folder / "b.npy"),)), saves=True))
    assert edited.files.opening == "b.npy" * is_written
    all_done(edited.files)


@pytest.mark.parametrize("event", ["escape", "close", "edit"])
def test_a_picture_that_is_saved_can_be_cancelled(
    edited: WithoutWindow, folder: Path, renderer: Renderer, event: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the escape key, or by closing the window: nothing is written. An edit meanwhile is not in it."""
    before, document, target = edited.state, edited.document, folder / "a-picture.npy"
    edited.renderer, edited.told, edited.polled = renderer, 0.0, 0.0
    shown = list[str]()
    monkeypatch.setattr(edited, "show", lambda: shown.append(edited.drawing))

    def wait(seconds: float) -> None:
        edited.effects += [WindowRequest.CANCEL] * (event == "escape")
        edited.window.closing = event == "close"
        edited.state = edited.state.edit(extinction=0.5)

    edited.window.wait = wait
    edited._save("picture", partial(save_as, target=target), True)
    assert shown.count("saving picture") > 1 and not (edited.drawing or edited.effects)
    if event == "edit":
        wanted = render_scene(
            scene_of(before, document), document.with_styles(before.styles, (), before.settings), renderer.render
        )
        assert np.array_equal(np.load(target), wanted.pixels)
        # it was made after what was saved
        assert edited.history.has_unsaved_edits(edited.state)
    else:
        assert not target.exists() and "cancelled" in edited.state.message


def test_a_scene_that_changes_on_disk_loses_no_edits(edited: WithoutWindow, folder: Path) -> None:
    """Undo brings them back; a scene that says the same, of a file that changed, keeps them."""
    scissors = Scissors("0,0 0.4,0 0.4,0.4")
    first, same = (SceneFile(str(folder / "a.npy"), annotate=("box",), scissors=(scissors,)) for _ in range(2))
    viewer = WithoutWindow(Document.open(first), files())
    viewer.state = viewer.state.edit(extinction=2.0)
    viewer.apply(FinishedJob(JobKind.RELOAD, Document.open(same, quiet=True)))
    assert viewer.state.style.extinction == 2.0
    viewer.apply(FinishedJob(JobKind.RELOAD, Document.open(replace(same, threshold=0.1))))
    assert viewer.state.style.extinction == 1.0 and viewer.state.message == CHANGED
    viewer.perform_one(WindowRequest.UNDO)
    assert viewer.state.style.extinction == 2.0

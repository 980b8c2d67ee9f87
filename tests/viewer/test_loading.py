"""What is read behind the window: no job is lost, and what arrives goes with what the window shows by then."""

from __future__ import annotations

import os
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from splatgl.scene.meshes import MeshFile
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import Settings
from splatgl.viewer.adaptive_quality import STRIDES
from splatgl.viewer.document import Document, Together, read_meshes
from splatgl.viewer.jobs import Done, Extractor, Jobs, followed
from splatgl.viewer.loading import TIME, Brought, Files, News, arrived, opened
from splatgl.viewer.state import History, State
from splatgl.viewer.viewer import answered
from tests.helpers.blobs import LONGEST, SIZE, blob


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, side in (("a", 24), ("b", 20)):
        np.save(tmp_path / f"{name}.npy", blob(side).samples)
    (tmp_path / "m.off").write_text("OFF\n3 1 0\n0 0 0\n9 0 0\n0 9 0\n3 0 1 2\n")
    return tmp_path


def files(watched: tuple[str, ...] = (), reopen: Any = None) -> Files:
    return Files(Jobs(lambda: None), watched, reopen, 0.0)


def viewer_of(document: Document, found: Files, **more: Any) -> Any:
    """What of a viewer takes what arrives."""
    state = State.of(document, SIZE)
    viewer = SimpleNamespace(
        document=document, state=state, home=state.pose, files=found, history=History(state), size=SIZE, **more
    )
    viewer.said, viewer.freed = [], []
    viewer.renderer = SimpleNamespace(free=lambda: viewer.freed.append(viewer.state))
    viewer.hands = SimpleNamespace(touch=lambda: None, drop=lambda paths: None)
    viewer.refresh, viewer.over, viewer.now = lambda: None, lambda what: None, lambda: 0.0
    viewer.say = lambda text, of="": viewer.said.append(text)
    viewer.take = lambda document: setattr(viewer, "document", document)
    viewer.recent = SimpleNamespace(opened=lambda path: viewer.recent)
    return viewer


def all_done(found: Files) -> list[Done]:
    assert found.jobs.settled(LONGEST)
    return found.jobs.collect()


def test_what_waits_is_replaced_by_its_kind_alone(folder: Path) -> None:
    """A file and a mesh that are dropped while finer voxels are read are both read after these, the file's newest."""
    pytest.importorskip("trimesh")
    found, gate = files(), threading.Event()
    found._read("reading finer voxels", lambda: cast(News, gate.wait(LONGEST)), "finer")
    for name in ("a.npy", "b.npy", "m.off"):
        found.open([str(folder / name)], Settings())
    assert found.jobs.names == ["reading finer voxels", "opening b.npy", "reading m.off"] and found.opening == "b.npy"
    gate.set()
    done = all_done(found)
    assert [each.error for each in done] == [None] * 3 and isinstance(done[2].result, Brought)
    for each in done:
        found.finished(each.name)
    assert found.opening == ""


def test_meshes_stay_with_what_is_read_meanwhile(folder: Path) -> None:
    """Finer voxels, time points and changed files were asked for before the mesh was there."""
    pytest.importorskip("trimesh")
    document = Document.open(SceneFile(str(folder / "a.npy")))
    mesh = MeshFile(str(folder / "m.off"))
    for news in (
        News(replace(document, made={}, beside={}), finer=True),
        News(Document.open(SceneFile(str(folder / "b.npy"))), time=1),
        News(Document.open(SceneFile(str(folder / "a.npy")))),
    ):
        viewer = viewer_of(document, files())
        arrived(viewer, Done("reading m.off", Brought((mesh,), read_meshes([mesh]))))
        assert len(Together.with_meshes(document, {}).meshes) == 0
        arrived(viewer, Done("reading", news))
        assert viewer.document is not document and viewer.state.meshes == (mesh,)
        shown = viewer.document.followed(viewer.state.looks, viewer.state.meshes, viewer.state.settings)
        assert len(shown.meshes) == 1 and shown.volume is news.document.volume


def test_a_time_point_that_is_not_there_leaves_the_one_that_is_shown(folder: Path) -> None:
    found = files()
    viewer = viewer_of(Document.open(SceneFile(str(folder / "a.npy"))), found)
    found.times = tuple(SceneFile(str(folder / name)) for name in ("a.npy", "b.npy", "c.npy"))
    viewer.state = replace(viewer.state, times=3, time=2, playing=True)
    found.show_time(2)
    (done,) = all_done(found)
    arrived(viewer, done)
    assert (viewer.state.time, viewer.state.playing, found.time) == (0, False, 0) and "c.npy" in viewer.said[0]
    # one that is there
    viewer.state = replace(viewer.state, time=1)
    found.show_time(1)
    (done,) = all_done(found)
    arrived(viewer, done)
    assert (viewer.state.time, found.time, done.name) == (1, 1, f"{TIME} 1") and viewer.document.volume.shape[0] == 20
    # one that is given up
    viewer.state = replace(viewer.state, time=0, asks=("cancel",))
    gate = threading.Event()
    found._read(f"{TIME} 0", lambda: cast(News, gate.wait(LONGEST)), TIME)
    viewer.dialogs, viewer.window, viewer.dirty = SimpleNamespace(look=lambda: None), SimpleNamespace(closing=False), 1
    viewer.closed = viewer.warned = False
    answered(viewer)
    gate.set()
    assert (viewer.state.time, found.jobs.busy, viewer.closed) == (1, None, False)
    # what waited for a file that is given up goes on
    finer = replace(viewer.document, portion=SimpleNamespace(finer=lambda: None))
    viewer.document, viewer.state = finer, replace(viewer.state, asks=("cancel",))
    gate = threading.Event()
    found._open("b.npy", lambda: cast(News, gate.wait(LONGEST)))
    answered(viewer)
    assert found.jobs.names == ["reading finer voxels"] or found.jobs.settled(LONGEST)
    gate.set()
    assert all_done(found)[0].name == "reading finer voxels"
    # time points are drawn with the buffers of those before; another file frees these
    assert not viewer.freed
    found.open([str(folder / "b.npy")], Settings())
    (done,) = all_done(found)
    arrived(viewer, done)
    assert len(viewer.freed) == 1


def test_a_job_that_is_told_has_ended() -> None:
    """Whoever is woken by it finds nothing running, or a file would stay to be opened for good."""
    found, seen = files(), []
    found.jobs.wake = lambda: seen.append(list(found.jobs.names))
    for _ in range(20):
        found._open("b.npy", lambda: cast(News, None))
        (done,) = all_done(found)
        found.finished(done.name)
        assert found.opening == ""
    assert seen == [[]] * 20


def test_a_failed_extraction_that_is_taken_back_is_over(folder: Path) -> None:
    """The picture is that of the state again: nothing is said, and nothing redrawn."""
    document = Document.open(SceneFile(str(folder / "a.npy")))
    for stride in STRIDES:
        document.extract(stride)
    viewer = viewer_of(document, files(), coming=None, extractor=Extractor(lambda: None))
    viewer.hands.touched = 0.0
    taken: list[Document] = []

    def take(document: Document) -> None:
        taken.append(document)
        viewer.document, viewer.coming, viewer.extractor.failed = document, None, None

    viewer.take = take
    viewer.state = replace(viewer.state, settings=viewer.state.settings.but(classification="pre"))
    followed(viewer, False)
    assert viewer.coming is not None and viewer.extractor.jobs.settled(LONGEST)
    viewer.coming = replace(viewer.coming, made={}, skins={})
    viewer.extractor.failed, viewer.extractor.why = viewer.coming, "not enough memory"
    followed(viewer, False)
    assert viewer.said[-1] == "not enough memory" and not taken
    viewer.state = replace(viewer.state, settings=document.scene.settings)
    followed(viewer, False)
    assert viewer.coming is None and viewer.document is document


def test_other_channels_have_their_own_looks(folder: Path) -> None:
    """Of a time point, or a changed file, with fewer channels than before."""
    tifffile = pytest.importorskip("tifffile")
    documents = []
    for count in (3, 2):
        path, samples = folder / f"{count}.tif", np.stack([blob().samples] * count, axis=1).astype(np.uint8)
        tifffile.imwrite(path, samples, imagej=True, metadata={"axes": "ZCYX"})
        documents.append(opened(SceneFile(str(path), {"channel": "all"}))[0])
    assert [len(each.looks) for each in documents] == [3, 2]
    viewer = viewer_of(documents[0], files())
    viewer.history.note(viewer.state.selecting(2))
    viewer.state = viewer.state.selecting(2)
    arrived(viewer, Done(TIME, News(documents[1], time=1)))
    assert len(viewer.state.looks) == 2 and viewer.state.selected == 0
    # steps of the others cannot be taken back, and nothing is lost that was edited
    assert viewer.history.undone(viewer.state).message == "nothing to undo"
    assert not viewer.history.unsaved(viewer.state)


def test_a_change_while_another_file_is_read_is_seen_afterwards(folder: Path) -> None:
    path = folder / "a.npy"
    found = files((str(path),), lambda: SceneFile(str(path)))
    gate = threading.Event()
    found._open("b.npy", lambda: cast(News, gate.wait(LONGEST)))
    os.utime(path, (1, 1))
    state = State.of(Document.open(SceneFile(str(path))), SIZE)
    found.look(state, 1e9)
    assert found.jobs.names == ["opening b.npy"]
    gate.set()
    for each in all_done(found):
        found.finished(each.name)
    found.look(state, 2e9)
    assert [each.name for each in all_done(found)] == ["reading again"]
    # of a file that is opened, from before it is read
    found.open([str(path)], Settings())
    (done,) = all_done(found)
    os.utime(path, (2, 2))
    found.turn_to(done.result)
    found.finished(done.name)
    found.look(state, 3e9)
    assert [each.name for each in all_done(found)] == ["reading again"]


def test_another_size_is_no_step(folder: Path) -> None:
    """What was undone can be redone in a window of another size."""
    state = State.of(Document.open(SceneFile(str(folder / "a.npy"))), SIZE)
    history = History(state)
    edited = replace(state, extinction=2.0)
    history.note(edited)
    back = history.undone(edited)
    small = replace(back, pose=back.pose.resized((60, 40)))
    history.fitted(back.pose, small.pose)
    history.note(small)
    again = history.redone(small)
    assert again.extinction == 2.0 and again.pose.camera.size == (60, 40) and len(history.past) == 1

"""Movies that the window records: their motion, preview, process, and the command that draws the same."""

from __future__ import annotations

import shlex
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import PIL.ImageSequence
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer.document import Document
from splatgl.viewer.movie_track import Movie
from splatgl.viewer.recorder import Recorder, movie_command, movie_scene
from splatgl.viewer.saving import scene_of
from splatgl.viewer.state import State
from tests.helpers.blobs import blob
from tests.helpers.commands import acted
from tests.helpers.window import MISSING, Window

pytestmark = pytest.mark.usefixtures("shared_programs")

SIZE = (24, 20)
# seconds after which a process hangs
LONGEST = 300.0


@pytest.fixture
def document(tmp_path: Path) -> Document:
    np.save(tmp_path / "blob.npy", blob(12).samples)
    return Document.open(SceneFile(str(tmp_path / "blob.npy")))


def finished(recorder: Recorder) -> str:
    """The message of a recording once it has ended."""
    end = time.monotonic() + LONGEST
    message = ""
    while not message and time.monotonic() < end:
        time.sleep(0.05)
        _, message = recorder.look()
    return message


def flown(state: State, document: Document) -> State:
    """A movie of three keyframes."""
    for _ in range(3):
        state = acted(acted(state, "keyframe", document), "turn-left", document)
    return state


def test_keyframes_are_edited_and_saved(document: Document, tmp_path: Path) -> None:
    state = flown(State.of(document, SIZE), document)
    movie = state.movie
    assert movie.motion == "keyframes" and [key.time for key in movie.keyframes] == [0, 2, 4] and movie.count == 121
    swapped = movie.swapped(0)
    assert [key.view for key in swapped.keyframes[:2]] == [key.view for key in movie.keyframes[1::-1]]
    assert [key.time for key in swapped.keyframes] == [0, 2, 4] and swapped.swapped(0) == movie
    # a keyframe stays between its neighbours, and frames are apart however few there are
    assert movie.timed(1, 9.0).keyframes[1].time == pytest.approx(4 - 1 / 30) and movie.timed(2, 9.0).count == 271
    assert replace(movie, fps=0.25).frames == [0, 1, 2]
    assert [key.time for key in movie.without(1).keyframes] == [0, 4]
    other = acted(acted(state, "projection", document), "keyframe", document)
    assert "orthographic" in other.message and other.movie == movie
    # it survives the scene file, and a movie that is not edited is not written
    assert not scene_of(State.of(document, SIZE), document).animation
    target = tmp_path / "scene.toml"
    target.write_text(scene_of(state, document).to_toml(tmp_path))
    opened = State.of(Document.open(SceneFile.from_toml(target)), SIZE)
    assert opened.movie == movie
    target.write_text(target.read_text().replace("frame = 60", "frame = 0"))
    with pytest.raises(InputError, match="a frame after 0"):
        Document.open(SceneFile.from_toml(target))


@pytest.mark.parametrize("motion", ["turntable", "keyframes"])
def test_a_preview_passes_the_frames_of_the_movie(document: Document, motion: str) -> None:
    """It shows their cameras, and then the view before it."""
    state = flown(State.of(document, SIZE), document)
    state = replace(state, movie=replace(state.movie, motion=motion, seconds=4.0))
    assert acted(replace(state, movie=Movie("keyframes")), "preview", document).message.startswith("movie: expected")
    begun = acted(state, "preview", document)
    assert begun.preview is not None and begun.gliding
    shown = begun.preview.show(begun, 2.0)
    assert shown.preview is not None and not np.allclose(shown.pose.camera.eye, state.pose.camera.eye)
    if motion == "keyframes":
        assert shown.pose.camera.eye == pytest.approx(state.movie.keyframes[1].view.eye)
    else:
        # half a turn about the middle
        opposite = 2 * document.middle - state.pose.camera.eye
        assert shown.pose.camera.eye[:2] == pytest.approx(opposite[:2])
    assert shown.preview.show(shown, 2.5).pose.camera.eye == pytest.approx(state.pose.camera.eye)
    stopped = acted(shown, "preview", document)
    assert stopped.preview is None and stopped.pose.camera.eye == pytest.approx(state.pose.camera.eye)


def test_a_recording_is_the_movie_of_its_command(
    document: Document, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its frames are those that `splatgl animate` draws of the copied scene, bit for bit; nothing else stays."""
    state = State.of(document, SIZE)
    state = replace(state, movie=Movie(degrees=90.0, seconds=1.0, fps=2.0, form=""), ground="white")
    recorder = Recorder()
    recorder.start(*movie_scene(state, document, ()), tmp_path / "movie-001")
    with pytest.raises(InputError, match="one movie at a time"):
        recorder.start(*movie_scene(state, document, ()), tmp_path / "movie-002")
    assert finished(recorder) == "saved movie-001: 2 frames" and recorder.running is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["blob.npy", "movie-001"]
    copied = movie_command(state, document, ())
    scene = copied.split("<<'END'\n")[1].split("END\n")[0]
    command = shlex.split(copied.strip().split("\n")[-1])
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(scene)
    assert command[0] == "splatgl" and main([*command[1:], "--quiet"]) == 0
    for name in ("0000.png", "0001.png"):
        recorded, drawn = (sg.Image.load(tmp_path / folder / name).pixels for folder in ("movie-001", "movie"))
        assert np.array_equal(recorded, drawn) and recorded.shape == (20, 24, 4) and recorded[0, 0].min() == 1


def test_a_series_is_recorded_by_all_its_points(document: Document) -> None:
    state = State.of(document, SIZE)
    state = replace(state, movie=Movie("still", seconds=2.0, fps=10.0, series=True, stamped=True), times=8, time=3)
    files = tuple(SceneFile(f"t{number}.npy") for number in range(8))
    scene, more = movie_scene(state, document, files)
    assert Path(scene.volume).name == "t0.npy" and [Path(file).name for file in more] == [
        f"t{n}.npy" for n in range(1, 8)
    ]
    # each for as many frames as the others
    assert scene.animation["hold"] == 2 and scene.animation["frames"] == 16
    points = tuple(SceneFile("t.nrrd", load={"time": number}) for number in range(8))
    scene, more = movie_scene(state, document, points)
    assert "time" not in scene.load and not more
    # else the one that is shown
    one = replace(state, movie=replace(state.movie, series=False))
    scene, more = movie_scene(one, document, points)
    assert scene.load["time"] == 3 and not more and "hold" not in scene.animation


@pytest.mark.long
@pytest.mark.parametrize("form", ["", ".mp4", ".webm", ".gif"])
@pytest.mark.parametrize("is_one_file", [False, True])
def test_a_recorded_series_is_that_of_animate(tmp_path: Path, is_one_file: bool, form: str) -> None:
    """Frame by frame, of several files and of one with several time points: three, each for two frames while the camera
    turns; frames bit for bit, movies as near as their codecs.
    """
    if form in (".mp4", ".webm"):
        pytest.importorskip("av")
    # the blob fills the frame, so that its loss in a codec is that of a picture
    near = ViewOptions(zoom=1.8)
    points = [blob(12).samples * np.float32(factor) for factor in (1.0, 0.6, 0.3)]
    if is_one_file:
        header = "NRRD0004\ntype: float\nendian: little\ndimension: 4\nsizes: 12 12 12 3\nencoding: raw\n"
        header += "kinds: domain domain domain time\n\n"
        (tmp_path / "series.nrrd").write_bytes(header.encode() + np.stack(points).astype("<f4").tobytes())
        scene = SceneFile(str(tmp_path / "series.nrrd"), view=near)
        times = tuple(replace(scene, load={"time": number}) for number in range(3))
    else:
        for number, samples in enumerate(points):
            np.save(tmp_path / f"t{number}.npy", samples)
        times = tuple(SceneFile(str(tmp_path / f"t{number}.npy"), view=near) for number in range(3))
    document = Document.open(times[0])
    movie = Movie(degrees=60.0, seconds=1.0, fps=6.0, form=form, series=True, size=(48, 32))
    state = replace(State.of(document, SIZE), movie=movie, times=3, ground="white", annotate=())
    recorder, target = Recorder(), tmp_path / f"recorded{form}"
    recorder.start(*movie_scene(state, document, times), target)
    assert finished(recorder) == f"saved {target.name}: 6 frames"
    # the same movie by options of the command
    still = scene_of(state, document)
    (tmp_path / "still.toml").write_text(replace(still, load={}, animation={}).to_toml(tmp_path))
    more = [] if is_one_file else [point.volume for point in times[1:]]
    options = ["--turntable", "60", "--axis", "0,0,1", "--frames", "6", "--hold", "2", "--fps", "6", "--size", "48x32"]
    picture = ["--background", "white", "--quiet", "-o", str(tmp_path / "{frame:04d}.png")]
    assert main(["animate", str(tmp_path / "still.toml"), *more, *options, *picture]) == 0
    drawn = [sg.Image.load(tmp_path / f"{number:04d}.png").samples8()[..., :3] for number in range(6)]
    assert len({frame.tobytes() for frame in drawn}) == 6
    for number, frame in enumerate(read_frames(target)):
        off = [np.abs(frame.astype(int) - other.astype(int)) for other in drawn]
        assert off[number].max() == 0 if not form else off[number].mean() < 4, number
        # frames of the other time points are far off
        means = np.array([each.mean() for each in off])
        assert means[number] < 0.2 * means[np.arange(6) // 2 != number // 2].min(), (number, means)


def read_frames(target: Path) -> list[np.ndarray]:
    """The frames of a movie or of a folder of pictures, uint8 [H, W, 3]."""
    if target.is_dir():
        return [sg.Image.load(path).samples8()[..., :3] for path in sorted(target.iterdir())]
    if target.suffix == ".gif":
        with PIL.Image.open(target) as movie:
            return [np.asarray(frame.convert("RGB")) for frame in PIL.ImageSequence.Iterator(movie)]
    import av

    with av.open(str(target)) as movie:
        return [frame.to_ndarray(format="rgb24") for frame in movie.decode(video=0)]


def test_a_cancelled_recording_leaves_nothing(document: Document, tmp_path: Path) -> None:
    state = replace(State.of(document, SIZE), movie=Movie(form=".gif"))
    recorder = Recorder()
    recorder.start(*movie_scene(state, document, ()), tmp_path / "movie-001.gif")
    assert recorder.running is not None and recorder.running.count == 120
    process = recorder.running.process
    assert recorder.cancel() and process.poll() is not None and not recorder.cancel()
    # and so does one that fails
    (scene, more) = movie_scene(state, document, ())
    recorder.start(replace(scene, volume=str(tmp_path / "none.npy")), more, tmp_path / "movie-001.gif")
    assert "none.npy" in finished(recorder)
    assert [path.name for path in tmp_path.iterdir()] == ["blob.npy"]


@pytest.mark.skipif(bool(MISSING), reason=f"needs {' and '.join(MISSING)}: apt-get install xvfb xdotool")
def test_a_movie_is_recorded_from_the_window(tmp_path: Path) -> None:
    """By the palette; the window is drawn meanwhile, and tells the end."""
    pytest.importorskip("av")
    np.save(tmp_path / "blob.npy", blob(12).samples)
    scene = tmp_path / "scene.toml"
    scene.write_text('volume = "blob.npy"\n[animation]\nturntable = 90\nframes = 2\nfps = 2\n')
    window = Window(scene, tmp_path, panel=True)
    window.hands("key", "ctrl+p")
    window.ask("settle")
    window.hands("type", "record the movie")
    window.ask("settle")
    window.hands("key", "Return")
    told = window.until(lambda told: told["message"].startswith("saved"))
    assert told["message"] == "saved movie-001.mp4: 2 frames"
    window.end()
    assert sorted(path.name for path in tmp_path.glob("*movie*")) == ["movie-001.mp4"]

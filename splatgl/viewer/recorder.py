"""`Recorder`: a process of `splatgl animate` that draws a movie of the window's scene."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from splatgl.animation.animation import MOVIES, FrameFiles
from splatgl.animation.movie import need
from splatgl.data.scenes import SCENES
from splatgl.errors import USER_ERRORS, error_text, expected
from splatgl.fileio import atomic_write, check_folder
from splatgl.readers.remote import is_address
from splatgl.scene.draw import duration
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.hud import background_of
from splatgl.viewer.jobs import NICE
from splatgl.viewer.saving import scene_of
from splatgl.viewer.state import State

# seconds for which an ended process may go on
PATIENCE = 10.0
FRAME = "{frame:04d}.png"


def movie_scene(state: State, document: Document, times: Sequence[SceneFile]) -> tuple[SceneFile, list[str]]:
    """The scene of the movie of a state, and the files of its series after the first. times: scenes of the time points.

    Raises InputError for a movie without frames.
    """
    movie, scene = state.movie, scene_of(state, document)
    movie.check()
    background = background_of(state) if state.ground != "checks" else state.settings.ground
    view = movie.keyframes[0].view if movie.motion == "keyframes" else state.pose.view()
    view = replace(view, size=movie.size or state.pose.camera.size, fit=scene.view.fit)
    annotate, more, shown = scene.annotate, [], times[state.time : state.time + 1]
    if movie.series and len(times) > 1:
        annotate, shown = (*annotate, *["time"] * movie.stamped), times[:1]
        others = [point.volume for point in times[1:] if point.volume != times[0].volume]
        more = [file if file in SCENES or is_address(file) else str(Path(file).resolve()) for file in others]
    load = {name: value for name, value in scene.load.items() if name != "time"}
    for point in shown:
        scene = replace(scene, volume=point.volume)
        if "time" in point.load and not (movie.series and not more):
            load["time"] = point.load["time"]
    return replace(
        scene,
        load=load,
        view=view,
        settings=scene.settings.replace(background=background),
        annotate=annotate,
        animation=movie.table(document, len(times)),
    ), more


def movie_command(state: State, document: Document, times: Sequence[SceneFile]) -> str:
    """Shell commands that write the scene of a movie and draw it. Raises InputError as `movie_scene`."""
    (scene, more), form = movie_scene(state, document, times), state.movie.form
    output = f"movie{form}" if form else f"movie/{FRAME}"
    return f"cat > scene.toml <<'END'\n{scene.to_toml()}END\n{shlex.join(_command('scene.toml', more, output))}\n"


def _command(scene: str, more: Sequence[str], output: str) -> list[str]:
    return ["splatgl", "animate", scene, *more, "-o", output]


@dataclass
class Recording:
    """A running process. folder: its working folder, next to the target; frames: those that it writes, `drawn` of
    `count` so far; first: when the first was seen.
    """

    process: subprocess.Popen[bytes]
    target: Path
    folder: Path
    frames: FrameFiles
    count: int
    drawn: int = 0
    first: float = 0.0

    @property
    def share(self) -> float:
        """Drawn part of the frames."""
        return self.drawn / self.count

    @property
    def text(self) -> str:
        """The current frame, and the remaining time."""
        if self.drawn == self.count:
            return f"writing {self.target.name}"
        text = f"frame {self.drawn + 1} of {self.count}"
        if self.drawn < 2:
            return text
        left = (time.monotonic() - self.first) / (self.drawn - 1) * (self.count - self.drawn)
        return f"{text}, {duration(left)} left"


class Recorder:
    """Draws one movie at a time, in another process. running: the movie that is being drawn."""

    def __init__(self) -> None:
        self.running: Recording | None = None

    def start(self, scene: SceneFile, more: Sequence[str], target: Path) -> None:
        """Begins a movie, or a folder of frames, which is there once it is complete. Raises InputError for a target
        that cannot be written, for a missing library, and while another movie is drawn.
        """
        if self.running is not None:
            raise expected("recording", "one movie at a time", "another one", "wait for it, or cancel it")
        text = scene.to_toml()
        need(target)
        check_folder(target.parent, target)
        folder = Path(tempfile.mkdtemp(prefix=".movie-", dir=target.parent))
        (folder / "scene.toml").write_text(text, encoding="utf-8")
        output = folder / target.name if target.suffix.lower() in MOVIES else folder / "frames" / FRAME
        arguments = [*_command(str(folder / "scene.toml"), more, str(output))[1:], "--quiet"]
        with (folder / "errors").open("wb") as errors:
            process = subprocess.Popen(
                [sys.executable, "-m", "splatgl", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            )
        table = scene.animation
        count = table["frames"] if "frames" in table else table["keyframe"][-1]["frame"] + 1
        if hasattr(os, "setpriority"):
            os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
        self.running = Recording(process, target, folder, FrameFiles.at(str(output), ""), count)

    def look(self) -> tuple[bool, str]:
        """Whether the progress has changed, and the message of a finished movie."""
        running = self.running
        if running is None:
            return False, ""
        before = running.drawn
        while running.drawn < running.count and running.frames.path(running.drawn).exists():
            running.drawn += 1
        if not before and running.drawn:
            running.first = time.monotonic()
        if (code := running.process.poll()) is None:
            return running.drawn > before, ""
        self.running = None
        try:
            return True, _finish(running) if code == 0 else _error_of(running)
        except USER_ERRORS as error:
            return True, error_text(error)
        finally:
            shutil.rmtree(running.folder, ignore_errors=True)

    def cancel(self) -> bool:
        """Cancels the recording and removes its files; returns whether there was one."""
        running, self.running = self.running, None
        if running is None:
            return False
        running.process.terminate()
        try:
            running.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            running.process.kill()
            running.process.wait()
        shutil.rmtree(running.folder, ignore_errors=True)
        return True


def _finish(running: Recording) -> str:
    """Moves what was drawn to its place; returns the message to show."""
    if running.frames.movie is None:
        running.frames.path(0).parent.replace(running.target)
    else:
        with atomic_write(running.target) as part:
            running.frames.movie.replace(part)
    return f"saved {running.target.name}: {running.count} frames"


def _error_of(running: Recording) -> str:
    """The last line that the process wrote."""
    lines = (running.folder / "errors").read_text("utf-8", "replace").split("\n")
    written = [line.removeprefix("splatgl: ") for line in lines if line.strip()]
    return written[-1] if written else f"recording: ended by code {running.process.returncode}"

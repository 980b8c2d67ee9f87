"""`Movie`: how the camera of a recorded movie moves, and its preview in the window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from splatgl.animation.animation import FULL_TURN, Timeline
from splatgl.animation.api import FPS, timeline_of
from splatgl.animation.camera_track import FIXED, CameraTrack, keyframes, turning
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.options import non_default
from splatgl.scene.scene_file import TRACK, SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.viewer.trackball import Pose, up_direction

if TYPE_CHECKING:
    from splatgl.viewer.document import Document
    from splatgl.viewer.state import State

MOTIONS = ("turntable", "keyframes", "still")
# endings, and what they are called; frames are a folder of PNG files
FORMS = {".mp4": "MP4", ".webm": "WebM", ".gif": "GIF", "": "frames (PNG)"}
# seconds between a new keyframe and the one before
STEP = 2.0


@dataclass(frozen=True)
class Keyframe:
    """A view, and the seconds after which the camera has it."""

    time: float
    view: ViewOptions


@dataclass(frozen=True)
class Movie:
    """motion: one of MOTIONS. degrees: of a turntable in all. seconds: of a movie without keyframes. form: of FORMS.
    size: pixels; None: those of the picture. series: whether all time points are shown, and stamped: their times in the
    picture. keyframes: in the order of their times.
    """

    motion: str = MOTIONS[0]
    degrees: float = FULL_TURN
    seconds: float = 4.0
    fps: float = FPS
    form: str = ".mp4"
    size: tuple[int, int] | None = None
    series: bool = False
    stamped: bool = False
    keyframes: tuple[Keyframe, ...] = ()

    @classmethod
    def of(cls, table: Mapping[str, Any], volume: Volume) -> Movie:
        """The movie of a scene's table [animation]. Raises InputError for a bad one."""
        timeline, fps = timeline_of(SceneFile("", animation=table), Timeline(), None)
        fps, rows = fps or FPS, table.get("keyframe", ())
        if rows:
            track = keyframes({name: table[name] for name in TRACK if name in table}, ViewOptions(), volume, volume)
            views = [ViewOptions(**{name: value for name, value in row.items() if name != "frame"}) for row in rows]
            shown = tuple(Keyframe(row["frame"] / fps, view) for row, view in zip(rows, views, strict=True))
            return cls("keyframes", seconds=track.last / fps, fps=fps, series="hold" in table, keyframes=shown)
        count = timeline.frames or round(cls.seconds * fps)
        degrees = -count * timeline.degrees(count, series=False)
        motion = "turntable" if degrees else "still"
        return cls(motion, degrees or FULL_TURN, count / fps, fps, series="hold" in table)

    @property
    def count(self) -> int:
        """Number of frames."""
        if self.motion == "keyframes":
            return self.frames[-1] + 1 if self.keyframes else 0
        return max(1, round(self.seconds * self.fps))

    @property
    def frames(self) -> list[int]:
        """Numbers of the frames of the keyframes, ascending."""
        numbers: list[int] = []
        for key in self.keyframes:
            numbers.append(max(round(key.time * self.fps), *(number + 1 for number in numbers[-1:]), 0))
        return numbers

    def check(self) -> None:
        """Raises InputError for a movie without frames."""
        if not self.count:
            raise expected("movie", "keyframes", "none", "add the view as a keyframe")

    def hold(self, times: int) -> int:
        """Number of frames for each of so many time points."""
        return max(1, round(self.count / times))

    def table(self, document: Document, times: int) -> dict[str, Any]:
        """The table [animation] of a scene. times: number of time points of the series."""
        table: dict[str, Any] = {"fps": self.fps}
        if self.series and times > 1:
            table["hold"] = self.hold(times)
        if self.motion == "keyframes":
            pairs = zip(self.frames, self.keyframes, strict=True)
            rows = [{"frame": frame, **_numbers(key.view)} for frame, key in pairs]
            return {**table, "path": "orbit", "keyframe": rows}
        # each time point for as long as the others
        count = table["hold"] * times if "hold" in table else self.count
        degrees = self.degrees if self.motion == "turntable" else 0.0
        return {"turntable": degrees, "axis": up_direction(document).tolist(), "frames": count, **table}

    def with_keyframe(self, pose: Pose) -> Movie:
        """The movie with one more keyframe, after the others. Raises InputError for another projection."""
        view, before = ViewOptions(**_numbers(pose.view())), self.keyframes[-1:]
        if before and (before[0].view.height is None) != (view.height is None):
            kinds = ("perspective", "orthographic")
            this, other = kinds if before[0].view.height is None else kinds[::-1]
            raise expected("keyframe", f"a view in {this}, as the others", other, "switch the projection (p)")
        time = before[0].time + STEP if before else 0.0
        return replace(self, motion="keyframes", keyframes=(*self.keyframes, Keyframe(time, view)))

    def without(self, number: int) -> Movie:
        """The movie without a keyframe."""
        return replace(self, keyframes=(*self.keyframes[:number], *self.keyframes[number + 1 :]))

    def timed(self, number: int, time: float) -> Movie:
        """The movie with another time of a keyframe, which stays between its neighbours."""
        keys, gap = self.keyframes, 1 / self.fps
        low = keys[number - 1].time + gap if number else 0.0
        high = keys[number + 1].time - gap if number + 1 < len(keys) else float("inf")
        moved = replace(keys[number], time=min(max(time, low), max(low, high)))
        return replace(self, keyframes=(*keys[:number], moved, *keys[number + 1 :]))

    def swapped(self, number: int) -> Movie:
        """The movie with the views of a keyframe and the next one exchanged; their times stay."""
        keys = list(self.keyframes)
        first, second = keys[number : number + 2]
        keys[number : number + 2] = replace(first, view=second.view), replace(second, view=first.view)
        return replace(self, keyframes=tuple(keys))


def _numbers(view: ViewOptions) -> dict[str, Any]:
    """The numbers of a view that a keyframe states."""
    return {name: value for name, value in non_default(view).items() if name not in FIXED}


@dataclass(frozen=True, eq=False)
class Preview:
    """A movie that plays in the window. home: the view before; time: seconds since its begin."""

    movie: Movie
    track: CameraTrack
    home: Pose
    time: float = 0.0

    @classmethod
    def of(cls, state: State, document: Document) -> Preview:
        """The preview of the movie of a state. Raises InputError for a movie without frames, as `animate` does."""
        movie, volume = state.movie, document.volume
        view = replace(state.pose.view(), fit=document.scene.view.fit)
        movie.check()
        if movie.motion == "keyframes":
            table = {name: value for name, value in movie.table(document, 1).items() if name in TRACK}
            track: CameraTrack = keyframes(table, view, volume, document.subject)
        else:
            degrees = -movie.degrees / movie.count if movie.motion == "turntable" else 0.0
            track = turning(view, volume, document.subject, degrees, up_direction(document))
        return cls(movie, track, state.pose)

    def show(self, state: State, seconds: float) -> State:
        """The state so many seconds later; the view before once the movie is over."""
        time = self.time + seconds
        frame = int(time * self.movie.fps)
        if frame >= self.movie.count:
            return stop_preview(state)
        pose = replace(self.home, camera=self.track.camera(frame).resized(state.pose.camera.size))
        if self.movie.series and state.times > 1:
            state = replace(state, time=frame // self.movie.hold(state.times) % state.times)
        return replace(state, pose=pose, preview=replace(self, time=time))


def stop_preview(state: State) -> State:
    """The state in the view before its preview, if there is one."""
    if state.preview is None:
        return state
    return replace(state, pose=state.preview.home.resized(state.pose.camera.size), preview=None)

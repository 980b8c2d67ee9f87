"""`sg.animate`, and the writing of an animation's frames and movie."""

from __future__ import annotations

import html
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from splatgl.animation.animation import MOVIES, Animation, FrameFiles, Timeline
from splatgl.animation.movie import need, volumes, write_behind
from splatgl.coercion import public
from splatgl.data.arrays import time_points_of
from splatgl.errors import USER_ERRORS, error_prefix, expected
from splatgl.fileio import check_source, within, write_file
from splatgl.options import OptionGroup, is_number, keyword, keywords_of, names_of, non_default
from splatgl.scene.api import scene_of, ungrouped, with_groups
from splatgl.scene.draw import DrawOptions, WorkerOptions, progress_bar
from splatgl.scene.open_scene import print_lines
from splatgl.scene.scene_file import TRACK, SceneFile
from splatgl.splat.kernels import require_built_in
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.keywords import AnimateKeywords

FPS = 30.0
# shortest movie of a series, seconds
SHORTEST = 2.0
# a GIF frame lasts at most 655 s
MIN_FPS, MAX_FPS = 0.01, 1000.0
BLACK = (0.0, 0.0, 0.0)
# number, file and notes of frames; and what is called with the path of each that exists
Drawn = Iterator[tuple[int, bytes, list[str]]]
Wrote = Callable[[Path], None]


# largest movie in a notebook's file, bytes; others are read from where they are
MOST_INLINE = 1 << 26


class AnimationFiles(list[Path]):
    """The files of an animation, which notebooks show as a player if they are a movie."""

    def _repr_html_(self) -> str | None:
        kind = self[0].suffix.lower().removeprefix(".") if len(self) == 1 else ""
        if f".{kind}" not in MOVIES or not self[0].is_file():
            return None
        source = html.escape(self[0].as_posix())
        if self[0].stat().st_size <= MOST_INLINE:
            mime = f"image/{kind}" if kind == "gif" else f"video/{kind}"
            source = f"data:{mime};base64,{b64encode(self[0].read_bytes()).decode()}"
        return f'<img src="{source}">' if kind == "gif" else f'<video controls loop src="{source}"></video>'


# keywords of an animation alone: its time points may be several
TIMES = {
    "time": keyword("time", "slice | int | float | str | None", help="time points, such as slice(0, 20, 2), or one"),
    **keywords_of(Timeline),
    **keywords_of(WorkerOptions, *names_of(WorkerOptions)),
    "fps": keyword("fps", "float | None", help="frames per second (default 30, of a short series fewer)"),
    "bits": keyword("bits", "Literal[8, 16]", 8, "bits of the frames' samples: 8, 16"),
    "resume": keyword("resume", "bool", False, "keep frames that exist"),
}


@with_groups(TIMES)
@public
def animate(
    x: Any,
    output: str | Path,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    **options: Unpack[AnimateKeywords],
) -> list[Path]:
    """Draws frames or a movie with the defaults of `splatgl animate`; returns the files: one movie, which a notebook
    plays, or the frames.

    x: as of `render`, not splats, scenes or plotters; or a list: a series in time, as are the files of a pattern, the
    time points of an xarray, and those of a file, or some of them: time=slice(0, 20, 2). output: frames/{frame:04d}.png
    or .npy, or a name that ends in .mp4, .webm or .gif. transfer, settings: as of `render`.
    options: those of `render`, and frames (their number), draft (draw faster), turntable (total angle in degrees, 360
    by default), spin (degrees a frame), axis, keyframes (a file or its table), hold (frames for each volume of a
    series), flow, only (the first and the last frame to draw), fps, bits (8 or 16), resume (keep frames that exist),
    workers (processes of this machine that draw) or scheduler (the address of Dask's), devices (their numbers); they
    replace those of a scene file. Raises InputError as `render`, and for options that do not go together.

    ```python
    sg.animate("head.nii.gz", "turn.gif", frames=8, size=64)
    ```
    """
    items = list(x) if isinstance(x, list | tuple) else time_points_of(x)
    if not items:
        raise expected("animate", "volumes, arrays or files", "an empty list")
    if "camera" in options:
        raise expected("animate", "a view", "a camera", "name its azimuth, elevation and zoom, or eye and look_at")
    options_given, (look, base) = ungrouped(options, transfer, settings)
    given = {name: options_given[name] for name in OWN if name in options_given}
    by = WorkerOptions(**{name: given.pop(name) for name in names_of(WorkerOptions) if name in given})
    rest = {name: value for name, value in options_given.items() if name not in OWN and not isinstance(value, slice)}
    fps, bits, resume = (given.pop(name, usual) for name, usual in (("fps", None), ("bits", 8), ("resume", False)))
    if bits not in (8, 16):
        raise expected("bits", "8 or 16", repr(bits))
    check_fps(fps, "fps")
    found = [scene_of(item, look, None, base, rest) for item in items]
    scenes, how = (
        [scene for scene in found if isinstance(scene, SceneFile)],
        DrawOptions(is_shared=True, memory=rest.get("memory")),
    )
    if len(scenes) < len(found):
        raise expected("animate", "volumes, arrays or files", "splats or a scene")
    timeline, fps = timeline_of(scenes[0], Timeline(**given), fps)
    scenes = [with_blur(scene, options_given.get("shutter")) for scene in scenes]
    scenes = [each for scene in scenes for each in ([scene] if scene.held is not None else volumes(scene, ()))]
    with within(how.memory):
        animation = Animation.of(scenes, timeline, options_given.get("time"), bits, True)
        return AnimationFiles(write_animation(animation, str(output), by, how, fps, resume, True)[0])


def timeline_of(scene: SceneFile, given: Timeline, fps: float | None) -> tuple[Timeline, float | None]:
    """The timeline and the frames per second of a scene's table [animation], which what is given replaces."""
    table, named = dict(scene.animation), non_default(given)
    track = {name: table.pop(name) for name in TRACK if name in table}
    if "keyframe" in track:
        table["keyframes"] = track
    if MOTIONS & set(named):
        table = {name: value for name, value in table.items() if name not in MOTIONS}
    with error_prefix("[animation]"):
        rate = table.pop("fps", None)
        check_fps(rate, "fps")
        return Timeline(**{**table, **named}), fps if fps is not None else rate


# options that say how the camera or the volume moves
MOTIONS = {"turntable", "spin", "keyframes"}
# options of `animate` that are not those of `render`
OWN = (*(item.name for item in fields(Timeline)), *names_of(WorkerOptions), "fps", "bits", "resume")


def with_blur(scene: SceneFile, shutter: float | None) -> SceneFile:
    """The scene, whose frames are blurred if a shutter is asked for, the default one, too."""
    if shutter is None or scene.settings.motion != "auto":
        return scene
    return replace(scene, settings=scene.settings.replace(motion="moments"))


def write_animation(
    animation: Animation, output: str, by: WorkerOptions, how: DrawOptions, fps: float | None, resume: bool, quiet: bool
) -> tuple[list[Path], int]:
    """Draws the frames and joins them to a movie; returns its path or theirs, and how many existed. how: the renderer,
    unless workers draw. fps: None: the default. resume: frames that exist are kept.
    """
    frames, wanted = FrameFiles.at(output, animation.mark), animation.numbers
    if frames.movie:
        need(frames.movie)
    sources = [file for scene in animation.job.scenes for file in scene.files]
    for n in wanted:
        check_source(frames.path(n), *sources)
    frames.sweep(wanted)
    todo = [n for n in wanted if not (resume and frames.done(n))]
    with _told_if_stopped(frames, wanted), _movie(animation, frames, fps, todo) as wrote:
        if todo and by.are_used:
            require_built_in(animation.job.settings.kernel)
            how.check_supported("workers", "frames rendered by this process", "--workers")
            with by.connected(None if quiet else print) as client:
                drawn = animation.drawn_on_workers(client, frames, todo, by.drawing)
                _write(frames, drawn, wrote, len(todo), quiet, alike=False)
        elif todo:
            with how.renderer() as renderer:
                drawn = animation.drawn_here(renderer, frames, todo, how.explain)
                _write(frames, drawn, wrote, len(todo), quiet, alike=True)
    return [frames.movie] if frames.movie else [frames.path(n) for n in wanted], len(wanted) - len(todo)


def _write(frames: FrameFiles, drawn: Drawn, wrote: Wrote, count: int, quiet: bool, alike: bool) -> None:
    """Writes frames as they are drawn; prints the notes on the first. wrote: is called with each that exists. count: of
    all. alike: as of `progress_bar`.
    """
    with progress_bar("frame", quiet, alike) as progress:
        for done, (n, data, notes) in enumerate(drawn, 1):
            print_lines(notes, quiet or done > 1)
            write_file(frames.path(n), data)
            wrote(frames.path(n))
            progress(done, count)


@contextmanager
def _told_if_stopped(frames: FrameFiles, wanted: Sequence[int]) -> Iterator[None]:
    """Adds a note on the frames that stay to an error or an interruption of the work on them."""
    try:
        yield
    except (KeyboardInterrupt, *USER_ERRORS) as error:
        stay = sum(path.exists() and frames.is_own(path) for path in map(frames.path, wanted))
        if stay:
            where = f"{stay} of {len(wanted)} frames stay in {frames.path(0).parent}"
            error.add_note(f"{where}; --resume, in Python resume=True, continues from them")
        raise


@contextmanager
def _movie(animation: Animation, frames: FrameFiles, fps: float | None, todo: Sequence[int]) -> Iterator[Wrote]:
    """Writes the movie, if one is asked for, while its frames are written, and removes them. todo: their numbers."""
    if frames.movie is None:
        yield lambda _: None
        return
    ground = animation.job.scenes[0].settings.ground or BLACK
    # fewer for a short series, so that it can be followed
    usual = min(FPS, animation.count / SHORTEST) if len(animation.job.scenes) > 1 else FPS
    pictures, coming = ([frames.path(n) for n in numbers] for numbers in (animation.numbers, todo))
    with write_behind(frames.movie, pictures, coming, fps or usual, ground) as wrote:
        yield wrote
    frames.clear(animation.numbers)


def check_fps(fps: float | None, name: str) -> None:
    """Raises InputError for frames per second that no movie has."""
    if fps is not None and not (is_number(fps) and MIN_FPS <= fps <= MAX_FPS):
        raise expected(name, f"a number from {MIN_FPS:g} to {MAX_FPS:g}", fps)

"""Encodes frames as movies, and lists the volumes of a series in time."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from threading import Event
from typing import Any, TypeVar

import numpy as np

from splatgl.data.color import Color, srgb_from_linear
from splatgl.data.image import Image, load_png
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import USER_ERRORS, expected, import_extra
from splatgl.fileio import atomic_write
from splatgl.readers.remote import is_address
from splatgl.scene.open_scene import OpenScene, look_notes, print_lines, print_notes, series_look
from splatgl.scene.scene_file import SceneFile

# codec and its options; a smaller crf gives a larger file: these values are visually lossless
CODECS: dict[str, tuple[str, str, dict[str, str]]] = {
    ".mp4": ("mp4", "libx264", {"crf": "16", "preset": "medium"}),
    ".webm": ("webm", "libvpx-vp9", {"crf": "24", "b:v": "0", "row-mt": "1", "deadline": "good", "cpu-used": "4"}),
}
# without random numbers, and threads of an encoder, whose number is in the file and changes it
EXACT, THREADS = {"fflags": "+bitexact"}, 4
# chroma at half resolution, which all players support
PIXELS = "yuv420p"
# GIF delays are in hundredths of a second, of 10 ms; browsers keep to 20 ms and more
GIF_TICK, GIF_SHORTEST = 10, 20
MILLISECONDS = 1000


def need(path: Path) -> None:
    """Raises InputError if the libraries for this movie format are missing."""
    if path.suffix.lower() in CODECS:
        _library()


def write_movie(path: Path, pictures: Iterable[Path], count: int, fps: float, over: Color) -> None:
    """Writes a movie of PNG images of one size over a background colour (linear RGB), atomically. count: of images.

    Raises InputError if it cannot be written.
    """
    with atomic_write(path) as part:
        if path.suffix.lower() == ".gif":
            chosen, durations = gif_times(count, fps)
            _write_gif(part, _frames((each for n, each in enumerate(pictures) if n in chosen), over), durations)
        else:
            _write_video(part, path.suffix.lower(), _frames(pictures, over), fps)


@contextmanager
def write_behind(
    path: Path, pictures: Sequence[Path], coming: Iterable[Path], fps: float, over: Color
) -> Iterator[Callable[[Path], None]]:
    """As `write_movie`, in a thread meanwhile. coming: images that do not exist yet; the function is called with each
    that does. An error or interruption stops the thread.
    """
    there, stopped = {picture: Event() for picture in coming}, Event()

    def existing() -> Iterator[Path]:
        for picture in pictures:
            if picture in there:
                there[picture].wait()
            if stopped.is_set():
                raise InterruptedError
            yield picture

    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="write-behind") as pool:
        movie = pool.submit(write_movie, path, existing(), len(pictures), fps, over)
        try:
            yield lambda picture: there[picture].set()
            movie.result()
        finally:
            stopped.set()
            for each in there.values():
                each.set()


def _frames(pictures: Iterable[Path], over: Color) -> Iterator[np.ndarray]:
    """Yields frames, uint8 [H, W, 3], sRGB."""
    for picture in pictures:
        samples, _ = load_png(picture)
        if samples.dtype == np.uint8 and samples[..., 3].min() == 255:
            yield np.ascontiguousarray(samples[..., :3])
            continue
        shown = Image.from_samples(samples).over(over).pixels[..., :3]
        yield np.rint(srgb_from_linear(np.clip(shown, 0.0, 1.0)) * 255).astype(np.uint8)


def _write_video(part: Path, suffix: str, frames: Iterable[np.ndarray], fps: float) -> None:
    av = _library()
    form, codec, options = CODECS[suffix]
    with av.open(str(part), "w", format=form, options=EXACT) as container:
        stream: Any = None
        for shown in frames:
            # chroma subsampling requires even sides
            shown = np.pad(shown, ((0, shown.shape[0] % 2), (0, shown.shape[1] % 2), (0, 0)), mode="edge")
            if stream is None:
                stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
                stream.height, stream.width = shown.shape[:2]
                stream.pix_fmt, stream.options = PIXELS, options
                stream.codec_context.thread_count = THREADS
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        container.mux(stream.encode(None))


def _write_gif(part: Path, frames: Iterable[np.ndarray], durations: Sequence[int]) -> None:
    from PIL import Image as Pillow

    shown = (Pillow.fromarray(frame).quantize(256, method=Pillow.Quantize.MEDIANCUT) for frame in frames)
    next(shown).save(part, "GIF", save_all=True, append_images=shown, duration=list(durations), loop=0, optimize=False)


def gif_times(count: int, fps: float) -> tuple[list[int], list[int]]:
    """Numbers of the frames of a GIF, and their durations in milliseconds: whole ticks of the speed that is asked for.

    Frames shorter than GIF_SHORTEST, which browsers show for a tenth of a second, are left out.
    """
    begins = [round(number * MILLISECONDS / fps / GIF_TICK) * GIF_TICK for number in range(count + 1)]
    chosen = [0]
    for number in range(1, count):
        if begins[number] >= begins[chosen[-1]] + GIF_SHORTEST:
            chosen.append(number)
    ends = [*(begins[number] for number in chosen[1:]), max(begins[-1], begins[chosen[-1]] + GIF_SHORTEST)]
    return chosen, [end - begins[number] for number, end in zip(chosen, ends, strict=True)]


def _library() -> Any:
    return import_extra("av", "movies", "av", "video")


T = TypeVar("T")
WILDCARDS = re.compile(r"[*?\[]")


def volumes(scene: SceneFile, more: Sequence[str]) -> list[SceneFile]:
    """The scene of each volume; patterns are expanded as by `expanded`."""
    return [replace(scene, volume=source) for source in expanded((scene.volume, *more))]


def expanded(sources: Iterable[str]) -> list[str]:
    """The sources, with all matching files of each pattern, sorted by the numbers in their names.

    Raises InputError for a pattern without matches.
    """
    names: list[str] = []
    for source in sources:
        names += _matching(source) if is_pattern(source) else [source]
    return names


def time_points(scene: SceneFile, volume: Volume, requested: float | str | slice | None) -> list[SceneFile]:
    """The scene of each time point of a file; one scene for a single point. requested: --time."""
    # the number of an array picks a time point, its name does not
    picked = scene.held is not None or "time" in scene.load or str(scene.load.get("array", "")).isdecimal()
    if volume.times < 2 or isinstance(requested, float | int | str) or picked:
        if isinstance(requested, slice):
            raise expected("--time", "a file of several time points", volume.times)
        return [scene]
    numbers = range(volume.times)[requested or slice(None)]
    if not numbers:
        raise expected("--time", f"some of 0 to {volume.times - 1}", "none")
    return [replace(scene, load={**scene.load, "time": number}) for number in numbers]


def open_series(
    scenes: list[SceneFile], time: float | str | slice | None, is_quiet: bool
) -> tuple[list[SceneFile], OpenScene]:
    """The scenes of all volumes, in the look of their series, and the first one; prints notes. time: as of
    `time_points`.
    """
    file, scene = scenes[0], OpenScene.read(scenes[0]) if len(scenes) == 1 else None
    if scene is not None:
        scenes = time_points(file, scene.volume, time)
    if scene is None or scenes[0] is not file:
        look = series_look(scenes)
        scenes = [replace(each, look=look) for each in scenes]
        scene = OpenScene.read(scenes[0])
        print_lines(look_notes(look, scenes), is_quiet)
    print_notes(scene.volume, is_quiet)
    return scenes, scene


def is_pattern(source: str) -> bool:
    """Whether a source is a pattern of files, and no file itself. The name of their folder may hold brackets."""
    path = Path(source)
    if source in SCENES or is_address(source) or path.exists():
        return False
    return bool(WILDCARDS.search(path.name if path.parent.is_dir() else source))


def _matching(source: str) -> list[str]:
    """Files and folders that match a pattern, of which folders that exist may hold brackets."""
    path = Path(source)
    base = next(parent for parent in path.parents if parent.is_dir() or parent == parent.parent)
    files = sorted((str(p) for p in base.glob(str(path.relative_to(base)))), key=by_numbers)
    if not files:
        raise expected(source, "a pattern that files fit", "none", "quote it, and check the folder")
    return files


def by_numbers(name: str) -> list[tuple[bool, int, str]]:
    """Natural sort key: t9 before t10."""
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in re.split(r"(\d+)", name)]


def read_ahead(read: Callable[[int], T], wanted: Sequence[int]) -> Iterator[tuple[int, T]]:
    """(n, read(n)) for each wanted n in order; a thread reads one item ahead."""
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="read-ahead") as pool:
        coming = [pool.submit(read, n) for n in wanted[:1]]
        for place, n in enumerate(wanted):
            result = coming.pop().result()
            coming += [pool.submit(read, following) for following in wanted[place + 1 : place + 2]]
            yield n, result
            # the caller has the only reference
            del result


def finish_behind(steps: Iterable[Callable[[], T]]) -> Iterator[T]:
    """The results of functions in order; a thread calls each while the next ones are prepared, but the first at once.
    An error of their preparation follows the results of those before it.
    """
    with ThreadPoolExecutor(max_workers=1, thread_name_prefix="finish-behind") as pool:
        coming = deque[Future[T]]()
        try:
            for number, step in enumerate(steps):
                coming.append(pool.submit(step))
                while len(coming) > min(number, 1):
                    yield coming.popleft().result()
        except (KeyboardInterrupt, *USER_ERRORS):
            yield from (result.result() for result in coming)
            raise
        yield from (result.result() for result in coming)

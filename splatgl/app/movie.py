"""Encodes frames as .mp4 (H.264), .webm (VP9) or .gif, with one frame in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.errors import missing_extra
from splatgl.fileio import replaced

# codec and its options; a smaller crf gives a larger file: these values are visually lossless
CODECS: dict[str, tuple[str, str, dict[str, str]]] = {
    ".mp4": ("mp4", "libx264", {"crf": "16", "preset": "medium"}),
    ".webm": ("webm", "libvpx-vp9", {"crf": "24", "b:v": "0", "row-mt": "1", "deadline": "good", "cpu-used": "4"}),
}
# chroma at half resolution, which all players support
PIXELS = "yuv420p"
# GIF delays are in hundredths of a second; one is 10 ms
GIF_TICK = 10
MILLISECONDS = 1000


def need(path: Path) -> None:
    """InputError, before any work, if the libraries for this movie format are missing."""
    if path.suffix.lower() in CODECS:
        _library()


def write_movie(path: Path, pictures: Sequence[Path], fps: float, ground: tuple[float, float, float]) -> None:
    """Writes a movie of PNG images of one size over a background colour (linear RGB), atomically.

    Raises InputError if it cannot be written.
    """
    with replaced(path) as part:
        if path.suffix.lower() == ".gif":
            _write_gif(part, pictures, fps, ground)
        else:
            _write_video(part, path.suffix.lower(), pictures, fps, ground)


def _frames(pictures: Sequence[Path], ground: tuple[float, float, float]) -> Iterator[np.ndarray]:
    """Yields frames, uint8 [H, W, 3], sRGB."""
    from splatgl.data.color import srgb_from_linear
    from splatgl.data.image import Image

    for picture in pictures:
        shown = Image.load(picture).over(ground).pixels[..., :3]
        yield np.rint(srgb_from_linear(np.clip(shown, 0.0, 1.0)) * 255).astype(np.uint8)


def _write_video(
    part: Path, suffix: str, pictures: Sequence[Path], fps: float, ground: tuple[float, float, float]
) -> None:
    av = _library()
    form, codec, options = CODECS[suffix]
    with av.open(str(part), "w", format=form) as container:
        stream: Any = None
        for shown in _frames(pictures, ground):
            # chroma subsampling requires even sides
            shown = np.pad(shown, ((0, shown.shape[0] % 2), (0, shown.shape[1] % 2), (0, 0)), mode="edge")
            if stream is None:
                stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
                stream.height, stream.width, stream.pix_fmt = *shown.shape[:2], PIXELS
                stream.options = options
            container.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        container.mux(stream.encode(None))


def _write_gif(part: Path, pictures: Sequence[Path], fps: float, ground: tuple[float, float, float]) -> None:
    """Writes a GIF with an optimal palette of 256 colours per frame."""
    from PIL import Image as Pillow

    shown = (
        Pillow.fromarray(frame).quantize(256, method=Pillow.Quantize.MEDIANCUT) for frame in _frames(pictures, ground)
    )
    duration = max(GIF_TICK, round(MILLISECONDS / fps / GIF_TICK) * GIF_TICK)
    next(shown).save(part, "GIF", save_all=True, append_images=shown, duration=duration, loop=0, optimize=False)


def _library() -> Any:
    try:
        import av
    except ImportError as error:
        raise missing_extra("movies", "av", "video") from error
    return av

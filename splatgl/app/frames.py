"""Frame files of an animation: named by a template, written atomically, and recognized when it is resumed."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.fileio import check_output, shortened, write_whole

MOVIES = (".mp4", ".webm", ".gif")
PICTURES = (".png", ".npy")
# hexadecimal digits of the digest that identifies an animation
DIGITS = 16
# format of a frame number: a number of digits, or none
DIGITED = re.compile("(0?[1-9][0-9]?)?d?")


@dataclass(frozen=True)
class Frames:
    """Output paths. template: a path with {frame}; mark: the animation's digest, stored in each PNG's text.

    movie: the movie file to write, or None.
    """

    template: str
    mark: str
    movie: Path | None = None

    @classmethod
    def at(cls, output: str, mark: str) -> Frames:
        """For an --output: a template, or a movie name, whose frames are stored in a folder beside it.

        Raises InputError for any other name, and if the frames cannot be written. Their folder is made with the first.
        """
        path = Path(output)
        if path.suffix.lower() in MOVIES:
            check_output(path, MOVIES)
            folder = path.with_name(f"{shortened(path.name)}.frames")
            frames = cls(str(folder / "{frame:06d}.png"), mark, path)
        else:
            _check_template(output)
            folder = path.parent
            frames = cls(output, mark)
        if "{" in str(folder):
            raise expected(output, "{ } in the file's name alone", "some in a folder's or a movie's name")
        check_output(frames.path(0), PICTURES)
        return frames

    def path(self, frame: int) -> Path:
        """The file of frame number `frame`."""
        return Path(self.template.format(frame=frame))

    def encoded(self, frame: int, image: Image, bits: int, ground: tuple[float, float, float] | None) -> bytes:
        """The frame's file, with the animation's mark."""
        info = {**image.info, "frame": frame, "animation": self.mark}
        return Image(image.pixels, info).encoded(self.path(frame), bits, ground)

    def write(self, frame: int, data: bytes) -> None:
        """Writes a frame's file atomically."""
        write_whole(self.path(frame), data)

    def done(self, frame: int) -> bool:
        """Whether the frame exists. InputError if the file belongs to another animation."""
        path = self.path(frame)
        if not path.exists():
            return False
        if path.suffix.lower() == ".npy":
            return True
        if _mark(path) != self.mark:
            raise expected(path, "a frame of this animation", "another picture", "leave out --resume to draw over it")
        return True

    def sweep(self, numbers: Sequence[int]) -> None:
        """Removes temporary files of these frames left by a killed run."""
        names = {f".{shortened(self.path(n).name)}" for n in numbers}
        # a temporary file is named .<frame file>.<random letters>
        for path in self.path(0).parent.glob(".*"):
            if path.name.rpartition(".")[0] in names and path.is_file():
                path.unlink(missing_ok=True)

    def clear(self, numbers: Sequence[int]) -> None:
        """Removes these frames after writing the movie, and their folder if it is empty."""
        for n in numbers:
            self.path(n).unlink(missing_ok=True)
        folder = self.path(0).parent
        if not any(folder.iterdir()):
            folder.rmdir()


def mark_of(*parts: object) -> str:
    """A short digest of everything that determines an animation."""
    return hashlib.sha256("\n".join(map(repr, parts)).encode()).hexdigest()[:DIGITS]


def _check_template(text: str) -> None:
    """InputError for a template that does not name each frame uniquely."""
    try:
        fields = [tuple(rest) for _, *rest in Formatter().parse(text) if rest[0] is not None]
    except ValueError:
        fields = []
    if not fields or any(name != "frame" or form or not DIGITED.fullmatch(spec or "") for name, spec, form in fields):
        fix = "such as frames/{frame:04d}.png, or a name that ends in .mp4, .webm or .gif"
        raise expected(text, "a name with {frame} in it", "another", fix)


def _mark(path: Path) -> str | None:
    """The mark in a PNG's text; None if there is none."""
    from PIL import Image as Pillow

    try:
        with Pillow.open(path) as picture:
            about = json.loads(getattr(picture, "text", {}).get("splatgl", "{}"))
    except (OSError, ValueError, SyntaxError):
        return None
    return about.get("animation") if isinstance(about, dict) else None

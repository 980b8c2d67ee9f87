"""Baselines on disk: the pictures that a test accepts, one for all renderers or some for each class of them.

tests/baselines/<test file>/<name>.png              portable: for any renderer that has none of its own
tests/baselines/<test file>/<name>.nvidia.png       for NVIDIA only, instead of the portable one
tests/baselines/<test file>/<name>.nvidia-2.png     one more that is right there
tests/baselines/<test file>/<name>.portable-2.png   one more that is right wherever the portable one is
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from splatgl.data.image import Image

FOLDER = "baselines"
# the key of what is right for any renderer
PORTABLE = "portable"
# what OpenGL calls the renderer, and its class; the first that fits, since ANGLE and Direct3D name the card inside
CLASSES = (
    ("llvmpipe", r"llvmpipe|softpipe|swrast|swiftshader"),
    ("nvidia", r"nvidia|geforce|quadro|tesla|\bnv[0-9a-f]{2,3}\b"),
    ("amd", r"\bamd\b|radeon|\bati\b"),
    ("intel", r"intel"),
    ("apple", r"apple"),
)
# letters of a digest that keep two names apart which differ only in letters that files can't have
DIGEST = 6
# letters of a name: file systems allow 255 bytes with the ending
LONGEST = 120


@dataclass(frozen=True)
class Baselines:
    """The accepted pictures of one name. key: the renderer's class, None where it has none."""

    folder: Path
    stem: str
    key: str | None
    suffix: str = ".png"

    @property
    def portable(self) -> Path:
        """The baseline for any renderer that has none of its own."""
        return self.folder / f"{self.stem}{self.suffix}"

    @property
    def of_class(self) -> Path:
        """The class's own; the portable one where there is no class."""
        return self.folder / f"{self.stem}.{self.key}{self.suffix}" if self.key else self.portable

    def valid(self) -> list[Path]:
        """Those to compare with, files that exist: the class's own, else the portable one; then all that were added."""
        more = self._more(self.key or PORTABLE)
        if self.key and self.of_class.is_file():
            return [self.of_class, *more]
        portable = [self.portable] if self.portable.is_file() else []
        return [*portable, *(self._more(PORTABLE) if self.key else []), *more]

    def others(self) -> list[Path]:
        """What there is for other renderers only."""
        return sorted(set(self._named(r"\.[a-z]+(-\d+)?")) - set(self.valid()))

    def fresh(self) -> Path:
        """Where one more goes: the class's own or the portable one, where there is none that is right yet."""
        if not self.valid():
            return self.of_class
        key = self.key or PORTABLE
        places = (self.folder / f"{self.stem}.{key}-{number}{self.suffix}" for number in count(2))
        return next(place for place in places if not place.exists())

    def _more(self, key: str) -> list[Path]:
        """What was added for a class, or for any renderer."""
        return self._named(rf"\.{key}-\d+")

    def _named(self, pattern: str) -> list[Path]:
        """The files whose name is the stem, what fits the pattern, and the suffix."""
        whole = re.compile(re.escape(self.stem) + pattern + re.escape(self.suffix))
        return sorted(path for path in self.folder.glob("*") if whole.fullmatch(path.name))


def renderer_class(image: Image) -> str | None:
    """llvmpipe, nvidia, amd, intel or apple by the picture's `info["renderer"]`; None for any other, or none."""
    renderer = str(image.info.get("renderer", ""))
    return next((name for name, pattern in CLASSES if re.search(pattern, renderer, re.IGNORECASE)), None)


def stem_of(name: str) -> str:
    """A name as a file's: Latin letters, digits, _ and -; where others are replaced, a digest keeps names apart."""
    plain = re.sub(r"\[(.*)\]$", r"-\1", name)
    safe = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-")[:LONGEST]
    if safe == plain:
        return safe
    return f"{safe}-{hashlib.sha1(name.encode()).hexdigest()[:DIGEST]}".lstrip("-")

"""Baselines on disk: the accepted images of a test, either portable or specific to a class of renderers.

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
# key of baselines valid for any renderer
PORTABLE = "portable"
# substrings of GL_RENDERER, and their class; the first match counts, since ANGLE and Direct3D include the GPU's name
CLASSES = (
    ("llvmpipe", r"llvmpipe|softpipe|swrast|swiftshader"),
    ("nvidia", r"nvidia|geforce|quadro|tesla|\bnv[0-9a-f]{2,3}\b"),
    ("amd", r"\bamd\b|radeon|\bati\b"),
    ("intel", r"intel"),
    ("apple", r"apple"),
)
# length of the digest that distinguishes names after invalid characters are replaced
DIGEST = 6
# maximum length of a name: file systems allow 255 bytes including the suffix
LONGEST = 120


@dataclass(frozen=True)
class Baselines:
    """The accepted images of a name. key: the renderer's class, or None."""

    folder: Path
    stem: str
    key: str | None
    suffix: str = ".png"

    @property
    def portable(self) -> Path:
        """The baseline for renderers without one of their own class."""
        return self.folder / f"{self.stem}{self.suffix}"

    @property
    def of_class(self) -> Path:
        """The baseline of the renderer's class; the portable one if there is no class."""
        return self.folder / f"{self.stem}.{self.key}{self.suffix}" if self.key else self.portable

    def valid(self) -> list[Path]:
        """Existing files to compare with: the class's baseline, else the portable one; then all additional ones."""
        more = self._more(self.key or PORTABLE)
        if self.key and self.of_class.is_file():
            return [self.of_class, *more]
        portable = [self.portable] if self.portable.is_file() else []
        return [*portable, *(self._more(PORTABLE) if self.key else []), *more]

    def others(self) -> list[Path]:
        """Baselines for other renderers only."""
        return sorted(set(self._named(r"\.[a-z]+(-\d+)?")) - set(self.valid()))

    def fresh(self) -> Path:
        """Path for a new baseline: the class's or the portable one, if no valid one exists yet."""
        if not self.valid():
            return self.of_class
        key = self.key or PORTABLE
        places = (self.folder / f"{self.stem}.{key}-{number}{self.suffix}" for number in count(2))
        return next(place for place in places if not place.exists())

    def _more(self, key: str) -> list[Path]:
        """Additional baselines of a class, or of any renderer."""
        return self._named(rf"\.{key}-\d+")

    def _named(self, pattern: str) -> list[Path]:
        """Files named by the stem, a match of the pattern, and the suffix."""
        whole = re.compile(re.escape(self.stem) + pattern + re.escape(self.suffix))
        return sorted(path for path in self.folder.glob("*") if whole.fullmatch(path.name))


def renderer_class(image: Image) -> str | None:
    """llvmpipe, nvidia, amd, intel or apple, from the image's `info["renderer"]`; None for any other or none."""
    renderer = str(image.info.get("renderer", ""))
    return next((name for name, pattern in CLASSES if re.search(pattern, renderer, re.IGNORECASE)), None)


def stem_of(name: str) -> str:
    """A name as a file stem of Latin letters, digits, _ and -; a digest keeps names with replaced characters unique."""
    plain = re.sub(r"\[(.*)\]$", r"-\1", name)
    safe = re.sub(r"[^A-Za-z0-9_-]+", "-", plain).strip("-")[:LONGEST]
    if safe == plain:
        return safe
    return f"{safe}-{hashlib.sha1(name.encode()).hexdigest()[:DIGEST]}".lstrip("-")

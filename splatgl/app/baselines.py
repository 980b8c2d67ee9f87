"""Baselines on disk: the pictures that a test accepts, one for all renderers or some for each class of them.

    tests/baselines/<test file>/<name>.png              portable: for any renderer that has none of its own
    tests/baselines/<test file>/<name>.nvidia.png       for NVIDIA only, instead of the portable one
    tests/baselines/<test file>/<name>.nvidia-2.png     another that is right there
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from splatgl.data.image import Image

FOLDER = "baselines"
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


@dataclass(frozen=True)
class Baselines:
    """The accepted pictures of one name. key: the renderer's class, None where it has none."""

    folder: Path
    stem: str
    key: str | None
    suffix: str = ".png"

    @property
    def portable(self) -> Path:
        return self.folder / f"{self.stem}{self.suffix}"

    def of_class(self, number: int = 1) -> Path:
        """The class's own; the portable one where there is no class."""
        name = f".{self.key}" if self.key else ""
        return self.folder / f"{self.stem}{name}{f'-{number}' if number > 1 else ''}{self.suffix}"

    def valid(self) -> list[Path]:
        """Those to compare with: all of the class's own, else the portable one; none where there is no file."""
        return self._numbered() or [path for path in (self.portable,) if path.is_file()]

    def others(self) -> list[Path]:
        """What there is for other renderers only."""
        mine = set(self.valid())
        found = self.folder.glob(f"{self.stem}*{self.suffix}") if self.folder.is_dir() else ()
        pattern = re.compile(re.escape(self.stem) + r"\.[a-z]+(-\d+)?" + re.escape(self.suffix))
        return sorted(path for path in found if path not in mine and pattern.fullmatch(path.name))

    def fresh(self) -> Path:
        """Where one more of the class goes."""
        number = 1
        while self.of_class(number).is_file():
            number += 1
        return self.of_class(number)

    def _numbered(self) -> list[Path]:
        if not self.key or not self.folder.is_dir():
            return []
        pattern = re.compile(re.escape(f"{self.stem}.{self.key}") + r"(-\d+)?" + re.escape(self.suffix))
        return sorted(path for path in self.folder.iterdir() if pattern.fullmatch(path.name))


def renderer_class(image: Image) -> str | None:
    """llvmpipe, nvidia, amd, intel or apple by the picture's `info["renderer"]`; None for any other, or none."""
    renderer = str(image.info.get("renderer", ""))
    return next((name for name, pattern in CLASSES if re.search(pattern, renderer, re.IGNORECASE)), None)


def stem_of(name: str) -> str:
    """A name as a file's: letters, digits, _ and -; where others are replaced, a digest keeps names apart."""
    plain = re.sub(r"\[(.*)\]$", r"-\1", name)
    safe = re.sub(r"[^\w-]+", "-", plain).strip("-")
    if safe == plain:
        return safe
    return f"{safe}-{hashlib.sha1(name.encode()).hexdigest()[:DIGEST]}".lstrip("-")

"""Writes splatgl/keywords.py, the keywords of public functions for type checkers and editors, from declared options.

python scripts/keywords.py
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

from splatgl.animation.animation import Timeline
from splatgl.data.arrays import ArrayOptions
from splatgl.options import declared, names_of
from splatgl.readers.options import LoadOptions
from splatgl.scene.api import SCENE, TRANSFER
from splatgl.scene.draw import DrawOptions, WorkerOptions
from splatgl.scene.meshes import VECTORS, Vectors
from splatgl.scene.mixing import MIXING
from splatgl.scene.scene_file import SceneFile, TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

TARGET = Path(__file__).parents[1] / "splatgl" / "keywords.py"
HEAD = '''"""Keywords of public functions for type checkers and editors.

scripts/keywords.py writes this file from the declared options.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np

Numbers: TypeAlias = Sequence[float] | np.ndarray
'''


def hints_of(record: Any) -> dict[str, str]:
    """Types of the values that the options of a dataclass accept, by name; "" where the declaration has none."""
    hints = {name: option.kind.hint for name, option in declared(record).items()}
    optional = [item.name for item in fields(record) if item.default is None]
    return {name: f"{hint} | None" if hint and name in optional else hint for name, hint in hints.items()}


def render_hints() -> dict[str, str]:
    """Types of the options of `sg.render`."""
    vectors = hints_of(Vectors)
    known = {
        **hints_of(Transfer),
        **hints_of(TransferChoice),
        **hints_of(Settings),
        **hints_of(SceneFile),
        **hints_of(ViewOptions),
    }
    known |= {**hints_of(DrawOptions), **array_hints(), **hints_of(LoadOptions)}
    known |= {
        "clip_meshes": "bool",
        "mixing": MIXING.kind.hint,
        **{name: vectors[field] for name, field in VECTORS.items()},
    }
    drawing = names_of(ViewOptions, Settings)
    reading = [*names_of(LoadOptions), *array_hints()]
    return {name: known[name] for name in [*drawing, *TRANSFER, *SCENE, "memory", "mixing", *reading]}


def array_hints() -> dict[str, str]:
    """Types of the options of `Volume.of`."""
    return {item.name: str(item.type).replace("Triple", "Numbers") for item in fields(ArrayOptions)}


def write_class(name: str, about: str, hints: dict[str, str], base: str = "TypedDict") -> Iterable[str]:
    """Lines of a TypedDict. base: the class that it extends. Raises ValueError for an option without a type."""
    missing = [option for option, hint in hints.items() if not hint]
    if missing:
        raise ValueError(f"options without a hint: {', '.join(missing)}")
    rows = [f"    {option}: {hint}" for option, hint in hints.items()]
    return ["", f"class {name}({base}, total=False):", f'    """{about}"""', "", *rows]


def compose() -> str:
    """The text of splatgl/keywords.py."""
    classes = {
        "SettingsKeywords": ("Fields of `Settings`.", hints_of(Settings)),
        "LoadKeywords": ("Fields of `LoadOptions`.", hints_of(LoadOptions)),
        "ArrayKeywords": ("Options of `Volume.of`.", array_hints()),
    }
    lines = [line for name, (about, hints) in classes.items() for line in write_class(name, about, hints)]
    # an animation may show several time points
    common = render_hints()
    one = {"time": common.pop("time")}
    lines += write_class("PictureKeywords", "Options of all pictures.", common)
    lines += write_class("RenderKeywords", "Options of `render`, `show` and `depth_map`.", one, "PictureKeywords")
    frames = {"time": f"slice | {one['time']}", **hints_of(Timeline), **hints_of(WorkerOptions)}
    frames |= {"fps": "float | None", "bits": "Literal[8, 16]", "resume": "bool"}
    lines += write_class("AnimateKeywords", "Options of `animate`.", frames, "PictureKeywords")
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(TARGET), "-"]
    text = HEAD + "\n".join(lines) + "\n"
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    TARGET.write_text(compose(), encoding="utf-8")

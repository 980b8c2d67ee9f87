"""Writes splatgl/keywords.pyi, the keywords of public functions for type checkers and editors, from declared options.

python scripts/keywords.py
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterable, Mapping
from inspect import Parameter
from pathlib import Path

from splatgl.animation.api import TIMES
from splatgl.data.volume import ArrayOptions
from splatgl.exporters.api import ExportOptions
from splatgl.options import keywords_of
from splatgl.readers.options import LoadOptions
from splatgl.scene.api import GROUPS, KEYWORDS
from splatgl.splat.settings import Settings

# names of views in a line
VIEWS = 7
TARGET = Path(__file__).parents[1] / "splatgl" / "keywords.pyi"
HEAD = '''"""Keywords of public functions for type checkers and editors.

scripts/keywords.py writes this file from the declared options.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypedDict

import numpy as np

from splatgl.options import OptionGroup

Numbers: TypeAlias = Sequence[float] | np.ndarray
'''


def write_class(name: str, about: str, table: Mapping[str, Parameter], base: str = "TypedDict") -> Iterable[str]:
    """Lines of a TypedDict. base: the classes that it extends. Raises ValueError for an option without a type."""
    hints = {name: parameter.annotation for name, parameter in table.items()}
    missing = [option for option, hint in hints.items() if not hint]
    if missing:
        raise ValueError(f"options without a hint: {', '.join(missing)}")
    rows = [f"    {option}: {hint}" for option, hint in hints.items()]
    return ["", f"class {name}({base}, total=False):", f'    """{about}"""', "", *rows]


def compose() -> str:
    """The text of splatgl/keywords.pyi."""
    # an animation may show several time points
    common = {name: parameter for name, parameter in KEYWORDS.items() if name != "time"}
    lines: list[str] = []
    bases = []
    for name, record in {"Settings": Settings, "Load": LoadOptions}.items():
        table = keywords_of(record)
        shared = {option: common.pop(option) for option in table if common.get(option) == table[option]}
        bases.append(f"Picture{name}Keywords")
        about = f"Fields of `{record.__name__}`"
        lines += write_class(bases[-1], f"{about} that are options of all pictures, too.", shared)
        rest = {option: parameter for option, parameter in table.items() if option not in shared}
        lines += write_class(f"{name}Keywords", f"{about}.", rest, bases[-1])
    for name, kind in ((kind.__name__, kind) for kind in GROUPS.values()):
        about = f"Keywords of `{name}`"
        shared = {option: parameter for option, parameter in kind.known.items() if common.get(option) == parameter}
        # a group of which pictures take all, or most, as they are
        if len(shared) < len(kind.known) - 1:
            lines += write_class(f"{name}Keywords", f"{about}.", kind.known)
            continue
        rest = {option: parameter for option, parameter in kind.known.items() if option not in shared}
        bases.append(f"Picture{name}Keywords" if rest else f"{name}Keywords")
        lines += write_class(bases[-1], f"{about}{' that all pictures take, too' if rest else ''}.", shared)
        lines += write_class(f"{name}Keywords", f"{about}.", rest, bases[-1]) if rest else []
        common = {option: parameter for option, parameter in common.items() if option not in shared}
    lines += write_class("ArrayKeywords", "Options of `Volume.of`.", keywords_of(ArrayOptions))
    lines += write_class("PictureKeywords", "Options of all pictures.", common, ", ".join(bases))
    one = {"time": KEYWORDS["time"]}
    lines += write_class("RenderKeywords", "Options of `render`, `show` and `depth_map`.", one, "PictureKeywords")
    lines += write_class("AnimateKeywords", "Options of `animate`.", TIMES, "PictureKeywords")
    about = "Options of `export`."
    lines += write_class("ExportKeywords", about, {**one, **keywords_of(ExportOptions)}, "PictureKeywords")
    command = [sys.executable, "-m", "ruff", "format", "--stdin-filename", str(TARGET), "-"]
    views = KEYWORDS["view"].annotation.partition(" |")[0]
    names = re.findall("'[^']+'", views)
    # a line each
    parts = (", ".join(names[n : n + VIEWS]) for n in range(0, len(names), VIEWS))
    union = " | ".join(f"Literal[{part}]" for part in parts)
    text = f"{HEAD}ViewName: TypeAlias = {union}\n" + "\n".join(lines).replace(views, "ViewName") + "\n"
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


if __name__ == "__main__":
    TARGET.write_text(compose(), encoding="utf-8")

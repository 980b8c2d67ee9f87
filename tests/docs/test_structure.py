"""The rules a reader relies on: imports point left, gl and truth stand apart, functions stay small."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "splatgl"
# data flows to the right, imports point to the left; rooms of one place are neighbours, and none imports another
ORDER = (
    ("errors", "fileio"),
    ("data",),
    ("readers",),
    ("splat",),
    ("gl", "reference", "comparison", "annotations", "truth"),
    ("distributed",),
    ("scene",),
    ("animation",),
    ("integrations", "studies", "viewer"),
    ("cli",),
    ("app",),
)
PLACES = {room: place for place, rooms in enumerate(ORDER) for room in rooms}
# methods that take or make objects of readers and of other libraries import them once they are called
FACADES = {
    "data/arrays.py": ("readers",),
    "data/mask.py": ("readers",),
    "data/mesh.py": ("integrations",),
    "data/volume.py": ("integrations",),
    "splat/scene.py": ("integrations",),
    "splat/settings.py": ("integrations",),
    "scene/api.py": ("integrations",),
}
FILES = sorted(PACKAGE.rglob("*.py"))
# a longer file is looked at again: does it still hold one subject?
MAX_FILE_LINES, MAX_FUNCTION_LINES, MAX_PARAMETERS = 700, 60, 7

Function = ast.FunctionDef | ast.AsyncFunctionDef


def relative(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def room(parts: tuple[str, ...]) -> str | None:
    """The room's name, None for the package itself."""
    return parts[0] if parts and parts[0] in PLACES else None


def imports(path: Path) -> Iterator[tuple[str, int]]:
    """Every module that a file imports, in functions too, by its full name, with the line."""
    package = ("splatgl", *path.relative_to(PACKAGE).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            # `from splatgl import gl` imports the room gl
            yield from ((f"{module}.{alias.name}", node.lineno) for alias in node.names)


def functions(path: Path) -> Iterator[Function]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, Function):
            yield node


def wrong_imports(path: Path) -> list[str]:
    """Imports to the right, of a neighbour, and of the whole package from inside a room, which would be a cycle."""
    here = room(path.relative_to(PACKAGE).parts[:-1])
    if here is None:
        return []
    wrong = []
    for name, line in imports(path):
        parts = tuple(name.split("."))
        if parts[0] != "splatgl":
            continue
        there = room(parts[1:])
        if there is not None and there != here and PLACES[there] >= PLACES[here]:
            # until all of truth has moved into rooms of their own
            if there in FACADES.get(relative(path), ()) or (here, there) in (
                ("truth", "reference"),
                ("truth", "comparison"),
            ):
                continue
            wrong.append(f"{relative(path)}:{line} imports {name}")
        if there is None and name != "splatgl.__version__":
            wrong.append(f"{relative(path)}:{line} imports {name}, the package that imports it")
    return wrong


def parameters(node: Function) -> int:
    """Parameters that a caller gives: without self and cls."""
    names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def opengl_imports(path: Path) -> list[str]:
    """Imports of moderngl outside gl/."""
    if path.relative_to(PACKAGE).parts[0] == "gl":
        return []
    used = [(name, line) for name, line in imports(path) if name.split(".")[0] in ("moderngl", "glcontext")]
    return [f"{relative(path)}:{line} imports {name}" for name, line in used]


def plan_imports(path: Path) -> list[str]:
    """Imports of `plan`, which decides for OpenGL, in truth/."""
    if path.relative_to(PACKAGE).parts[0] != "truth":
        return []
    used = [(name, line) for name, line in imports(path) if f"{name}.".startswith("splatgl.splat.plan.")]
    return [f"{relative(path)}:{line} imports {name}" for name, line in used]


def too_big(path: Path) -> list[str]:
    """What is longer than the limits, or takes more parameters."""
    lines = len(path.read_text(encoding="utf-8").splitlines())
    wrong = [f"{relative(path)} has {lines} lines"] if lines > MAX_FILE_LINES else []
    for node in functions(path):
        length = (node.end_lineno or node.lineno) - node.lineno + 1
        if length > MAX_FUNCTION_LINES:
            wrong.append(f"{relative(path)}:{node.lineno} {node.name} has {length} lines")
        if parameters(node) > MAX_PARAMETERS:
            wrong.append(f"{relative(path)}:{node.lineno} {node.name} has {parameters(node)} parameters")
    return wrong


def test_the_rooms_are_all_there() -> None:
    assert {path.relative_to(PACKAGE).parts[0] for path in FILES if path.parent != PACKAGE} <= set(PLACES)


def test_imports_point_left() -> None:
    assert [wrong for path in FILES for wrong in wrong_imports(path)] == []


def test_moderngl_stays_in_gl() -> None:
    assert [wrong for path in FILES for wrong in opengl_imports(path)] == []


def test_truth_never_plans() -> None:
    assert [wrong for path in FILES for wrong in plan_imports(path)] == []


def test_files_and_functions_stay_small() -> None:
    assert [wrong for path in FILES for wrong in too_big(path)] == []


@pytest.mark.parametrize(
    ("place", "text", "count"),
    [
        ("data/x.py", "from splatgl.splat.splats import SplatRows", 1),
        ("splat/x.py", "def f():\n    import splatgl.gl.context", 1),
        ("gl/x.py", "from splatgl import truth", 1),
        ("data/x.py", "from ..app import cli", 1),
        ("splat/x.py", "import splatgl", 1),
        ("truth/x.py", "from splatgl.gl.context import current", 1),
        ("truth/x.py", "from splatgl.splat.resolve import Resolved\nfrom ..data import volume\nimport numpy", 0),
        ("app/x.py", "from splatgl import __version__", 0),
    ],
)
def test_wrong_imports_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, text: str, count: int
) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    path = tmp_path / place
    path.parent.mkdir()
    path.write_text(text)
    assert len(wrong_imports(path)) == count


def test_big_files_and_functions_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    path = tmp_path / "x.py"
    long = "\n".join(["def long():", *["    x = 1"] * MAX_FUNCTION_LINES])
    path.write_text(f"import moderngl\n{long}\ndef many(a, b, c, d, e, f, g, h): ...\ndef few(self, b): ...")
    last = MAX_FUNCTION_LINES + 3
    assert too_big(path) == [f"x.py:2 long has {last - 2} lines", f"x.py:{last} many has 8 parameters"]
    assert opengl_imports(path) == ["x.py:1 imports moderngl"]
    path.write_text("\n" * (MAX_FILE_LINES + 1))
    assert too_big(path) == [f"x.py has {MAX_FILE_LINES + 1} lines"]

"""Rules of structure: imports point to lower rooms, and a file or a function holds one subject."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[2] / "splatgl"
# Rooms by level. A room imports rooms of lower levels only.
LEVELS = (
    ("errors", "platforms"),
    ("fileio", "options", "plugins"),
    ("coercion", "keywords", "opengl"),
    ("data",),
    ("readers",),
    ("transfer",),
    ("geometry",),
    ("splat",),
    ("planning",),
    ("gl", "reference", "comparison", "annotations", "writers"),
    ("distributed",),
    ("scene",),
    ("animation",),
    ("exporters",),
    ("integrations", "report", "viewer"),
    ("cli",),
)
LEVEL = {room: level for level, rooms in enumerate(LEVELS) for room in rooms}
# Methods that accept or return objects of a higher room or of other libraries import them when called, or as types.
FACADES = {
    "transfer/presets.py": {"splat"},
    "geometry/clipping.py": {"splat"},
    "geometry/grid.py": {"splat"},
    "geometry/view.py": {"splat"},
    "splat/extract.py": {"planning"},
    "splat/lighting.py": {"planning"},
    "data/arrays.py": {"readers"},
    "data/image.py": {"reference", "geometry", "planning", "splat", "transfer"},
    "data/mask.py": {"readers"},
    "data/mesh.py": {"integrations"},
    "data/volume.py": {"integrations", "writers"},
    "geometry/camera.py": {"integrations", "scene"},
    "planning/scene.py": {"integrations"},
    "splat/settings.py": {"integrations"},
    "scene/api.py": {"integrations"},
}
# One module of each import cycle that functions close: `Volume.of` and `Scene.of`.
CYCLES = {"splatgl.data.volume", "splatgl.planning.scene"}
# Classes of the package that others inherit from, other than protocols and exceptions.
INHERITED = {
    "OptionGroup": "groups of keywords in public signatures, which share the check of their keywords",
    "PictureSettingsKeywords": "a type of dictionaries, which has no other way to contain one",
    "PictureLoadKeywords": "a type of dictionaries",
    "PictureViewKeywords": "a type of dictionaries",
    "LookKeywords": "a type of dictionaries",
    "CutsKeywords": "a type of dictionaries",
    "PictureKeywords": "a type of dictionaries",
}
# What reads, places, masks, cuts and extracts for a picture, and the one room that calls it above `splat`; and other
# files that do, with the reason.
LOADER = "scene/"
LOADING = {
    "splatgl.readers.load",
    "splatgl.splat.extract.extract",
    "splatgl.planning.resolve.extract_for_settings",
    "splatgl.geometry.scissors.cut_volume",
    *(".placed", ".masked", ".transfer_for"),
}
LOADS = {
    "cli/export.py": "files for files; levels for a store; meshes for files",
    "cli/doctor.py": "headers, and scenes to try a renderer",
    "distributed/render.py": "parts of a volume on workers",
    "gl/large_volumes.py": "parts of a volume, one after the other",
    "integrations/exchange.py": "frames that other libraries fix",
    "integrations/napari/reader.py": "layers of napari, which it places",
    "integrations/vtk/scene.py": "masks of a plotter's volumes",
    "report/sweep.py": "splats of coarser voxels",
    "viewer/layer_splats.py": "splats at each stride, in the frame of the first layer that is shown",
    "viewer/saving.py": "looks of a scene that is saved",
    "writers/__init__.py": "volumes for files",
}
# Files that are shorter than SHORT_FILE and have one importer, or none, and what names them.
SHORT_FILE = 80
SHORT_FILES = {
    "__main__.py": "python -m splatgl",
    "cli/animate.py": "cli/main.py: COMMANDS",
    "cli/info.py": "cli/main.py: COMMANDS",
    "distributed/worker_preload.py": "Dask's option preload",
    "integrations/xarray.py": "an import that adds the accessor",
}
MAX_FUNCTION_LINES, MAX_PARAMETERS = 60, 7

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Import(NamedTuple):
    """An imported name in full, its line, and whether a call or only the type check imports it."""

    name: str
    line: int
    late: bool
    typed: bool


def relative(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def files() -> list[Path]:
    return sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.pyi")])


def module_of(path: Path) -> str:
    parts = ("splatgl", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room_of(path: Path) -> str | None:
    """First folder of a file, or its stem at the top; None for the package itself."""
    first = path.relative_to(PACKAGE).parts[0].split(".")[0]
    return None if first in ("__init__", "__main__") else first


@cache
def parse(path: Path) -> ast.Module:
    """Syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imports(path: Path) -> list[Import]:
    """All imports of a file with full names, those in functions and for type checks included."""
    package = ("splatgl", *path.relative_to(PACKAGE).parts[:-1])

    def walk(node: ast.AST, late: bool, typed: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                yield from (Import(alias.name, child.lineno, late, typed) for alias in child.names)
            elif isinstance(child, ast.ImportFrom):
                base = ".".join(package[: len(package) - child.level + 1]) if child.level else ""
                module = ".".join(part for part in (base, child.module) if part)
                yield from (Import(f"{module}.{alias.name}", child.lineno, late, typed) for alias in child.names)
            checks = isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING"
            if not isinstance(child, ast.expr):
                yield from walk(child, late or isinstance(child, Function), typed or checks)

    return list(walk(parse(path), False, False))


def wrong_imports(path: Path) -> list[str]:
    """Imports of rooms that are not lower, and of the package itself, of which only the version may be imported."""
    here = room_of(path)
    if here is None:
        return []
    wrong = []
    for each in imports(path):
        parts = each.name.split(".")
        if parts[0] != "splatgl" or each.name == "splatgl.__version__":
            continue
        there = parts[1] if len(parts) > 1 and parts[1] in LEVEL else None
        if there is None:
            wrong.append(f"{relative(path)}:{each.line} imports {each.name}, the package that imports it")
        elif there != here and LEVEL[there] >= LEVEL[here]:
            if (each.late or each.typed) and there in FACADES.get(relative(path), ()):
                continue
            wrong.append(f"{relative(path)}:{each.line} imports {each.name}")
    return wrong


def edges(late: bool) -> dict[str, set[str]]:
    """Module → modules of the package that it imports at run time; late: when a function runs, too."""
    modules = {module_of(path): path for path in files()}
    found: dict[str, set[str]] = defaultdict(set)
    for module, path in modules.items():
        for each in imports(path):
            target = each.name if each.name in modules else each.name.rpartition(".")[0]
            if target in modules and target != module and not each.typed and (late or not each.late):
                found[module].add(target)
    return found


def reached(start: str, graph: Mapping[str, set[str]]) -> set[str]:
    """Modules that a module imports, directly or through others."""
    found: set[str] = set()
    waiting = [start]
    while waiting:
        new = graph.get(waiting.pop(), set()) - found
        found |= new
        waiting += new
    return found


def cycles(graph: Mapping[str, set[str]]) -> set[frozenset[str]]:
    """Largest sets of modules that all import one another."""
    reach = {module: reached(module, graph) for module in graph}
    return {
        frozenset(other for other in reach[module] if module in reach.get(other, ()))
        for module in graph
        if module in reach[module]
    }


def parameters(node: Function) -> int:
    """Number of parameters without self and cls."""
    names = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def long_functions(path: Path) -> list[str]:
    """Functions that exceed the limits of lines or parameters."""
    wrong = []
    for node in ast.walk(parse(path)):
        if isinstance(node, Function):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if length > MAX_FUNCTION_LINES:
                wrong.append(f"{relative(path)}:{node.lineno} {node.name} has {length} lines")
            if parameters(node) > MAX_PARAMETERS:
                wrong.append(f"{relative(path)}:{node.lineno} {node.name} has {parameters(node)} parameters")
    return wrong


def uses(folder: str, *names: str) -> list[str]:
    """Imports of modules, or of names in them, by the files of a folder ("" for all folders)."""
    return [
        f"{relative(path)}:{each.line} imports {each.name}"
        for path in files()
        if relative(path).startswith(folder)
        for each in imports(path)
        if any(f"{each.name}.".startswith(f"{name}.") for name in names)
    ]


@cache
def classes(path: Path) -> tuple[ast.ClassDef, ...]:
    return tuple(node for node in ast.walk(parse(path)) if isinstance(node, ast.ClassDef))


def inherited() -> list[str]:
    """Classes that inherit from a class of the package, other than a protocol or an exception."""
    found = [(path, node) for path in files() for node in classes(path)]
    above = [{ast.unparse(base).partition("[")[0].rpartition(".")[2] for base in node.bases} for _, node in found]
    named = [node.name for _, node in found]
    refused = {
        name for name, bases in zip(named, above, strict=True) if "Protocol" not in bases and not name.endswith("Error")
    }
    return [
        f"{relative(path)}:{node.lineno} {node.name} inherits from {base}"
        for (path, node), bases in zip(found, above, strict=True)
        for base in sorted(bases & refused)
    ]


def loading(path: Path) -> list[str]:
    """Calls of LOADING in a file."""
    names, found = dict[str, str](), list[str]()
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.ImportFrom):
            names |= {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
    for node in ast.walk(parse(path)):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            first, _, last = called.rpartition(".")
            full = f"{names[first]}.{last}" if first in names else names.get(called, called)
            found += [f"{relative(path)}:{node.lineno} calls {called}"] * bool({full, f".{last}"} & LOADING)
    return found


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def test_all_rooms_have_a_level() -> None:
    assert {room for path in files() if (room := room_of(path)) is not None} == set(LEVEL)


def test_scenes_are_opened_in_one_place() -> None:
    """No second loader: what draws takes its layers from `scene`."""
    lower = LEVEL["planning"]
    upper = [path for path in files() if (room := room_of(path)) is not None and LEVEL[room] > lower]
    found = {relative(path): calls for path in upper if (calls := loading(path))}
    own = {place for place in found if place.startswith(LOADER)}
    assert own and found.keys() - own == LOADS.keys(), [found[place] for place in found.keys() - own - LOADS.keys()]


def test_only_type_checks_import_stubs() -> None:
    """A stub has no module: an import in a function that no test calls would fail for the user."""
    stubs = {module_of(path) for path in files() if path.suffix == ".pyi"}
    wrong = [
        f"{relative(path)}:{each.line}"
        for path in files()
        for each in imports(path)
        if not each.typed and stubs & {each.name, each.name.rpartition(".")[0]}
    ]
    assert stubs and not wrong


def has_rows(path: Path) -> bool:
    """Whether a module has rows of `annotations.annotate.ANNOTATIONS`, which finds them by itself."""
    return path.parent.name == "annotations" and "\nROWS = " in path.read_text(encoding="utf-8")


def test_imports_point_to_lower_rooms() -> None:
    assert [wrong for path in files() for wrong in wrong_imports(path)] == []


def test_comparison_needs_data_alone() -> None:
    allowed = {"coercion", "comparison", "data", "errors", "fileio", "options", "platforms"}
    others = [f"splatgl.{room}" for room in LEVEL if room not in allowed]
    assert uses("comparison/", *others) == []


def test_moderngl_stays_in_gl() -> None:
    assert [each for each in uses("", "moderngl", "glcontext") if not each.startswith("gl/")] == []


def test_reference_never_plans() -> None:
    assert uses("reference/", "splatgl.planning.plan") == []


def test_no_cycles_but_of_facades() -> None:
    assert cycles(edges(late=False)) == set()
    found = cycles(edges(late=True))
    assert len(found) == len(CYCLES)
    assert {module for cycle in found for module in CYCLES & cycle} == CYCLES


def test_files_hold_one_subject() -> None:
    """Short files with one importer are looked at again: each stands here with its reason."""
    importers: dict[str, set[str]] = defaultdict(set)
    for module, targets in edges(late=True).items():
        for target in targets:
            importers[target].add(module)
    short = [path for path in files() if lines_of(path) < SHORT_FILE and path.name != "__init__.py"]
    short = [path for path in short if not has_rows(path)]
    assert {relative(path) for path in short if len(importers[module_of(path)]) < 2} == set(SHORT_FILES)


def test_classes_are_composed() -> None:
    """No class is split over files, or into a chain, by inheritance: only from a protocol or a class of a library."""
    found = inherited()
    assert {each.rpartition(" ")[2] for each in found} == set(INHERITED), found


def test_no_test_imports_another() -> None:
    """What several tests share stands in tests/helpers, or is a fixture of tests/conftest.py."""
    found = []
    named = re.compile(r"^\s*(from|import)\s[^\n(]*(\([^)]*)?\b(test_|conftest)", re.MULTILINE)
    for path in Path(__file__).parents[1].rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        # only statements count, and to parse all files takes a second
        for node in ast.walk(ast.parse(text)) if named.search(text) else ():
            if not isinstance(node, ast.Import | ast.ImportFrom):
                continue
            module = node.module or "" if isinstance(node, ast.ImportFrom) else ""
            parts = [part for alias in node.names for part in f"{module}.{alias.name}".split(".")]
            if any(part == "conftest" or part.startswith("test_") for part in parts):
                found.append(f"{path.name}:{node.lineno}")
    assert found == []


def test_class_names_stand_once() -> None:
    homes: dict[str, list[str]] = defaultdict(list)
    for path in files():
        for node in classes(path):
            homes[node.name].append(relative(path))
    repeated = {name: places for name, places in homes.items() if len(places) > 1}
    assert repeated == {}


def test_functions_stay_small() -> None:
    assert [wrong for path in files() for wrong in long_functions(path)] == []


@pytest.mark.parametrize(
    ("place", "text", "count"),
    [
        ("data/x.py", "from splatgl.splat.splats import SplatRows", 1),
        ("splat/x.py", "def f():\n    import splatgl.gl.context", 1),
        ("splat/settings.py", "def f():\n    from splatgl.integrations.vtk.scene import settings_of", 0),
        ("splat/settings.py", "from splatgl.integrations.vtk.scene import settings_of", 1),
        ("gl/x.py", "from splatgl import reference", 1),
        ("data/x.py", "from ..cli import main", 1),
        ("splat/x.py", "import splatgl", 1),
        ("cli/x.py", "from splatgl import __version__", 0),
        ("reference/x.py", "from splatgl.gl.context import current", 1),
        ("reference/x.py", "from splatgl.planning.resolve import Resolved\nfrom ..data import volume\nimport numpy", 0),
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


def test_plans_in_reference_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    path = tmp_path / "reference" / "x.py"
    path.parent.mkdir()
    path.write_text(
        "import splatgl.planning.plan\nfrom splatgl.planning import plan, order\nfrom splatgl.planning.plan import Plan"
    )
    assert len(uses("reference/", "splatgl.planning.plan")) == 3


def test_loaders_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    path = tmp_path / "x.py"
    path.write_text(
        "from splatgl import readers\nfrom splatgl.readers import load as read, scan\nread(1)\nreaders.load(2)\n"
        "volume.placed('LPS')\nload(3)\nscan(4)\nlayer.placed"
    )
    assert [call.partition(" ")[0] for call in loading(path)] == ["x.py:3", "x.py:4", "x.py:5"]


def test_cycles_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a.py").write_text("from splatgl.data.b import B")
    (tmp_path / "data" / "b.py").write_text("def f():\n    from splatgl.data import a\n    return a")
    (tmp_path / "data" / "c.py").write_text("if TYPE_CHECKING:\n    from splatgl.data.a import A")
    assert cycles(edges(late=False)) == set()
    assert cycles(edges(late=True)) == {frozenset({"splatgl.data.a", "splatgl.data.b"})}


def test_inheritance_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    (tmp_path / "a.py").write_text(
        "class A: ...\nclass F(Protocol): ...\nclass E(Exception): ...\nclass MyError(E): ..."
    )
    (tmp_path / "b.py").write_text(
        "from splatgl import a\nclass B(a.A): ...\nclass C(B): ...\nclass G(a.F): ...\nclass H(Buffer): ...\n"
        "class K(a.MyError): ..."
    )
    found = [each.partition(" ")[2] for each in inherited()]
    assert found == ["MyError inherits from E", "B inherits from A", "C inherits from B"]


def test_long_functions_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(globals(), "PACKAGE", tmp_path)
    path = tmp_path / "x.py"
    long = "\n".join(["def long():", *["    x = 1"] * MAX_FUNCTION_LINES])
    path.write_text(f"import moderngl\n{long}\ndef many(a, b, c, d, e, f, g, h): ...\ndef few(self, b): ...")
    last = MAX_FUNCTION_LINES + 3
    assert long_functions(path) == [f"x.py:2 long has {last - 2} lines", f"x.py:{last} many has 8 parameters"]
    assert uses("", "moderngl") == ["x.py:1 imports moderngl"]

"""Writes tests/docs/public_names.txt: names that programs, scripts and files of users rely on.

python scripts/public_names.py
"""

from __future__ import annotations

import inspect
import io
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from mkdocs_hooks import command_parsers

import splatgl as sg
from splatgl.annotations.canvas import Measure
from splatgl.cli.main import main
from splatgl.options import declared, names_of
from splatgl.readers.options import LoadOptions
from splatgl.scene.meshes import MeshFile, Vectors
from splatgl.scene.scene_file import ANIMATION, LAYER, PLAIN, TABLES
from splatgl.scene.transfer_choice import TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

API = Path(sg.__file__).parent / "docs" / "api.md"
TARGET = Path(__file__).parents[1] / "tests" / "docs" / "public_names.txt"
# pictures with all kinds of metadata: options of `splatgl render`
PICTURES = ("", "--blend xray", "--like 0.1 --check 2", "--slice z=3", "--shadows 1 --annotate scale", "--crop 1:4,:,:")

MARKS: dict[Any, str] = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}


def python_names() -> Iterator[str]:
    """Functions with their parameters; classes also with methods and properties."""
    for name in sg.__all__:
        value = getattr(sg, name)
        if isinstance(value, ModuleType):
            public = getattr(value, "__all__", [key for key, item in vars(value).items() if defined_in(item, name)])
            for key in sorted(public):
                yield from lines_of(f"sg.{name}.{key}", getattr(value, key))
            continue
        yield from lines_of(f"sg.{name}", value)
        if inspect.isclass(value):
            own = [base for base in value.__mro__[::-1] if base.__module__.startswith("splatgl")]
            members = {key: item for base in own for key, item in vars(base).items()}
            shown = members_on_page(name) or {key for key in members if not key.startswith("_") and owned(members[key])}
            for key in sorted(shown):
                yield from lines_of(f"sg.{name}.{key}", getattr(value, key))


def members_on_page(name: str) -> set[str]:
    """The members of a class to which the API page is limited; none where it shows all."""
    limit = re.search(
        rf"^::: splatgl\.{name}\n    options:\n      members: \[(.+)\]$", API.read_text(encoding="utf-8"), re.M
    )
    return set(limit[1].split(", ")) if limit else set()


def defined_in(item: Any, module: str) -> bool:
    """Whether an object is a function of that module of the package."""
    return inspect.isfunction(item) and f".{module}" in item.__module__ and not item.__name__.startswith("_")


def owned(item: Any) -> bool:
    """Whether a member of a class is a method or a property, not a default value."""
    return callable(item) or isinstance(item, classmethod | staticmethod | property) or hasattr(item, "attrname")


def lines_of(name: str, value: Any) -> Iterator[str]:
    """A line with the parameters that a function or class needs, in order, and one for each that has a default."""
    if not callable(value) or (inspect.isclass(value) and issubclass(value, BaseException)):
        yield name
        return
    found = inspect.signature(value).parameters.values()
    needed = [MARKS.get(item.kind, "") + item.name for item in found if item.default is item.empty]
    yield f"{name}({', '.join(needed)})"
    yield from (f"{name}(… {item.name}=)" for item in found if item.default is not item.empty)


def command_names() -> Iterator[str]:
    """Options of all commands."""
    for name, parser in command_parsers().items():
        flags = {flag for action in parser._actions for flag in action.option_strings}
        yield from (f"splatgl {name} {flag}" for flag in sorted(flags))


def toml_names() -> Iterator[str]:
    """Keys of a scene file by table."""
    tables = {
        "": {*PLAIN, *TABLES},
        "load": declared(LoadOptions),
        "transfer": {*declared(Transfer), *declared(TransferChoice)},
        "camera": names_of(ViewOptions),
        "settings": declared(Settings),
        "vectors": declared(Vectors),
        "animation": ANIMATION,
        "mesh": declared(MeshFile),
        "measure": {item.name for item in fields(Measure)},
        "layer": {*PLAIN, *LAYER},
    }
    yield from (f"scene.toml [{table}] {key}" for table, keys in tables.items() for key in sorted(keys))


def metadata_names() -> Iterator[str]:
    """Keys of the JSON in the PNG text `splatgl` of some pictures."""
    keys: set[str] = set()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        path, before = Path(folder), os.getcwd()
        np.save(path / "noise.npy", np.random.default_rng(1).random((8, 8, 8), np.float32))
        os.chdir(path)
        try:
            for options in PICTURES:
                drawn = main(["render", "noise.npy", "--size", "64", "--quiet", "-o", "a.png", *options.split()])
                assert drawn == 0, options
                keys |= set(sg.Image.load("a.png").info)
        finally:
            os.chdir(before)
    yield from (f"PNG {key}" for key in sorted(keys))


def compose() -> str:
    """The text of the list."""
    parts = (python_names(), command_names(), toml_names(), metadata_names())
    return "".join(f"{line}\n" for part in parts for line in part)


if __name__ == "__main__":
    TARGET.write_text(compose(), encoding="utf-8")

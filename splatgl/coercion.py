"""`public`: converts the arguments of public functions to the types that their parameters state."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import is_dataclass
from functools import cache, wraps
from importlib import import_module
from inspect import CO_VARARGS, CO_VARKEYWORDS, isfunction
from os import PathLike
from typing import Any, NamedTuple, TypeVar

import numpy as np

from splatgl.errors import InputError, expected
from splatgl.options import SIZE, declared, is_number, nearest

Target = TypeVar("Target")


class ArgumentType(NamedTuple):
    """A type of arguments. this: its description in messages. take: returns the converted value, by it and the other
    arguments; raises TypeError or ValueError for other values.
    """

    this: str
    take: Callable[[Any, Mapping[str, Any]], Any]


def _plain(this: str, *types: type) -> ArgumentType:
    """Values of some types, as they are."""
    return _fitting(this, lambda value: isinstance(value, types))


def _fitting(this: str, fits: Callable[[Any], bool]) -> ArgumentType:
    """Values that fit, as they are."""

    def take(value: Any, _: Mapping[str, Any]) -> Any:
        if not fits(value):
            raise TypeError
        return value

    return ArgumentType(this, take)


def _take_array(value: Any, _: Mapping[str, Any]) -> Any:
    """An array of numbers or records; those of other libraries stay."""
    array = value if hasattr(value, "dtype") and hasattr(value, "__getitem__") else np.asarray(value)
    if np.dtype(array.dtype).kind not in "buifV":
        raise TypeError
    return array


def _has_numbers(value: Any) -> bool:
    return np.ndim(value) == 1 and np.asarray(value).dtype.kind in "uif"


def _is_whole(value: Any) -> bool:
    return is_number(value) and value == int(value)


def is_instance(value: Any, name: str) -> bool:
    """Whether a value is of a class of this package, of which only the name is known: nothing is imported."""
    return any(base.__name__ == name and base.__module__.startswith("splatgl.") for base in type(value).__mro__)


def is_scene(x: Any) -> bool:
    """Whether `x` is a scene of layers, a PyVista plotter, or a VTK window or renderer. Imports none of them."""
    plotted = any(hasattr(getattr(x, "renderer", x), name) for name in ("GetVolumes", "GetRenderers"))
    return is_instance(x, "Scene") or plotted


def _instance(name: str) -> ArgumentType:
    """Objects of a class of this package, of which only the name is known."""
    return _fitting(_NAMED.get(name, f"a {name}"), lambda value: is_instance(value, name))


def _made(name: str, this: str, place: str) -> ArgumentType:
    """Objects of a class of this package, and what module:function makes one of."""

    def take(value: Any, others: Mapping[str, Any]) -> Any:
        if is_instance(value, name):
            return value
        module, _, function = place.partition(":")
        return getattr(import_module(module), function)(value, others)

    return ArgumentType(this, take)


_NUMBERS = _fitting("some numbers", _has_numbers)
_ARRAY = ArgumentType("an array of numbers", _take_array)
# classes whose objects stay as they are, and descriptions that are not their names
_CLASSES = (
    *("Bricks", "Camera", "Drawing", "Image", "Layer", "LoadOptions", "Mesh", "Motion", "OptionGroup", "Points"),
    *("Scene", "Settings", "Slice", "Splats", "Transfer", "Volume", "World"),
)
_NAMED = {"OptionGroup": "a group of options such as View", "Image": "an Image", "Settings": "Settings"}
_SUBJECTS = "splatgl.planning.scene"
FORMS = {
    "None": _fitting("None", lambda value: value is None),
    "str": _plain("text", str),
    "Path": _plain("a path", str, PathLike),
    "bool": _plain("true or false", bool, np.bool_),
    "float": _fitting("a number", is_number),
    "int": _fitting("a whole number", _is_whole),
    "Size": ArgumentType(SIZE.this, lambda value, _: SIZE.check(value)),
    "Kernel": _fitting("a kernel, such as a PiecewiseCubic", lambda value: hasattr(value, "footprint")),
    "Client": _fitting("a client of Dask", lambda value: hasattr(value, "submit")),
    **dict.fromkeys(("Vector", "Triple", "Places", "Color"), _NUMBERS),
    **dict.fromkeys(("np.ndarray", "ArrayLike"), _ARRAY),
    **dict.fromkeys(("Callable", "Progress"), _fitting("a function", callable)),
    "Mapping": _plain("names with values", Mapping),
    "Bounded": _fitting("a volume, splats or a scene", lambda value: hasattr(value, "corners")),
    **{name: _instance(name) for name in _CLASSES},
}
# of types beside `Any`, which stands for what makes one
MADE = {
    **FORMS,
    "Volume": _made("Volume", "a volume, an array or a file", f"{_SUBJECTS}:volume_of"),
    "Splats": _made("Splats", "splats, a volume, an array or a file", f"{_SUBJECTS}:splats_of"),
    "Scene": _made("Scene", "a scene", f"{_SUBJECTS}:scene_of"),
    "Bounded": _made("Bounded", "splats, a volume, an array or a file", f"{_SUBJECTS}:bounded_of"),
    "Transfer": _made(
        "Transfer", "a Transfer, its fields or file, or the name of a preset", f"{_SUBJECTS}:transfer_of"
    ),
    "Camera": _made("Camera", "a Camera, or one of VTK or PyVista", f"{_SUBJECTS}:camera_of"),
    "Settings": _made("Settings", "Settings, or some of their fields", f"{_SUBJECTS}:settings_of"),
    "Image": _made("Image", "an Image, a file or an array", "splatgl.comparison.pictures:image_of"),
}
# parts of a union of types, in which brackets may hold unions
PART = re.compile(r"(?:[^|\[\]]|\[(?:[^\[\]]|\[[^\]]*\])*\])+")


def _sequence(inner: str) -> ArgumentType:
    """Several values of a type."""
    if re.fullmatch(r"(float|int)(, (float|int|\.\.\.))*", inner):
        return _NUMBERS
    form = form_of(inner.removesuffix(", ..."))

    def take(value: Any, others: Mapping[str, Any]) -> Any:
        if isinstance(value, str | bytes | Mapping) or not hasattr(value, "__len__"):
            raise TypeError
        return tuple(form.take(item, others) for item in value) if form else value

    return ArgumentType(f"a sequence of {form.this}" if form else "a sequence", take)


@cache
def form_of(hint: str) -> ArgumentType | None:
    """The form of a type, as it stands in an annotation; None if a part of it has none. `Any` in a union stands for
    what makes an object of its other parts.
    """
    words = [part.strip() for part in PART.findall(hint)]
    table, several = MADE if "Any" in words else FORMS, ("Sequence", "Collection", "tuple")
    parts = [word.partition("[") for word in words if word != "Any"]
    forms = [_sequence(inner[:-1]) if name in several else table.get(name) for name, _, inner in parts]
    known = [form for form in forms if form is not None]
    if not known or len(known) < len(forms):
        return None

    def take(value: Any, others: Mapping[str, Any]) -> Any:
        for form in known:
            try:
                return form.take(value, others)
            except InputError:
                raise
            except (TypeError, ValueError, OverflowError):
                continue
        raise TypeError

    return ArgumentType(" or ".join(form.this for form in known), take)


def _got(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"an array {value.dtype} {value.shape}"
    is_plain = value is None or isinstance(value, str | int | float | list | tuple | dict)
    return repr(value)[:80] if is_plain else f"a {type(value).__name__}"


def public(target: Target) -> Target:
    """A decorator of public functions, and of classes for their public methods: converts arguments to the types that
    the parameters state, as `sg.render` takes them. A file or an array becomes a volume, the name of a preset a
    transfer function, a mapping settings. InputError for others, and for unknown names of parameters.
    """
    if not isinstance(target, type):
        return _checked(target)
    # options have checks of their own
    options = declared(target) if is_dataclass(target) else {}
    for name, member in [*vars(target).items()]:
        if name != "__init__" and name.startswith("_"):
            continue
        if isinstance(member, classmethod | staticmethod):
            setattr(target, name, type(member)(_checked(member.__func__)))
        elif isfunction(member):
            setattr(target, name, _checked(member, options if name == "__init__" else ()))
    return target


def _checked(function: Any, others: Collection[str] = ()) -> Any:
    """The function with converted arguments. others: names of those that stay."""
    code, hints = function.__code__, function.__annotations__
    names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    is_open = bool(code.co_flags & CO_VARKEYWORDS) or bool(code.co_flags & CO_VARARGS)
    forms: dict[str, ArgumentType] | None = None

    @wraps(function)
    def call(*args: Any, **named: Any) -> Any:
        nonlocal forms
        if forms is None:
            found = {name: form_of(hints[name]) for name in names if name in hints and name not in others}
            forms = {name: form for name, form in found.items() if form}
        if not (is_open or named.keys() <= set(names)):
            unknown = next(name for name in named if name not in names)
            what = function.__qualname__.removesuffix(".__init__")
            known = [name for name in names if name not in ("self", "cls")]
            raise expected(what, f"some of {', '.join(known)}", unknown, nearest(unknown, known))
        values = {**dict(zip(names, args, strict=False)), **named}
        for name, form in forms.items():
            if name in values:
                try:
                    values[name] = form.take(values[name], values)
                except InputError:
                    raise
                except (TypeError, ValueError):
                    raise expected(name, form.this, _got(values[name])) from None
        count = min(len(args), len(names))
        plain = [values[name] for name in names[:count]]
        return function(*plain, *args[count:], **{name: values[name] for name in named})

    return call

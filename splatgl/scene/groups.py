"""Keywords of pictures, and their groups as objects: `View`, `Look`, `Cuts`, `Light` and `Check`."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from inspect import Parameter, Signature
from typing import TYPE_CHECKING, Any, TypeVar, Unpack

import numpy as np

from splatgl.data.volume import ArrayOptions
from splatgl.errors import expected
from splatgl.options import Group, OptionGroup, declared, flag_name, keyword, keywords_of, names_of, with_keywords
from splatgl.readers.options import LoadOptions
from splatgl.scene.draw import DrawOptions
from splatgl.scene.meshes import VECTORS, MeshFile, Vectors
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import Settings
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.keywords import CheckKeywords, CutsKeywords, LightKeywords, LookKeywords, ViewKeywords

Function = TypeVar("Function", bound=Callable[..., Any])

# options of the transfer function that are keywords; `shading` is a setting
TRANSFER = names_of(TransferChoice, Transfer)
_vectors = keywords_of(Vectors)
# keywords of all pictures but the groups: by record, those of a source last
PLAIN = {
    **keywords_of(ViewOptions, *names_of(ViewOptions)),
    **keywords_of(Settings, *names_of(Settings)),
    **keywords_of(TransferChoice),
    **keywords_of(Transfer, *names_of(Transfer), flags=True),
    **keywords_of(SceneFile, *names_of(SceneFile), flags=True),
    **{name: keyword(name, hint) for name, hint in (("labels", "Any"), ("clip_meshes", "bool"))},
    **keywords_of(MeshFile, *names_of(MeshFile)),
    **{name: _vectors[item].replace(name=name) for name, item in VECTORS.items()},
    **{name: keyword(name, hint) for name, hint in (("like", "str | None"), ("paper", "bool"))},
    **keywords_of(DrawOptions, "memory"),
    **keywords_of(ArrayOptions),
    **keywords_of(LoadOptions, *names_of(LoadOptions), flags=True),
    # text: the unit of an array's lengths; a number or "extent": the length that opacities refer to
    "unit": keyword("unit", "str | float | None"),
}


def _groups() -> Iterator[tuple[str, str]]:
    """Names of keywords, and the group of each on the command line."""
    for record in (LoadOptions, ViewOptions, Settings, TransferChoice, Transfer, SceneFile, MeshFile):
        for name, option in declared(record).items():
            yield from ((key, option.group) for key in (name, flag_name(option)) if key and option.group)


_GROUPS = dict(_groups())


def _of_group(group: Group) -> dict[str, Parameter]:
    return {name: parameter for name, parameter in PLAIN.items() if _GROUPS.get(name) == group}


class View(OptionGroup):
    """Keywords of the view, as an object for `view=`: azimuth, elevation, zoom, size, …; each as of `render`.

    ```python
    front = sg.View(azimuth=0, size=64)
    sg.render(sg.scenes.ball(12), view=front, light=sg.Light(shadows=0.8)).save("front.png")
    ```
    """

    known = _of_group(Group.VIEW)
    record = ViewOptions
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[ViewKeywords]) -> None: ...


class Look(OptionGroup):
    """Keywords of the transfer function, as an object for `look=`: preset, points, colormap, window, …"""

    known = _of_group(Group.TRANSFER)
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[LookKeywords]) -> None: ...


class Cuts(OptionGroup):
    """Keywords of clipping and masks, as an object for `cuts=`: clip, crop, mask, …"""

    known = _of_group(Group.CLIPPING)
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[CutsKeywords]) -> None: ...


class Light(OptionGroup):
    """Keywords of the picture and its light, as an object for `light=`: blend, light, shadows, background, …"""

    known = _of_group(Group.PICTURE)
    record = Settings
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[LightKeywords]) -> None: ...


class Check(OptionGroup):
    """Keywords of accuracy, as an object for `check=`: tolerance, antialias, samples, kernel, …"""

    known = _of_group(Group.ACCURACY)
    record = Settings
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[CheckKeywords]) -> None: ...


# by their keywords
GROUPS: dict[str, type[OptionGroup]] = {kind.__name__.lower(): kind for kind in (View, Look, Cuts, Light, Check)}
for _kind in GROUPS.values():
    _kind.__signature__ = Signature([*_kind.known.values()])  # type: ignore[attr-defined]

# of `view` and `light`, which are names of options, too
_hints = {name: f"{PLAIN[name].annotation.removesuffix(' | None')} | " if name in PLAIN else "" for name in GROUPS}
KEYWORDS = {
    **PLAIN,
    **{
        name: keyword(name, f"{hint}OptionGroup | None", PLAIN[name].default if hint else None)
        for name, hint in _hints.items()
    },
}
# keywords that take arrays, as they are
_OF_ARRAYS = {"uncut", *(name for name, item in PLAIN.items() if item.annotation.removesuffix(" | None") == "Any")}


def ungrouped(options: Mapping[str, Any], *slots: Any) -> tuple[dict[str, Any], list[Any]]:
    """Options with those of groups among them and among other arguments, which options of the same name replace; and
    these arguments, None where one is a group. Arrays become lists, but those of voxels and meshes.
    """
    given: dict[str, Any] = {}
    for name, value in options.items():
        is_group = isinstance(value, OptionGroup)
        if name in GROUPS and (is_group or name not in PLAIN) and not isinstance(value, GROUPS[name] | None):
            raise expected(name, f"a {GROUPS[name].__name__}", f"a {type(value).__name__}")
        given |= value.options if is_group else {}
    for slot in slots:
        given |= slot.options if isinstance(slot, OptionGroup) else {}
    plain = {name: value for name, value in options.items() if not isinstance(value, OptionGroup)}
    plain = {name: value for name, value in plain.items() if name in PLAIN or name not in GROUPS}
    merged = {
        name: value.tolist() if isinstance(value, np.ndarray) and name not in _OF_ARRAYS else value
        for name, value in {**given, **plain}.items()
    }
    return merged, [None if isinstance(slot, OptionGroup) else slot for slot in slots]


def with_groups(*tables: Mapping[str, Parameter]) -> Callable[[Function], Function]:
    """A decorator that lists all keywords of pictures, and further ones, in the signature of a function, and their
    groups in its docstring.
    """

    def add(function: Function) -> Function:
        titles = {f"{name} ({kind.__name__})": kind.known for name, kind in GROUPS.items()}
        rest = {name: item for name, item in PLAIN.items() if not any(name in known for known in titles.values())}
        lines = [f"{title}: {', '.join(known)}" for title, known in {**titles, "others": rest}.items()]
        text = "\n".join(
            textwrap.fill(line, 112, initial_indent="    ", subsequent_indent="        ") for line in lines
        )
        function.__doc__ = (
            f"{inspect.cleandoc(function.__doc__ or '')}\n\nKeywords by the objects that also take them:\n\n{text}\n"
        )
        return with_keywords(KEYWORDS, *tables)(function)

    return add

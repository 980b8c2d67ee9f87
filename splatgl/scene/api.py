"""`sg.render` and `sg.depth_map`, and groups of their keywords: `View`, `Look`, `Cuts`, `Light` and `Check`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, replace
from inspect import Parameter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, Unpack

import numpy as np

from splatgl import __version__
from splatgl.coercion import is_instance, is_scene, public
from splatgl.data.image import Image
from splatgl.data.volume import ArrayOptions, Volume
from splatgl.errors import expected, warn
from splatgl.fileio import within
from splatgl.options import (
    HelpGroup,
    OptionGroup,
    by_fields,
    declared,
    flag_name,
    is_number,
    keyword,
    keywords_of,
    names_of,
    reject_unknown,
    with_keywords,
)
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.draw import DrawOptions, SubjectView, depths_of, draw
from splatgl.scene.meshes import VECTORS, MeshFile, Vectors
from splatgl.scene.open_scene import OpenScene, with_background
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import TransferChoice
from splatgl.scene.view import AZIMUTH, ELEVATION, ViewOptions
from splatgl.splat.settings import Settings
from splatgl.transfer.presets import CONSTANT
from splatgl.transfer.transfer import EXTENT, Transfer
from splatgl.transfer.transfer_nodes import SUFFIXES

if TYPE_CHECKING:
    from splatgl.geometry.camera import Camera
    from splatgl.keywords import CheckKeywords, CutsKeywords, LightKeywords, LookKeywords, RenderKeywords, ViewKeywords


Target = TypeVar("Target", bound=Any)

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
    "labels": keyword("labels", "Any", help="a segmentation that is laid over the volume"),
    "clip_meshes": keyword("clip_meshes", "bool", help="whether clip and crop cut meshes (default True)"),
    **keywords_of(MeshFile, *names_of(MeshFile)),
    **{name: _vectors[item].replace(name=name) for name, item in VECTORS.items()},
    "like": keyword("like", "str | None", help="defaults of an earlier version: '0.1', '0.2'"),
    "paper": keyword("paper", "bool", help="the settings of the paper's hardware"),
    **keywords_of(DrawOptions, "memory"),
    **keywords_of(ArrayOptions),
    **keywords_of(LoadOptions, *names_of(LoadOptions), flags=True),
    # text: the unit of an array's lengths; a number or "extent": the length that opacities refer to
    "unit": keyword(
        "unit",
        "str | float | None",
        help="length that opacities refer to, or unit of an array's lengths, such as 'mm'",
    ),
}


def _groups() -> Iterator[tuple[str, str]]:
    """Names of keywords, and the group of each on the command line."""
    for record in (LoadOptions, ViewOptions, Settings, TransferChoice, Transfer, SceneFile, MeshFile, Vectors):
        for name, option in declared(record).items():
            yield from ((key, option.group) for key in (name, flag_name(option)) if key and option.group)


_GROUPS = {
    **dict(_groups()),
    **dict.fromkeys(("labels", "clip_meshes"), HelpGroup.LAYERS),
    **dict.fromkeys(("like", "paper"), HelpGroup.PAPER),
    "memory": HelpGroup.SPEED,
}


def _of_group(group: HelpGroup) -> dict[str, Parameter]:
    return {name: parameter for name, parameter in PLAIN.items() if _GROUPS.get(name) == group}


class View(OptionGroup):
    """Keywords of the view, as an object for `view=`: azimuth, elevation, zoom, size, …; each as of `render`.

    ```python
    front = sg.View(azimuth=0, size=64)
    sg.render(sg.scenes.ball(12), view=front, light=sg.Light(shadows=0.8)).save("front.png")
    ```
    """

    known = _of_group(HelpGroup.VIEW)
    record = ViewOptions
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[ViewKeywords]) -> None: ...


class Look(OptionGroup):
    """Keywords of the transfer function, as an object for `look=`: preset, points, colormap, window, …"""

    known = _of_group(HelpGroup.TRANSFER)
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[LookKeywords]) -> None: ...


class Cuts(OptionGroup):
    """Keywords of clipping and masks, as an object for `cuts=`: clip, crop, mask, …"""

    known = _of_group(HelpGroup.CLIPPING)
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[CutsKeywords]) -> None: ...


class Light(OptionGroup):
    """Keywords of the picture and its light, as an object for `light=`: blend, light, shadows, background, …"""

    known = _of_group(HelpGroup.PICTURE)
    record = Settings
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[LightKeywords]) -> None: ...


class Check(OptionGroup):
    """Keywords of accuracy, as an object for `check=`: tolerance, antialias, samples, kernel, …"""

    known = _of_group(HelpGroup.ACCURACY)
    record = Settings
    if TYPE_CHECKING:

        def __init__(self, **options: Unpack[CheckKeywords]) -> None: ...


# by their keywords
GROUPS: dict[str, type[OptionGroup]] = {kind.__name__.lower(): kind for kind in (View, Look, Cuts, Light, Check)}
for _kind in GROUPS.values():
    with_keywords(_kind.known)(_kind)

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


def with_groups(table: Mapping[str, Parameter] | None = None) -> Callable[[Target], Target]:
    """A decorator that lists all keywords of pictures, and those of a table, in the signature of a function and, by the
    groups that also take them, in its docstring.
    """
    own = table or {}
    sections: dict[str, dict[str, Parameter]] = {}
    for name, item in PLAIN.items():
        kind = next((kind for kind in GROUPS.values() if name in kind.known), None)
        title = f"Options of sg.{kind.__name__}" if kind else f"Options, {_GROUPS.get(name, HelpGroup.READING)}"
        if name not in own:
            sections.setdefault(title, {})[name] = item
    return with_keywords({**KEYWORDS, **own}, {"Options of this function alone": own, **sections})


# options of a scene that are keywords; the last ones are those of settings as a whole
SCENE = (*names_of(SceneFile), "labels", "clip_meshes", *names_of(MeshFile), *VECTORS, "like", "paper")


@with_groups()
@public
def depth_map(
    x: Any,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    camera: Camera | OptionGroup | Any | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    at: float | str | None = None,
    **options: Unpack[RenderKeywords],
) -> np.ndarray:
    """Returns the eye-space depths of the picture that `render` draws with the same arguments, also of a Scene:
    float64 [H, W], world units along the view direction, of rays through pixel centres, row 0 on top; NaN where a ray
    meets no matter.

    at: a share from 0 (the first matter) to below 1: the depth at which the ray has lost this share of its light;
    "max" or "min": the depth of the largest or least value; None: ½, or the value that mip and minip show. Needs no
    OpenGL. Raises InputError like `render`, and for splats and volumes that are read in parts.
    """
    return depths_of(opened(scene_of(x, transfer, camera, settings, options)), at)


@with_groups()
@public
def render(
    x: Any,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    camera: Camera | OptionGroup | Any | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    **options: Unpack[RenderKeywords],
) -> Image:
    """Draws `x` with the defaults of `splatgl render`; the pixels are the same bit for bit.

    x: anything that `Volume.of` accepts, a file, address, built-in scene or scene.toml, a Volume, or Splats; or a Scene
    or PyVista plotter, which accept only options of the view and the settings.
    transfer: a Transfer, the name of a preset or of a file, or the fields of a Transfer.
    options: those of the command line by their names, as below, or in groups: view=sg.View(azimuth=60, zoom=2),
    look=sg.Look(…), cuts, light and check, which also stand in place of transfer, camera and settings. An option beside
    a group that has it, too, replaces it. color_of and window_of: {"DAPI": "blue"}; only_labels: [3, 7] or {3: 0.5};
    colormap: a name, or sRGB [N, 3]; colors: pairs of a value and a name or sRGB (r, g, b); layers: volumes, arrays,
    Layers or files, one or several; labels: a segmentation; mask: anything that `Volume.masked` accepts, or several;
    unit: a number or "extent", the length that opacities refer to, or other text, the unit of an array's lengths;
    background: linear RGB, a name, "#rrggbb" or "transparent"; by default white behind surfaces and black behind
    glowing matter. `info["notes"]` lists the notes that the command prints about a file, and on options without effect.
    Warns (InputWarning) of samples that are all the same, of which only the box is visible. The image's `accuracy`
    compares it with the float64 reference, when asked. Raises InputError for bad input, and if nothing is visible.

    ```python
    image = sg.render("head.nii.gz", "mri", azimuth=60, size=200, background="white")
    image.save("head.png")
    ```
    """
    scene = scene_of(x, transfer, camera, settings, options)
    image = picture(scene, options.get("memory"))
    warn([note for note in image.notes if note.startswith(CONSTANT)], getattr(x, "name", None) or "render")
    return image


def picture(scene: SceneFile | SubjectView, memory: Any) -> Image:
    """Draws a scene from `scene_of` with the shared renderer."""
    how = DrawOptions(is_shared=True, memory=memory)
    with within(how.memory):
        shown = opened(scene)
        return draw(shown, how)


def opened(scene: SceneFile | SubjectView) -> OpenScene | SubjectView:
    """A scene from `scene_of`, whose first volume is read."""
    return OpenScene.read(scene) if isinstance(scene, SceneFile) else scene


def scene_of(x: Any, transfer: Any, camera: Any, settings: Any, keywords: Mapping[str, Any]) -> SceneFile | SubjectView:
    """Returns the scene of `x` with the arguments of `render`; splats, layers and plotters have no file, and are seen
    as they are.
    """
    options, (transfer, camera, settings) = ungrouped(keywords, transfer, camera, settings)
    if is_scene(x):
        if transfer is not None:
            raise expected(
                "transfer", "none together with a scene, whose layers have their own", type(transfer).__name__
            )
        return _layers_view(x, camera, settings, options)
    rest, transfer = by_fields(options, Transfer, SceneFile, LoadOptions), _transfer(transfer)
    beside = [name for name in ("preset", "file") if rest.get(name)]
    if beside and transfer:
        raise expected(
            beside[0], "none together with a transfer function", repr(rest[beside[0]]), "leave one of them out"
        )
    drawing, are_splats = names_of(ViewOptions, Settings), is_instance(x, "Splats")
    if rest.get("annotate") is None:
        rest.pop("annotate", None)
    if are_splats:
        others = [*transfer, *(name for name in rest if name not in drawing)]
        if others:
            raise expected("splats", "a view and settings", ", ".join(others), "extract them with these")
        scene = SceneFile(x.name)
    else:
        reading = names_of(LoadOptions) if isinstance(x, str | Path) else [f.name for f in fields(ArrayOptions)]
        known = [*drawing, *TRANSFER, *SCENE, "transfer", "camera", "settings", "memory", *reading]
        for name in rest:
            allowed = f"options of the view, the settings, or {', '.join(reading)}"
            reject_unknown("options", [name], known, allowed)
        # a number, or the extent, is the length that opacities refer to
        unit = rest.get("unit")
        of_transfer = {"unit"} if is_number(unit) or str(unit) == EXTENT else set()
        scene = _source(x, {name: rest.pop(name) for name in reading if name in rest and name not in of_transfer})
    if settings is not None:
        scene = replace(scene, settings=settings)
    if camera is not None:
        if viewing := [name for name in names_of(ViewOptions) if name in rest]:
            raise expected("options", "no view together with a camera", ", ".join(viewing), "leave one of them out")
        scene = replace(scene, view=ViewOptions(camera.size, fixed=camera))
    scene = scene.with_transfer(transfer).with_options(**rest)
    if are_splats:
        if not len(x):
            raise expected("splats", "at least one", "none")
        info = {"version": __version__, "source": x.name, **scene.view.paper}
        return SubjectView(x, scene.view.camera(x, x), with_background(scene.settings, x.shaded), info)
    return scene if "blend" in rest else scene.with_preset_blend()


def _source(x: Any, reading: dict[str, Any]) -> SceneFile:
    """Returns the scene of a file or of a volume in memory, with options of the reader."""
    if not isinstance(x, str | Path):
        volume = Volume.of(x, **reading)
        return SceneFile(volume.name or "array", held=volume)
    path = str(x)
    toml = path.endswith(".toml") and not is_address(path)
    scene = SceneFile.from_toml(Path(path)) if toml else SceneFile(path)
    return replace(scene, load={**scene.load, **reading})


def _transfer(transfer: Any) -> dict[str, Any]:
    """Returns the fields of a transfer function, or its preset."""
    if isinstance(transfer, str | Path):
        return {"file" if str(transfer).endswith(SUFFIXES) else "preset": str(transfer)}
    if isinstance(transfer, Transfer):
        return transfer.fields
    if transfer is not None and not isinstance(transfer, Mapping):
        raise expected("transfer", "a Transfer, or the name of a preset", type(transfer).__name__)
    return dict(transfer or {})


# options of the view of a scene of layers
ORBIT = ("azimuth", "elevation", "fov", "size", "zoom", "up")


def _layers_view(x: Any, camera: Camera | None, settings: Settings | None, options: Mapping[str, Any]) -> SubjectView:
    """The view of a scene of layers; or of a plotter on its background, with notes on the differences from its own
    picture.

    camera, settings: replace the plotter's. options: fields of Settings, and options of the view; for a plotter only
    the size.
    """
    from splatgl.geometry.camera import Camera
    from splatgl.planning.scene import Scene

    layers = isinstance(x, Scene)
    drawing = {f.name: options[f.name] for f in fields(Settings) if f.name in options}
    viewing = {name: value for name, value in options.items() if name not in drawing}
    known = () if camera is not None else ORBIT if layers else ("size",)
    for name in viewing:
        if name not in known:
            allowed = ", ".join(["fields of Settings", *known])
            raise expected("options", allowed, name, "a scene has its transfer functions" if layers else "")
    if "size" in viewing:
        viewing["size"] = ViewOptions(viewing["size"]).size
    scene = x if layers else Scene.of(x)
    base = replace(settings or (Settings() if layers else Settings.of(x)), **drawing)
    base = with_background(base, scene.is_lit)
    if layers:
        orbit = {"azimuth": AZIMUTH, "elevation": ELEVATION, **viewing}
        return SubjectView(scene, camera or Camera.orbit(scene, **orbit), base)
    from splatgl.integrations.vtk.scene import list_differences

    view = camera or Camera.of(x, viewing.get("size"))
    typed = {*(settings or Settings()).given, *options}
    return SubjectView(scene, view, base, notes=tuple(list_differences(x)), typed=typed)


@public
def camera_of(
    x: Any,
    transfer: Transfer | OptionGroup | str | Mapping[str, Any] | None = None,
    camera: Camera | OptionGroup | Any | None = None,
    settings: Settings | OptionGroup | Any | None = None,
    **options: Any,
) -> Camera:
    """Returns the camera of `render` with the same arguments; draws nothing."""
    return opened(scene_of(x, transfer, camera, settings, options)).camera

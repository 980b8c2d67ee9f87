"""`sg.render` and `sg.depth_map`: pictures and depths of volumes, arrays, files, splats, scenes and plotters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from splatgl import __version__
from splatgl.data.image import Image
from splatgl.data.volume import ArrayOptions, Volume
from splatgl.errors import expected
from splatgl.fileio import parse_bytes, within
from splatgl.options import by_fields, checked, is_number, keyword, keywords_of, names_of, refuse_unknown, with_keywords
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.draw import DrawOptions, depths_of, draw, draw_subject
from splatgl.scene.meshes import VECTORS, MeshFile, Vectors
from splatgl.scene.mixing import DISPLAY, LINEAR, MIXING, display_image, display_scene, display_settings
from splatgl.scene.open_scene import OpenScene, with_background
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import TransferChoice
from splatgl.scene.view import ViewOptions
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import EXTENT, Transfer
from splatgl.splat.transfer_files import SUFFIXES

if TYPE_CHECKING:
    from splatgl.keywords import RenderKeywords
    from splatgl.splat.camera import Camera
    from splatgl.splat.scene import Scene


# options of the transfer function that are keywords; `shading` is a setting
TRANSFER = names_of(TransferChoice, Transfer)
# options of a scene that are keywords; the last ones are those of settings as a whole
SCENE = (*names_of(SceneFile), "labels", "clip_meshes", *names_of(MeshFile), *VECTORS, "like", "paper")
_vectors = keywords_of(Vectors)
# keywords of all pictures: by record, those of a source last
KEYWORDS = {
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
    "mixing": keyword("mixing", MIXING.kind.hint, LINEAR),
    **keywords_of(ArrayOptions),
    **keywords_of(LoadOptions, *names_of(LoadOptions), flags=True),
    # text: the unit of an array's lengths; a number or "extent": the length that opacities refer to
    "unit": keyword("unit", "str | float | None"),
}


@with_keywords(KEYWORDS)
def depth_map(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
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
    if is_splats(x):
        raise expected("depths", "a volume, an array, a file or a scene", "splats")
    if is_scene(x):
        _refuse_transfer(transfer)
        layers, view, look, _ = view_of(x, camera, settings, options)
        return depths_of(layers, view, look, at)
    scene = OpenScene.read(scene_of(x, transfer, camera, settings, options)[0])
    # the planes of the settings are the scene's
    return depths_of(scene.scene, scene.camera, replace(scene.file.settings, clip=()), at)


@with_keywords(KEYWORDS)
def render(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    **options: Unpack[RenderKeywords],
) -> Image:
    """Draws `x` with the defaults of `splatgl render`; the pixels are the same bit for bit.

    x: anything that `Volume.of` accepts, a file, address, built-in scene or scene.toml, a Volume, or Splats; or a Scene
    or PyVista plotter, which accept only options of the view and the settings.
    transfer: a Transfer, the name of a preset or of a file, or the fields of a Transfer.
    options: those of the command line by their names, of the view (view, azimuth, elevation, zoom, fov, size, eye,
    look_at, up, orthographic, height, dpi, width), unless there is a camera, and of the settings (blend, antialias,
    background, like, …); preset, points, curve, colormap, colors, window, level_width, log, iso; color_of and window_of
    ({"DAPI": "blue"}), only_labels ([3, 7] or {3: 0.5}); layers (volumes, arrays, Layers or files, one or several)
    and labels (a segmentation); vectors ("magnitude", "direction"), streamlines, arrows (their number, or True);
    surfaces (smoothing of segmentations, or True); clip (a condition or plane, or several), crop, mask (anything
    that `Volume.masked` accepts, or several); meshes; annotate (names as on the command line); threshold, memory;
    unit (a number or "extent": the length that opacities refer to; other text: the unit of an array's lengths);
    options of `load` or `Volume.of` (spacing, array, …); of a Scene or plotter `mixing`: "linear" light, or "display"
    values as VTK mixes them. background: linear RGB, a name, "#rrggbb" or "transparent"; by default white behind
    surfaces and black behind glowing matter. `info["notes"]` lists the notes that the command prints about a file, and
    on options without effect. `render` does not compare the picture with the float64 reference; `check` does. Raises
    InputError for bad input, and if nothing is visible.

    ```python
    image = sg.render("head.nii.gz", "mri", azimuth=60, size=200, background="white")
    image.save("head.png")
    ```
    """
    if is_scene(x):
        _refuse_transfer(transfer)
        return picture_of(x, camera, settings, options)
    scene, memory = scene_of(x, transfer, camera, settings, options)
    return picture(x, scene, memory)


def picture(x: Any, file: SceneFile, memory: int | None = None) -> Image:
    """Draws a scene from `scene_of` with the shared renderer."""
    drawing = DrawOptions(is_shared=True, memory=memory)
    if is_splats(x):
        if not len(x):
            raise expected("splats", "at least one", "none")
        image = draw_subject(x, file.view.camera(x, x), with_background(file.settings, x.shaded), drawing)
        info = {"version": __version__, "source": x.name, **({} if file.view.dpi is None else {"dpi": file.view.dpi})}
        return replace(image, info={**image.info, **info})
    with within(memory):
        scene = OpenScene.read(file)
        return draw(scene, drawing)


def is_splats(x: Any) -> bool:
    """Whether `x` is Splats; does not import their module."""
    return any(base.__module__ == "splatgl.splat.splats" for base in type(x).__mro__)


def scene_of(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None,
    camera: Camera | None,
    settings: Settings | None,
    options: Mapping[str, Any],
) -> tuple[SceneFile, int | None]:
    """Returns the scene of `x` with the arguments of `render`, and the memory limit; for splats without a volume."""
    rest, transfer = by_fields(options, Transfer, SceneFile, LoadOptions), _transfer(transfer)
    beside = [name for name in ("preset", "file") if rest.get(name)]
    if beside and transfer:
        raise expected(beside[0], "none beside a transfer function", repr(rest[beside[0]]), "leave one of them out")
    drawing = names_of(ViewOptions, Settings)
    if rest.get("annotate") is None:
        rest.pop("annotate", None)
    if is_splats(x):
        others = [*transfer, *(name for name in rest if name not in drawing)]
        if others:
            raise expected("splats", "a view and settings", ", ".join(others), "extract them with these")
        scene = SceneFile(x.name)
    else:
        reading = names_of(LoadOptions) if isinstance(x, str | Path) else [f.name for f in fields(ArrayOptions)]
        known = [*drawing, *TRANSFER, *SCENE, "transfer", "camera", "settings", "memory", *reading]
        for name in rest:
            allowed = f"options of the view, the settings, or {', '.join(reading)}"
            refuse_unknown("options", [name], known, allowed)
        # a number, or the extent, is the length that opacities refer to
        unit = rest.get("unit")
        of_transfer = {"unit"} if is_number(unit) or str(unit) == EXTENT else set()
        scene = _source(x, {name: rest.pop(name) for name in reading if name in rest and name not in of_transfer})
    memory = rest.pop("memory", None)
    if settings is not None:
        if not isinstance(settings, Settings):
            raise expected("settings", "Settings", type(settings).__name__)
        scene = replace(scene, settings=settings)
    if camera is not None:
        viewing = [name for name in names_of(ViewOptions) if name in rest]
        scene = replace(scene, view=_fixed(camera, viewing))
    scene = scene.with_transfer(transfer).with_options(**rest)
    scene = scene if "blend" in rest else scene.with_preset_blend()
    return scene, parse_bytes(memory) if isinstance(memory, str) else memory


def _source(x: Any, reading: dict[str, Any]) -> SceneFile:
    """Returns the scene of a file or of a volume in memory, with options of the reader."""
    if not isinstance(x, str | Path):
        volume = Volume.of(x, **reading)
        return SceneFile(volume.name or "array", held=volume)
    path = str(x)
    toml = path.endswith(".toml") and not is_address(path)
    scene = SceneFile.from_toml(Path(path)) if toml else SceneFile(path)
    return replace(scene, load={**scene.load, **reading})


def _fixed(camera: Any, viewing: list[str]) -> ViewOptions:
    """Returns the view of a camera. Raises InputError for other types, and for view options beside the camera."""
    from splatgl.splat.camera import Camera

    if not isinstance(camera, Camera):
        raise expected("camera", "a Camera", type(camera).__name__)
    if viewing:
        raise expected("options", "no view beside a camera", ", ".join(viewing), "leave one of them out")
    return ViewOptions(camera.size, fixed=camera)


def _transfer(transfer: Any) -> dict[str, Any]:
    """Returns the fields of a transfer function, or its preset."""
    if isinstance(transfer, str | Path):
        return {"file" if str(transfer).endswith(SUFFIXES) else "preset": str(transfer)}
    if isinstance(transfer, Transfer):
        return transfer.fields
    if transfer is not None and not isinstance(transfer, Mapping):
        raise expected("transfer", "a Transfer, or the name of a preset", type(transfer).__name__)
    return dict(transfer or {})


# arguments of `render` beside its options
ARGUMENTS = ("transfer", "camera", "settings")
# options of the view of a scene of layers
ORBIT = ("azimuth", "elevation", "fov", "size", "zoom", "up")


def _refuse_transfer(transfer: Any) -> None:
    if transfer is not None:
        raise expected("transfer", "none beside a scene, whose layers have theirs", type(transfer).__name__)


def is_scene(x: Any) -> bool:
    """Whether `x` is a scene of layers, a PyVista plotter, or a VTK window or renderer. Imports none of them."""
    layers = any(base.__module__ == "splatgl.splat.scene" for base in type(x).__mro__)
    return layers or any(hasattr(getattr(x, "renderer", x), name) for name in ("GetVolumes", "GetRenderers"))


def view_of(
    x: Any, camera: Camera | None, settings: Settings | None, options: Mapping[str, Any]
) -> tuple[Scene, Camera, Settings, str]:
    """The layers, view, settings and mixing of a scene of layers, or of a plotter.

    camera, settings: replace the plotter's. options: fields of Settings, `mixing`, and options of the view; for a
    plotter only the size.
    """
    from splatgl.splat.camera import Camera
    from splatgl.splat.scene import Scene

    layers = isinstance(x, Scene)
    drawing = {f.name: options[f.name] for f in fields(Settings) if f.name in options}
    viewing = {name: value for name, value in options.items() if name not in drawing}
    mixing = checked(MIXING.kind, "mixing", viewing.pop("mixing", LINEAR))
    known = () if camera is not None else ORBIT if layers else ("size",)
    for name in viewing:
        if name not in known:
            allowed = ", ".join(["fields of Settings", "mixing", *known])
            raise expected("options", allowed, name, "a scene has its transfer functions" if layers else "")
    if "size" in viewing:
        viewing["size"] = ViewOptions(viewing["size"]).size
    scene = x if layers else Scene.of(x)
    view = camera or (Camera.orbit(scene, **{"azimuth": 30.0, "elevation": 20.0, **viewing}) if layers else None)
    base = replace(settings or (Settings() if layers else Settings.of(x)), **drawing)
    base = with_background(base, scene.is_lit)
    return scene, view or Camera.of(x, viewing.get("size")), base, mixing


def picture_of(x: Any, camera: Camera | None, settings: Settings | None, options: Mapping[str, Any]) -> Image:
    """Draws a scene of layers, or the view of a plotter on the plotter's background; arguments as of `view_of`.

    For a plotter scalar bars and texts are drawn where it has them, and info["notes"] lists the differences from its
    own picture.
    """
    scene, view, base, mixing = view_of(x, camera, settings, options)
    layers, shared = scene is x, DrawOptions(is_shared=True)
    if mixing == DISPLAY and (layers or not BLENDS[base.blend].unbounded):
        image = draw_subject(display_scene(scene), view, display_settings(base), shared)
        image = display_image(image, base.ground)
    else:
        image = draw_subject(scene, view, base, shared)
    if layers:
        return image
    from splatgl.integrations.vtk.overlays import finish

    # not those on what the plotter sets
    typed = {*(settings or Settings()).given, *options}
    unused = tuple(note for note in image.notes if typed & {*note.partition(":")[0].split(", ")})
    image = replace(image, info={**image.info, "notes": unused})
    return finish(image, x, base.ground)


def camera_of(x: Any, options: Mapping[str, Any]) -> Camera:
    """Returns the camera of `render`, with its arguments by their names; draws nothing."""
    transfer, camera, settings = (options.get(name) for name in ARGUMENTS)
    rest = {name: value for name, value in options.items() if name not in ARGUMENTS}
    if is_scene(x):
        return view_of(x, camera, settings, rest)[1]
    file, _ = scene_of(x, transfer, camera, settings, rest)
    return file.view.camera(x, x) if is_splats(x) else OpenScene.read(file).camera

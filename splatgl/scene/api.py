"""`sg.render` and `sg.depth_map`: scenes from volumes, arrays, files, splats and plotters, and their pictures."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl import __version__
from splatgl.annotations.annotate import check, check_size, check_time, parsed
from splatgl.data.arrays import ArrayOptions
from splatgl.data.color import AUTO, BACKGROUNDS, CLEAR, read_background
from splatgl.data.image import Image
from splatgl.data.mesh import Mesh
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import parse_bytes
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import is_address
from splatgl.scene.background import as_drawn, grounded
from splatgl.scene.draw import DrawOptions, depth_share, depths_of, draw, drawn, lay, origin, unbacked, with_room
from splatgl.scene.meshes import MeshFile, asked_vectors, mark_clipped
from splatgl.scene.parse import size
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.shared_renderer import shared_renderer
from splatgl.scene.view import ViewOptions, typed
from splatgl.splat.segment_surfaces import strength_of
from splatgl.splat.settings import Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.splat.camera import Bounded, Camera
    from splatgl.splat.splats import Splats


def depth_map(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    at: float | str | None = None,
    **options: Any,
) -> np.ndarray:
    """Eye-space depths float64 [H, W] of the picture that `render` draws with the same arguments: along the view
    direction, world units, row 0 on top, of rays through pixel centres; NaN where there is nothing.

    at: where the ray is absorbed by that share, from 0 (where anything is) to below 1; "max" or "min": at the largest
    or least value; None: ½, or the value that mip and minip show. Needs no OpenGL. Raises InputError as `render`, for
    splats, and for volumes that are read in parts.
    """
    if is_splats(x):
        raise expected("depths", "a volume, an array or a file", "splats")
    scene, _ = scene_of(x, transfer, camera, settings, options)
    volume = scene.open()
    scene, chosen = scene.cut(volume), scene.transfer_for(volume)
    return depths_of(scene, volume, chosen, depth_share(at, scene.settings))[0]


# the fields of Transfer that are keywords of their own; `unit` is that of an array, and `shading` a setting
TRANSFER = ("points", "gradient", "colormap", "window", "scale")


@dataclass(frozen=True)
class Held(SceneFile):
    """A scene whose volume is in memory."""

    held: Volume | None = None

    def open(self) -> Volume:
        """The volume; a flat stack with the view of it."""
        assert self.held is not None
        return self._placed(self.held)

    def to_toml(self, folder: Path) -> str:
        """Raises InputError: a scene file names a volume's file."""
        raise expected("scene", "a volume in a file, which a scene file can name", "an array in memory")


@dataclass(frozen=True)
class Fixed(ViewOptions):
    """A view by a camera."""

    fixed: Camera | None = None

    def is_fixed(self, volume: Volume) -> bool:
        """True: there is a camera."""
        return True

    def camera(self, volume: Volume | Splats, subject: Bounded) -> Camera:
        """The camera."""
        assert self.fixed is not None
        return self.fixed.resized(self.size)


def render(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    **options: Any,
) -> Image:
    """The picture of `x`, with the defaults of `splatgl render`, and bit for bit its pixels.

    x: whatever `Volume.of` takes, a file, address, built-in scene or scene.toml, a Volume, or Splats; a Scene or a
    plotter of PyVista, of which view and settings alone may be given.
    transfer: a Transfer, the name of a preset or of a file, or the fields of a Transfer.
    options: as on the command line, of the view (azimuth, elevation, zoom, fov, size, eye, look_at, up, orthographic,
    height), unless there is a camera, and of the settings (blend, antialias, background, …); points, gradient,
    colormap, window; vectors ("magnitude", "direction"), streamlines, arrows (how many, or True); surfaces (smoothing
    of segmentations, or True); clip (a condition,
    plane, or several), crop, mask (whatever `Volume.masked` takes, or several); meshes; annotate (names, as on the
    command line); threshold, memory; those of `load` or
    `Volume.of` (spacing, array, …). background: linear RGB, or a name or "#rrggbb"; none leaves the image transparent.
    `info["notes"]` lists what the command tells of a file. Nothing is compared with float64; `check` does. Raises
    InputError for bad input, and if nothing is visible.
    """
    if is_scene(x):
        if transfer is not None:
            raise expected("transfer", "none beside a scene, whose layers have theirs", type(transfer).__name__)
        if "background" in options:
            options["background"] = _background(options["background"])
        return picture_of(x, camera, settings, options)
    scene, memory = scene_of(x, transfer, camera, settings, options)
    return picture(x, scene, memory)


def picture(x: Any, scene: SceneFile, memory: int | None = None, seen: bool = False) -> Image:
    """The picture of a scene from `scene_of`, by the renderer that calls share. seen: on a background that suits it."""
    how = DrawOptions(kept=True, memory=memory, check=0)
    if is_splats(x):
        if not len(x):
            raise expected("splats", "at least one", "none")
        image = drawn(how, scene, x, scene.view.camera(x, x))
        return Image(image.pixels, {**image.info, "version": __version__, "source": x.name})
    volume = scene.open()
    chosen, scene = scene.transfer_for(volume), scene.cut(volume)
    if seen and "background" not in scene.settings.given:
        scene = replace(scene, settings=grounded(scene.settings, AUTO, as_drawn(volume, chosen)))
    check_size(scene.annotate, scene.view.size)
    check_time(scene.annotate)
    scene = with_room(scene, volume, scene.annotate)
    image = draw(how, replace(scene, settings=unbacked(scene.settings, scene.annotate)), volume, chosen)
    drawn_so = image.info.get("notes", ())
    notes = (*volume.notes, *(drawn_so if isinstance(drawn_so, tuple) else ()))
    told = {"notes": notes} if notes else {}
    image = Image(image.pixels, {**image.info, **origin(scene, chosen), **told})
    return lay(image, scene, volume, chosen, scene.annotate, quiet=True) if scene.annotate else image


def is_splats(x: Any) -> bool:
    """Whether `x` is Splats, whose module need not be imported to tell."""
    return any(base.__module__ == "splatgl.splat.splats" for base in type(x).__mro__)


def scene_of(
    x: Any,
    transfer: Transfer | str | Mapping[str, Any] | None,
    camera: Camera | None,
    settings: Settings | None,
    options: Mapping[str, Any],
) -> tuple[SceneFile, int | None]:
    """The scene of `x` and the arguments of `render`, and the memory to draw in. Of splats, all but the volume."""
    given = dict(options)
    viewing, cuts = _taken(given, *(f.name for f in fields(ViewOptions))), _cuts(_taken(given, "clip", "crop", "mask"))
    meshes, annotate = _meshes(given.pop("meshes", ())), given.pop("annotate", None)
    clip_meshes = bool(given.pop("clip_meshes", False))
    over = () if annotate is None else parsed(annotate) if isinstance(annotate, str) else check(annotate)
    drawing = _taken(given, *(f.name for f in fields(Settings)))
    classified = {**_transfer(transfer), **_taken(given, *TRANSFER)}
    threshold, memory = given.pop("threshold", None), given.pop("memory", None)
    vectors = _taken(given, "vectors", "streamlines", "arrows")
    surfaces = given.pop("surfaces", None)
    if is_splats(x):
        extra = [*classified, *given, *cuts] + ["threshold"] * (threshold is not None)
        extra += ["meshes"] * bool(meshes) + ["annotate"] * bool(over) + [*vectors]
        extra += ["surfaces"] * (surfaces is not None)
        if extra:
            raise expected("splats", "a view and settings", ", ".join(extra), "extract them with these")
        scene: SceneFile = SceneFile(x.name)
    else:
        scene = _source(x, given)
    if settings is not None and not isinstance(settings, Settings):
        raise expected("settings", "Settings", type(settings).__name__)
    if "background" in drawing:
        drawing["background"] = _background(drawing["background"])
    if threshold is not None:
        scene = replace(scene, threshold=float(typed("threshold", threshold)))
    found = replace(
        scene,
        **cuts,
        meshes=tuple(mark_clipped(each) if clip_meshes else each for each in (*scene.meshes, *meshes)),
        vectors=asked_vectors(vectors, scene.vectors),
        surfaces=scene.surfaces if surfaces is None else strength_of(surfaces),
        annotate=scene.annotate if annotate is None else over,
        transfer={**scene.transfer, **classified},
        view=_view(scene.view, camera, viewing),
        settings=(scene.settings if settings is None else settings).but(**drawing),
    )
    found = found if "blend" in drawing else found.blended()
    return found, parse_bytes(memory) if isinstance(memory, str) else memory


def _source(x: Any, given: dict[str, Any]) -> SceneFile:
    """The scene of a file, or of a volume in memory; `given` are options of its reader."""
    named = isinstance(x, str | Path)
    known = [f.name for f in fields(LoadOptions if named else ArrayOptions)]
    for name in given:
        if name not in known:
            every = [f.name for record in (ViewOptions, Settings) for f in fields(record)] + [*TRANSFER, *known]
            near = get_close_matches(name, [*every, "transfer", "camera", "settings", "threshold", "memory"], 1)
            fix = f"did you mean {near[0]}?" if near else ""
            raise expected("options", f"those of the view, the settings, or {', '.join(known)}", name, fix)
    if not named:
        volume = Volume.of(x, **given)
        return Held(volume.name or "array", held=volume)
    path = str(x)
    toml = path.endswith(".toml") and not is_address(path)
    scene = SceneFile.from_toml(Path(path)) if toml else SceneFile(path)
    return replace(scene, load={**scene.load, **given}) if path not in SCENES or given else scene


def _cuts(given: dict[str, Any]) -> dict[str, Any]:
    """The fields of a scene of what is cut away."""
    found: dict[str, Any] = {"crop": given["crop"]} if "crop" in given else {}
    if not isinstance(found.get("crop", ""), str):
        raise expected("crop", "A:B,C:D,E:F, voxels along x, y and z", repr(found["crop"])[:80])
    if "mask" in given:
        mask = given["mask"]
        found["mask"] = tuple(mask) if isinstance(mask, list | tuple) else (mask,)
    clip = given.get("clip", ())
    if isinstance(clip, str) or not isinstance(clip, Iterable):
        clip = (clip,)
    return {**found, "clip": tuple(clip)} if "clip" in given else found


def _meshes(given: Any) -> list[MeshFile | Mesh]:
    """Meshes, and those of files."""
    every = given if isinstance(given, list | tuple) else [given]
    for each in every:
        if not isinstance(each, Mesh | str | Path):
            raise expected("meshes", "meshes, or names of files", type(each).__name__)
    return [each if isinstance(each, Mesh) else MeshFile(str(each)) for each in every]


def _view(view: ViewOptions, camera: Camera | None, given: dict[str, Any]) -> ViewOptions:
    """The view as the options have it."""
    if camera is None:
        return replace(view, **{name: _placed(name, value) for name, value in given.items()})
    from splatgl.splat.camera import Camera

    if not isinstance(camera, Camera):
        raise expected("camera", "a Camera", type(camera).__name__)
    if given:
        raise expected("options", "no view beside a camera", ", ".join(given), "leave one of them out")
    return Fixed(camera.size, fixed=camera)


def _placed(name: str, value: Any) -> Any:
    """A field of View: numbers of numpy and tuples too, and a size as text or one number."""
    plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    if name == "size":
        try:
            plain = size(str(plain)) if isinstance(plain, str | int) else plain
        except argparse.ArgumentTypeError as error:
            raise expected("size", "a width and a height", repr(value)) from error
    return typed(name, list(plain) if isinstance(plain, tuple) else plain)


def _background(value: Any) -> Any:
    try:
        found = read_background(value) if isinstance(value, str) and value != AUTO else value
    except ValueError as error:
        raise expected("background", f"linear RGB, {BACKGROUNDS}", repr(value)) from error
    return None if found == CLEAR else found


def _transfer(transfer: Any) -> dict[str, Any]:
    """The fields of a transfer function, or its preset."""
    if isinstance(transfer, str | Path):
        if not str(transfer).endswith(".toml"):
            return {"preset": str(transfer)}
        transfer = Transfer.load(transfer)
    if isinstance(transfer, Transfer):
        return {f.name: getattr(transfer, f.name) for f in fields(Transfer)}
    if transfer is not None and not isinstance(transfer, Mapping):
        raise expected("transfer", "a Transfer, or the name of a preset", type(transfer).__name__)
    return dict(transfer or {})


def _taken(given: dict[str, Any], *names: str) -> dict[str, Any]:
    """Those options, which are removed."""
    return {name: given.pop(name) for name in names if name in given}


# options of the view of layers, and of a plotter's
ORBIT = ("azimuth", "elevation", "fov", "size", "zoom", "up")


def is_scene(x: Any) -> bool:
    """Whether `x` is a scene of layers, a plotter of PyVista, or a window or renderer of VTK. Imports none of them."""
    layers = any(base.__module__ == "splatgl.splat.scene" for base in type(x).__mro__)
    return layers or any(hasattr(getattr(x, "renderer", x), name) for name in ("GetVolumes", "GetRenderers"))


def picture_of(x: Any, camera: Camera | None, settings: Settings | None, options: Mapping[str, Any]) -> Image:
    """The picture of layers, or of what a plotter shows from its camera, on its background.

    Of a plotter info["notes"] lists what it shows beside. camera, settings: instead of the plotter's. options: fields
    of Settings, and of the view: of a plotter the size.
    """
    from splatgl.splat.camera import Camera
    from splatgl.splat.scene import Scene

    layers = isinstance(x, Scene)
    drawing = {f.name: options[f.name] for f in fields(Settings) if f.name in options}
    viewing = {name: value for name, value in options.items() if name not in drawing}
    known = () if camera is not None else ORBIT if layers else ("size",)
    for name in viewing:
        if name not in known:
            what = f"fields of Settings{', ' if known else ''}{', '.join(known)}"
            raise expected("options", what, name, "a scene has its transfer functions" if layers else "")
    if "size" in viewing and isinstance(viewing["size"], str | int):
        viewing["size"] = size(str(viewing["size"]))
    scene = x if layers else Scene.of(x)
    view = camera or (Camera.orbit(scene, **{"azimuth": 30.0, "elevation": 20.0, **viewing}) if layers else None)
    view = view or Camera.of(x, viewing.get("size"))
    how = settings or (Settings() if layers else Settings.of(x))
    with shared_renderer() as renderer:
        image = renderer.render(scene, view, how.but(**drawing))
    if layers:
        return image
    from splatgl.integrations.vtk.scene import left_out

    return Image(image.pixels, {**image.info, "notes": tuple(left_out(x))})

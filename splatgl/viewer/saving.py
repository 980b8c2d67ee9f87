"""Saves screenshots and scenes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.annotate import LEAST_SIDE
from splatgl.annotations.canvas import BLACK, WHITE, Canvas
from splatgl.data.color import linear_from_srgb
from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text, expected
from splatgl.fileio import overwrites, write_file
from splatgl.gl.screen import Sprite, Stroke
from splatgl.scene.draw import lay, origin
from splatgl.scene.meshes import MeshFile, surfaces_of
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.camera import Camera
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats
from splatgl.viewer.document import Document
from splatgl.viewer.overlays import of_ruler
from splatgl.viewer.slice_views import outlines
from splatgl.viewer.state import LayerStyle, State

if TYPE_CHECKING:
    from splatgl.viewer.viewer import Viewer


# opacity of the rim around lines, as on the screen
RIM = 0.6


def as_seen(viewer: Viewer, image: Image) -> Image:
    """The picture with what the window shows over it and beside it, but for handles and the value under the cursor."""
    state, document, scale = viewer.state, viewer.document, viewer.window.scale
    lines, labels = of_ruler(state.ruler, document, state.pose.camera, scale)
    image = with_marks(image, (*lines, *outlines(state.slices, document.volume, state.pose.camera, scale)), labels)
    beside = viewer.slicing.picture()
    return image if beside is None else with_slices(image, beside)


def with_marks(image: Image, strokes: Sequence[Stroke], sprites: Sequence[Sprite]) -> Image:
    """A picture under marks, in the order in which the window draws them."""
    if not strokes and not sprites:
        return image
    layer = Canvas(np.zeros_like(image.pixels), WHITE)
    for sprite in sprites:
        left, top = (round(each) for each in sprite.place[:2])
        layer.stamp(as_dark(sprite.pixels[..., 3] / 255), linear_from_srgb(sprite.pixels[..., :3] / 255), (left, top))
    for stroke in strokes:
        ends, alpha = np.array([[*stroke.start, *stroke.stop]]), stroke.color[3]
        red, green, blue = linear_from_srgb(np.array(stroke.color[:3])).tolist()
        layer.segments(ends, BLACK, float(as_dark(RIM * alpha)), stroke.width + stroke.rim)
        layer.segments(ends, (red, green, blue), alpha, stroke.width)
    under = (1 - layer.pixels[..., 3:]) * image.pixels
    return Image(under + _one(image) * layer.pixels, image.info)


def as_dark(alpha: np.ndarray | float) -> np.ndarray:
    """The opacity that darkens linear light as much as alpha darkens the screen's values."""
    return np.asarray(1 - linear_from_srgb(1 - np.asarray(alpha)), np.float32)


def with_slices(image: Image, beside: np.ndarray) -> Image:
    """A picture with the slices at its right, as the window shows them: uint8 [H, w, 3], sRGB."""
    height = image.pixels.shape[0]
    # a window that is being resized may be of another height by now
    beside = np.pad(beside[:height], ((0, max(height - len(beside), 0)), (0, 0), (0, 0)))
    light = np.ones((*beside.shape[:2], 4), np.float32)
    light[..., :3] = linear_from_srgb(beside / 255)
    return Image(np.concatenate([image.pixels, _one(image) * light], axis=1), image.info)


def _one(image: Image) -> np.float32:
    """The light that is saved as white: an X-ray is saved relative to its brightest."""
    return np.float32((float(image.pixels.max()) or 1.0) if image.info["blend"] == "xray" else 1.0)


Draw = Callable[[Splats | Layers, Camera, Settings], Image]
Add = Callable[[Image], Image]
RENDERED = "splatgl render draws it, as large as it is"


def scene_of(state: State, document: Document) -> SceneFile:
    """The scene equivalent to the window's state."""
    # motion blur does not affect a still image, but it does affect an animation of the scene
    settings = state.settings if state.blur == "off" else state.settings.but(motion=state.blur)
    if settings.classification == "post" and not document.followed(state.looks, state.meshes, settings).after:
        settings = settings.but(classification="pre")
    first, *others = [_part(document.part(number), look) for number, look in enumerate(state.looks)]
    meshes = tuple(each for each in state.meshes if each != MeshFile(document.scene.volume))
    shown = replace(document.scene, load=first.load, transfer=first.transfer, threshold=first.threshold)
    shown = replace(shown, opacity=first.opacity, visible=first.visible, layers=tuple(others), meshes=meshes)
    # what is laid over a window too small for it is not asked for
    annotate = state.annotate if min(state.pose.camera.size) >= LEAST_SIDE else ()
    return replace(shown, view=state.pose.view(), settings=settings, annotate=annotate)


def _look(scene: SceneFile, document: Document) -> LayerStyle:
    """How a part is seen in a scene."""
    base = replace(scene, opacity=1.0).transfer_for(document.volume)
    return LayerStyle(base, scene.threshold, 1.0, scene.opacity, scene.visible)


def _part(document: Document, look: LayerStyle) -> SceneFile:
    """The scene of a volume, or of a layer, as it is seen."""
    scene, portion = document.scene, document.portion
    load = scene.load if portion is None or portion.level is None else {**scene.load, "level": portion.level}
    found = replace(scene, load=load, transfer=look.table, threshold=look.threshold)
    return replace(found, opacity=look.opacity, visible=look.visible)


def picture_of(scene: SceneFile, document: Document, draw: Draw) -> Image:
    """The image that `splatgl render` makes of a scene of this document, drawn by the window's renderer."""
    transfer = scene.transfer_for(document.volume)
    looks = [_look(each, document.part(number)) for number, each in enumerate((scene, *scene.layers))]
    document = document.followed(looks, surfaces_of(scene), scene.settings)
    subject, settings = (document if document.fresh else document.anew()).subject_at(1, scene.settings)
    image = draw(subject, scene.view.camera(document.volume, subject), settings)
    image = Image(image.pixels, {**image.info, **origin(scene, transfer)})
    return lay(image, scene, document.volume, transfer, scene.annotate, quiet=True) if scene.annotate else image


def nothing(image: Image) -> Image:
    """The picture alone."""
    return image


def save_picture(state: State, document: Document, draw: Draw, folder: Path, add: Add = nothing) -> str:
    """Writes the next free picture-NNN.png; returns the message to show. add: what the window adds to the picture."""
    return _picture(state, document, draw, free(folder, "picture", ".png"), add)


def _picture(state: State, document: Document, draw: Draw, target: Path, add: Add) -> str:
    if document.heavy:
        raise expected("picture", "splats that fit into memory", "too many", f"save the scene: {RENDERED}")
    scene = scene_of(state, document)
    ground = scene.settings.background if BLENDS[scene.settings.blend].unbounded else None
    add(picture_of(scene, document, draw)).save(target, background=ground)
    return f"saved {target.name}"


def save_scene(state: State, document: Document, draw: Draw, folder: Path) -> str:
    """Writes the next free scene-NNN.toml and the float image beside it; returns the message to show."""
    target = free(folder, "scene", ".toml")
    scene = scene_of(state, document)
    if document.heavy:
        write_file(target, scene.to_toml(target.parent).encode())
        return f"saved {target.name}: {RENDERED}"
    picture_of(scene, document, draw).save(target.with_suffix(".npy"))
    write_file(target, scene.to_toml(target.parent).encode())
    return f"saved {target.with_suffix('.npy').name} and {target.name}"


# save actions
SCENE = "save"
SAVES = ("screenshot", SCENE)


def saved(state: State, ask: str, document: Document, draw: Draw, folder: Path, add: Add = nothing) -> State:
    """Runs one of SAVES; returns the state with its message. add: as of `save_picture`."""
    try:
        if ask == SCENE:
            return replace(state, message=save_scene(state, document, draw, folder))
        return replace(state, message=save_picture(state, document, draw, folder, add))
    except USER_ERRORS as error:
        return replace(state, message=error_text(error))


def saved_as(
    state: State, document: Document, draw: Draw, target: Path, add: Add = nothing, times: Sequence[SceneFile] = ()
) -> tuple[State, bool]:
    """Writes a scene (.toml, also where a name has no ending) or a picture of it; the state with what it says, and
    whether a scene was written. times: the series that it is of, of which no file is overwritten either.
    """
    scene = target.suffix.lower() in ("", ".toml")
    try:
        if not target.name or os.path.isdir(target):
            raise expected(target, "a file's name", "a folder")
        target = target.with_suffix(".toml") if scene else target
        if overwrites(target, sources(document, times)):
            raise expected(target, "another file", "what is shown", "choose another name")
        if scene:
            write_file(target, scene_of(state, document).to_toml(target.parent).encode())
            return replace(state, message=f"saved {target.name}"), True
        return replace(state, message=_picture(state, document, draw, target, add)), False
    except USER_ERRORS as error:
        return replace(state, message=error_text(error)), False


def sources(document: Document, times: Sequence[SceneFile] = ()) -> list[str]:
    """What a document, and the series that it is of, were read from."""
    parts = [document.part(number) for number in range(len(document.looks))]
    scenes = (document.scene, *(each.scene for each in parts), *times)
    return [*(file for scene in scenes for file in scene.files), *(mesh.file for mesh in document.surfaces)]


def free(folder: Path, stem: str, suffix: str) -> Path:
    """First unused path of folder/stem-001 and so on."""
    number = 1
    while any((folder / f"{stem}-{number:03d}{end}").exists() for end in (suffix, ".npy")):
        number += 1
    return folder / f"{stem}-{number:03d}{suffix}"

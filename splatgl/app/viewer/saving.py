"""Saves screenshots and scenes; a screenshot matches `splatgl render` of the saved scene pixel for pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

from splatgl.app.annotations.request import LEAST_SIDE, lay
from splatgl.app.render import origin
from splatgl.app.scene import Scene
from splatgl.app.viewer.content import Content
from splatgl.app.viewer.state import State
from splatgl.data.errors import InputError, expected
from splatgl.data.image import Image, write_whole
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.blend_mode import BLENDS
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera

Draw = Callable[[Splats, Camera, Settings], Image]


def scene_of(state: State, content: Content) -> Scene:
    """The scene equivalent to the window's state."""
    transfer = state.transfer
    table = {f.name: getattr(transfer, f.name) for f in fields(Transfer) if getattr(transfer, f.name) is not None}
    # motion blur does not affect a still image, but it does affect an animation of the scene
    settings = state.settings if state.blur == "off" else state.settings.but(motion=state.blur)
    if settings.classification == "post" and not content.following(state.transfer, state.threshold, settings).after:
        settings = settings.but(classification="pre")
    shown = replace(content.scene, transfer=table, view=state.pose.view(), settings=settings)
    if content.portion and content.portion.level is not None:
        shown = replace(shown, load={**shown.load, "level": content.portion.level})
    # what is laid over a window too small for it is not asked for
    annotate = state.annotate if min(state.pose.camera.size) >= LEAST_SIDE else ()
    return replace(shown, threshold=state.threshold, annotate=annotate)


def picture_of(scene: Scene, content: Content, draw: Draw) -> Image:
    """The image that `splatgl render` makes of a scene, drawn by the window's renderer."""
    transfer = scene.transfer_for(content.volume)
    content = content.following(transfer, scene.threshold, scene.settings)
    splats = content.at(1) if content.fresh else scene.splats(content.volume, transfer)
    image = draw(splats, scene.view.camera(content.volume, splats), scene.settings)
    image = Image(image.pixels, {**image.info, **origin(scene, transfer)})
    return lay(image, scene, content.volume, transfer, scene.annotate, quiet=True) if scene.annotate else image


def save_picture(state: State, content: Content, draw: Draw, folder: Path) -> str:
    """Writes the next free picture-NNN.png; returns the message to show."""
    return _picture(state, content, draw, free(folder, "picture", ".png"))


def _picture(state: State, content: Content, draw: Draw, target: Path) -> str:
    scene = scene_of(state, content)
    ground = scene.settings.background if BLENDS[scene.settings.blend].unbounded else None
    picture_of(scene, content, draw).save(target, background=ground)
    return f"saved {target.name}"


def save_scene(state: State, content: Content, draw: Draw, folder: Path) -> str:
    """Writes the next free scene-NNN.toml and the float image beside it; returns the message to show."""
    target = free(folder, "scene", ".toml")
    scene = scene_of(state, content)
    picture_of(scene, content, draw).save(target.with_suffix(".npy"))
    write_whole(target, scene.to_toml(target.parent).encode())
    return f"saved {target.with_suffix('.npy').name} and {target.name}"


# save actions by name
SAVES = {"screenshot": save_picture, "save": save_scene}


def saved(state: State, ask: str, content: Content, draw: Draw, folder: Path) -> State:
    """Runs one of SAVES; returns the state with its message."""
    try:
        return replace(state, message=SAVES[ask](state, content, draw, folder))
    except InputError as error:
        return replace(state, message=str(error))


def saved_as(state: State, content: Content, draw: Draw, target: Path) -> tuple[State, bool]:
    """Writes a scene (.toml, also where a name has no ending) or a picture of it; the state with what it says, and
    whether a scene was written.
    """
    scene = target.suffix.lower() in ("", ".toml")
    target = target.with_suffix(".toml") if scene else target
    try:
        if target.exists() and Path(content.scene.volume).exists() and target.samefile(content.scene.volume):
            raise expected(target, "another file", "the volume that is shown", "choose another name")
        if scene:
            write_whole(target, scene_of(state, content).to_toml(target.parent).encode())
            return replace(state, message=f"saved {target.name}"), True
        return replace(state, message=_picture(state, content, draw, target)), False
    except InputError as error:
        return replace(state, message=str(error)), False


def free(folder: Path, stem: str, suffix: str) -> Path:
    """First unused path of folder/stem-001 and so on."""
    number = 1
    while any((folder / f"{stem}-{number:03d}{end}").exists() for end in (suffix, ".npy")):
        number += 1
    return folder / f"{stem}-{number:03d}{suffix}"

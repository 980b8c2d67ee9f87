"""Doors to a scene: each draws a scene file as one front end does."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from contextlib import chdir, contextmanager, nullcontext, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

import splatgl as sg
from splatgl.annotations.annotate import on_ground
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.gl.renderer import shared_renderer
from splatgl.planning import resolve
from splatgl.scene.draw import DrawOptions, draw
from splatgl.scene.meshes import VECTORS, MeshFile
from splatgl.scene.open_scene import OpenScene, without_background
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.adaptive_quality import FULL
from splatgl.viewer.commands import Copy
from splatgl.viewer.document import Document
from splatgl.viewer.frame_renderer import FrameRenderer
from splatgl.viewer.saving import copy_text, render_scene, scene_of
from splatgl.viewer.state import State
from tests.helpers.memory import allow_any_memory
from tests.helpers.random_scenes import TABLES, Draft, Table

Info = Mapping[str, Any]


@dataclass(frozen=True)
class Drawn:
    """A picture float32 [H, W, 4], and what is told of it."""

    pixels: np.ndarray
    info: Info | None = None


Draw = Callable[[Draft], Drawn]


@dataclass(frozen=True)
class Door:
    """A front end. refuses: message by trait of a scene, as `traits` names them, that it does not draw. lacks: traits
    that it has no words for. base: the picture that it must equal. is_open: whether it shows nothing, where nothing is
    visible yet, instead of an error.
    """

    draw: Draw
    refuses: Mapping[str, str] = field(default_factory=dict)
    lacks: tuple[str, ...] = ()
    base: str = "picture"
    is_open: bool = False


@contextmanager
def in_process() -> Any:
    """Commands draw with the shared renderer, whose programs are compiled."""

    def renderer(how: DrawOptions) -> Any:
        return nullcontext(how.held) if how.held else shared_renderer()

    with mock.patch.multiple(DrawOptions, renderer=renderer, open_early=lambda how: nullcontext(how)):
        yield


def command(*arguments: object) -> None:
    """Runs a command in this process. Raises InputError with what it prints if it fails."""
    out, err = StringIO(), StringIO()
    with in_process(), redirect_stdout(out), redirect_stderr(err):
        code = main([str(argument) for argument in arguments])
    if code:
        lines = [line for line in err.getvalue().splitlines() if line.startswith("splatgl: ")]
        raise InputError(lines[-1].removeprefix("splatgl: ") if lines else f"exit code {code}: {err.getvalue()}")


def _loaded(path: Path) -> np.ndarray:
    pixels = np.load(path)
    path.unlink()
    return pixels


def scene_path(draft: Draft) -> Path:
    return draft.folder / "scene.toml"


def from_file(draft: Draft) -> Drawn:
    image = sg.render(scene_path(draft))
    return Drawn(image.pixels, image.info)


def by_command(draft: Draft, *options: object) -> Drawn:
    target = draft.folder / "command.npy"
    command("render", scene_path(draft), "-o", target, "--quiet", "--check", "0", *options)
    return Drawn(_loaded(target))


def by_batch(draft: Draft) -> Drawn:
    command("render", scene_path(draft), "-o", draft.folder / "{name}.npy", "--quiet", "--check", "0")
    return Drawn(_loaded(draft.folder / "scene.npy"))


def by_process(draft: Draft) -> Drawn:
    target = draft.folder / "process.npy"
    line = [sys.executable, "-m", "splatgl", "render", str(scene_path(draft)), "-o", str(target), "--quiet"]
    done = subprocess.run(line, capture_output=True, text=True, env={**os.environ}, check=False)
    if done.returncode:
        raise InputError(done.stderr.strip().splitlines()[-1].removeprefix("splatgl: "))
    return Drawn(_loaded(target))


def by_workers(draft: Draft) -> Drawn:
    return by_command(draft, "--workers", "1")


def files_of(draft: Draft) -> dict[str, bytes]:
    """The bytes of a saved PNG, by door. Raises InputError as the doors."""
    target, source = draft.folder / "file.png", scene_path(draft)
    sg.render(source).save(target)
    found = {"Python": target.read_bytes()}
    for name, output in (("command", target), ("batch", draft.folder / "{name}.png")):
        command("render", source, "-o", output, "--quiet")
        found[name] = (target if name == "command" else draft.folder / "scene.png").read_bytes()
    return found


# --- Python from arrays -----------------------------------------------------------------------------------------------


def keywords(draft: Draft) -> dict[str, Any]:
    """The options of a scene file as keywords, without volumes, layers and meshes."""
    table, names = draft.table, {key: name for name, key in VECTORS.items()}
    flat = {key: value for key, value in table.items() if key not in (*TABLES, "volume", "layer", "mesh")}
    flat |= {**table.get("camera", {}), **table.get("settings", {})}
    flat |= {names[key]: value for key, value in table.get("vectors", {}).items()}
    return {**flat, "mask": masks(draft, flat["mask"])} if "mask" in flat else flat


def masks(draft: Draft, texts: list[str]) -> list[str]:
    """Masks by names of files, which are in the folder of the scene."""
    return [str(draft.folder / text) for text in texts]


def _volume(draft: Draft, table: Table) -> sg.Volume:
    source = draft.sources[table["volume"]]
    return source.open(draft.folder, table.get("load", {}))


def transfer(table: Table, volume: sg.Volume) -> sg.Transfer | None:
    """The transfer function of a layer by public functions; None: the default one."""
    keys = dict(table.get("transfer", {}))
    name = keys.pop("preset", None)
    if not keys.keys() - {"points", "colormap", "window", "unit", "gradient", "shading", "regions"}:
        if name:
            return replace(sg.preset(name, volume), **keys)
        if not keys or keys.keys() >= {"points", "colormap", "window", "shading"}:
            return sg.Transfer(**keys) if keys else None
    return SceneFile("", held=volume, transfer=table["transfer"]).transfer_for(volume)


def layer(draft: Draft, table: Table) -> sg.Layer:
    volume = _volume(draft, table)
    for text in masks(draft, table.get("mask", [])):
        volume = volume.masked(text)
    names = ("opacity", "visible", "threshold", "clip", "surfaces", "uncut")
    return sg.Layer(volume, transfer(table, volume), **{name: table[name] for name in names if name in table})


def mesh(draft: Draft, table: Table) -> sg.Mesh:
    return MeshFile(**{**table, "file": str(draft.folder / table["file"])}).open()


def from_arrays(draft: Draft) -> Drawn:
    table = draft.table
    others: dict[str, Any] = {"layers": [layer(draft, row) for row in table.get("layer", ())]}
    others |= {"meshes": [mesh(draft, row) for row in table.get("mesh", ()) if row.get("visible", True)]}
    others = {name: value for name, value in others.items() if value}
    image = sg.render(_volume(draft, table), table.get("transfer"), **keywords(draft), **others)
    return Drawn(image.pixels, image.info)


def from_objects(draft: Draft) -> Drawn:
    """A Scene of Layers, from the camera of the scene file."""
    table = draft.table
    opened = OpenScene.read(SceneFile.from_toml(scene_path(draft)))
    first = {key: value for key, value in table.items() if key != "clip"}
    layers = [layer(draft, first), *(layer(draft, row) for row in table.get("layer", ()))]
    meshes = [mesh(draft, row) for row in table.get("mesh", ()) if row.get("visible", True)]
    # conditions of a scene file are on the box of its volume, those of a Scene on the box around all layers
    scene = sg.Scene(layers, opened.file.settings.clip, meshes, table.get("slice_planes", ()))
    image = sg.render(scene, camera=opened.camera, settings=sg.Settings(**table.get("settings", {})))
    return Drawn(image.pixels, image.info)


# --- the window and the notebook --------------------------------------------------------------------------------------


class NoScreen:
    """A screen that shows nothing."""

    def put(self, name: str, pixels: np.ndarray) -> None:
        """Takes a picture."""


def opened(draft: Draft) -> tuple[Document, State]:
    """The document and the state of a window, once all is read."""
    scene = SceneFile.from_toml(scene_path(draft))
    document = Document.open(scene, quiet=True)
    while document.has_finer:
        document = document.refined()
    state = State.of(document, scene.view.size)
    placed = document.with_planes(state.slice_planes)
    return placed.with_styles(state.styles, state.mesh_files, state.settings), state


def in_window(draft: Draft) -> Drawn:
    document, state = opened(draft)
    with shared_renderer() as renderer:
        painter = FrameRenderer(NoScreen(), renderer)  # type: ignore[arg-type]
        frame = painter.draw(state, document, FULL, False, None)
    return Drawn(painter.pixels, frame.info)


def saved_by_window(draft: Draft) -> Drawn:
    """The picture that the window saves, which has the camera of numbers in a scene file."""
    document, state = opened(draft)
    scene = scene_of(replace(state, annotate=document.scene.annotate), document)
    with shared_renderer() as renderer:
        image = render_scene(scene, document, renderer.render)
    return Drawn(image.pixels, image.info)


def copied(draft: Draft, form: Copy) -> Drawn:
    """What the window copies, run in a folder of its own; equal to what the window saves."""
    document, state = opened(draft)
    state = replace(state, annotate=document.scene.annotate)
    text = copy_text(form, state, document)
    folder = draft.folder / "copied"
    folder.mkdir(exist_ok=True)
    with chdir(folder):
        if form is Copy.PYTHON:
            with in_process():
                exec(text.replace("picture.png", "picture.npy"), {})
        else:
            _, _, rest = text.partition("END'\n")
            body, _, line = rest.rpartition("END\n")
            Path("scene.toml").write_text(body, encoding="utf-8")
            command(*line.replace("picture.png", "picture.npy").split()[1:], "--check", "0")
        pixels = _loaded(folder / "picture.npy")
    return Drawn(pixels)


def by_copied_command(draft: Draft) -> Drawn:
    return copied(draft, Copy.COMMAND)


def by_copied_python(draft: Draft) -> Drawn:
    return copied(draft, Copy.PYTHON)


def in_notebook(draft: Draft) -> Drawn:
    from splatgl.viewer.notebook import Session

    session = Session(SceneFile.from_toml(scene_path(draft)))
    while session.frame() is not None:
        pass
    assert session.level == FULL
    return Drawn(session.image.pixels, session.image.info)


# --- movies, workers, bricks ------------------------------------------------------------------------------------------


def by_animation(draft: Draft) -> Drawn:
    """Frame 0 of a movie that does not move."""
    target = draft.folder / "frame{frame}.npy"
    command("animate", scene_path(draft), "-o", target, "--frames", "1", "--turntable", "0", "--quiet")
    return Drawn(_loaded(draft.folder / "frame0.npy"))


def by_python_animation(draft: Draft) -> Drawn:
    (frame,) = sg.animate(scene_path(draft), draft.folder / "frame{frame}.npy", frames=1, turntable=0)
    return Drawn(_loaded(frame))


def in_bricks(draft: Draft) -> Drawn:
    with pytest.MonkeyPatch.context() as patch:
        allow_any_memory(patch)
        image = sg.render(scene_path(draft), memory="1MiB")
    return Drawn(image.pixels, image.info)


def with_all_samples(draft: Draft) -> Drawn:
    """The picture with all samples, of which whole volumes spare some within a quarter of the tolerance."""
    with mock.patch.object(resolve, "SPARED_SHARE", 0.0):
        return from_file(draft)


def without_annotations(draft: Draft) -> Drawn:
    """The picture that a window shows under its annotations, which it draws on the screen."""
    opened = OpenScene.read(SceneFile.from_toml(scene_path(draft)))
    image = draw(replace(opened, file=replace(opened.file, annotate=())), DrawOptions(is_shared=True, check=0))
    return Drawn(image.pixels, image.info)


def steadily_annotated(draft: Draft) -> Drawn:
    """The picture under the annotations of movies, whose places do not depend on the picture."""
    opened = OpenScene.read(SceneFile.from_toml(scene_path(draft)))
    names, background = opened.file.annotate, opened.file.settings.background
    bare = replace(opened.file, annotate=(), settings=without_background(opened.file.settings, names))
    image = draw(replace(opened, file=bare), DrawOptions(is_shared=True, check=0))
    image = sg.annotated(image, opened.annotated_subject, opened.transfer, opened.camera, names, background, True)
    image = on_ground(image, background)
    return Drawn(image.pixels, image.info)


# pictures that doors must equal, and the options for which they are another than the command's
BASES: dict[str, Draw] = {
    "picture": from_file,
    "bare": without_annotations,
    "steady": steadily_annotated,
    "saved": saved_by_window,
    "all samples": with_all_samples,
}

NOT_IN_WINDOW = {
    "slices": "slice: expected none in the window, which draws in space",
}
NOT_IN_MOVIES = {"slices": "--slice: expected none in movies"}
BY_WORKERS = "expected none, with --workers or --scheduler"
NOT_BY_WORKERS = {
    "threshold": f"--threshold: {BY_WORKERS}",
    "scissors": f"scissors: {BY_WORKERS}",
    "uncut": f"uncut: {BY_WORKERS}",
    "surfaces": f"surfaces: {BY_WORKERS}",
    "slice_planes": f"slice_planes: {BY_WORKERS}",
    "slices": "--slice: expected no --workers beside it",
    "layer": f"layers: {BY_WORKERS}",
    "a volume of channels": f"channels: {BY_WORKERS}",
    "visible": f"(meshes|visible): {BY_WORKERS}",
    "mesh": f"meshes: {BY_WORKERS}",
    "a volume of mesh": f"(meshes|layers): {BY_WORKERS}",
    "vectors.streamlines": f"streamlines or arrows: {BY_WORKERS}",
    "vectors.arrows": f"streamlines or arrows: {BY_WORKERS}",
    "settings.ambient_occlusion": f"--ambient-occlusion: {BY_WORKERS}",
    "settings.shadows": f"--shadows: {BY_WORKERS}",
}
TOO_LARGE = r"expected a layer that fits into 1\.0 MiB, got "
IN_PARTS = "expected a volume that fits into memory, got one in bricks or parts"
NO_KEYWORD = "options: expected options of the view, the settings, or .*, got "
DOORS: dict[str, Door] = {
    "command": Door(by_command),
    "batch": Door(by_batch),
    "arrays": Door(
        from_arrays,
        {name: NO_KEYWORD + name for name in ("opacity", "title", "visible")},
        (
            "layer.crop",
            "layer.title",
            "layer.transfer.color_of",
            "layer.transfer.window_of",
            "a layer of channels",
            "a volume of mesh",
            # as of `labels`, which are seen through the volume
            "layer.transfer.only_labels",
        ),
    ),
    "objects": Door(
        from_objects,
        lacks=(
            *("annotate", "slices", "scissors", "crop", "layer.crop", "visible", "surfaces", "a volume of mesh"),
            *("a volume of channels", "a layer of channels", "vectors.show", "vectors.streamlines", "vectors.arrows"),
            *("transfer.preset", "mask", "layer.transfer.only_labels"),
        ),
    ),
    "window": Door(in_window, NOT_IN_WINDOW, base="bare", is_open=True),
    "saved": Door(saved_by_window, NOT_IN_WINDOW, is_open=True),
    "copied command": Door(by_copied_command, NOT_IN_WINDOW, base="saved"),
    "copied Python": Door(by_copied_python, NOT_IN_WINDOW, base="saved"),
    "notebook": Door(in_notebook, NOT_IN_WINDOW, base="bare", is_open=True),
    # what is visible at one time may not be at others: the camera fits all of each volume, and a note says so
    "animate": Door(by_animation, NOT_IN_MOVIES, lacks=("a fitted series",), base="steady"),
    "sg.animate": Door(by_python_animation, NOT_IN_MOVIES, lacks=("a fitted series",), base="steady"),
    "bricks": Door(
        in_bricks,
        {
            **dict.fromkeys(
                ("layer", "mesh", "slice_planes", "a volume of channels", "a volume of mesh", "visible"), TOO_LARGE
            ),
            **dict.fromkeys(("vectors.streamlines", "vectors.arrows"), TOO_LARGE),
            **{name: IN_PARTS for name in ("settings.ambient_occlusion", "settings.shadows")},
        },
        base="all samples",
    ),
}
# doors that take seconds
SLOW: dict[str, Door] = {"process": Door(by_process), "workers": Door(by_workers, NOT_BY_WORKERS)}

"""Saves pictures and scenes, as `splatgl render` makes them."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.animation.animation import MOVIES
from splatgl.annotations.annotate import LEAST_SIDE
from splatgl.annotations.canvas import BLACK, WHITE, AnnotatedSubject, AnnotationView, Canvas
from splatgl.data.color import linear_from_srgb
from splatgl.data.image import SAVED, Image
from splatgl.errors import USER_ERRORS, error_text, expected
from splatgl.fileio import check_output, overwrites, write_file
from splatgl.geometry.camera import Camera
from splatgl.gl.screen import Stroke
from splatgl.gl.target import Interrupted
from splatgl.planning.scene import Scene
from splatgl.scene.draw import finish
from splatgl.scene.meshes import MeshFile
from splatgl.scene.open_scene import OpenScene, without_background
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import OF_POINTS
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.viewer.commands import AS_SHOWN, Copy, PictureOptions
from splatgl.viewer.document import Document, named_layers
from splatgl.viewer.frame_renderer import EDGE
from splatgl.viewer.layer_splats import LayerSplats
from splatgl.viewer.movie_track import Movie
from splatgl.viewer.slice_views import slice_outlines
from splatgl.viewer.state import LayerStyle, State

# opacity of the rim around lines, as on the screen
RIM = 0.6

Draw = Callable[[Splats | Scene, Camera, Settings], Image]
Add = Callable[[Image], Image]


def compose_screenshot(
    image: Image, state: State, document: Document, draw: Draw, scale: float, slices: np.ndarray | None
) -> Image:
    """The picture with the pinned one, slices and their lines, as in the window. slices: uint8 [H, w, 3], sRGB; None:
    hidden.
    """
    camera = state.pose.camera
    image = draw_strokes(image, slice_outlines(state.slices, document.volume, camera, scale))
    if state.beside is not None:
        matter, settings = state.beside.document.with_current_splats().subject_at(1, state.beside.still)
        image = append_pinned(image, draw(matter, camera, settings))
    return image if slices is None else append_slices(image, slices)


def draw_strokes(image: Image, strokes: Sequence[Stroke]) -> Image:
    """A picture under strokes, in the order in which the window draws them."""
    if not strokes:
        return image
    layer = Canvas(np.zeros_like(image.pixels), WHITE)
    for stroke in strokes:
        ends, alpha = np.array([[*stroke.start, *stroke.stop]]), stroke.color[3]
        red, green, blue = linear_from_srgb(np.array(stroke.color[:3])).tolist()
        # darkens linear light as much as the rim darkens the screen's values
        rim = float(1 - linear_from_srgb(np.array(1 - RIM * alpha)))
        layer.segments(ends, BLACK, float(np.float32(rim)), stroke.width + stroke.rim)
        layer.segments(ends, (red, green, blue), alpha, stroke.width)
    under = (1 - layer.pixels[..., 3:]) * image.pixels
    return Image(under + np.float32(image.white) * layer.pixels, image.info)


def append_pinned(image: Image, right: Image) -> Image:
    """A picture with another one of its height at its right, as on the screen: an X-ray relative to its brightest
    pixel, and a line between both.
    """
    beside = Image(right.pixels / np.float32(right.white))
    pixels = (beside if right.ground is None else beside.over(right.ground)).pixels
    pixels[:, 0] = *linear_from_srgb(np.array(EDGE[:3]) / 255), 1.0
    return Image(np.concatenate([image.pixels, np.float32(image.white) * pixels], axis=1), image.info)


def append_slices(image: Image, slices: np.ndarray) -> Image:
    """A picture with the slices at its right, uint8 [H, w, 3], sRGB."""
    height = image.pixels.shape[0]
    # a window that is being resized may have another height
    slices = np.pad(slices[:height], ((0, max(height - len(slices), 0)), (0, 0), (0, 0)))
    light = np.ones((*slices.shape[:2], 4), np.float32)
    light[..., :3] = linear_from_srgb(slices / 255)
    return Image(np.concatenate([image.pixels, np.float32(image.white) * light], axis=1), image.info)


RENDERED = "splatgl render draws it, as large as it is"


def scene_of(state: State, document: Document, on_paper: bool = True) -> SceneFile:
    """The scene equivalent to the window's state. on_paper: of the size on paper that the document's scene has, else of
    the window's pixels.
    """
    # motion blur does not affect a still image, but it does affect an animation of the scene
    settings = state.settings if state.blur == "off" else state.moving
    shown = document.with_styles(state.styles, state.mesh_files, settings)
    kinds = {layer.is_post_classified for layer in shown.drawn_layers}
    if settings.classification == "post" and False in kinds:
        # of several kinds, each layer has the one that it allows
        settings = settings.replace(classification="auto" if True in kinds else "pre")
    first_scene, *others = [_layer_scene(layer, style) for layer, style in _whole_layers(shown)]
    meshes = tuple(file for file in state.mesh_files if file != MeshFile(document.scene.volume))
    given = document.scene.view
    view = replace(state.pose.view(), fit=given.fit)
    view = replace(view, dpi=given.dpi, width=given.width) if on_paper else view
    # a picture that is too small has no annotations
    annotate = state.annotate if min(view.size) >= LEAST_SIDE else ()
    names = ("title", "load", "transfer", "look", "threshold", "opacity", "visible", "surfaces")
    look = {name: getattr(first_scene, name) for name in names}
    scene = replace(
        document.scene,
        **look,
        view=view,
        settings=settings,
        annotate=annotate,
        layers=tuple(others),
        meshes=meshes,
        measures=state.measures,
        scissors=shown.styles[0].scissors,
        slices=(),
        slice_planes=state.slice_planes,
    )
    if state.movie == Movie.of(scene.animation, document.volume):
        return scene
    return replace(scene, animation=state.movie.table(document, state.times))


def with_options(scene: SceneFile, options: PictureOptions) -> SceneFile:
    """The scene of a picture with options of its own. Raises InputError for a size or a width that is none."""
    view, settings = scene.view, scene.settings
    if options.size or options.width:
        view = replace(view, size=options.size or view.size, width=options.width, dpi=options.dpi)
    if options.background:
        settings = settings.replace(background=options.background)
    is_plain = options.is_plain or min(view.size) < LEAST_SIDE
    return replace(scene, view=view, settings=settings, annotate=() if is_plain else scene.annotate)


def _whole_layers(document: Document) -> list[tuple[LayerSplats, LayerStyle]]:
    """Layers and styles, of a layer that planes leave partly whole one of its two parts. Raises InputError for parts
    in two styles.
    """
    pairs, first = list[tuple[LayerSplats, LayerStyle]](), dict[int, LayerStyle]()
    for layer, style in zip(document.layers, document.styles, strict=True):
        known = first.setdefault(id(layer.scene), style)
        if known is style:
            pairs.append((layer, style))
        elif replace(style, number=known.number) != known:
            fix = "give both the same colours and opacity"
            raise expected(f"{layer.name}: uncut", "both parts in one look, as a scene file holds it", "two", fix)
    return pairs


def _layer_scene(layer: LayerSplats, style: LayerStyle) -> SceneFile:
    """The scene of one layer in a style."""
    scene, shown = layer.scene, layer.stand_in
    load = scene.load if shown is None or shown.level is None else {**scene.load, "level": shown.level}
    names = ("threshold", "opacity", "visible", "surfaces")
    look: dict[str, Any] = {name: getattr(style, name) for name in names}
    # points take the opacity of the value 1 alone
    table = {name: value for name, value in style.table.items() if layer.volume.points is None or name in OF_POINTS}
    # a channel has the options of the picture that the scene has
    look |= {"annotate": (), "slices": (), "slice_planes": (), "look": None}
    return replace(scene, title=style.title or scene.title, load=load, transfer=table, **look)


def render_scene(scene: SceneFile, document: Document, draw: Draw) -> Image:
    """The image that `splatgl render` makes of a scene of this document, in whose styles it is, drawn by the window's
    renderer.
    """
    transfer = scene.transfer_for(document.volume)
    shown = document.with_planes(scene.slice_planes).for_settings(scene.settings).with_current_splats()
    for layer in shown.drawn_layers:
        layer.make_surfaces()
    subject, settings = shown.subject_at(1, scene.settings)
    camera = scene.view.camera(shown.volume, subject)
    image = draw(subject, camera, without_background(settings, scene.annotate))
    # the first volume may be the part that planes leave whole
    opened, view = OpenScene(replace(scene, layers=(), uncut=""), document.volume, transfer), None
    if scene.annotate and len(shown.layers) > 1 and (named := named_layers(shown.layers, shown.styles)):
        told = AnnotatedSubject.of(document.volume, named[0][0], named)
        of_layers: dict[str, Any] = {name: getattr(told, name) for name in ("legend", "value_name", "colored")}
        view = AnnotationView(replace(opened.annotated_subject, **of_layers), named[0][1], camera)
    return finish(image, view, opened)


def plain(image: Image) -> Image:
    """The picture without additions."""
    return image


def save_picture(state: State, document: Document, draw: Draw, folder: Path, add: Add = plain) -> str:
    """Writes the next free picture-NNN.png; returns the message to show. add: draws ruler and slices over it."""
    return _save_picture(state, document, draw, free_path(folder, "picture", ".png"), add)


def _save_picture(
    state: State, document: Document, draw: Draw, target: Path, add: Add, options: PictureOptions = AS_SHOWN
) -> str:
    if document.exceeds_budget:
        raise expected("picture", "splats that fit into memory", "too many", f"save the scene: {RENDERED}")
    scene = with_options(scene_of(state, document, on_paper=False), options)
    document = document.with_styles(state.styles, state.mesh_files, state.settings)
    image, is_whole = render_scene(scene, document, draw), scene.view.size == state.pose.camera.size
    (add(image) if is_whole else image).save(target)
    beside = state.slices.shown or state.beside is not None
    return f"saved {target.name}" + ": of this size without what is beside the picture" * (beside and not is_whole)


def save_scene(state: State, document: Document, draw: Draw, folder: Path, has_picture: bool = True) -> str:
    """Writes the next free scene-NNN.toml, then the float image of it beside it; returns the message to show. A picture
    that fails or is interrupted leaves the scene, which has the edits.
    """
    target, scene = free_path(folder, "scene", ".toml"), scene_of(state, document)
    document = document.with_styles(state.styles, state.mesh_files, state.settings)
    write_file(target, scene.to_toml(target.parent).encode())
    if document.exceeds_budget:
        return f"saved {target.name}: {RENDERED}"
    picture = target.with_suffix(".npy")
    try:
        if has_picture:
            render_scene(scene, document, draw).save(picture)
    except Interrupted:
        return f"saved {target.name}; {picture.name} is cancelled"
    except USER_ERRORS as error:
        return f"saved {target.name}, without {picture.name}: {error_text(error)}"
    return f"saved {f'{picture.name} and ' if has_picture else ''}{target.name}"


def copy_text(
    form: Copy,
    state: State,
    document: Document,
    options: PictureOptions = AS_SHOWN,
    name: str = "picture.png",
) -> str:
    """Text that reproduces the picture: a scene file, or a command or Python that writes and draws it. name: of the
    picture.
    """
    scene = with_options(scene_of(state, document), options).to_toml()
    if form is Copy.SCENE:
        return scene
    if form is Copy.COMMAND:
        return f"cat > scene.toml <<'END'\n{scene}END\nsplatgl render scene.toml -o {shlex.quote(name)}\n"
    quoted = scene.replace("\\", "\\\\").replace('"""', '\\"\\"\\"')
    write = f'Path("scene.toml").write_text("""\\\n{quoted}""", encoding="utf-8")'
    draw = 'image = sg.render("scene.toml")\nimage.save("picture.png")'
    return f"from pathlib import Path\n\nimport splatgl as sg\n\n{write}\n{draw}\n"


def save_as(
    state: State,
    document: Document,
    draw: Draw,
    target: Path,
    add: Add = plain,
    times: Sequence[SceneFile] = (),
    options: PictureOptions = AS_SHOWN,
) -> str:
    """Writes a scene (.toml, or no ending) or a picture; returns the message to show. times: scenes of the series.
    Raises InputError as `check_target`, and for files that the document or its series was read from.
    """
    target = check_target(target)
    if overwrites(target, source_files(document, times)):
        raise expected(target, "another file", "what is shown", "choose another name")
    if not is_scene_name(target):
        return _save_picture(state, document, draw, target, add, options)
    write_file(target, with_options(scene_of(state, document), options).to_toml(target.parent).encode())
    return f"saved {target.name}"


def check_target(target: Path) -> Path:
    """The file that saving as `target` writes. Raises InputError for other endings, folders and missing folders."""
    if not target.name or os.path.isdir(target):
        raise expected(target, "a file's name", "a folder")
    target = target.with_suffix(".toml") if is_scene_name(target) else target
    check_output(target, (".toml", *SAVED, *MOVIES))
    if not os.path.isdir(target.parent):
        raise expected(target.parent, "a folder", "nothing", "make the folder first, or choose another one")
    return target


def is_scene_name(path: Path) -> bool:
    """Whether a scene, not a picture, is saved under this name."""
    return path.suffix.lower() in ("", ".toml")


def try_save(save: Callable[[], str]) -> tuple[str, bool]:
    """Message of a save, or of its error, and whether it succeeded."""
    try:
        return save(), True
    except USER_ERRORS as error:
        return error_text(error), False


def source_files(document: Document, times: Sequence[SceneFile] = ()) -> list[str]:
    """The files that a document, and its series, were read from."""
    scenes = (document.scene, *(layer.scene for layer in document.pool.values()), *times)
    return [
        *(file for scene in scenes for file in scene.files),
        *(mesh.file for mesh in document.mesh_files if mesh.held is None),
    ]


def free_path(folder: Path, stem: str, suffix: str) -> Path:
    """First unused path of folder/stem-001 and so on."""
    number = 1
    while any((folder / f"{stem}-{number:03d}{end}").exists() for end in (suffix, ".npy")):
        number += 1
    return folder / f"{stem}-{number:03d}{suffix}"

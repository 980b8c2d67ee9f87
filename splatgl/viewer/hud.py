"""Text and marks over the window's picture: device, time and plan of a frame, annotations, and lines of tools."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from splatgl.annotations.annotate import LEAST_SIDE, LiveOverlay, with_time
from splatgl.annotations.canvas import BLACK, WHITE, AnnotatedSubject, ColorScale, ink_on
from splatgl.annotations.text import INKS, Overlay, Text, draw_overlay, label, place_label
from splatgl.data.color import Color
from splatgl.data.volume import Volume
from splatgl.geometry.camera import Camera
from splatgl.gl.screen import LineColor, ScreenMarks, Sprite, Stroke
from splatgl.planning.plan import Plan
from splatgl.scene.meshes import is_mesh
from splatgl.transfer.statistics import Statistics
from splatgl.transfer.transfer import Transfer
from splatgl.viewer.adaptive_quality import FULL, PreviewLevel
from splatgl.viewer.clip_tool import box_edges, handles, lasso_strokes, outline
from splatgl.viewer.commands import Command
from splatgl.viewer.document import Document, named_layers
from splatgl.viewer.input import help_rows
from splatgl.viewer.measure_tool import describe_pick, under_cursor
from splatgl.viewer.reference_view import Difference
from splatgl.viewer.slice_views import clip_strokes, slice_outlines
from splatgl.viewer.state import ClipState, Ruler, State
from splatgl.viewer.trackball import Place, Viewport, project, project_segment


@dataclass(frozen=True, eq=False)
class DisplayedFrame:
    """The displayed frame: the renderer's info, seconds, level and plan. beyond: the share of splats beyond z_k.

    hidden: number of splats omitted because no view shows them. blurred: whether motion blur was applied.
    off: for a full frame that replaced a preview, the preview's error against it. whole: seconds of a frame in motion
    with its text, panel and display, as measured before this one.
    """

    info: Mapping[str, object]
    seconds: float
    level: PreviewLevel
    plan: Plan
    beyond: Callable[[], float]
    hidden: int
    blurred: bool = False
    off: Difference | None = None
    whole: float = 0.0

    @property
    def full(self) -> bool:
        """Whether this is the full-quality frame, not a preview."""
        return self.level == FULL and not self.blurred

    @property
    def given_up(self) -> str:
        """Text listing the quality reductions of a preview."""
        return f"{self.level}{', blurred' if self.blurred else ''}"


def short_lines(state: State, document: Document, frame: DisplayedFrame | None, busy: str | None) -> tuple[str, ...]:
    """File and quality."""
    name = document.volume.name or document.scene.volume
    notes = [document.stand_in.note] if document.stand_in and document.stand_in.note else []
    if document.is_loading:
        return (name, *([busy] if busy else []))
    return (name, *notes, busy or progress_text(frame))


def full_lines(state: State, document: Document, frame: DisplayedFrame | None, busy: str | None) -> tuple[str, ...]:
    """Device, splats, time, z_k, error bound and plan of the picture."""
    if frame is None or document.is_loading:
        return short_lines(state, document, frame, busy)
    info, size = frame.info, state.pose.camera.size
    return (
        f"{document.volume.name or document.scene.volume}  {size[0]} x {size[1]}",
        f"{info['renderer']} ({info['backend']})",
        *_splats(document, frame),
        *_instead(state, document),
        *_pace(state, frame, busy),
        _depths(document, frame),
        *_bound(info),
        "",
        *frame.plan.explain().splitlines(),
    )


# names of types of samples
KINDS = {"b": "truth values", "i": "whole numbers", "u": "whole numbers", "f": "decimal numbers"}


def describe_volume(volume: Volume, stats: Statistics, segments: int) -> str:
    """Sentences on the voxels and values of a volume. segments: their number, 0 for amounts."""
    size = " x ".join(map(str, reversed(volume.shape)))
    steps = tuple(f"{step:.4g}" for step in volume.spacing)
    apart = " x ".join(steps if len(set(steps)) > 1 else steps[:1])
    kind = np.dtype(volume.samples.dtype)
    text = f"{size} voxels, {apart} {volume.unit}".rstrip() + f" apart, {8 * kind.itemsize}-bit {KINDS[kind.kind]}."
    if segments:
        return f"{text} They number {segments:,} segment{'s' * (segments > 1)}."
    if not len(stats.values):
        return f"{text} No value is finite."
    ends = [
        f"{number:.4g}" for number in (stats.percentile(25), stats.percentile(75), stats.values[0], stats.values[-1])
    ]
    unit = f" {volume.value_unit}".rstrip()
    return f"{text} Values: half from {ends[0]} to {ends[1]}{unit}, all from {ends[2]} to {ends[3]}{unit}."


def describe_picture(document: Document, frame: DisplayedFrame | None) -> str:
    """Sentences on what the picture shows, how long it took, and how exact it is."""
    if frame is None or document.is_loading:
        return "No picture yet."
    if not frame.full:
        return f"A picture in motion, coarser than at rest, in {frame.seconds:.2g} s."
    layers, bound = document.drawn_layers, frame.info.get("error_bound")
    share = sum(len(layer.finest) for layer in layers) / max(sum(layer.volume.count for layer in layers), 1)
    exact = f"; the maximum error is {bound:.2g} of full brightness" if isinstance(bound, float) else ""
    return f"{100 * share:.2g} % of the voxels have an opacity. The picture took {frame.seconds:.2g} s{exact}."


@lru_cache(maxsize=2)
def help_sprite(size: tuple[int, int], shown: int, scale: float, commands: tuple[Command, ...]) -> Sprite:
    """The keys of commands over a window of `size` pixels, of which those from column `shown` on are covered."""
    text = Text(tuple("\t".join(row) for row in help_rows(commands)), "middle", fit=True)
    pixels = draw_overlay(Overlay(size, scale, (text,))).copy()
    # a veil as dark as the text's background: no box ends at the panel
    pixels[..., 3] = np.maximum(pixels[..., 3], INKS[0][2][3])
    pixels[:, shown:, 3] = 255
    return Sprite(pixels, (0.0, 0.0, float(size[0]), float(size[1])))


def progress_text(frame: DisplayedFrame | None) -> str:
    """Short text on the quality of the frame relative to the settings, and the rate of frames in motion."""
    if frame is None:
        return ""
    if frame.full:
        bound = frame.info.get("error_bound")
        return f"refined: error at most {bound:.2g}" if isinstance(bound, float) else "refined"
    rate = f"{1 / frame.whole:.0f} frames/s, " if frame.whole else ""
    return f"moving: {rate}{frame.given_up}"


def _splats(document: Document, frame: DisplayedFrame) -> list[str]:
    """The visible part of the volume, numbers of drawn and total splats, and why the others are missing."""
    layers, first = document.drawn_layers, document.layers[0]
    kept, total = sum(len(layer.finest) for layer in layers), sum(layer.volume.count for layer in layers)
    notes = [document.stand_in.note] if document.stand_in and document.stand_in.note else []
    if frame.level.stride > 1 or 1 not in document.extracted:
        return [*notes, f"of {total:,} voxels, blocks of {frame.level.stride}^3 are rendered"]
    most = f"at most {first.own.threshold:g}" if first.own.threshold else "0"
    left = f"the rest: opacity {most}{' around' * first.is_post_classified}"
    notes.append(f"{kept:,} of {total:,} voxels are splats ({left})")
    drawn = frame.info.get("drawn", kept - frame.hidden)
    if isinstance(drawn, int) and drawn < kept:
        notes.append(f"{drawn:,} rendered; the others are hidden from here")
    return notes


def _instead(state: State, document: Document) -> list[str]:
    """The reason why splats are classified before reconstruction although the settings ask for after."""
    if document.layers[0].is_post_classified or state.settings.classification != "post":
        return []
    why = document.layers[0].why_pre_classified(state.moving, True)
    return [f"classified before reconstruction because of {why}"]


def _pace(state: State, frame: DisplayedFrame, busy: str | None) -> list[str]:
    rate = f"{frame.seconds * 1e3:.0f} ms"
    work = f", {busy} ..." if busy else ""
    if not frame.full:
        return [f"{rate}  moving: {frame.given_up}{work}"]
    parts = 1 / state.settings.tolerance
    tolerance = f"1/{parts:.0f}" if abs(parts - round(parts)) < 1e-6 else f"{state.settings.tolerance:g}"
    lines = [f"{rate}  refined to {tolerance}{work}"]
    if frame.off is not None:
        lines.append(f"in motion it was off by RMSE {frame.off.rmse:.2g}, largest {frame.off.largest:.2g}")
    return lines


def _depths(document: Document, frame: DisplayedFrame) -> str:
    z_k, unit = frame.plan.resolved.z_k, document.volume.unit
    if frame.plan.program.seen.perspective:
        return f"z_k = {z_k:.4g}{' ' + unit if unit else ''}, {frame.beyond():.0%} of the splats beyond"
    return "z_k: voxels are " + ("narrower" if z_k == 0 else "wider") + " than pixels everywhere"


def _bound(info: Mapping[str, object]) -> list[str]:
    bound, dropped = info.get("error_bound"), info.get("dropped_depth")
    lines = [f"error at most {bound:.2g}"] if isinstance(bound, float) else []
    if isinstance(dropped, float) and dropped > 0:
        lines.append(f"the threshold dropped an optical depth of up to {dropped:.2g}")
    if "tolerance_met" in info and not info["tolerance_met"]:
        lines.append("the tolerance was not met" if isinstance(bound, float) else "its error has no known bound")
    return lines


# background of checks, linear light
GREY = 0.075
# widest gap of empty rows or columns within a sprite, pixels
GAP = 16


def crop_sprites(pixels: np.ndarray) -> tuple[Sprite, ...]:
    """Sprites of the visible parts of a picture uint8 [H, W, 4]."""
    sprites = []
    for top, bottom in _spans(np.asarray(pixels[..., 3].any(axis=1))):
        for left, right in _spans(np.asarray(pixels[top:bottom, :, 3].any(axis=0))):
            sprites.append(Sprite(pixels[top:bottom, left:right].copy(), (left, top, right, bottom)))
    return tuple(sprites)


def _spans(full: np.ndarray) -> list[tuple[int, int]]:
    """Starts and ends of runs of True, joined across gaps of up to GAP."""
    places = np.flatnonzero(full)
    if not len(places):
        return []
    ends = np.flatnonzero(np.diff(places) > GAP)
    starts = [places[0], *places[ends + 1]]
    return [(int(a), int(b) + 1) for a, b in zip(starts, [*places[ends], places[-1]], strict=True)]


def background_of(state: State) -> Color:
    """The background of the picture, linear RGB."""
    if state.settings.ground is not None:
        return state.settings.ground
    return {"white": WHITE, "checks": (GREY, GREY, GREY)}.get(state.ground, BLACK)


def is_light(state: State) -> bool:
    """Whether dark texts are read best on the background of the picture."""
    return ink_on(np.array(background_of(state))) == BLACK


# sRGB of the box, of planes, and of inactive cuts
BOX: LineColor = (0.36, 0.72, 1.0, 0.9)
PLANES: tuple[LineColor, ...] = ((1.0, 0.62, 0.2, 0.95), (0.45, 0.9, 0.45, 0.95), (0.95, 0.5, 0.85, 0.95))
RULER: LineColor = (1.0, 0.85, 0.3, 1.0)
RESTING: LineColor = (0.7, 0.7, 0.7, 0.7)
# pixels at a content scale of 1
LINE, DOT, TIP, EDGE = 1.5, 11.0, 8.0, 6.0
# of the short information on the frame, beside which annotations have room in pictures four times as high
TEXT = 56.0


class Overlays:
    """Marks over the picture; keeps annotations from one frame to the next."""

    def __init__(self) -> None:
        self.overlay = LiveOverlay()
        # inputs of the latest annotations, and their sprites
        self.key: tuple[object, ...] = ()
        self.latest: tuple[Sprite, ...] = ()

    def annotations(self, state: State, document: Document, scale: float = 1.0) -> tuple[Sprite, ...]:
        """Sprites of the annotations, drawn again only when their inputs change; none if the picture is too small."""
        camera, volume, meshes = state.pose.camera, document.volume, document.meshes
        names = with_time(state.annotate, volume, state.time)
        if not names or min(camera.size) < LEAST_SIDE:
            return ()
        valued, transfer = bar_of(state, document)
        above = 0 if state.hud == "off" or camera.size[1] < 4 * TEXT * scale else round(TEXT * scale)
        look = transfer, camera, names, background_of(state), state.settings.blend, above
        volumes = [layer.volume for layer in document.layers]
        key = volume, valued, meshes, state.measures, volumes, state.styles, *look
        if key != self.key:
            empty, scales = is_mesh(document.scene.volume), ColorScale.of(meshes)
            named = named_layers(document.layers, state.styles)
            subject = AnnotatedSubject.of(volume, named[0][0] if named else valued, named)
            subject = replace(subject, measures=state.measures, scales=scales, empty=empty)
            self.key, self.latest = key, crop_sprites(self.overlay.draw(subject, *look))
        return self.latest

    def marks(
        self, state: State, document: Document, view: Viewport, cursor: Place | None, slices: ScreenMarks, edge: float
    ) -> ScreenMarks:
        """All marks: annotations that end left of `edge`, pixels, from where on the panel lies over the picture;
        handles, ruler, the value under the cursor (None: hidden), and those of slices.
        """
        camera, scale = state.pose.camera, view.scale
        legend = tuple(sprite for sprite in self.annotations(state, document, scale) if sprite.place[2] <= edge)
        strokes = [*handle_strokes(state.cuts, document.volume, camera, scale), *lasso_strokes(state.lasso, scale)]
        lines, labels = ruler_marks(state.ruler, camera, scale), list[Sprite]()
        if state.probe and cursor is not None:
            labels += _value_label(state, document, cursor, scale)
        if not slices:
            return ScreenMarks(legend, (*strokes, *lines), tuple(labels))
        lines += slice_outlines(state.slices, document.volume, camera, scale)
        visible = clip_strokes((*strokes, *lines), camera.size[0])
        return ScreenMarks((*legend, *slices.sprites), (*visible, *slices.strokes), (*labels, *slices.labels))


def bar_of(state: State, document: Document) -> tuple[Volume, Transfer]:
    """Volume and transfer function of the colour bar: those of the first visible layer."""
    number = next((n for n, style in enumerate(state.styles) if style.is_shown), 0)
    # a document that loads anew may have fewer layers
    return document.layers[min(number, len(document.layers) - 1)].volume, state.styles[number].transfer


def ruler_marks(ruler: Ruler, camera: Camera, scale: float) -> list[Stroke]:
    """Dots at the points that are picked, and lines between them."""
    points = np.array(ruler.points).reshape(-1, 3)
    dots = [(float(x), float(y)) for x, y in project(camera, points) if np.isfinite(x)]
    strokes = _lines(camera, list(pairwise(points)), RULER, LINE * scale)
    return [*strokes, *(Stroke(dot, dot, RULER, TIP * scale, scale) for dot in dots)]


def readout_label(lines: tuple[str, ...], top: int, edge: float, scale: float, light: bool) -> tuple[Sprite, ...]:
    """The label of what is under the cursor, at the left below `top`, if it ends left of `edge`, pixels. light: whether
    the background is.
    """
    if not lines:
        return ()
    text, gap = label(lines, scale, light), round(EDGE * scale)
    high, wide = text.shape[:2]
    place = (float(gap), float(top + gap), float(gap + wide), float(top + gap + high))
    return (Sprite(text, place),) if place[2] <= edge else ()


def _value_label(state: State, document: Document, cursor: Place, scale: float) -> list[Sprite]:
    """The label of the value under the cursor."""
    size = state.pose.camera.size
    if not (0 <= cursor[0] < size[0] and 0 <= cursor[1] < size[1]):
        return []
    text = label(describe_pick(under_cursor(state, document, cursor), document), scale)
    return [Sprite(text, place_label(cursor, (text.shape[1], text.shape[0]), size, 1.5 * DOT * scale))]


def handle_strokes(cuts: ClipState, volume: Volume, camera: Camera, scale: float) -> list[Stroke]:
    """Lines and handles of the clip box and planes, pixels; none while they are hidden."""
    if not cuts.shown:
        return []
    box = BOX if cuts.active else RESTING
    strokes = _lines(camera, box_edges(cuts, volume), box, LINE * scale)
    for number, plane in enumerate(cuts.planes):
        points = outline(cuts, volume, plane)
        rim = list(zip(points, np.roll(points, -1, axis=0), strict=True)) if len(points) else []
        strokes += _lines(camera, rim, plane_color(cuts, number), LINE * scale)
    feet = {}
    for handle in handles(cuts, volume):
        color = box if handle.what == "side" else plane_color(cuts, handle.number)
        if handle.what == "plane":
            feet[handle.number] = handle.point
        elif handle.what == "tilt":
            strokes += _lines(camera, [(feet[handle.number], handle.point)], color, LINE * scale)
        (place,) = project(camera, handle.point[None])
        if np.isfinite(place).all():
            at = float(place[0]), float(place[1])
            strokes.append(Stroke(at, at, color, (TIP if handle.what == "tilt" else DOT) * scale, scale))
    return strokes


def plane_color(cuts: ClipState, number: int) -> LineColor:
    """Colour of a plane and its handles."""
    return PLANES[number % len(PLANES)] if cuts.active else RESTING


def _lines(camera: Camera, ends: list[tuple[np.ndarray, np.ndarray]], color: LineColor, width: float) -> list[Stroke]:
    segments = [project_segment(camera, start, stop) for start, stop in ends]
    return [Stroke(*each, color, width) for each in segments if each is not None]

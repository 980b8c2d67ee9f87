"""Draws previews and full frames of the window."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from splatgl.annotations.bars import shorten_label
from splatgl.annotations.text import Overlay, Path, Text, draw_overlay, text_box
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import InputError, error_text
from splatgl.geometry.camera import Camera
from splatgl.geometry.clipping import Plane
from splatgl.gl.renderer import Renderer
from splatgl.gl.screen import Screen, ScreenStyle
from splatgl.planning.culling import FAITHFUL
from splatgl.planning.plan import MotionBlur, ResolvedLayer
from splatgl.planning.resolve import has_streaks
from splatgl.scene.open_scene import print_lines
from splatgl.splat.motion import Motion
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats, as_points
from splatgl.viewer import hud
from splatgl.viewer.adaptive_quality import FULL, PreviewLevel
from splatgl.viewer.clip_tool import outline
from splatgl.viewer.document import Document
from splatgl.viewer.hud import DisplayedFrame
from splatgl.viewer.reference_view import Difference, Reference, resize_bilinear
from splatgl.viewer.state import ClipState, PinnedView, State
from splatgl.viewer.trackball import Pose, project

# linear light: splats beyond z_k are blended towards TINT by SHARE; splats at the plane get the colour PLANE
TINT, PLANE = np.array([0.9, 0.12, 0.02], np.float32), np.array([1.0, 0.85, 0.1], np.float32)
SHARE = 0.55
# thickness of the plane's band in voxels
BAND = 1.0


def depths(splats: Splats, camera: Camera) -> np.ndarray:
    """Depth [N] of each splat, world units, float32."""
    along = camera.forward @ splats.grid.world_from_index
    start = float(camera.forward @ (splats.grid.origin - camera.eye))
    return np.asarray(splats.positions @ along.astype(np.float32) + np.float32(start))


def share_beyond(splats: Splats, camera: Camera, z_k: float) -> float:
    """Fraction of the splats beyond z_k."""
    return float((depths(splats, camera) > z_k).mean()) if len(splats) else 0.0


def tint_splats(splats: Splats, camera: Camera, z_k: float) -> Splats:
    """Copy of the splats with those beyond z_k tinted and those at z_k in the plane's colour."""
    if not len(splats) or not np.isfinite(z_k):
        return splats
    depth = depths(splats, camera)
    records = as_points(splats.records)
    beyond = depth > z_k
    records["color"][beyond] += SHARE * (TINT - records["color"][beyond])
    records["color"][np.abs(depth - z_k) < BAND / 2 * splats.grid.mean_spacing] = PLANE
    return splats.in_cells(records=records)


def tint_light(whole: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The picture float32 [H, W, 4] with tinted light from beyond z_k. near: the picture without that light."""
    beyond = whole - near
    return np.concatenate(
        [whole[..., :3] + SHARE * (TINT * beyond[..., 3:] - beyond[..., :3]), whole[..., 3:]], axis=-1
    )


def plane_section(volume: Volume, camera: Camera, z_k: float) -> np.ndarray:
    """Section of a volume's box by the plane at depth z_k: a polygon [N, 2] in pixels; N = 0 if they miss."""
    if not np.isfinite(z_k):
        return np.zeros((0, 2))
    plane: Plane = (*camera.forward.tolist(), float(camera.forward @ camera.eye) + z_k)
    return project(camera, outline(ClipState(), volume, plane))


# minimum seconds between HUD updates in motion
CALM = 0.25
# motion blur: longest blurred motion, seconds, and most moments per picture: a slow picture would otherwise blur a
# longer path by more moments, and become slower still
BLURRED, MOMENTS = 0.1, 8
# line between two pictures, sRGB with alpha
EDGE = (128, 128, 128, 255)
# pixels per character of a message line, at a content scale of 1
LETTER = 7.5
# largest width of the text, as a share of the window
COLUMN = 0.42
# pictures less wide have room for annotations alone, pixels at a content scale of 1
NARROW = 200.0
# pixels at a content scale of 1 that annotations take at the top of these
BELOW = 110.0
# smallest difference of a visible pixel from its background, and largest share of visible pixels that a text may cover
SEEN, COVERED = 0.02, 0.02
# images with a side of more than n × ENOUGH pixels are compared with their preview at every (n + 1)-th pixel
ENOUGH = 1000
Ask = Callable[[], bool]


class FrameRenderer:
    """Keeps the contents of the screen: the last frame, the overlay, and the display mode."""

    def __init__(self, screen: Screen, renderer: Renderer) -> None:
        self.screen, self.renderer = screen, renderer
        self.frame: DisplayedFrame | None = None
        self.pixels = np.zeros((1, 1, 4), np.float32)
        # inputs and pose of the last frame, and the time of its begin
        self.subject: tuple[object, ...] = ()
        self.pose: Pose | None = None
        self.begun = 0.0
        # the preview that a full frame just replaced, until the HUD shows their difference
        self.stand_in: np.ndarray | None = None
        self.fresh = False
        self.white = 1.0
        self.overlay: Overlay | None = None
        # of the pinned picture, and why there is none
        self.overlay_beside: Overlay | None = None
        self.not_beside = ""
        # lines of text, and their corner
        self.words: tuple[str, ...] = ()
        # lower end of the texts at the upper left, pixels
        self.written_to = 0
        self.corner = "top left"
        self.written = -1e9
        # measured seconds of a whole frame in motion
        self.whole = 0.0
        self.beside: object = None
        # settings as opened, whose notes are printed
        self.noted: Settings | None = None

    def draw(
        self, state: State, document: Document, level: PreviewLevel, gliding: bool, interrupted: Ask | None
    ) -> DisplayedFrame:
        """Renders the splats at a level and keeps the image. Raises InputError as the renderer does.

        gliding: the view moves continuously from the last frame, so that motion blur may apply. interrupted: polled
        during the frame, if any; True raises Interrupted and leaves the painter unchanged.
        """
        started = time.perf_counter()
        camera = state.pose.camera.resized(level.size(state.pose.camera.size))
        # the classification of the extracted splats
        requested = state.settings.replace(motion=state.blur, classification="auto")
        first, layered = document.drawn_layers[0], document.is_layered
        resolved = ResolvedLayer.of(first.finest, state.pose.camera, requested).resolved
        # neither the reference nor layers are tinted
        tint = state.show_zk and state.compare == "off" and not layered
        z_k = resolved.z_k
        # the light of reconstructed values is tinted in the picture, before the background
        settings = level.settings(
            requested.replace(background=None) if tint and first.is_post_classified else requested
        )
        # a full frame leaves out what nobody sees where that is as good
        leaves_out = level != FULL or not (resolved.view.antialias or settings.tolerance <= FAITHFUL)
        matter, drawn_with = document.subject_at(level.stride, settings, camera.eye if leaves_out else None)
        splats = matter if isinstance(matter, Splats) else first.at(level.stride)
        if tint and not first.is_post_classified:
            matter = splats = tint_splats(splats, camera, z_k)
        motion = self._motion(state, camera, started - self.begun, layered) if gliding else None
        if motion is not None and MotionBlur.of(splats, camera, settings, motion, []).moments > MOMENTS:
            drawn_with = drawn_with.replace(moments=MOMENTS)
        draw = partial(self.renderer.render, verify_bound=False, interrupted=interrupted)
        render = partial(draw, camera=camera, settings=drawn_with, motion=motion)
        image = render(matter)
        pixels = image.pixels
        if level == FULL and document.scene.settings != self.noted:
            self.noted = document.scene.settings
            # what blurs motion is of use once the view turns
            print_lines(image.plan.notes_in_motion, False)
        if tint and first.is_post_classified:
            pixels = tint_light(pixels, render(splats.part(depths(splats, camera) <= z_k)).pixels)
        pinned = None if state.beside is None else self._draw_pinned(state.beside, camera, level, interrupted)
        seconds = time.perf_counter() - started

        subject = (state.pose, state.settings, document, state.show_zk)
        replaces = level == FULL and self.frame is not None and not self.frame.full
        self.fresh, self.stand_in = replaces, self.pixels if replaces and subject == self.subject else None
        self.subject, self.pose, self.pixels, self.begun = subject, state.pose, pixels, started
        self.white = Image(self.pixels, image.info).white
        if pinned is None:
            self.screen.put("picture", self.pixels)
        else:
            # the screen scales the light of both as that of this picture
            self.screen.put("picture", np.hstack([self.pixels, pinned * np.float32(self.white)]))
        beyond = partial(share_beyond, first.sample, state.pose.camera, z_k)
        hidden = len(first.at(level.stride)) - len(splats)
        blurred = "motion" in image.info
        self.frame = DisplayedFrame(
            image.info, seconds, level, image.plan.first, beyond, hidden, blurred, whole=self.whole
        )
        return self.frame

    def _draw_pinned(
        self, pinned: PinnedView, camera: Camera, level: PreviewLevel, interrupted: Ask | None
    ) -> np.ndarray:
        """Pixels of what is pinned, at a level, without motion blur; an X-ray relative to its brightest. Clear if it
        cannot be drawn from here, for the reason that is written over it.
        """
        settings = level.settings(pinned.still)
        self.not_beside = ""
        try:
            matter, settings = pinned.document.subject_at(level.stride, settings)
            image = self.renderer.render(matter, camera, settings, verify_bound=False, interrupted=interrupted)
        except InputError as error:
            self.not_beside = error_text(error)
            return np.zeros((*camera.size[::-1], 4), np.float32)
        return image.pixels * np.float32(1.0 / image.white)

    def write(self, state: State, document: Document, scale: float, busy: str | None, note: str) -> bool:
        """Redraws the overlay if its text changed; True if so. note: text about the reference.

        A frame that replaces a preview is displayed first; its text follows in the next call.
        """
        now = time.perf_counter()
        if self.fresh:
            self.fresh = False
            return False
        if self.stand_in is not None and self.frame is not None and state.hud == "full":
            self.frame, self.stand_in = replace(self.frame, off=self._off(self.stand_in)), None
        moving = self.frame is not None and not self.frame.full
        narrow = state.hud == "short" and state.pose.camera.size[0] < NARROW * scale
        if state.hud == "off" or state.help or narrow:
            self.words = ()
        elif not (moving and self.words and now - self.written < CALM):
            lines = (hud.short_lines if state.hud == "short" else hud.full_lines)(state, document, self.frame, busy)
            most = _column(state.pose.camera.size, scale)
            if state.hud == "short":
                lines = shorten_label(lines[0], most), *lines[1:]
            self.words = tuple(part for line in lines if line for part in _wrap(line, most))
            self.written = now
            if not moving and state.hud == "short":
                self.corner = self._free(Text(self.words), state, scale)
        wanted = self._overlay(state, document, scale, note)
        pinned = None
        if state.beside is not None:
            reason = textwrap.wrap(self.not_beside, _column(state.pose.camera.size, scale))
            pinned = replace(wanted, texts=(Text((state.beside.name, *reason)),), paths=())
        if (wanted, pinned) == (self.overlay, self.overlay_beside):
            return False
        self.overlay, self.overlay_beside = wanted, pinned
        boxes = [text_box(text, wanted.size, scale) for text in wanted.texts if text.corner == "top left"]
        self.written_to = max((bottom for _, _, _, bottom in boxes), default=0)
        drawn = draw_overlay(wanted)
        if pinned is not None:
            beside = draw_overlay(pinned).copy()
            beside[:, :1] = EDGE
            drawn = np.hstack([drawn, beside])
        self.screen.put("overlay", drawn)
        return True

    def _free(self, text: Text, state: State, scale: float) -> str:
        """A corner where a text covers no visible pixels and no axes; "" if there is none."""
        size, ground = state.pose.camera.size, state.settings.backdrop
        empty = np.zeros(4) if ground is None else np.array([*ground, 1.0])
        down, across = self.pixels.shape[0] / size[1], self.pixels.shape[1] / size[0]
        for corner in ("top left",) if "axes" in state.annotate else ("top left", "bottom left"):
            left, top, right, bottom = text_box(replace(text, corner=corner), size, scale)
            part = self.pixels[int(top * down) : int(bottom * down) + 1, int(left * across) : int(right * across) + 1]
            if not part.size or float((np.abs(part - empty) > SEEN).any(axis=2).mean()) < COVERED:
                return corner
        return ""

    def look(self, state: State, reference: Reference) -> ScreenStyle:
        """Current display mode; uploads the reference if there is one."""
        background = state.settings.backdrop
        overlay = self.overlay
        written = overlay is not None and bool(overlay.texts or overlay.paths or self.overlay_beside)
        plain = ScreenStyle(state.ground, 1.0 / self.white, overlay=written, background=background)
        right = reference.image
        if right is None or state.compare == "off" or right.pixels.shape != self.pixels.shape:
            return plain
        if self.beside is not right:
            self.screen.put("other", right.pixels.astype(np.float32))
            self.beside = right
        if state.compare == "split":
            return replace(plain, compare="split")
        largest = Difference.of(self.pixels, right.pixels).largest
        return replace(plain, compare="difference", scale=1.0, gain=1.0 / largest if largest > 0 else 1.0)

    def compared(self, state: State, reference: Reference) -> str:
        """Text about the reference."""
        right = reference.image
        if state.compare == "off" or right is None or right.pixels.shape != self.pixels.shape:
            return "" if state.compare == "off" else reference.note
        difference = Difference.of(self.pixels, right.pixels)
        numbers = f"largest {difference.largest:.2g}, RMSE {difference.rmse:.2g} of linear light"
        if state.compare == "split":
            return f"left: this picture; right: the float64 reference. Difference: {numbers}"
        return f"difference from the float64 reference: {numbers}; white is {difference.largest:.2g}"

    def _motion(self, state: State, camera: Camera, seconds: float, layered: bool) -> Motion | None:
        """Camera motion since the last frame, `seconds` ago; at most its last BLURRED seconds."""
        before = self.pose
        if state.blur == "off" or before is None or before is state.pose or (layered and has_streaks(state.moving)):
            return None
        if before.camera.perspective != camera.perspective:
            return None
        motion = Motion(camera=before.camera.resized(camera.size))
        return motion if seconds <= BLURRED else Motion(camera=motion.view(camera, -BLURRED / seconds))

    def _off(self, stand_in: np.ndarray) -> Difference:
        """The preview's error against the current frame; for an X-ray, relative to its brightest pixel."""
        height, width, _ = self.pixels.shape
        step = 1 + max(width, height) // ENOUGH
        stand_in, pixels = resize_bilinear(stand_in, (width, height), step), self.pixels[::step, ::step]
        return Difference.of(stand_in / self.white, pixels / self.white)

    def _overlay(self, state: State, document: Document, scale: float, note: str) -> Overlay:
        texts, size = [], state.pose.camera.size
        corner = self.corner if state.hud == "short" else "top left"
        if self.words and corner:
            texts.append(Text(self.words, corner, fit=state.hud == "full"))
        notes = [line for line in (note, state.message) if line]
        if notes:
            # annotations are at the bottom and in the middle of the top
            is_beside = bool(state.annotate) and size[0] >= 2 * NARROW * scale
            width = _column(size, scale) if is_beside else max(20, int(size[0] / LETTER / scale))
            lines = tuple(part for line in notes for part in _wrap(line, width))
            over = "top left" if state.annotate or corner == "bottom left" else "bottom left"
            above = text_box(texts[0], size, scale)[3] if texts and texts[0].corner == over == "top left" else 0
            if state.annotate and size[0] < NARROW * scale:
                above = max(above, round(BELOW * scale))
            texts.append(Text(lines, over, note=True, above=above))
        paths: tuple[Path, ...] = ()
        if state.show_zk and self.frame is not None and self.frame.plan.program.seen.perspective:
            section = plane_section(document.volume, state.pose.camera, self.frame.plan.resolved.z_k)
            polygon = tuple((round(float(x)), round(float(y))) for x, y in section)
            paths = ((*polygon, polygon[0]),) if polygon else ()
        return Overlay(size, scale, tuple(texts), paths, hud.is_light(state))


def _column(size: tuple[int, int], scale: float) -> int:
    """Letters in a line of text over a picture."""
    return max(16, int(size[0] / LETTER / scale * COLUMN))


def _wrap(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width) or [""]

"""The paper's rendered figures, 5, 6, 12, 13 and 14, of its scenes or of any volume."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from splatgl.animation.camera_track import Turning, turning
from splatgl.annotations.contact_sheet import Panel, sheet
from splatgl.data.volume import Volume
from splatgl.scene.scene_file import Scene
from splatgl.scene.view import View
from splatgl.splat.camera import Camera
from splatgl.splat.extract import extract
from splatgl.splat.motion import Draw, Moments
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.truth.aliasing import Reach
from splatgl.truth.flicker import strip

VARIANTS = ("standard", "antialiased", "motion-blurred", "motion-blurred and antialiased")
ANTIALIAS = ("off", "paper")
# the terrain's default low view, in widths of a flat volume: eye beside and above it, and the target
LOW_EYE, LOW_HEIGHT, LOW_TARGET = 0.69, 0.49, -0.04
FLAT = 0.3
# background rows kept above and below the content
EMPTY = 8
# Fig. 14: enlargement of pixels
BLOCK = 5
BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)

Motioned = Callable[[Draw, Turning], Draw]


@dataclass(frozen=True)
class PictureFigure:
    """A rendered figure. source: its scene; size: of its images; times: enlargement of pixels; spin: degrees per frame;
    zoom: of its scene's own view; detail: enlargement of an additional detail.
    """

    number: int
    caption: str
    source: str
    size: int
    times: int = 1
    spin: float = 0.0
    frames: int = 2
    zoom: float = 1.0
    detail: int = 0
    background: tuple[float, float, float] = BLACK


_ALL = (
    PictureFigure(
        5,
        "A tunnel of checks, standard and antialiased; beyond the black line, at z_k, voxels are smaller than pixels.",
        "tunnel",
        160,
        times=3,
    ),
    PictureFigure(
        6,
        "A landscape, standard and antialiased; behind the black line, at z_k, voxels are smaller than pixels. Below: "
        "a part of each, enlarged.",
        "terrain",
        512,
        detail=4,
        background=WHITE,
    ),
    PictureFigure(
        12,
        "A nerve cell that turns, in four ways: standard, antialiased, motion-blurred, and both.",
        "nerve",
        320,
        spin=8.0,
        zoom=1.35,
    ),
    PictureFigure(
        13,
        "A landscape that turns, in four ways: standard, antialiased, motion-blurred, and both.",
        "terrain",
        320,
        spin=8.0,
        background=WHITE,
    ),
    PictureFigure(
        14,
        "The pixels from the middle of the picture up, of one frame after the other, of a landscape that turns; "
        "each pixel is 5×5 dots.",
        "terrain",
        256,
        times=BLOCK,
        spin=1.0,
        frames=80,
        background=WHITE,
    ),
)
PICTURES = {figure.number: figure for figure in _ALL}


@dataclass(frozen=True, eq=False)
class Shown:
    """A figure of a scene. blur: wraps a `Draw` with motion blur, for a rotating scene."""

    figure: PictureFigure
    scene: Scene
    draw: Draw
    blur: Motioned | None = None

    @cached_property
    def volume(self) -> Volume:
        """The scene's volume, read once."""
        return self.scene.open()

    @cached_property
    def splats(self) -> Splats:
        """The volume's splats, extracted once by the scene's transfer function and threshold."""
        transfer = self.scene.transfer_for(self.volume)
        return extract(self.volume, transfer, self.scene.threshold, classification="pre")

    @cached_property
    def track(self) -> Turning:
        """The scene's rotation for the figure; a figure of one frame has none."""
        return self.turned(self.figure.spin)

    def turned(self, spin: float) -> Turning:
        """The scene rotating by `spin` degrees per frame; a flat scene without its own view gets a low one."""
        view = self.scene.view
        if view == View(size=view.size) and _flat(self.volume):
            view = _low_view(self.volume, view.size)
        elif self.scene.volume == self.figure.source and self.figure.zoom != 1 and view.zoom is None:
            view = replace(view, zoom=self.figure.zoom)
        return turning(view, self.volume, self.splats, spin)

    @property
    def camera(self) -> Camera:
        """The camera of frame 0."""
        return self.track.camera(0)

    def settings(self, variant: int, blend: str = "composite") -> Settings:
        """Settings of one of the four variants of splats, by number; the rest are the scene's own."""
        ground = self.scene.settings.background or self.figure.background
        mine = {"classification": "auto", "antialias": ANTIALIAS[variant % 2], "blend": blend, "background": ground}
        return Settings.like("0.1", **{**self.scene.settings.given, **mine})

    def drawer(self, variant: int, track: Turning) -> Draw:
        """The draw function of a variant; the last two have motion blur."""
        return self.draw if variant < 2 or self.blur is None else self.blur(self.draw, track)

    @property
    def variants(self) -> range:
        """Numbers of the variants: 0 and 1, and with motion blur of a rotating scene 2 and 3."""
        return range(4 if self.blur is not None and self.figure.spin else 2)

    def strips(self, spin: float, frames: int) -> list[np.ndarray]:
        """Fig. 14's strips, one per variant."""
        track = self.turned(spin)
        cameras = [track.camera(n) for n in range(frames)]
        return [strip(self.drawer(v, track), self.splats, cameras, self.settings(v)) for v in self.variants]


def picture(shown: Shown) -> np.ndarray:
    """The figure, uint8 [H, W, 3]."""
    figure = shown.figure
    if figure.number == 14:
        strips = shown.strips(figure.spin, figure.frames)
        rows = _matter(strips, shown.settings(0).background or BLACK)
        panels = [Panel.of(s[rows], VARIANTS[v], figure.times) for v, s in enumerate(strips)]
        return sheet([panels[:2], panels[2:]] if len(panels) > 2 else [panels])
    still = Reach.of(shown.draw, shown.splats, shown.camera) if not figure.spin else None
    line = still.line(figure.times) if still else None
    camera = shown.track.camera(1 if figure.spin else 0)
    pictures = [shown.drawer(v, shown.track)(shown.splats, camera, shown.settings(v)).pixels for v in shown.variants]
    rows = _matter(pictures, shown.settings(0).background or BLACK)
    dots = slice(rows.start * figure.times, rows.stop * figure.times)
    panels = [
        Panel.of(p[rows], VARIANTS[v], figure.times, None if line is None else line[dots])
        for v, p in enumerate(pictures)
    ]
    lines = [panels[:2], panels[2:]] if len(panels) > 2 else [panels]
    if figure.detail:
        part = _most_changed(pictures[0], pictures[1], figure.detail)
        lines.append([Panel.of(p[part], "", figure.detail) for p in pictures])
    return sheet(lines)


def _matter(pictures: list[np.ndarray], ground: tuple[float, float, float]) -> slice:
    """Rows with content other than background, with a few rows of margin."""
    height = len(pictures[0])
    used = np.flatnonzero(sum((np.abs(p[..., :3] - ground) > 0.02).any(axis=(1, 2)) for p in pictures))
    if not len(used):
        return slice(0, height)
    return slice(max(int(used[0]) - EMPTY, 0), min(int(used[-1]) + EMPTY + 1, height))


def _most_changed(first: np.ndarray, second: np.ndarray, times: int) -> tuple[slice, slice]:
    """The region, 1/`times` of the image's sides, in which two images differ most."""
    changed = ((first - second)[..., :3] ** 2).sum(axis=-1).cumsum(axis=0).cumsum(axis=1)
    sums = np.pad(changed, ((1, 0), (1, 0)))
    # half as tall, as suits landscapes
    tall, wide = (max(n // times, 1) for n in (first.shape[0] // 2, first.shape[1]))
    within = sums[tall:, wide:] - sums[:-tall, wide:] - sums[tall:, :-wide] + sums[:-tall, :-wide]
    y, x = np.unravel_index(int(within.argmax()), within.shape)
    return slice(int(y), int(y) + tall), slice(int(x), int(x) + wide)


def by_moments(count: int, shutter: float = 180.0) -> Motioned:
    """Motion blur by the mean of `count` moments."""
    return lambda draw, track: Moments(draw, track.turn, shutter, count)


def _flat(volume: Volume) -> bool:
    """Whether a volume is a coloured terrain without view hints."""
    extent = np.ptp(volume.corners, axis=0)
    silent = volume.color is not None and volume.hints.eye is None
    return silent and bool(extent[2] < FLAT * min(extent[0], extent[1]))


def _low_view(volume: Volume, size: tuple[int, int]) -> View:
    """The built-in terrain's view, scaled to a volume of any width."""
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    width = float(high[0] - low[0])
    x, y = (float(m) for m in (low + high)[:2] / 2)
    eye = (x, float(low[1]) - LOW_EYE * width, float(low[2]) + LOW_HEIGHT * width)
    return View(size=size, eye=eye, look_at=(x, y, float(low[2]) + LOW_TARGET * width), fov=60.0)

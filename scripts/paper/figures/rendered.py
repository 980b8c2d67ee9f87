"""Figures 5, 6 and 12 to 14: rendered images."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from paper.aliasing import (
    Reach,
    aliasing_energy,
    differing_before,
    finer,
    flicker,
    mean_square,
    noise_ratio,
    popping,
    share_beyond,
    strip,
)
from paper.tables import TEXT_WIDTH, Table

from splatgl import __version__
from splatgl.animation.camera_track import TurntableTrack, turning
from splatgl.annotations.text import load_font
from splatgl.data.color import srgb_from_linear
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import check_output, check_source, write_file
from splatgl.geometry.camera import Camera
from splatgl.options import ValueKind, declared
from splatgl.planning.resolve import blur_form
from splatgl.scene.draw import DrawOptions
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.view import ViewOptions
from splatgl.splat.extract import extract
from splatgl.splat.motion import Draw, Supersampling, count_moments, streaks
from splatgl.splat.motion_blur import MOTIONS
from splatgl.splat.settings import FULL_SHUTTER, MAX_MOMENTS, Attenuation, Blend, Settings
from splatgl.splat.splats import Splats

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer


# configurations for aliasing: blend mode, kernel, and attenuations beyond z_k, of which X-rays have one
KINDS: tuple[tuple[Blend, str, tuple[Attenuation, ...]], ...] = (
    ("xray", "crawfis-max", ("auto",)),
    ("xray", "gaussian", ("auto",)),
    ("composite", "crawfis-max", ("opacity", "optical-depth", "fill")),
)
# rotations per frame for flicker, degrees; and the number of frames for figures that are not strips
PACES, FRAMES = (1.0, 5.0), 24
# moments of the reference
TIMES = 16

Rows = Iterator[tuple[str, str, str]]


def metrics(shown: RenderedFigure) -> Table:
    """Metrics of the figure."""
    return Table(("what", "value", "against standard"), tuple(_measure(shown)))


def _measure(shown: RenderedFigure) -> Rows:
    yield "beyond z_k", f"{100 * share_beyond(shown.splats, shown.camera):.1f} % of {len(shown.splats)} splats", ""
    if shown.figure.number != 14:
        yield from _measure_still(shown)
    if shown.figure.spin:
        if shown.blur is not None:
            yield from _measure_blur(shown)
        yield from _measure_motion(shown)


def _measure_still(shown: RenderedFigure) -> Rows:
    """Aliasing beyond z_k, error against the supersampled image, and pixels that are unchanged."""
    draw, splats, camera = shown.draw, shown.splats, shown.camera
    reach = Reach.of(draw, splats, camera)
    window = reach.window()
    for blend, kernel, ways in shown.kinds:
        off = shown.settings(0, blend).replace(background=None, kernel=kernel)
        right = draw(splats, camera, off.replace(antialias="supersample"))
        variants = {"standard": off}
        for way in ways:
            name = f"antialiased ({way})" if len(ways) > 1 else "antialiased"
            variants[name] = off.replace(antialias="paper", attenuation=way)
        standard: dict[str, float] = {}
        for name, settings in variants.items():
            errors = {
                "aliasing energy": aliasing_energy(finer(draw, splats, camera, settings), window),
                "mean squared error": mean_square(draw(splats, camera, settings), right, reach.beyond),
            }
            for metric, value in errors.items():
                ratio = _ratio(standard[metric], value) if standard else ""
                yield f"{blend}, {kernel}: {metric}, {name}", f"{value:.3e}", ratio
            standard = standard or errors
        if blend == "xray":
            noise = f"÷ {noise_ratio(splats, camera, kernel):.2f}"
            yield f"{blend}, {kernel}: aliasing energy, noise at these depths", "by the kernel's spectrum", noise
    # quads: tiles end behind opaque splats, which rounds the same sums otherwise
    before = shown.settings(1).replace(background=None, technique="quads")
    changed, count = differing_before(draw, splats, camera, before)
    yield "before z_k: pixels that antialiasing changes", f"{changed} of {count}", ""


def _measure_motion(shown: RenderedFigure) -> Rows:
    """Figs. 12 to 14: flicker over the rotation, popping."""
    for spin in dict.fromkeys((*PACES, shown.figure.spin)):
        frames = shown.figure.frames if shown.figure.number == 14 else FRAMES
        variances = [flicker(strip) for strip in shown.strips(spin, frames)]
        for v, value in enumerate(variances):
            what = f"variance of frame differences at {spin:g}°: ({'abcd'[v]})"
            yield what, f"{value:.3e}", _ratio(variances[0], value)
    track = shown.turned(1.0)
    for pop in popping(shown.draw, shown.splats, track.camera, shown.settings(1)):
        what = f"popping: largest change in 0.01° at {pop.angle:.2f}°, where the order changes"
        yield what, f"{pop.change:.3f}", f"{pop.usual:.3f} beside it"


def _measure_blur(shown: RenderedFigure) -> Rows:
    """Energy of X-rays and errors of the four variants at 4×4 samples a pixel, against the mean of many moments."""
    splats, camera, turn = shown.splats, shown.track.camera(1), shown.track.turn
    paths = streaks(splats, camera, turn, shown.figure.shutter)
    longest = float(paths.pixels(splats.grid.mean_spacing).max(initial=0.0))
    yield (
        f"longest path at {shown.figure.spin:g}° a frame, shutter {shown.figure.shutter:g}°",
        f"{longest:.1f} pixels",
        "",
    )
    many = Supersampling(shown.draw, turn, shown.figure.shutter, TIMES)
    sums = shown.settings(1, "xray").replace(background=None)
    energy, right = (
        float(draw(splats, camera, sums).pixels[..., 3].sum(dtype=np.float64))
        for draw in (shown.drawer(3, shown.track), many)
    )
    yield f"energy of blurred splats, X-ray, by that of {TIMES} moments", f"{energy / right:.6f}", ""
    truth = many(splats, camera, shown.settings(1).replace(antialias="supersample"))
    everywhere = np.ones(camera.size[::-1], dtype=bool)
    errors = [
        mean_square(shown.drawer(v, shown.track)(splats, camera, shown.settings(v)), truth, everywhere)
        for v in shown.variants
    ]
    for v, error in enumerate(errors):
        what = f"mean squared error against 4×4 samples, {TIMES} moments: ({'abcd'[v]})"
        yield what, f"{error:.3e}", _ratio(errors[0], error)


def _ratio(standard: float, value: float) -> str:
    return f"÷ {standard / value:.2f}" if value > 0 else ""


MAX_FRAMES = 10_000
# options of the scene, and those of rendered figures only
CHOSEN = ("color", "kernel", "paper")
ONLY = ("source", "color", "size", "spin", "frames", "motion", "moments", "shutter", "kernel", "paper")


def add_pictures(parser: argparse.ArgumentParser) -> None:
    """Adds the source and the options of the rendered figures."""
    names = " ".join(map(str, PICTURES))
    parser.add_argument("source", nargs="?", metavar="SOURCE", help=f"{names}: a volume or scene.toml for the paper's")
    group = parser.add_argument_group(f"rendered figures ({names})")
    group.add_argument("--color", metavar="PICTURE", help="colour picture laid over a height map")
    group.add_argument("--size", type=ValueKind.picture_size().parse, metavar="W×H", help="pixels of each picture")
    kind = declared(Settings)["kernel"].kind
    group.add_argument("--kernel", type=kind.parse, metavar=kind.metavar, help="kernel of each voxel")
    about = "the hardware path of 1998: hybrid, 8-bit table and target"
    group.add_argument("--paper", action="store_const", const=True, help=about)
    group.add_argument("--spin", type=float, metavar="DEG", help="12, 13, 14: degrees a frame")
    group.add_argument("--frames", type=int, metavar="N", help="14: how many frames")
    group.add_argument("--motion", choices=MOTIONS, metavar="|".join(MOTIONS), help="12, 13, 14: blur by streaks")
    group.add_argument("--moments", type=int, metavar="N", help="12, 13, 14: blur by N pictures instead; 0: none")
    about = f"12, 13, 14: exposure in degrees, 360 being a whole frame (default {FULL_SHUTTER:g}, the paper's streak)"
    group.add_argument("--shutter", type=float, metavar="DEG", help=about)


def check_no_options(args: argparse.Namespace) -> None:
    """Raises InputError for an option of rendered figures."""
    given = [name for name in ONLY if getattr(args, name) is not None]
    if given:
        names = ", ".join(map(str, PICTURES))
        raise expected(f"figure {args.number}", "no picture options", given[0], f"they are for {names}")


def run_picture(args: argparse.Namespace) -> int:
    """Draws, writes or prints one rendered figure; returns 0."""
    figure = _with_options(PICTURES[int(args.number)], args)
    output = Path(args.output or f"figure{figure.number}.png")
    is_drawn, scene = bool(args.output) or not args.numbers, _scene(figure, args)
    if is_drawn:
        check_output(output, (".png",))
        check_source(output, args.source, *scene.files)
    with DrawOptions().renderer() as renderer:
        shown = RenderedFigure(figure, scene, renderer.render, _blur(renderer, args, figure.shutter))
        about = _about(figure, args, shown)
        if is_drawn:
            write_file(output, encode_sheet(picture(shown), about, f"splatgl {__version__}"))
            print(f"{output}:")
        print(fill(f"Figure {figure.number}. {about}", TEXT_WIDTH))
        if args.numbers:
            print(f"\n{metrics(shown).text()}")
    return 0


def _blur(renderer: Renderer, args: argparse.Namespace, shutter: float) -> Motioned | None:
    """Motion blur: streaks if requested, and by default for sums, where they are exact; else the mean of the
    requested number of images, or of as many as the path lengths need. None for 0 images.
    """
    if args.moments is not None:
        return by_moments(args.moments, shutter) if args.moments else None

    def blurred(draw: Draw, track: TurntableTrack) -> Draw:
        def draw_blurred(splats: Splats, camera: Camera, settings: Settings) -> Image:
            # the paper's settings streak
            default = "paper" if args.paper else "auto"
            settings = settings.replace(motion=args.motion or default, shutter=shutter)
            if blur_form(splats, settings) == "moments":
                # a strip's view is narrow: use the count for the whole image
                whole = replace(camera, size=(camera.size[1], camera.size[1]))
                settings = settings.replace(moments=count_moments(splats, whole, track.turn, shutter))
            return renderer.render(splats, camera, settings, track.turn)

        return draw_blurred

    return blurred


def _with_options(figure: PictureFigure, args: argparse.Namespace) -> PictureFigure:
    """The figure with the options applied. Raises InputError for invalid ones."""
    turns = figure.spin != 0
    for name in ("spin", "frames", "motion", "moments", "shutter"):
        if getattr(args, name) is not None and not (figure.number == 14 if name == "frames" else turns):
            raise expected(f"figure {figure.number}", f"no --{name}", getattr(args, name))
    if args.frames is not None and not 2 <= args.frames <= MAX_FRAMES:
        raise expected("--frames", f"a whole number from 2 to {MAX_FRAMES}", args.frames)
    if args.moments is not None and args.motion is not None:
        raise expected(f"figure {figure.number}", "one of --motion and --moments", "both")
    if args.moments is not None and not 0 <= args.moments <= MAX_MOMENTS:
        raise expected("--moments", f"a whole number from 0 to {MAX_MOMENTS}", args.moments)
    if args.spin is not None and not 0 < abs(args.spin) <= 360:
        raise expected("--spin", "an angle up to 360 degrees, not 0", args.spin)
    if args.shutter is not None and not 0 < args.shutter <= FULL_SHUTTER:
        raise expected("--shutter", "an angle up to 360 degrees, not 0", args.shutter)
    given = {name: getattr(args, name) for name in ("spin", "frames", "shutter") if getattr(args, name)}
    return replace(figure, **given)


def _scene(figure: PictureFigure, args: argparse.Namespace) -> SceneFile:
    """The requested scene or the paper's; a scene.toml overrides the figure's view and settings."""
    source = args.source or figure.source
    scene = SceneFile(source, view=ViewOptions(size=args.size or (figure.size, figure.size)))
    if Path(source).suffix == ".toml":
        scene = SceneFile.from_toml(Path(source))
        scene = replace(scene, view=replace(scene.view, size=args.size)) if args.size else scene
    return scene.with_options(**{name: value for name in CHOSEN if (value := getattr(args, name)) is not None})


def _about(figure: PictureFigure, args: argparse.Namespace, shown: RenderedFigure) -> str:
    """The caption, and what differs from it."""
    here = [shown.volume.name] if args.source is not None else []
    here += [f"kernel {args.kernel}"] if args.kernel is not None else []
    here += ["by the hardware path of 1998"] if args.paper else []
    return f"{shown.caption} Here: {', '.join(here)}." if here else shown.caption


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

Motioned = Callable[[Draw, TurntableTrack], Draw]


@dataclass(frozen=True)
class PictureFigure:
    """A rendered figure. source: its scene; size: of its images; times: enlargement of pixels; spin: degrees per
    frame; zoom: of its default scene; detail: enlargement of an additional detail; shutter: in degrees, 360 from one
    frame's time to the next, as the paper's streaks.
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
    shutter: float = FULL_SHUTTER
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
        spin=3.0,
        frames=80,
        background=WHITE,
    ),
)
PICTURES = {figure.number: figure for figure in _ALL}


@dataclass(frozen=True, eq=False)
class RenderedFigure:
    """A figure of a scene. blur: wraps a `Draw` with motion blur, for a rotating scene."""

    figure: PictureFigure
    scene: SceneFile
    draw: Draw
    blur: Motioned | None = None

    @property
    def caption(self) -> str:
        """The figure's caption, with the rotation and the shutter of its motion blur."""
        spin, shutter = self.figure.spin, self.figure.shutter
        turns = f" {spin:g}° a frame, shutter {shutter:g}°." if spin and self.blur else ""
        return self.figure.caption + turns

    @cached_property
    def volume(self) -> Volume:
        """Volume of the scene, read once."""
        return self.scene.open()

    @cached_property
    def splats(self) -> Splats:
        """The volume's splats, extracted once by the scene's transfer function and threshold."""
        transfer = self.scene.transfer_for(self.volume)
        return extract(self.volume, transfer, self.scene.threshold, classification="pre")

    @cached_property
    def track(self) -> TurntableTrack:
        """The scene's rotation for the figure; a figure of one frame has none."""
        return self.turned(self.figure.spin)

    def turned(self, spin: float) -> TurntableTrack:
        """The scene rotating by `spin` degrees per frame; a flat scene without a view gets a low one."""
        view = self.scene.view
        low = _low_view(self.volume, view.size) if view == ViewOptions(size=view.size) else None
        if low is not None:
            view = low
        elif self.scene.volume == self.figure.source and self.figure.zoom != 1 and view.zoom is None:
            view = replace(view, zoom=self.figure.zoom)
        return turning(view, self.volume, self.splats, spin)

    @property
    def camera(self) -> Camera:
        """The camera of frame 0."""
        return self.track.camera(0)

    def settings(self, variant: int, blend: str = "composite") -> Settings:
        """Settings of one of the four variants, by number; the rest are the scene's."""
        ground = self.scene.settings.ground or self.figure.background
        changes = {"classification": "auto", "antialias": ANTIALIAS[variant % 2], "blend": blend, "background": ground}
        return Settings.like("0.1", **{**self.scene.settings.given, **changes})

    @property
    def kinds(self) -> tuple[tuple[Blend, str, tuple[Attenuation, ...]], ...]:
        """KINDS, or those of the scene's kernel."""
        kernel = self.scene.settings.kernel
        return KINDS if kernel == "auto" else tuple((blend, kernel, ways) for blend, _, ways in KINDS[::2])

    def drawer(self, variant: int, track: TurntableTrack) -> Draw:
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


def picture(shown: RenderedFigure) -> np.ndarray:
    """The figure, uint8 [H, W, 3]."""
    figure = shown.figure
    if figure.number == 14:
        pictures = shown.strips(figure.spin, figure.frames)
    else:
        camera = shown.track.camera(1 if figure.spin else 0)
        pictures = [
            shown.drawer(v, shown.track)(shown.splats, camera, shown.settings(v)).pixels for v in shown.variants
        ]
    rows = _content_rows(pictures, shown.settings(0).ground or BLACK)
    line = None
    if not figure.spin:
        dots = slice(rows.start * figure.times, rows.stop * figure.times)
        line = Reach.of(shown.draw, shown.splats, shown.camera).line(figure.times)[dots]
    panels = [(enlarge(p[rows], figure.times, line), VARIANTS[v]) for v, p in enumerate(pictures)]
    lines = [panels[:2], panels[2:]] if len(panels) > 2 else [panels]
    if figure.detail:
        part = _find_largest_change(pictures[0], pictures[1], figure.detail)
        lines.append([(enlarge(p[part], figure.detail), "") for p in pictures])
    return sheet(lines)


def _content_rows(pictures: list[np.ndarray], ground: tuple[float, float, float]) -> slice:
    """Rows with content other than background, with a few rows of margin."""
    height = len(pictures[0])
    used = np.flatnonzero(sum((np.abs(p[..., :3] - ground) > 0.02).any(axis=(1, 2)) for p in pictures))
    if not len(used):
        return slice(0, height)
    return slice(max(int(used[0]) - EMPTY, 0), min(int(used[-1]) + EMPTY + 1, height))


def _find_largest_change(first: np.ndarray, second: np.ndarray, times: int) -> tuple[slice, slice]:
    """The region, 1/`times` of the image's sides, in which two images differ most."""
    changed = ((first - second)[..., :3] ** 2).sum(axis=-1).cumsum(axis=0).cumsum(axis=1)
    sums = np.pad(changed, ((1, 0), (1, 0)))
    # half as tall, as suits landscapes
    tall, wide = (max(n // times, 1) for n in (first.shape[0] // 2, first.shape[1]))
    within = sums[tall:, wide:] - sums[:-tall, wide:] - sums[tall:, :-wide] + sums[:-tall, :-wide]
    y, x = np.unravel_index(int(within.argmax()), within.shape)
    return slice(int(y), int(y) + tall), slice(int(x), int(x) + wide)


def by_moments(count: int, shutter: float = FULL_SHUTTER) -> Motioned:
    """Motion blur by the mean of `count` moments."""
    return lambda draw, track: Supersampling(draw, track.turn, shutter, count)


def _low_view(volume: Volume, size: tuple[int, int]) -> ViewOptions | None:
    """The built-in terrain's view, scaled to any coloured terrain without view hints; None for other volumes."""
    low, high = volume.corners.min(axis=0), volume.corners.max(axis=0)
    width, depth, height = (high - low).tolist()
    if volume.color is None or volume.hints.eye is not None or height >= FLAT * min(width, depth):
        return None
    (_, front, bottom), (x, y, _) = low.tolist(), ((low + high) / 2).tolist()
    eye = (x, front - LOW_EYE * width, bottom + LOW_HEIGHT * width)
    return ViewOptions(size=size, eye=eye, look_at=(x, y, bottom + LOW_TARGET * width), fov=60.0)


# sizes in sheet pixels: gap between panels, outer margin, text height and its least, gap between lines, and room for a
# line below a panel
GAP, MARGIN, TEXT, LEAST_TEXT, SPACING, ROOM = 12, 10, 15, 11, 3, 26
PAPER, INK = (255, 255, 255), (0, 0, 0)


def enlarge(pixels: np.ndarray, times: int, line: np.ndarray | None = None) -> np.ndarray:
    """uint8 sRGB of linear [H, W, 3 or 4], enlarged times × times; line: enlarged pixels drawn black, edged white."""
    from PIL import Image, ImageFilter

    shown = np.rint(srgb_from_linear(np.clip(pixels[..., :3], 0.0, 1.0)) * 255).astype(np.uint8)
    shown = np.repeat(np.repeat(shown, times, axis=0), times, axis=1)
    if line is not None:
        shown[np.asarray(Image.fromarray(line.astype(np.uint8)).filter(ImageFilter.MaxFilter(3))) > 0] = PAPER
        shown[line] = INK
    return shown


def wrapped(text: str, width: float, size: int) -> list[str]:
    """The text in lines of at most `width` pixels in a font of that size, each of one word at least."""
    font, lines = load_font(size), [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if not lines[-1] or font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def sheet(rows: Sequence[Sequence[tuple[np.ndarray, str]]]) -> np.ndarray:
    """uint8 [H, W, 3]: rows of pictures with captions, lettered (a), (b), … in reading order. Captions are wrapped to
    their pictures in a font in which each word fits, if there is one; else pictures stand farther apart.
    """
    from PIL import Image, ImageDraw

    letters = iter("abcdefghijklmnop")
    titled = [[(shown, f"({next(letters)}) {words}" if words else "") for shown, words in row] for row in rows]

    def cells(size: int) -> list[list[tuple[np.ndarray, list[str], int]]]:
        """Pictures, lines, and the width that both take."""
        measure, found = load_font(size).getlength, list[list[tuple[np.ndarray, list[str], int]]]()
        for row in titled:
            lines = [wrapped(words, shown.shape[1], size) for shown, words in row]
            wide = [
                max(shown.shape[1], *map(ceil, map(measure, text))) for (shown, _), text in zip(row, lines, strict=True)
            ]
            found.append([(shown, text, width) for (shown, _), text, width in zip(row, lines, wide, strict=True)])
        return found

    widest = [[shown.shape[1] for shown, _ in row] for row in titled]
    sizes = range(TEXT, LEAST_TEXT, -1)
    size = next((n for n in sizes if [[wide for *_, wide in row] for row in cells(n)] == widest), LEAST_TEXT)
    chosen, step, font = cells(size), size + SPACING, load_font(size)
    rooms = [ROOM + step * (max(len(lines) for _, lines, _ in row) - 1) for row in chosen]
    width = max(sum(wide + GAP for *_, wide in row) - GAP for row in chosen) + 2 * MARGIN
    heights = [max(len(shown) for shown, *_ in row) for row in chosen]
    page = Image.new("RGB", (width, sum(heights) + sum(rooms) + GAP * (len(rows) - 1) + 2 * MARGIN), PAPER)
    pen, top = ImageDraw.Draw(page), MARGIN
    for row, tall, room in zip(chosen, heights, rooms, strict=True):
        left = MARGIN
        for shown, lines, wide in row:
            page.paste(Image.fromarray(shown), (left, top))
            for n, line in enumerate(lines):
                pen.text((left + wide / 2, top + tall + ROOM / 2 + n * step), line, INK, font=font, anchor="mm")
            left += wide + GAP
        top += tall + room + GAP
    return np.asarray(page)


def encode_sheet(page: np.ndarray, about: str, maker: str) -> bytes:
    """A PNG with its description in the metadata."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    buffer, info = io.BytesIO(), PngInfo()
    info.add_itxt("Description", about)
    info.add_text("Software", maker)
    Image.fromarray(page).save(buffer, "PNG", pnginfo=info)
    return buffer.getvalue()

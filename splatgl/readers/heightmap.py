"""Terrain: turns a height map (picture or CSV), with or without a colour picture, into columns of voxels.

The picture's row 0 is the far, northern edge, so that y = H − 1 − row; a CSV's row 0 is the southern edge, y = 0.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from splatgl.data.fills import custom_fills, format_numbers
from splatgl.data.volume import AxisCoordinate, Hints, Volume
from splatgl.errors import expected
from splatgl.fileio import require_memory
from splatgl.readers.channels import mark_microscope, split_colors
from splatgl.readers.common import decoder_errors, parse_number, require_plausible
from splatgl.readers.options import DEFAULT_LEVELS, LoadOptions

# most voxels of a terrain, a byte each: a map of 6400 × 6400 in 103 levels
MAX_VOXELS = 4 * 2**30
# bytes of a column besides its voxels: its heights and colour as they are read, and in float64
PER_COLUMN = 24
# supported formats of pictures; Pillow's others run programs or are recognized by guessing
PICTURES = ("PNG", "JPEG", "TIFF", "BMP", "GIF", "WEBP", "PPM")
# of a camera's dark background: least share, least ratio of second to first differences (noise: 1.7), least side
DARK, NOISY, DARK_LEAST = 0.5, 1.2, 16
# sample of a voxel at or below the ground; 0 above it
SOLID = 255
# levels below the visible surface: its gradients and opacity need matter behind it
SHELL = 3
# default relief as a part of the longer side: cubic voxels for the 512 × 512 × 103 terrain of [M98]
RELIEF = (DEFAULT_LEVELS - 1) / 512
# sRGB of lowland, meadow, steppe, rock and snow: what is drawn where no colour picture is given
_TINTS = np.array([[64, 104, 60], [122, 143, 79], [176, 158, 106], [142, 112, 86], [244, 244, 244]], np.float64)
# metres of a degree of latitude on a sphere
DEGREE = 6_371_000 * np.pi / 180

HEIGHTS = re.compile(
    r"(?<![a-z])(dem|dtm|dsm|srtm|aster|lidar|heights?|heightmap|elev(ation)?|terrain|relief|topo(graphy)?|bathy(metry)?)"
)
# words in the names of height maps, and of a microscope's pictures
PLANES = re.compile(
    r"(?<![a-z])(dapi|hoechst|[emy]?gfp|[ry]fp|mcherry|fitc|tritc|cy[357]|fluo\w*|confocal|widefield|brightfield|stained)"
)

_HINTS = Hints(
    window=(0.0, float(SOLID)),
    points=((SOLID / 2 - 0.5, 0.0), (SOLID / 2 + 0.5, 1.0)),
    shading=True,
    azimuth=25.0,
    elevation=35.0,
)


@dataclass(frozen=True)
class HeightMetadata:
    """Metadata of a height map. step: widths of a pixel along x and y in `unit`, None if unknown. missing: number for
    no data. Heights are slope · stored + offset. notes: on assumptions. is_south_first: whether row 0 is the southern.
    """

    step: tuple[float, float] | None = None
    unit: str = ""
    missing: float | None = None
    slope: float = 1.0
    offset: float = 0.0
    notes: tuple[str, ...] = ()
    is_south_first: bool = False


def terrain_from_heights(
    heights: np.ndarray, color: np.ndarray | None = None, levels: int = DEFAULT_LEVELS, relief: float | None = None
) -> Volume:
    """A volume [levels, H, W] of uint8: 255 at the ground, 0 above and deep below; z is up, voxels are 1 wide.

    Columns reach below the lowest neighbour, so that there are no gaps, and to the bottom at the map's edge.

    heights: [H, W] real numbers, row 0 at y = 0; NaN and infinite ones are holes. color: uint8 [H', W', 3] sRGB, row 0
    at y = 0, resampled to the grid; default: tinted by height. relief: world height from the lowest to the highest
    column. Raises InputError for heights that make no terrain.
    """
    # 1. heights in voxel levels; −1 for a hole
    if heights.ndim != 2 or min(heights.shape) < 1 or heights.dtype.kind not in "buif":
        raise expected("heights", "a 2-D map of real numbers", f"{heights.dtype} {heights.shape}")
    _check_voxels(heights.shape[1], heights.shape[0], levels)
    parts = _normalize_heights(np.asarray(heights, dtype=np.float64))
    tops = np.where(np.isfinite(parts), np.rint(parts * (levels - 1)), -1).astype(np.int32)
    # 2. the ground's shell, level by level; one colour per column, shared by its voxels
    samples = np.empty((levels, *heights.shape), np.uint8)
    floor = _lowest_levels(tops)
    for level in range(levels):
        np.multiply((tops >= level) & (floor <= level), np.uint8(SOLID), out=samples[level])
    if color is None:
        stops = np.linspace(0, 1, len(_TINTS))
        tints = [np.interp(np.nan_to_num(parts), stops, channel) for channel in _TINTS.T]
        ground = np.rint(np.stack(tints, axis=-1)).astype(np.uint8)
    else:
        ground = _resize_color(color, heights.shape)
    # 3. the grid
    relief = relief or RELIEF * max(heights.shape)
    return Volume(
        samples,
        spacing=(1.0, 1.0, relief / (levels - 1)),
        color=np.broadcast_to(ground, (*samples.shape, 3)),
        hints=_HINTS,
    )


def _check_voxels(width: int, height: int, levels: int) -> None:
    voxels = width * height * levels
    if voxels > MAX_VOXELS:
        got = f"{voxels} ({width}x{height}x{levels})"
        raise expected("terrain", f"at most {MAX_VOXELS} voxels", got, "use a smaller map or fewer levels")


def _check_columns(path: Path, width: int, height: int, levels: int) -> None:
    """Raises InputError for too many columns, since a small file may hold a large empty map."""
    require_plausible(width * height * min(levels, DEFAULT_LEVELS), path.stat().st_size, bounded=False)
    _check_voxels(width, height, levels)
    require_memory(width * height * (levels + PER_COLUMN), path.stat().st_size, "use a smaller map or fewer levels")


def read_picture(path: Path, options: LoadOptions) -> Volume:
    """The terrain of a grey picture of heights (8 or 16 bits or float, bright is high), or a microscope's plane."""
    flat = options.values in ("labels", "amounts") or (options.values is None and PLANES.search(path.name.lower()))
    # before it is decoded: a small file may hold a large map
    pixels = open_picture(path, 1 if flat else options.levels)
    is_map, note = classify_picture(path, pixels, options)
    volume = make_terrain(path, grey_heights(pixels), options) if is_map else mark_microscope(make_plane(pixels))
    return replace(volume, notes=(*volume.notes, *([note] if note else [])))


def read_csv(path: Path, options: LoadOptions) -> Volume:
    """The terrain of a table of comma-separated heights, the first line at y = 0; empty cells are holes."""
    with decoder_errors("a CSV table of heights"):
        try:
            with path.open(encoding="utf-8-sig", errors="replace") as file:
                heights = np.loadtxt(file, delimiter=",", ndmin=2, dtype=np.float64)
        except ValueError:
            heights = _parse_rows(path)
    if options.values in ("labels", "amounts"):
        return Volume(heights[None])
    return make_terrain(path, heights[::-1], options)


def _parse_rows(path: Path) -> np.ndarray:
    """The numbers of a table with empty cells, NaN there."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        rows = [[cell.strip().lower() for cell in line.split(",")] for line in file if line.strip()]
    none = ("", "na", "n/a", "nan", "null", "none", "-", "nodata")
    text = next((cell for row in rows for cell in row if cell not in none and parse_number(cell, None) is None), None)
    if text is not None:
        raise expected("table", "heights, a row in each line", repr(text[:40]), "leave out titles; save points as .ply")
    return np.array([[np.nan if cell in none else float(cell) for cell in row] for row in rows])


def make_terrain(path: Path, rows: np.ndarray, options: LoadOptions, survey: HeightMetadata | None = None) -> Volume:
    """The terrain of heights [H, W], row 0 the northern edge, with holes for missing ones, sized by the survey."""
    _check_columns(path, rows.shape[1], rows.shape[0], options.levels)
    color, survey = _load_color(options), survey or HeightMetadata()
    if options.relief is not None and options.spacing is not None:
        raise expected("relief", "no value beside spacing, whose z is the height of a level", options.relief)
    values, new_notes = _mask_missing(rows if survey.is_south_first else rows[::-1], survey.missing)
    values = values * survey.slope + survey.offset
    volume = terrain_from_heights(values, color, options.levels, options.relief)
    notes = (*survey.notes, *new_notes)
    least, most = float(np.nanmin(values)), float(np.nanmax(values))
    spacing = volume.spacing
    if survey.step is not None:
        relief = options.relief or most - least or min(survey.step)
        spacing = (*survey.step, relief / (options.levels - 1))
    height = AxisCoordinate("height", survey.unit, (most - least) / (spacing[2] * (options.levels - 1)), least)
    axes = (AxisCoordinate("x", survey.unit), AxisCoordinate("y", survey.unit), height)
    return replace(volume, spacing=spacing, unit=survey.unit, notes=notes, axes=axes)


def _mask_missing(heights: np.ndarray, missing: float | None) -> tuple[np.ndarray, list[str]]:
    """Heights in float64, NaN for missing ones; a note on these."""
    values = np.asarray(heights, np.float64)
    kind = heights.dtype
    if missing is not None:
        # rounded as the file's type rounds it
        same = np.float64(np.float32(missing)) if kind == np.float32 else missing
        holes, why = np.isin(values, (missing, same)), f"no data ({missing:g})"
    else:
        fills = custom_fills(np.sort(values[np.isfinite(values)]))[0]
        holes, why = np.isin(values, fills), f"{format_numbers(fills)}, the usual mark of missing data,"
    holes &= np.isfinite(values)
    count = int(np.count_nonzero(holes))
    values = np.where(holes, np.nan, values)
    notes = [f"{count:,} of {values.size:,} heights are {why} and left out"] if count else []
    return values, notes


def make_plane(pixels: np.ndarray) -> Volume:
    """One plane of a picture [H, W] or of colours [H, W, 3…4], row 0 at y = 0, as thick as a pixel is wide."""
    if pixels.ndim == 2:
        return Volume(pixels[None])
    if pixels.ndim == 3 and pixels.shape[-1] in (1, 2):
        return Volume(pixels[None, ..., 0])
    if pixels.ndim != 3 or pixels.shape[-1] > 4 or pixels.dtype not in (np.uint8, np.uint16):
        raise expected("picture", "grey, or colours of 8 or 16 bits", f"{pixels.dtype} {pixels.shape}")
    samples, color = split_colors(pixels[None])
    return Volume(samples, color=color)


def classify_picture(path: Path, pixels: np.ndarray, options: LoadOptions, surveyed: bool = False) -> tuple[bool, str]:
    """Whether a single picture is a height map, else a plane; and a note on the choice, "" if options decide.

    A survey and terrain options mean heights; then the file's name decides; a dark and noisy background means a plane.
    """
    file_name = path.name.lower()
    if options.values is not None:
        return options.values == "heights", ""
    if surveyed or options.color is not None or options.relief is not None or options.levels != DEFAULT_LEVELS:
        return True, ""
    plane = not HEIGHTS.search(file_name) and bool(PLANES.search(file_name) or _is_dark(pixels))
    if plane:
        return False, "a single picture is rendered as a plane; --values heights renders it as a terrain"
    return True, "a single picture is rendered as a terrain; --values amounts renders it as a plane"


def _is_dark(pixels: np.ndarray) -> bool:
    """Whether most of a grey picture is a camera's dark noise; low land and sea are even or smooth instead."""
    if pixels.ndim != 2 or min(pixels.shape) < DARK_LEAST:
        return False
    values = np.asarray(pixels, np.float64)
    if not np.isfinite(values).all():
        return False
    low, high = np.percentile(values, (0.1, 99.9))
    dark = values < low + (high - low) / 10
    three = dark[:, 2:] & dark[:, 1:-1] & dark[:, :-2]
    if high <= low or dark.mean() < DARK or not three.any():
        return False
    bends, slopes = np.abs(np.diff(values, 2, axis=1))[three], np.abs(values[:, 2:] - values[:, :-2])[three]
    # for noise, √6 to √2 times its deviation
    return float(bends.mean()) > NOISY * float(slopes.mean())


def grey_heights(pixels: np.ndarray) -> np.ndarray:
    """Heights [H, W] of a grey picture [H, W] or [H, W, 2…4]. Raises InputError if its channels differ."""
    if pixels.ndim == 2:
        return pixels
    colors = pixels[..., :3] if pixels.shape[-1] > 2 else pixels[..., :1]
    if pixels.ndim != 3 or (colors != colors[..., :1]).any():
        raise expected("height map", "a grey picture", "colours", "give heights first and the picture as color=")
    return colors[..., 0]


def _load_color(options: LoadOptions) -> np.ndarray | None:
    """The colour picture uint8 [H, W, 3], flipped so that row 0 is at y = 0; None without one."""
    if options.color is None:
        return None
    picture = Path(options.color)
    if not picture.is_file():
        raise expected("color", "a picture", f"nothing named {str(picture)!r}", "check its path")
    return open_picture(picture, 1, as_color=True)[::-1]


def open_picture(path: Path, levels: int, as_color: bool = False) -> np.ndarray:
    """The stored pixels of a picture; palettes become RGB. levels: voxels per pixel, for the limit of size."""
    from PIL import Image

    # from memory: Pillow allocates any chunk length stated in a file
    data = io.BytesIO(path.read_bytes())
    with decoder_errors(f"a picture ({path.name})"), Image.open(data, formats=PICTURES) as picture:
        _check_columns(path, picture.width, picture.height, levels)
        if as_color or picture.mode in ("P", "PA", "CMYK", "YCbCr", "LAB", "HSV"):
            return np.asarray(picture.convert("RGB"))
        return np.asarray(picture)


def _lowest_levels(tops: np.ndarray) -> np.ndarray:
    """int32 [H, W]: the lowest level of each column that is visible from above the ground, less SHELL."""
    padded = np.pad(tops, 1, constant_values=-1)
    height, width = tops.shape
    around = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.minimum.reduce(around)) - SHELL


def _normalize_heights(heights: np.ndarray) -> np.ndarray:
    """Heights from 0 (lowest) to 1 (highest); NaN for missing ones."""
    finite = heights[np.isfinite(heights)]
    if finite.size == 0:
        raise expected("heights", "at least one finite number", "none")
    # halved, so that the range of float64 itself does not overflow
    low, high = float(finite.min()) / 2, float(finite.max()) / 2
    return np.where(np.isfinite(heights), (heights / 2 - low) / ((high - low) or 1.0), np.nan)


def _resize_color(color: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A picture resampled to [H, W, 3]: area averages where it shrinks, Lanczos where it grows."""
    from PIL import Image

    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise expected("color", "uint8 [H, W, 3]", f"{color.dtype} {color.shape}")
    height, width = shape
    if color.shape[:2] == (height, width):
        return color
    shrinks = color.shape[0] >= height and color.shape[1] >= width
    method = Image.Resampling.BOX if shrinks else Image.Resampling.LANCZOS
    return np.asarray(Image.fromarray(np.ascontiguousarray(color)).resize((width, height), method))

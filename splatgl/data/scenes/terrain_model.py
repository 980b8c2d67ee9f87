"""Synthetic terrain: noise shaped by hydraulic erosion, coloured like a satellite image.  [M98 Fig. 6]"""

from __future__ import annotations

import numpy as np

from splatgl.coercion import public
from splatgl.data.volume import Hints, Volume

# voxels along z, y, x
TERRAIN_SHAPE = (103, 512, 512)
# cell size of the erosion grid in voxels, and number of iterations
CELL, ROUNDS = 2, 40
# noise of initial heights and uplift: longest wavelength in voxels; fraction of land below water
LONGEST, LAKES = 260.0, 0.08
# the terrain is periodic; this shift along y, in voxels, keeps the lakes away from the near edge
SHIFT = 90
# heights in iterations of mean uplift: initial standard deviation, and fill over a pit; variation of uplift
RAW, PIT_FILL, UNEVEN = 4.0, 0.01, 0.7
# erosion: strength relative to uplift, and exponent of the drainage area (stream power law)
WEAR, DRAINAGE = 0.05, 0.5
# upper bound of river length in cells
LONGEST_RIVER = 2048
# height of the water surface and of the highest peak, and lake depth, in voxels
WATER, PEAK, LAKE_DEPTH = 16.0, 100.0, 8.0
# quantile of the eroded heights that counts as a summit; exponent that lowers peaks relative to plains
SUMMITS, FLATTENED = 0.9999, 0.6
# fine noise on slopes: voxels of height per unit slope, and longest wavelength in voxels
ROUGHNESS, FINE = 0.35, 16.0
# a column extends this many voxels below its lowest neighbour, so that no ray passes through a step
SKIN = 1
# direction towards the sun (x, y, z): afternoon, from the left
SUN = np.array([-0.62, -0.35, 0.70]) / np.linalg.norm([-0.62, -0.35, 0.70])
# depth below the surface, in voxels, from which cut sides show earth; its colours (sRGB)
TURF, EARTH, STONE = 3.0, (104, 76, 52), (74, 64, 58)
# sRGB of the ground
DEEP, SHALLOW, SAND, GRASS, MEADOW = (18, 44, 74), (46, 98, 116), (190, 172, 128), (112, 128, 66), (140, 140, 82)
FOREST, SOIL, ROCK, SCREE, SNOW = (44, 70, 38), (128, 102, 72), (112, 102, 94), (150, 142, 132), (246, 248, 252)


@public
def terrain(seed: int = 7) -> Volume:
    """Mountains, valleys and a lake, 512×512×103 voxels, z up.

    samples uint8: 255 in the ground's outer shell, less in the voxels cut by its surface, 0 elsewhere;
    color: water, sand, grass, forest, rock or snow with baked sun shading. The view is a low one
    towards the horizon.
    """
    rng = np.random.default_rng(seed)
    ground = _heights(rng)
    surface = np.maximum(ground, WATER)
    photo = _photograph(ground, surface, rng)

    # occupancy of voxels, filled down to the depth that neighbouring columns expose
    planes = np.arange(TERRAIN_SHAPE[0], dtype=np.float32)[:, None, None]
    filled = np.clip(surface.astype(np.float32) - planes + 0.5, 0.0, 1.0)
    shell = planes >= _floor(surface)
    samples = np.where(shell, np.rint(filled * 255), 0).astype(np.uint8)
    color = np.where(samples[..., None] > 0, photo, np.uint8(0))
    _paint_sides(color, samples, surface)
    hints = Hints(
        points=((0.0, 0.0), (255.0, 0.99)),
        shading=False,
        eye=(256.0, -355.0, 250.0),
        target=(256.0, 256.0, -20.0),
        up=(0.0, 0.0, 1.0),
        fov=60.0,
    )
    return Volume(samples, name="terrain", color=color, hints=hints)


def _heights(rng: np.random.Generator) -> np.ndarray:
    """Ground heights [y, x] in voxels: uplifted land after erosion, with fine noise on steep slopes."""
    worn = _erode(*(_fractal(rng, LONGEST)[::CELL, ::CELL] for _ in range(2)))
    worn = np.roll(worn, SHIFT // CELL, axis=0)
    relief = (worn / np.quantile(worn, SUMMITS)) ** FLATTENED
    land = WATER - 1.0 + (PEAK - WATER) * _upsample(np.minimum(relief, 1.0))

    # fine noise on slopes; the lake bed deepens away from the shores
    dy, dx = np.gradient(land)
    land = land + ROUGHNESS * np.minimum(np.hypot(dx, dy), 2.0) * _fractal(rng, FINE)
    return np.asarray(land - LAKE_DEPTH * _upsample((worn <= 0).astype(np.float64)) ** 2)


def _erode(land: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """Land (periodic, [y, x], unit variance) after ROUNDS of uplift and erosion by each cell's drainage."""
    here = np.arange(land.size)
    shifts = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)]
    around = np.stack([np.roll(here.reshape(land.shape), shift, (0, 1)).ravel() for shift in shifts])
    distance = np.array([np.hypot(*shift) for shift in shifts])
    h = np.maximum(land - np.quantile(land, LAKES), 0.0).ravel() * RAW
    water = h <= 0
    uplift = np.where(water, 0.0, np.exp(UNEVEN * rise.ravel()))
    for _ in range(ROUNDS):
        # uplift; each cell drains into its steepest neighbour; a pit is filled above its lowest neighbour
        h = h + uplift
        neighbours = h[around]
        fall = (h - neighbours) / distance[:, None]
        steepest = fall.argmax(axis=0)
        target = around[steepest, here]
        pit = (fall.max(axis=0) <= 0) & ~water
        h = np.where(pit, neighbours.min(axis=0) + PIT_FILL, h)

        # the stream power law, implicit: a step towards the receiver's height never overshoots
        area = _drainage_area(np.where(water | pit, here, target))
        share = WEAR * area**DRAINAGE / distance[steepest]
        h = np.where(water | pit, h, (h + share * h[target]) / (1 + share))
    return h.reshape(land.shape)


def _drainage_area(target: np.ndarray) -> np.ndarray:
    """Number of cells that drain through a cell, including the cell; a cell that drains into itself is a sink."""
    sink = len(target)
    jump = np.append(np.where(target == np.arange(sink), sink, target), sink)
    area = np.ones(sink + 1)
    # paths of doubling length
    for _ in range(LONGEST_RIVER.bit_length()):
        area = area + np.bincount(jump, area, sink + 1)
        area[sink] = 0
        jump = jump[jump]
    return area[:sink]


def _upsample(small: np.ndarray) -> np.ndarray:
    """Upsamples a periodic coarse grid [y, x] to the full grid, smoothly."""
    spectrum = np.fft.rfft2(np.kron(small, np.ones((CELL, CELL))))
    height, width = TERRAIN_SHAPE[1:]
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)
    return np.asarray(np.fft.irfft2(spectrum * np.exp(-((np.hypot(fy, fx) * CELL * 1.6) ** 2) * 2), (height, width)))


def _fractal(rng: np.random.Generator, longest: float, power: float = 1.1) -> np.ndarray:
    """Periodic fractal noise [y, x] of unit variance, scale-free below `longest` voxels."""
    height, width = TERRAIN_SHAPE[1:]
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)) * longest
    spectrum = np.fft.rfft2(rng.standard_normal((height, width))) / np.maximum(frequency, 1.0) ** (1 + power)
    spectrum[frequency < 0.5] = 0.0
    noise = np.fft.irfft2(spectrum, (height, width))
    return np.asarray(noise / noise.std())


def _floor(surface: np.ndarray) -> np.ndarray:
    """The lowest plane [y, x] to fill: SKIN below the lowest of nine columns, against gaps; 0 at the four borders."""
    padded = np.pad(surface, 1, constant_values=0.0)
    rows = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    lowest = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return np.asarray(np.floor(lowest) - SKIN)


def _paint_sides(color: np.ndarray, samples: np.ndarray, surface: np.ndarray) -> None:
    """Colours the block's four sides as layers of earth, from TURF below the surface."""
    planes = np.arange(TERRAIN_SHAPE[0])[:, None]
    for side in (np.s_[0, :], np.s_[-1, :], np.s_[:, 0], np.s_[:, -1]):
        depth = surface[side] - planes
        layers = 0.5 + 0.3 * np.sin(depth * 0.35) + 0.2 * np.sin(planes * 0.9)
        earth = _blend(EARTH, STONE, np.clip(depth / 60.0 + 0.4 * layers, 0.0, 1.0))
        cut = (depth > TURF) & (samples[:, *side] > 0)
        color[:, *side][cut] = np.rint(earth[cut])


def _photograph(ground: np.ndarray, surface: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The terrain's colours from above, sRGB uint8 [y, x, 3]."""
    dy, dx = np.gradient(ground)
    steep = np.hypot(dx, dy)
    patches, mottle, grain = _fractal(rng, 120.0, 0.6), _fractal(rng, 40.0, 0.2), rng.standard_normal(ground.shape)
    height = (ground - WATER) / (PEAK - WATER) + 0.03 * patches + 0.01 * mottle

    # layers from the shore upwards, each blended over the previous
    photo = _blend(SAND, GRASS, _ramp(height, 0.0, 0.04))
    photo = _over(photo, MEADOW, _ramp(patches, -0.5, 1.5))
    photo = _over(photo, FOREST, _ramp(height, 0.08, 0.16) * _ramp(patches + 0.5 * mottle, -0.8, 0.1))
    photo = _over(photo, SOIL, _ramp(height, 0.40, 0.52) * 0.9)
    photo = _over(photo, SCREE, _ramp(height, 0.52, 0.66) * 0.8)
    photo = _over(photo, ROCK, _ramp(steep + 0.15 * mottle, 1.0, 1.5) * _ramp(height, 0.2, 0.4))
    photo = _over(photo, SNOW, _ramp(height - 0.06 * steep, 0.56, 0.64))

    # sunlight on slopes, fine grain, and the flat lake
    light = (SUN[2] - dx * SUN[0] - dy * SUN[1]) / np.sqrt(1.0 + steep**2)
    photo = photo * (0.40 + 0.85 * np.clip(light, 0.0, 1.0) + 0.03 * grain + 0.03 * mottle)[..., None]
    depth = _ramp(surface - ground, 0.0, 6.0)
    photo = np.where((ground < WATER)[..., None], _blend(SHALLOW, DEEP, depth), photo)
    return np.clip(np.rint(photo), 0, 255).astype(np.uint8)


def _ramp(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Smooth step: 0 below low, 1 above high."""
    t = np.clip((values - low) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _blend(first: tuple[int, int, int], second: tuple[int, int, int], share: np.ndarray) -> np.ndarray:
    return _over(np.broadcast_to(np.array(first, np.float64), (*share.shape, 3)), second, share)


def _over(photo: np.ndarray, paint: tuple[int, int, int], share: np.ndarray) -> np.ndarray:
    return np.asarray(photo + (np.array(paint) - photo) * share[..., None])

"""Colours of layers in a plane: pixels of slices, and textured meshes that show them in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.mesh import Mesh, Texture
from splatgl.data.volume import Volume
from splatgl.geometry.clipping import Plane, box_planes
from splatgl.geometry.grid import Grid
from splatgl.geometry.resample import BEYOND, level_for, sample_places, sample_raster
from splatgl.geometry.slices import SlicePlane, plane_through
from splatgl.transfer.colormaps import FURTHEST, SOLID, UNKNOWN, colormap, interpolate_map
from splatgl.transfer.transfer import Transfer

# sides of a pixel along right and down, world units
Pitch = tuple[float, float]
# texels along a voxel's side where one is not exact, and the most of a plane; and of one of voxels
TEXELS, MOST_TEXELS, MOST_VOXELS = 4, 1 << 20, 1 << 24
# texels beyond the edges of a plane, which cubics need
MARGIN = 2
# entries of the table of a colour map for a screen
COLORS = 4096
# area of a cap, as a share of the square of a volume's longest side, that is only rounding
LEAST_AREA = 1e-12


class Painted(NamedTuple):
    """A volume, its transfer function, and a factor of its opacity over other layers, or of its light beside them."""

    volume: Volume
    transfer: Transfer
    opacity: float = 1.0

    @property
    def nearest(self) -> bool:
        """Whether voxels are segments."""
        return bool(self.transfer.labels) or self.volume.labels is not None

    @property
    def solid(self) -> bool:
        """Whether all values have the same colour, so that their opacity shows them."""
        if self.volume.color is not None or self.transfer.labels:
            return False
        table = colormap(self.transfer.colormap)
        return bool((table == table[0]).all())

    @property
    def glows(self) -> bool:
        """Whether it is an unshaded amount, which adds to others."""
        return not (self.nearest or self.transfer.shading)

    def color(self, values: np.ndarray) -> np.ndarray:
        """Linear RGB [..., 3] of values [...], or of sRGB [..., 3]."""
        if self.volume.color is not None:
            return linear_from_srgb(np.clip(values, 0.0, 1.0))
        color = self.transfer.color(values)
        return color * self.share(values)[..., None] if self.solid else color

    def share(self, values: np.ndarray) -> np.ndarray:
        """Opacity [...] of values from 0 to 1: of amounts relative to the largest, of segments that of each."""
        if self.volume.color is not None:
            return np.ones(values.shape[:-1])
        most = SOLID if self.transfer.labels else max(opacity for _, opacity in self.transfer.points)
        return np.minimum(self.transfer.opacity(values) / (most or 1.0), 1.0)

    def shows(self, values: np.ndarray, known: np.ndarray) -> np.ndarray:
        """bool: where values are known, and of a segment that is visible."""
        return known & (self.transfer.opacity(values) > 0) if self.transfer.labels else known


def to_screen(light: np.ndarray) -> np.ndarray:
    """uint8 [..., 4], sRGB, of linear RGB and opacity."""
    return np.rint(np.append(srgb_from_linear(np.clip(light[..., :3], 0.0, 1.0)), light[..., 3:], -1) * 255).astype(
        np.uint8
    )


@lru_cache(maxsize=8)
def map_colors(name: str) -> np.ndarray:
    """uint8 [COLORS, 4]: a colour map in sRGB."""
    return to_screen(np.insert(interpolate_map(colormap(name), np.linspace(0.0, 1.0, COLORS)), 3, 1.0, -1))


@dataclass(frozen=True, eq=False)
class Painter:
    """Layers that a slice shows: the first is opaque; others lie over it, or add up if all are unshaded amounts."""

    layers: Sequence[Painted]

    def light(self, points: np.ndarray) -> np.ndarray:
        """float64 [P, 4] at world points [P, 3]: linear RGB, and 1, or 0 beside the volumes."""
        parts = []
        for layer in self.layers:
            places = Grid.of(layer.volume).index_from_world(points)
            parts.append(sample_places(layer.volume, places, layer.nearest))
        return self._join(parts)

    def pixels(
        self, plane: SlicePlane, low: np.ndarray, pitch: Pitch, size: tuple[int, int], beyond: float = 0.0
    ) -> np.ndarray:
        """float64 [H, W, 4], as `light`, at the pixels of a plane; of the level with voxels as wide as a pixel. low,
        pitch, size: as of `SlicePlane.raster`; beyond: voxels to which the first layer is continued beyond its box.
        """
        parts = []
        for number, layer in enumerate(self.layers):
            volume = level_for(layer.volume, min(pitch))
            raster = plane.raster(volume, low, pitch, size)
            parts.append(sample_raster(volume, raster, layer.nearest, 0.0 if number else beyond))
        return self._join(parts)

    def screen(self, plane: SlicePlane, low: np.ndarray, pitch: Pitch, size: tuple[int, int]) -> np.ndarray:
        """uint8 [H, W, 4], sRGB, and 255, or 0 beside the volumes: as `pixels`; of a map or segments by a table."""
        if len(self.layers) > 1:
            return to_screen(self.pixels(plane, low, pitch, size))
        only, volume = self.layers[0], level_for(self.layers[0].volume, min(pitch))
        values, known = sample_raster(volume, plane.raster(volume, low, pitch, size), only.nearest)
        if self.is_mapped:
            place = self.places(values, known)
            place *= COLORS - 1
            place += 0.5
            entries = place.astype(np.intp)
            table = map_colors(only.transfer.colormap)
        elif values.dtype.kind in "iu" and int(values.max()) - int(values.min()) < COLORS:
            kinds = np.arange(int(values.min()), int(values.max()) + 1)
            entries, table = (
                values.astype(np.intp) - kinds[0],
                to_screen(self._join([(kinds, np.ones(len(kinds), bool))])),
            )
        else:
            return to_screen(self._join([(values, known)]))
        # four bytes at a time
        pixels: np.ndarray = np.take(table.view(np.uint32)[:, 0], entries, mode="clip")
        if not known.all():
            pixels[~known] = 0
        return pixels.view(np.uint8).reshape(*known.shape, 4)

    def _join(self, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        adds = len(self.layers) > 1 and all(layer.glows for layer in self.layers)
        total: np.ndarray = np.zeros((*parts[0][1].shape, 4))
        for number, (layer, (values, known)) in enumerate(zip(self.layers, parts, strict=True)):
            shown = layer.shows(values, known)
            color = layer.color(values) * shown[..., None]
            if adds:
                total[..., :3] += layer.opacity * color
            else:
                share = (shown if number == 0 else layer.opacity * layer.share(values) * shown)[..., None]
                total[..., :3] = total[..., :3] * (1 - share) + color * share
            total[..., 3] = np.maximum(total[..., 3], shown)
        # sums end at white
        return np.minimum(total, 1.0) if adds else total

    @property
    def has_map(self) -> bool:
        """Whether the light is that of a map's places, which are linear in values."""
        return self.is_mapped and not self.layers[0].transfer.logarithmic

    @property
    def is_mapped(self) -> bool:
        """Whether the light is that of a map's places."""
        only = self.layers[0]
        return len(self.layers) == 1 and not (only.nearest or only.solid or only.volume.color is not None)

    def places(self, values: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Places [...] of values in the colour map of the only layer; UNKNOWN where there is a hole."""
        transfer = self.layers[0].transfer
        low, high = transfer.color_range
        if transfer.logarithmic:
            low, high, values = float(np.log(low)), float(np.log(high)), np.log(np.maximum(values, low))
        wide = high - low
        place: np.ndarray = (
            np.subtract(values, low, dtype=np.float64) if wide > 0 else np.where(values >= low, 1.0, 0.0)
        )
        if wide > 0:
            place /= wide
        # in place, as for most of the time memory is made
        np.clip(place, -FURTHEST, FURTHEST, out=place)
        np.copyto(place, UNKNOWN, where=~known)
        return place

    def mesh(self, plane: SlicePlane, opacity: float) -> Mesh:
        """The part of a plane in the first layer's volume, with its colours."""
        faces = [[0, n, n + 1] for n in range(1, len(plane.corners) - 1)]
        name, frame = f"slice {plane.title}", self.layers[0].volume.frame
        return self._painted(Mesh(plane.corners, np.array(faces), opacity=opacity, name=name, frame=frame), plane)

    def cap(self, mesh: Mesh, clip: Plane) -> list[Mesh]:
        """Parts of a cap in a clipping plane: in the first layer's volume with the colours there, elsewhere plain."""
        volume, parts = self.layers[0].volume, list[Mesh]()
        for x, y, z, d in box_planes(volume):
            parts.append(mesh.cut([(-x, -y, -z, -d)]))
            mesh = mesh.cut([(x, y, z, d)])
        if mesh.area > LEAST_AREA * float(np.ptp(volume.corners, axis=0).max()) ** 2:
            plane = plane_through(volume, mesh.vertices.mean(axis=0), np.array(clip[:3]), np.eye(3)[2])
            mesh = self._painted(mesh, plane)
        return [part for part in (*parts, mesh) if len(part)]

    def _painted(self, mesh: Mesh, plane: SlicePlane) -> Mesh:
        """A mesh in a plane, with the colours there."""
        volume, nearest = self.layers[0].volume, any(layer.nearest for layer in self.layers)
        pitch, size = self._texel_grid(plane)
        low = plane.box[0]
        if self.has_map:
            level = level_for(volume, min(pitch))
            # the polygon ends the plane, not the last texel within
            values, known = sample_raster(level, plane.raster(level, low, pitch, size), beyond=BEYOND)
            # beyond the edges as the field is continued
            values = np.pad(values, MARGIN, "reflect", reflect_type="odd")
            texels = self.places(values, np.pad(known, MARGIN, "edge"))
        else:
            texels = self.pixels(plane, low, pitch, size, BEYOND)
            texels = np.pad(texels, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), "edge")
        rows = np.array([plane.right / pitch[0], plane.down / pitch[1]])
        matrix = np.column_stack([rows, MARGIN - 0.5 - rows @ plane.point - low / np.array(pitch)])
        texture = Texture(self.light, texels.astype(np.float32), matrix, not nearest)
        return replace(mesh, colormap=self.layers[0].transfer.colormap, texture=texture)

    def density(self, plane: SlicePlane) -> np.ndarray:
        """The most voxels of a layer per world length, along the plane's right and down [2]."""
        axes = np.stack([plane.right, plane.down], axis=1)
        steps = [np.linalg.inv(layer.volume.world_from_index) @ axes for layer in self.layers]
        return np.asarray(np.abs(steps).max(axis=(0, 1)))

    def _texel_grid(self, plane: SlicePlane) -> tuple[Pitch, tuple[int, int]]:
        """Sides of a texel, world units, and columns and rows: the voxels of a plane along the axes of the only
        layer's grid, where texels say as much as voxels do; else several a voxel.
        """
        low, high = plane.box
        only, nearest = self.layers[0], any(layer.nearest for layer in self.layers)
        is_along = plane.raster(only.volume, low, (1.0, 1.0), (1024, 1024)).axes is not None
        is_exact = is_along and (self.has_map or (nearest and len(self.layers) == 1))
        steps = self.density(plane)
        is_exact &= float(((high - low) * steps).prod()) <= MOST_VOXELS
        wide = (high - low) * steps * (1 if is_exact else TEXELS)
        if not is_exact:
            wide *= min(1.0, (MOST_TEXELS / float(wide.prod())) ** 0.5)
        wide = np.maximum(np.ceil(wide - 1e-6), 1)
        across, down = ((high - low) / wide).tolist()
        return (across, down), (int(wide[0]), int(wide[1]))

"""Slices: planes through a volume by text, their directions in pictures, and the colours of layers in them.

`x=12`, `y=40%` and `z` are planes of the grid: by the number of a voxel from 0 on, a share of the axis, or the middle
voxel. `z=30mm` is a plane across the world's axis. `axial`, `coronal` and `sagittal` are the planes of a patient that
are nearest. `X,Y,Z:NX,NY,NZ` is a plane through a point across a normal, world units.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import permutations
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.data.mesh import Mesh, Texture
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.geometry.clipping import Plane, box_planes, clip_corners, world_units
from splatgl.geometry.grid import Grid
from splatgl.geometry.resample import BEYOND, Raster, level_for, sample_places, sample_raster
from splatgl.options import HelpGroup, Option, ValueKind
from splatgl.transfer.colormaps import FURTHEST, SOLID, UNKNOWN, colormap, interpolate_map
from splatgl.transfer.transfer import Transfer

# right and down in a slice as (axis, sign), by the world axis across it. For patients, down is posterior or inferior,
# and right is left or posterior, as in 3D Slicer; for others, z and y point up.
PATIENT = {2: ((0, 1), (1, 1)), 1: ((0, 1), (2, -1)), 0: ((1, 1), (2, -1))}
OTHERS = {2: ((0, 1), (1, -1)), 1: ((0, 1), (2, -1)), 0: ((1, 1), (2, -1))}
ANATOMY = ("sagittal", "coronal", "axial")
AXES = {**{name: axis for axis, name in enumerate("xyz")}, **{name: axis for axis, name in enumerate(ANATOMY)}}
# smallest component of a scene's up along an axis that it points along
UPRIGHT = 0.7
# most slices of a picture
MOST_SLICES = 1024
FORM = "AXIS=PLACE, such as z=120, z=50%, z=30mm, axial or z=10:90:8, or X,Y,Z:NX,NY,NZ, a point and a normal"
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?"
PLACE = rf"({NUMBER})(%|[^\W\d_]*)"
# between a plane and its opacity
AT = "@"


class SlicePosition(NamedTuple):
    """A parsed text. name: of the axis; numbers: the place, or start, stop and step; unit: "" of voxels, "%", or of
    length. point, normal: of a plane without an axis.
    """

    text: str
    name: str = ""
    numbers: tuple[float | None, ...] = ()
    unit: str = ""
    point: tuple[float, ...] = ()
    normal: tuple[float, ...] = ()

    @classmethod
    def of(cls, text: str) -> SlicePosition:
        """Raises InputError for text of another form."""
        compact = text.replace(" ", "").lower()
        name, equals, place = compact.partition("=")
        if name in AXES and bool(equals) == bool(place):
            parts = [re.fullmatch(PLACE, part) if part else None for part in place.split(":")]
            units = {match[2] for match in parts if match}
            known = [bool(match) == bool(part) for match, part in zip(parts, place.split(":"), strict=True)]
            numbers = tuple(float(match[1]) if match else None for match in parts)
            known += [number is None or isfinite(number) for number in numbers]
            if all(known) and len(parts) <= 3 and len(units) <= 1:
                return cls(text, name, numbers, units.pop() if units else "")
        try:
            point, normal = (tuple(float(n) for n in part.split(",")) for part in compact.split(":"))
        except ValueError:
            point = normal = ()
        if len(point) != 3 or len(normal) != 3 or not any(normal) or not np.isfinite((*point, *normal)).all():
            raise expected("slice", FORM, repr(text))
        return cls(text, point=point, normal=normal)


@dataclass(frozen=True)
class Slice:
    """A plane on which a scene shows the values of its layers. where: text as of `--slice`, also with "@" and an
    opacity from 0 to 1; or a point and a normal, world units. Raises InputError otherwise.

    ```python
    sg.Slice("axial=30mm"), sg.Slice("z=50%@0.5"), sg.Slice(((10, 20, 30), (0, 1, 1)))
    ```
    """

    where: str | Sequence[Sequence[float]]

    def __post_init__(self) -> None:
        where = self.where
        if not isinstance(where, str):
            try:
                where = ":".join(",".join(f"{float(n)!r}" for n in part) for part in where)
            except (TypeError, ValueError):
                raise expected("slice", FORM, repr(where)[:80]) from None
            object.__setattr__(self, "where", where)
        place, at, opacity = where.partition(AT)
        SlicePosition.of(place)
        try:
            known = not at or 0 <= float(opacity) <= 1
        except ValueError:
            known = False
        if not known:
            raise expected("slice", "an opacity from 0 to 1 after @", repr(opacity))

    @property
    def place(self) -> str:
        """The text without its opacity."""
        return str(self.where).partition(AT)[0]

    @property
    def opacity(self) -> float:
        """From 0 to 1."""
        return float(str(self.where).partition(AT)[2] or 1)


@dataclass(frozen=True, eq=False)
class SlicePlane:
    """A plane in a volume's world. point [3]: on it; right, down [3]: unit vectors of its picture, at right angles.

    title: its place in words. outline [N, 2]: corners, along right and down from the point, of the part in the volume.
    """

    point: np.ndarray
    right: np.ndarray
    down: np.ndarray
    title: str
    outline: np.ndarray

    @cached_property
    def normal(self) -> np.ndarray:
        """Unit vector [3] away from the viewer."""
        return np.cross(self.right, self.down)

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """The minimum and maximum position [2] of the outline, world units along right and down."""
        return self.outline.min(axis=0), self.outline.max(axis=0)

    @property
    def corners(self) -> np.ndarray:
        """World points [N, 3] of the outline."""
        return np.asarray(self.point + self.outline @ np.array([self.right, self.down]))

    def raster(self, volume: Volume, low: np.ndarray, pitch: Sequence[float], size: tuple[int, int]) -> Raster:
        """Grid positions of pixels. low [2]: their left upper edge along right and down; pitch: sides, world units."""
        into = np.linalg.inv(volume.world_from_index)
        across, down = self.right * pitch[0], self.down * pitch[1]
        corner = self.point + self.right * low[0] + self.down * low[1] + (across + down) / 2
        return Raster(into @ (corner - np.asarray(volume.origin)), into @ across, into @ down, size)


def check_slices(value: Any) -> tuple[str, ...]:
    """Texts of slices from one or several texts. Raises InputError for another form."""
    texts = (value,) if isinstance(value, str) else tuple(value)
    for text in texts:
        SlicePosition.of(text if isinstance(text, str) else repr(text))
    return texts


def check_planes(value: Any) -> tuple[str, ...]:
    """Texts of planes in space from one or several texts or Slices. Raises InputError for another form."""
    several = (value,) if isinstance(value, str | Slice) else tuple(value)
    return tuple(str((item if isinstance(item, Slice) else Slice(item)).where) for item in several)


SLICES = Option(
    ValueKind("slices", check_slices, metavar="AXIS=PLACE", hint="str | Sequence[str]"),
    "draw slices instead, such as z=120, z=50%, axial=30mm, z=10:90:8. Or through POINT:NORMAL; repeatable",
    HelpGroup.PICTURE,
    flag="--slice",
    repeat=True,
)
SLICE_PLANES = Option(
    ValueKind("slices", check_planes, metavar="AXIS=PLACE[@OPACITY]", hint="str | Sequence[Any]"),
    "show a slice as a plane in space, such as z=120 or axial@0.5. Positions as for --slice; repeatable",
    HelpGroup.LAYERS,
    flag="--slice-plane",
    repeat=True,
)


def parse_slices(texts: str | Sequence[str], volume: Volume, up: np.ndarray | None = None) -> tuple[SlicePlane, ...]:
    """The planes of texts, ranges as several. up [3]: of the scene. Raises InputError for other text, and for planes
    beside the volume.
    """
    planes: list[SlicePlane] = []
    upwards = np.array([0.0, 0.0, 1.0]) if up is None else up
    for text in [texts] if isinstance(texts, str) else texts:
        where = SlicePosition.of(text)
        if where.name:
            planes += [_axis_plane(where, volume, upwards, at) for at in _places(where, volume)]
        else:
            normal = _unit(np.array(where.normal))
            planes.append(plane_through(volume, np.array(where.point), normal, upwards, text=text))
        if len(planes) > MOST_SLICES:
            raise expected("slice", f"at most {MOST_SLICES} slices", f"more by {text}")
    return tuple(planes)


def _places(where: SlicePosition, volume: Volume) -> list[float]:
    """Places along the axis, in the unit."""
    size, numbers, unit = volume.shape[2 - grid_axis(volume, where.name)], where.numbers, where.unit
    if len(numbers) == 1:
        return [float(size // 2) if numbers[0] is None else numbers[0]]
    ends = (0.0, float(size)) if not unit else (0.0, 100.0) if unit == "%" else _ends(volume, where)
    first, stop = (end if number is None else number for number, end in zip(numbers[:2], ends, strict=True))
    step = 1.0 if len(numbers) < 3 or numbers[2] is None else numbers[2]
    if not (step > 0 and first < stop and (stop - first) / step <= MOST_SLICES):
        raise expected("slice", f"START:STOP:STEP of up to {MOST_SLICES} slices, upwards", repr(where.text))
    return [float(at) for at in np.arange(first, stop, step)]


def _length(where: SlicePosition, volume: Volume) -> float:
    """World units per unit of the place."""
    return world_units(where.unit, volume.unit, where.text, "slice")


def _ends(volume: Volume, where: SlicePosition) -> tuple[float, float]:
    """The ends of the volume along a world axis, in the unit."""
    along = volume.corners[:, AXES[where.name]] / _length(where, volume)
    return float(along.min()), float(along.max())


def grid_axis(volume: Volume, name: str) -> int:
    """The axis of the grid of a name: x, y, z, or that nearest to the patient's. InputError without directions."""
    if name not in ANATOMY:
        return AXES[name]
    if volume.frame is None:
        raise expected("slice", "x, y or z, as the file states no patient directions", name)
    return world_axes(volume).index(AXES[name])


def world_axes(volume: Volume) -> tuple[int, int, int]:
    """The nearest world axis of each axis of the grid, all different."""
    columns = np.abs(volume.world_from_index) / np.linalg.norm(volume.world_from_index, axis=0)
    x, y, z = max(permutations(range(3)), key=lambda order: sum(columns[order[axis], axis] for axis in range(3)))
    return x, y, z


def _axis_plane(where: SlicePosition, volume: Volume, up: np.ndarray, at: float) -> SlicePlane:
    """The plane across an axis: of the grid by voxels or a share, of the world by a length."""
    name, unit = where.name, where.unit
    axis = grid_axis(volume, name)
    title = f"{name} {at:.6g}{'' if unit in ('', '%') else ' '}{unit}"
    if unit not in ("", "%"):
        point = volume.center
        point[AXES[name]] = at * _length(where, volume)
        return plane_through(volume, point, np.eye(3)[AXES[name]], up, title, where.text)
    size = volume.shape[2 - axis]
    index = at if not unit else at / 100 * size - 0.5
    if not -0.5 <= index <= size - 0.5:
        this = f"a voxel from 0 to {size - 1} along {'xyz'[axis]}" if not unit else "a share from 0% to 100%"
        fix = f"{name}={at:g}{volume.unit or 'units'} is a position in the world" if not unit else ""
        raise expected("slice", this, repr(where.text), fix)
    middle = (np.array(volume.shape[::-1]) - 1) / 2
    middle[axis] = index
    point = volume.world_from_index @ middle + np.asarray(volume.origin)
    return plane_through(volume, point, grid_normals(volume)[axis], up, title, where.text, True)


def grid_normals(volume: Volume) -> np.ndarray:
    """Unit vectors [3, 3] across the planes of the grid, in rows, towards larger indices."""
    rows = np.linalg.inv(volume.world_from_index)
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def plane_through(
    volume: Volume,
    point: np.ndarray,
    normal: np.ndarray,
    up: np.ndarray,
    title: str = "",
    text: str = "",
    grid: bool = False,
) -> SlicePlane:
    """The plane through a point [3] across a unit vector [3]. grid: whether rows and columns follow the grid's axes,
    not the world's. Raises InputError, naming `text`, for a plane beside the volume.
    """
    directions, nearest, facing = np.eye(3), (0, 1, 2), int(np.abs(normal).argmax())
    if grid:
        directions, nearest = volume.world_from_index, world_axes(volume)
        facing = nearest[int(np.abs(grid_normals(volume) @ normal).argmax())]
    (across, right_sign), (along, down_sign) = pane_axes(volume.frame, facing, up)
    right, down = (directions[:, nearest.index(axis)] for axis in (across, along))
    right, down = (
        vector * (1 if vector[axis] * sign > 0 else -1)
        for vector, axis, sign in ((right, across, right_sign), (down, along, down_sign))
    )
    right = _unit(right - (right @ normal) * normal)
    down = _unit(down - (down @ normal) * normal - (down @ right) * right)
    d = float(normal @ point)
    row = (float(normal[0]), float(normal[1]), float(normal[2]))
    corners = clip_corners([(*row, d), (-row[0], -row[1], -row[2], -d)], volume.corners)
    outline = polygon_around(np.stack([(corners - point) @ right, (corners - point) @ down], axis=1))
    if len(outline) < 3:
        raise expected("slice", "a plane through the volume", repr(text or title))
    at = f"through {_triple(point.tolist())}, across {_triple(normal.tolist())}"
    return SlicePlane(point, right, down, title or at, outline)


def polygon_around(points: np.ndarray) -> np.ndarray:
    """Distinct corners [N, 2] of a convex polygon, in order."""
    if len(points) < 3:
        return np.zeros((0, 2))
    size = max(float(np.ptp(points, axis=0).max()), 1e-300)
    points = points[np.unique((points / (size * 1e-6)).round(), axis=0, return_index=True)[1]]
    from_middle = points - points.mean(axis=0)
    return np.asarray(points[np.argsort(np.arctan2(from_middle[:, 1], from_middle[:, 0]))])


def pane_axes(frame: str | None, normal: int, up: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """World axes, and their signs, to the right and down in the slice across a world axis."""
    if frame:
        turned = -1 if frame == "RAS" else 1
        right, down = PATIENT[normal]
        signs = {0: turned, 1: turned, 2: 1}
        return (right[0], right[1] * signs[right[0]]), (down[0], down[1] * signs[down[0]])
    right, down = OTHERS[normal]
    upright = int(np.argmax(np.abs(up)))
    if abs(up[upright]) >= UPRIGHT and upright in (right[0], down[0]):
        other = right[0] if upright == down[0] else down[0]
        return (other, 1), (upright, -1 if up[upright] > 0 else 1)
    # seen from the other side
    return right, (down[0], -down[1] if upright == normal and up[upright] <= -UPRIGHT else down[1])


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def _triple(numbers: Any) -> str:
    return ",".join(f"{number:.6g}" for number in numbers)


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


class SliceLayer(NamedTuple):
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
        """Whether it is an unshaded amount, which is added to others."""
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


def near_borders(values: np.ndarray, width: int) -> np.ndarray:
    """bool [H, W]: where another value is at most `width` pixels away along a row or column."""
    near = np.zeros(values.shape, bool)
    for rows, marked in ((values, near), (values.T, near.T)):
        for step in range(1, min(width, len(rows) - 1) + 1):
            differ = rows[step:] != rows[:-step]
            marked[step:] |= differ
            marked[:-step] |= differ
    return near


@lru_cache(maxsize=8)
def map_colors(name: str) -> np.ndarray:
    """uint8 [COLORS, 4]: a colour map in sRGB."""
    return to_screen(np.insert(interpolate_map(colormap(name), np.linspace(0.0, 1.0, COLORS)), 3, 1.0, -1))


@dataclass(frozen=True, eq=False)
class SlicePainter:
    """Layers of a slice: the first is opaque; others are blended over it, or added if all are unshaded amounts. fill:
    factor of the opacity of segments over others in pictures, but at their outlines.
    """

    layers: Sequence[SliceLayer]
    fill: float = 1.0

    def light(self, points: np.ndarray) -> np.ndarray:
        """float64 [P, 4] at world points [P, 3]: linear RGB, and 1, or 0 outside the volumes."""
        parts = []
        for layer in self.layers:
            places = Grid.of(layer.volume).index_from_world(points)
            parts.append(sample_places(layer.volume, places, layer.nearest))
        return self._join(parts)

    def pixels(
        self,
        plane: SlicePlane,
        low: np.ndarray,
        pitch: Pitch,
        size: tuple[int, int],
        beyond: float = 0.0,
        width: int = 1,
    ) -> np.ndarray:
        """float64 [H, W, 4], as `light`, at the pixels of a plane; of the level with voxels as wide as a pixel. low,
        pitch, size: as of `SlicePlane.raster`; beyond: voxels to which the first layer is continued beyond its box;
        width: of outlines within segments, pixels.
        """
        parts = []
        for number, layer in enumerate(self.layers):
            volume = level_for(layer.volume, min(pitch))
            raster = plane.raster(volume, low, pitch, size)
            parts.append(sample_raster(volume, raster, layer.nearest, 0.0 if number else beyond))
        return self._join(parts, width if self.fill < 1 else 0)

    def screen(self, plane: SlicePlane, low: np.ndarray, pitch: Pitch, size: tuple[int, int]) -> np.ndarray:
        """uint8 [H, W, 4], sRGB, and 255, or 0 outside the volumes: as `pixels`; of a map or segments by a table."""
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

    def _join(self, parts: Sequence[tuple[np.ndarray, np.ndarray]], width: int = 0) -> np.ndarray:
        adds = len(self.layers) > 1 and all(layer.glows for layer in self.layers)
        total: np.ndarray = np.zeros((*parts[0][1].shape, 4))
        for number, (layer, (values, known)) in enumerate(zip(self.layers, parts, strict=True)):
            shown = layer.shows(values, known)
            color = layer.color(values) * shown[..., None]
            if adds:
                total[..., :3] += layer.opacity * color
            else:
                share = (shown if number == 0 else layer.opacity * layer.share(values) * shown)[..., None]
                if number and width and layer.nearest:
                    share = np.where(
                        near_borders(np.where(shown, values, 0), width)[..., None], share, self.fill * share
                    )
                total[..., :3] = total[..., :3] * (1 - share) + color * share
            total[..., 3] = np.maximum(total[..., 3], shown)
        # sums end at white
        return np.minimum(total, 1.0) if adds else total

    @property
    def has_map(self) -> bool:
        """Whether the light is that of positions in a colour map, linear in values."""
        return self.is_mapped and not self.layers[0].transfer.logarithmic

    @property
    def is_mapped(self) -> bool:
        """Whether the light is that of positions in a colour map."""
        only = self.layers[0]
        return len(self.layers) == 1 and not (only.nearest or only.solid or only.volume.color is not None)

    def places(self, values: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Positions [...] of values in the colour map of the only layer; UNKNOWN where there is a hole."""
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
        """The maximum number of voxels of a layer per world length, along the plane's right and down [2]."""
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

"""Three linked slices beside the picture, as values: where they cut, how each lies in the window, and its pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.data.volume import Triple, Volume
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State

Box = tuple[float, float, float, float]

# share of a window's width that the slices take at most
WIDEST = 0.5
# pixels around a slice in its pane, at a content scale of 1
MARGIN = 6.0
# entries of the table of colours
COLORS = 4096
# across and down of a slice by the world axis that it lies across, as (axis, sign); down of a patient is posterior or
# inferior, and across left or posterior, as 3D Slicer shows them. Of others z and y point up.
PATIENT = {2: ((0, 1), (1, 1)), 1: ((0, 1), (2, -1)), 0: ((1, 1), (2, -1))}
OTHERS = {2: ((0, 1), (1, -1)), 1: ((0, 1), (2, -1)), 0: ((1, 1), (2, -1))}
ANATOMY = ("sagittal", "coronal", "axial")
# a scene's up points along an axis from this component on
UPRIGHT = 0.7


@dataclass(frozen=True)
class Slices:
    """shown: whether they are. colored: in the transfer function's colours, else grey by its window. place: the point
    that all three go through, as shares of the volume's box along x, y and z.
    """

    shown: bool = False
    colored: bool = False
    place: Triple = (0.5, 0.5, 0.5)

    def index(self, volume: Volume) -> tuple[int, int, int]:
        """The voxel (x, y, z) that all three go through."""
        sizes = volume.shape[::-1]
        x, y, z = (min(int(share * size), size - 1) for share, size in zip(self.place, sizes, strict=True))
        return x, y, z

    def at(self, index: Sequence[float], volume: Volume) -> Slices:
        """Through the voxel at an index (x, y, z), or the nearest one that there is."""
        sizes = volume.shape[::-1]
        x, y, z = ((min(max(round(each), 0), size - 1) + 0.5) / size for each, size in zip(index, sizes, strict=True))
        return replace(self, place=(x, y, z))

    def moved(self, axis: int, steps: int, volume: Volume) -> Slices:
        """With the slice across an axis moved by so many voxels."""
        index: list[float] = [*self.index(volume)]
        index[axis] += steps
        return self.at(index, volume)

    def through(self, point: np.ndarray, volume: Volume) -> Slices:
        """Through a world point [3]."""
        return self.at(np.linalg.solve(volume.world_from_index, point - np.asarray(volume.origin)).tolist(), volume)


@dataclass(frozen=True)
class Pane:
    """A slice in the window. axis: of the grid, across which it lies; across, down: those along its columns and rows,
    negative where the index grows to the left or upwards is told by back. room: what is the pane's; box: the slice's;
    left, top, right, bottom, pixels.
    """

    axis: int
    across: int
    down: int
    back: tuple[bool, bool]
    room: Box
    box: Box

    def holds(self, place: tuple[float, float]) -> bool:
        """Whether a position in pixels is the pane's."""
        return self.room[0] <= place[0] < self.room[2] and self.room[1] <= place[1] < self.room[3]

    def index(self, place: tuple[float, float], index: Sequence[float], volume: Volume) -> list[float]:
        """The index (x, y, z) under a position in pixels; of the slice at `index`."""
        found, sizes = list(index), volume.shape[::-1]
        for side, axis in enumerate((self.across, self.down)):
            share = (place[side] - self.box[side]) / (self.box[side + 2] - self.box[side])
            found[axis] = (1.0 - share if self.back[side] else share) * sizes[axis] - 0.5
        return found

    def place(self, index: Sequence[float], volume: Volume) -> tuple[float, float]:
        """Where the middle of a voxel (x, y, z) is in the slice, pixels."""
        found, sizes = [], volume.shape[::-1]
        for side, axis in enumerate((self.across, self.down)):
            share = (index[axis] + 0.5) / sizes[axis]
            share = 1.0 - share if self.back[side] else share
            found.append(self.box[side] + share * (self.box[side + 2] - self.box[side]))
        return found[0], found[1]


def column(window: tuple[int, int], shown: bool) -> int:
    """Pixels of the window's width that are the slices'."""
    return int(min(window[1] / 3, window[0] * WIDEST)) if shown else 0


def panes(volume: Volume, up: np.ndarray, window: tuple[int, int], scale: float = 1.0) -> tuple[Pane, ...]:
    """The three slices, z above y above x of the world, at the window's right. up: the scene's, world."""
    wide, world = column(window, True), world_axes(volume)
    found = []
    for number, normal in enumerate((2, 1, 0)):
        (right, right_sign), (down, down_sign) = _laid(volume.frame, normal, up)
        axis, across, along = world.index(normal), world.index(right), world.index(down)
        columns = volume.world_from_index
        back = bool(columns[right, across] * right_sign < 0), bool(columns[down, along] * down_sign < 0)
        top, bottom = number * window[1] / 3, (number + 1) * window[1] / 3
        room = float(window[0] - wide), top, float(window[0]), bottom
        sides = [float(np.linalg.norm(columns[:, each]) * volume.shape[2 - each]) for each in (across, along)]
        found.append(Pane(axis, across, along, back, room, _fitted(room, sides, MARGIN * scale)))
    return tuple(found)


def world_axes(volume: Volume) -> tuple[int, int, int]:
    """The world axis that each axis of the grid is nearest to, each once."""
    columns = np.abs(volume.world_from_index) / np.linalg.norm(volume.world_from_index, axis=0)
    x, y, z = max(permutations(range(3)), key=lambda order: sum(columns[order[each], each] for each in range(3)))
    return x, y, z


def _laid(frame: str | None, normal: int, up: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """World axes with their signs to the right and down, of the slice across a world axis."""
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
    return right, down


def _fitted(room: Box, sides: Sequence[float], margin: float) -> Box:
    """The largest box of these proportions in the middle of a room."""
    wide, high = room[2] - room[0] - 2 * margin, room[3] - room[1] - 2 * margin
    factor = min(max(wide, 1.0) / sides[0], max(high, 1.0) / sides[1])
    width, height = max(sides[0] * factor, 1.0), max(sides[1] * factor, 1.0)
    left, top = (room[0] + room[2] - width) / 2, (room[1] + room[3] - height) / 2
    return left, top, left + width, top + height


def plane(array: Any, pane: Pane, index: int) -> np.ndarray:
    """The samples or colours of a slice, [rows, columns, …] as the pane shows them; nothing else is read."""
    cut: list[Any] = [slice(None)] * 3
    cut[2 - pane.axis] = index
    found = np.asarray(array[tuple(cut)])
    # rows are along the later axis of the grid
    if pane.down < pane.across:
        found = found.swapaxes(0, 1)
    found = found[:, ::-1] if pane.back[0] else found
    return found[::-1] if pane.back[1] else found


def strided(found: np.ndarray, pane: Pane) -> np.ndarray:
    """A slice with no more than about two samples a pixel along each side."""
    sides = pane.box[3] - pane.box[1], pane.box[2] - pane.box[0]
    steps = [max(1, int(size / (2 * side))) for size, side in zip(found.shape, sides, strict=False)]
    return found[:: steps[0], :: steps[1]]


def window_of(transfer: Transfer) -> tuple[float, float]:
    """The values from black to white."""
    low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    return (low, high) if low < high else (low - 0.5, low + 0.5)


def grey(values: np.ndarray, window: tuple[float, float], logarithmic: bool = False) -> np.ndarray:
    """uint8 [H, W, 4]: grey by a window, or by logarithms of both; what is not a number is as its low end."""
    low, high = window
    with np.errstate(all="ignore"):
        if logarithmic:
            values, low, high = np.log(np.maximum(values, low)), float(np.log(low)), float(np.log(high))
        shade = (values.astype(np.float32) - np.float32(low)) * np.float32(255.0 / (high - low))
    found = np.full((*values.shape, 4), 255, np.uint8)
    found[..., :3] = np.clip(np.nan_to_num(shade, nan=0.0), 0.0, 255.0).astype(np.uint8)[..., None]
    return found


def colors(values: np.ndarray, transfer: Transfer) -> np.ndarray:
    """uint8 [H, W, 4]: the transfer function's colours."""
    if transfer.labels or transfer.logarithmic:
        linear = transfer.color(values)
    else:
        low, high = window_of(transfer)
        with np.errstate(all="ignore"):
            place = (values.astype(np.float64) - low) * ((COLORS - 1) / (high - low))
        entries = np.clip(np.nan_to_num(place, nan=0.0), 0, COLORS - 1).astype(np.intp)
        table = srgb_from_linear(np.clip(transfer.color(np.linspace(low, high, COLORS)), 0.0, 1.0))
        return _opaque(np.rint(table * 255).astype(np.uint8)[entries])
    return _opaque(np.rint(srgb_from_linear(np.clip(linear, 0.0, 1.0)) * 255).astype(np.uint8))


def _opaque(rgb: np.ndarray) -> np.ndarray:
    found = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    found[..., :3] = rgb
    return found


def _show(state: State, content: Content) -> State:
    return replace(state, slices=replace(state.slices, shown=not state.slices.shown))


def _color(state: State, content: Content) -> State:
    colored = not state.slices.colored
    said = "slices in the colours of values" if colored else "slices in grey, by the window of values"
    return replace(state, slices=replace(state.slices, colored=colored, shown=True), message=said)


ACTIONS: dict[str, Any] = {"slices": _show, "slice-colors": _color}

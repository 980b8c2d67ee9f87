"""`Cuts`: the box and the planes that cut what the window shows, as a value, and what keys do to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.clipping import MOST_CLIPS, Plane, index_plane, left, planes

if TYPE_CHECKING:
    from splatgl.app.viewer.content import Content
    from splatgl.app.viewer.state import State

WHOLE = ((0.0, 1.0),) * 3
# most planes beside the six of the box
MOST_PLANES = MOST_CLIPS - 6
# shares of the box: of its sides that nearly coincide, and of what a box keeps at least
SAME, LEAST = 1e-9, 1e-3
FULL = f"there are {MOST_PLANES} planes already: remove one"

Sides = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Cuts:
    """sides: what the box keeps of the volume's, as shares along its x, y and z. planes: (n_x, n_y, n_z, d), world
    units; kept is n · x ≥ d. active: whether they cut. shown: whether their handles are.
    """

    sides: Sides = WHOLE
    planes: tuple[Plane, ...] = ()
    active: bool = True
    shown: bool = False

    @classmethod
    def of(cls, clip: Sequence[Plane], volume: Volume) -> Cuts:
        """The cuts of planes, of which those along a side of the volume's box are its box."""
        sides, others = [list(each) for each in WHOLE], []
        for plane in clip:
            found = _side(plane, volume)
            if found is None:
                others.append(plane)
                continue
            axis, end, share = found
            sides[axis][end] = min(sides[axis][1], share) if end else max(sides[axis][0], share)
        if any(low >= high for low, high in sides):
            return cls(planes=tuple(clip))
        return cls(tuple((low, high) for low, high in sides), tuple(others))

    @property
    def any(self) -> bool:
        """Whether anything is cut off while they are active."""
        return self.sides != WHOLE or bool(self.planes)

    def clip(self, volume: Volume) -> tuple[Plane, ...]:
        """The planes that cut, as of `Settings`."""
        return planes([*self.planes, *box_planes(self.sides, volume)]) if self.active else ()

    def with_side(self, axis: int, end: int, share: float) -> Cuts:
        """With one side of the box moved, which keeps LEAST of it at least."""
        low, high = self.sides[axis]
        moved = (
            (low, float(np.clip(share, low + LEAST, 1.0))) if end else (float(np.clip(share, 0.0, high - LEAST)), high)
        )
        return replace(self, sides=tuple(moved if number == axis else each for number, each in enumerate(self.sides)))

    def with_plane(self, number: int, plane: Sequence[float]) -> Cuts:
        """With one plane changed; the number after the last adds one."""
        (found,) = planes([tuple(map(float, plane))])
        return replace(self, planes=(*self.planes[:number], found, *self.planes[number + 1 :]))

    def without(self, number: int) -> Cuts:
        """Without a plane."""
        return replace(self, planes=(*self.planes[:number], *self.planes[number + 1 :]))


def box_planes(sides: Sides, volume: Volume) -> list[Plane]:
    """The planes at the sides of a box that are not the volume's own."""
    found = []
    for axis, (each, size) in enumerate(zip(sides, volume.shape[::-1], strict=True)):
        for end, whole in enumerate((0.0, 1.0)):
            if each[end] != whole:
                found.append(index_plane(volume, axis, -1 if end else 1, each[end] * size - 0.5))
    return found


def leaves(cuts: Cuts, volume: Volume) -> bool:
    """Whether anything of the volume's box is left."""
    found = replace(cuts, active=True).clip(volume)
    return not found or bool(len(left(found, volume.corners)))


def cut(state: State, content: Content, cuts: Cuts) -> State:
    """The state with other cuts; the same with a message where they would leave nothing."""
    if cuts == state.cuts:
        return state
    if not leaves(cuts, content.volume):
        return replace(state, message="this would cut everything off")
    clip = cuts.clip(content.volume)
    # a scene's own planes stay as they are until they are changed
    same = (cuts.sides, cuts.planes, cuts.active) == (state.cuts.sides, state.cuts.planes, state.cuts.active)
    return replace(state, cuts=cuts, settings=state.settings if same else state.settings.but(clip=clip))


def facing(state: State, content: Content) -> Plane:
    """A plane through the middle of what is left that cuts off what is towards the eye, and looks at it."""
    forward, middle = state.pose.camera.forward, content.volume.corners.mean(axis=0)
    return (*map(float, forward), float(forward @ middle))  # type: ignore[return-value]


def add_plane(state: State, content: Content, normal: Sequence[float] | None = None) -> State:
    """With one more plane through the volume's middle. normal: towards what is kept; None: away from the eye."""
    cuts = state.cuts
    if len(cuts.planes) >= MOST_PLANES:
        return replace(state, message=FULL)
    plane = facing(state, content)
    if normal is not None:
        along = np.asarray(normal, np.float64)
        plane = (*map(float, along), float(along @ content.volume.corners.mean(axis=0)))  # type: ignore[assignment]
    return cut(state, content, replace(cuts.with_plane(len(cuts.planes), plane), active=True, shown=True))


def _handles(state: State, content: Content) -> State:
    cuts = replace(state.cuts, shown=not state.cuts.shown)
    said = "drag the dots to cut; shift+x: with and without the cuts" if cuts.shown else ""
    return replace(cut(state, content, cuts), message=said)


def _active(state: State, content: Content) -> State:
    if not state.cuts.any:
        return replace(state, message="nothing is cut: x shows the handles, ctrl+x makes a plane")
    cuts = replace(state.cuts, active=not state.cuts.active)
    return replace(cut(state, content, cuts), message=f"cuts {'on' if cuts.active else 'off'}")


def _plane(state: State, content: Content) -> State:
    found = add_plane(state, content)
    return (
        found if found.message else replace(found, message="drag its dot up or down; turn the view to reach its arrow")
    )


def _uncut(state: State, content: Content) -> State:
    if not state.cuts.any:
        return replace(state, message="nothing is cut")
    return replace(cut(state, content, Cuts(shown=state.cuts.shown)), message="nothing is cut any more")


ACTIONS: dict[str, Any] = {"handles": _handles, "cuts": _active, "plane": _plane, "uncut": _uncut}


def _side(plane: Plane, volume: Volume) -> tuple[int, int, float] | None:
    """Axis, end and share of the box's side that a plane is; None for others."""
    g = np.array(plane[:3]) @ volume.world_from_index
    axis = int(np.abs(g).argmax())
    along = np.delete(g, axis)
    if np.abs(along).max() > SAME * abs(g[axis]):
        return None
    place = (plane[3] - float(np.array(plane[:3]) @ np.asarray(volume.origin))) / float(g[axis])
    share = (place + 0.5) / volume.shape[2 - axis]
    return (axis, int(g[axis] < 0), share) if -SAME <= share <= 1 + SAME else None

"""What is marked in the view: the box and planes of cuts with their handles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from splatgl.app.viewer.cutting import Cuts
from splatgl.app.viewer.handles import box_edges, handles, outline
from splatgl.app.viewer.sight import seen, segment
from splatgl.data.volume import Volume
from splatgl.gl.marks import Color, Marks, Stroke
from splatgl.splat.view.camera import Camera

if TYPE_CHECKING:
    from splatgl.app.viewer.viewer import Viewer

# sRGB, of the box, of planes, and of what does not cut at present
BOX: Color = (0.36, 0.72, 1.0, 0.9)
PLANES: tuple[Color, ...] = ((1.0, 0.62, 0.2, 0.95), (0.45, 0.9, 0.45, 0.95), (0.95, 0.5, 0.85, 0.95))
RESTING: Color = (0.7, 0.7, 0.7, 0.7)
# pixels at a content scale of 1
LINE, DOT, TIP = 1.5, 11.0, 8.0


def marked(viewer: Viewer) -> Marks:
    """All that is marked now."""
    state, content, scale = viewer.state, viewer.content, viewer.window.scale
    if content.waiting:
        return Marks()
    return Marks((), tuple(of_cuts(state.cuts, content.volume, state.pose.camera, scale)))


def of_cuts(cuts: Cuts, volume: Volume, camera: Camera, scale: float) -> list[Stroke]:
    """The lines and dots of the box and the planes, in pixels; none while they are hidden."""
    if not cuts.shown:
        return []
    box = BOX if cuts.active else RESTING
    found = _lines(camera, box_edges(cuts, volume), box, LINE * scale)
    for number, plane in enumerate(cuts.planes):
        points = outline(cuts, volume, plane)
        rim = list(zip(points, np.roll(points, -1, axis=0), strict=True)) if len(points) else []
        found += _lines(camera, rim, plane_color(cuts, number), LINE * scale)
    feet = {}
    for handle in handles(cuts, volume):
        color = box if handle.what == "side" else plane_color(cuts, handle.number)
        if handle.what == "plane":
            feet[handle.number] = handle.point
        elif handle.what == "tilt":
            found += _lines(camera, [(feet[handle.number], handle.point)], color, LINE * scale)
        (place,) = seen(camera, handle.point[None])
        if np.isfinite(place).all():
            at = float(place[0]), float(place[1])
            found.append(Stroke(at, at, color, (TIP if handle.what == "tilt" else DOT) * scale, scale))
    return found


def plane_color(cuts: Cuts, number: int) -> Color:
    """That of a plane and its handles."""
    return PLANES[number % len(PLANES)] if cuts.active else RESTING


def _lines(camera: Camera, ends: list[tuple[np.ndarray, np.ndarray]], color: Color, width: float) -> list[Stroke]:
    found = [segment(camera, start, stop) for start, stop in ends]
    return [Stroke(*each, color, width) for each in found if each is not None]

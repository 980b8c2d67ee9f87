"""What was chosen for a picture that nothing was said of, in a line each."""

from __future__ import annotations

from splatgl.app.backgrounds import Color, told
from splatgl.app.scene import Scene
from splatgl.data.volume import Volume
from splatgl.splat.classification.transfer import Transfer


def choices_of(scene: Scene, volume: Volume, transfer: Transfer, ground: Color | str | None) -> list[str]:
    """Lines on the view of a flat stack, a logarithmic scale, and the background that was chosen."""
    lines = []
    if scene.view.along_z(volume):
        lines.append("a flat stack, seen along z: x to the right, y down; --elevation 60 sees it from above")
    if transfer.logarithmic:
        low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
        opaque = next((value for value, opacity in transfer.points if opacity > 0), high)
        first = max((value for value, opacity in transfer.points if value < opaque), default=opaque)
        lines.append(f"logarithmic: colours from {low:.4g} to {high:.4g}, values up to {first:.4g} are clear")
    return lines + told(scene.settings, ground)

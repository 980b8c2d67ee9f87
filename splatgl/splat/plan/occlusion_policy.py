"""Occlusion policy: the transmittance at which tiles terminate, and whether a volume is solid."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.screen_bounds import ScreenBounds
from splatgl.splat.view.view import View

# transmittance at termination, as a share of the tolerance. sRGB is 13 times as steep at black as on average, so at
# the default tolerance this is one level there too; 3/4 is only 5 % faster
SHARE = 1 / 13
# mean optical depth over the window from which a volume is solid
SOLID = 20.0
# nearer batches are smaller: batch i of n ends at (i/n)^GROWTH of the splats
GROWTH = 1.5


@dataclass(frozen=True)
class Hiding:
    """depth_batches: their number per picture; splats behind terminated tiles are not listed.

    cutoff: transmittance below which a tile terminates; 0: never.
    """

    depth_batches: int = 1
    cutoff: float = 0.0


def solid(splats: Splats, view: View, bounds: ScreenBounds) -> bool:
    """Whether the splats' mean optical depth over the window hides most of them."""
    area = bounds.window.width * bounds.window.height
    pixel = view.pitch * bounds.mean_depth if view.perspective else view.pitch
    return area > 0 and splats.total_depth / (area * pixel**2) >= SOLID


def cuts(count: int, number: int) -> list[int]:
    """Starts of `number` batches of `count` splats, and the end."""
    return [int(count * (n / number) ** GROWTH) for n in range(number)] + [count]

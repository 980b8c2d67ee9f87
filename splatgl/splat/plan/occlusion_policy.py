"""What may be hidden: how little light may pass a tile that ends, and whether a volume is solid."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.view.screen_bounds import ScreenBounds
from splatgl.splat.view.view import View

# share of the tolerance that may be hidden: the light that still passes where no more is drawn. sRGB is 13 times
# as steep at black as on average: so it is a level there too, at the default tolerance; 3/4 is but 5 % faster
SHARE = 1 / 13
# a volume is solid with as much optical depth on average over the window
SOLID = 20.0
# nearer parts are smaller: part i of n ends at (i/n)^this of the splats
GROWTH = 1.5


@dataclass(frozen=True)
class Hiding:
    """depth_batches: in how many a picture is drawn, so that what lies behind tiles that have ended is not listed.

    cutoff: a tile ends where less than this share of the light passes; 0: none does.
    """

    depth_batches: int = 1
    cutoff: float = 0.0


def solid(splats: Splats, view: View, bounds: ScreenBounds) -> bool:
    """Whether the optical depth that the splats would have, if they were spread over the window, hides most of them."""
    area = bounds.window.width * bounds.window.height
    pixel = view.pitch * bounds.mean_depth if view.perspective else view.pitch
    return area > 0 and splats.total_depth / (area * pixel**2) >= SOLID


def cuts(count: int, number: int) -> list[int]:
    """Where `number` parts of `count` splats begin, and the end."""
    return [int(count * (n / number) ** GROWTH) for n in range(number)] + [count]

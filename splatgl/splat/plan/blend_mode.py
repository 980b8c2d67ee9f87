"""Blend modes: a splat's value along a ray, and how values combine. All other code reads this table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BlendMode:
    """join: `over` (by the transmittance of nearer splats), `sum`, `max`, `min` or `mean`.

    peak: whether a splat's value is its opacity times its share of the footprint's peak, instead of a line integral.
    """

    name: str
    join: str
    peak: bool
    about: str

    @property
    def ordered(self) -> bool:
        """Whether the picture depends on the order."""
        return self.join == "over"

    @property
    def unbounded(self) -> bool:
        """Whether pixel values are unbounded: errors and PNGs are relative to the brightest."""
        return self.join == "sum"

    @property
    def one_value(self) -> bool:
        """Whether a pixel of values classified after reconstruction shows one: the join of all along its ray."""
        return self.join in ("max", "min", "mean")

    @property
    def post_only(self) -> bool:
        """Whether splats that are classified before have no such blend."""
        return self.join in ("min", "mean")


BLENDS = {
    mode.name: mode
    for mode in (
        BlendMode("composite", "over", False, "'over' by opacity, nearest first"),
        BlendMode("xray", "sum", False, "sums of optical depth and of depth times colour"),
        BlendMode("mip", "max", True, "the maximum of opacity and of opacity times colour, or of values"),
        BlendMode("minip", "min", False, "the minimum of values"),
        BlendMode("mean", "mean", False, "the mean of values over the ray's length"),
    )
}

"""`Accuracy`: the error of a picture against float64 by a bound or by drawn pixels, in numbers and in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any


def aliasing_note(info: Mapping[str, object]) -> str:
    """A clause on the error of a picture whose voxels are narrower than its samples, by its provenance, as the
    reference takes the same samples; "" for others.
    """
    return "; aliasing is not counted" if info.get("aliased") is True else ""


@dataclass(frozen=True)
class Accuracy:
    """Error of a picture against the float64 reference of the same splats, linear premultiplied light.

    error_bound: largest error of any channel of any pixel. tolerance: the allowed one. tolerance_met: whether the bound
    is within it. checked: as `sg.check` stores it, of pixels that were drawn in float64. Each is None where it is not
    known. brightest: largest component of a picture of sums, to which its errors are relative. level: of the volume.
    note: of `aliasing_note`.
    """

    error_bound: float | None
    tolerance: float | None
    tolerance_met: bool | None
    checked: Mapping[str, Any] | None = None
    brightest: float | None = None
    level: int = 0
    note: str = ""

    def __str__(self) -> str:
        """The bound and the tolerance, and a line of each comparison."""
        if self.tolerance is None:
            return "its error is not known"
        known = "no error bound" if self.error_bound is None else f"error bound {self.error_bound:.3g}"
        met = {None: "not known to be met", False: "not met", True: "met"}[self.tolerance_met]
        return "\n".join([f"{known}: the tolerance {self.tolerance:.3g} is {met}{self.note}", *self.comparisons])

    @property
    def comparisons(self) -> tuple[str, ...]:
        """Text on the errors of compared pixels, to the reference and to the field."""
        if self.checked is None:
            return ()
        relative = "" if self.brightest is None else f" of {self.brightest:.3g}"
        checked = self.checked
        text = guarantee(checked, relative)
        text += f": {'all ' * (checked['confidence'] == 1)}{checked['pixels']} drawn in float64"
        if self.level:
            text += f", of level {self.level}'s voxels"
        text += f"; RMSE {checked['rmse']:.2g}, worst at {checked['worst'][0]}, {checked['worst'][1]}"
        field = checked.get("field")
        if field is None:
            return (text,)
        field_text = f"off the field itself by up to {field['largest']:.2g}{relative}, RMSE {field['rmse']:.2g}"
        return text, f"{field_text}, in {field['pixels']} of these pixels"


def guarantee(checked: Mapping[str, Any], relative: str = "") -> str:
    """The statement that follows from a comparison with float64. relative: to what, of sums."""
    most = f"{_round_up(checked['largest'])}{relative}"
    if checked["confidence"] == 1:
        return f"no pixel is off by more than {most}"
    above = checked["share_above_tolerance"]
    text = f"with {100 * checked['confidence']:.0f} % confidence at most {_round_up(100 * checked['share'])} % of the "
    text += f"pixels are off by more than {most}"
    return text if above <= checked["share"] else f"{text}, {_round_up(100 * above)} % by more than the tolerance"


def _round_up(number: float) -> str:
    """Two digits of a number, rounded up."""
    if number <= 0:
        return "0"
    step = 10.0 ** (floor(log10(number)) - 1)
    return f"{ceil(round(number / step, 9)) * step:.2g}"

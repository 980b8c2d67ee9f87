"""Errors of an image against a truth, in linear light on premultiplied floats."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from splatgl.comparison.compare import compare
from splatgl.data.image import Image

# fraction of pixels worse than `p999`, per cent
WORST = 0.1


@dataclass(frozen=True)
class Errors:
    """rmse: root mean square of the differences over that of the truth. maximum: the largest of any channel; p999:
    exceeded by one pixel in a thousand. share_over: of the pixels off by more than 1/255. energy: (Σ − Σ_truth)/Σ_truth
    over all channels. flip: mean FLIP, None if not requested. maximum and p999 relative to an X-ray's peak.
    """

    rmse: float
    maximum: float
    p999: float
    share_over: float
    energy: float
    flip: float | None = None

    def as_dict(self) -> dict[str, float | None]:
        """All errors by name, for JSON."""
        return asdict(self)


def errors(image: Image, truth: Image, flip: bool = False) -> Errors:
    """The errors of `image` against `truth`, both [H, W, 4] of one size. Raises InputError as `compare`."""
    found = compare(image, truth, extra=("flip",) if flip else ())
    drawn, right = (np.asarray(each.pixels, np.float64) for each in (image, truth))
    worst = np.abs(drawn - right).max(axis=-1)
    scale = float(np.sqrt((right * right).mean()))
    return Errors(
        rmse=found.rmse / scale if scale else found.rmse,
        maximum=found.maximum / found.peak,
        p999=float(np.percentile(worst, 100 - WORST)) / found.peak,
        share_over=found.share_over,
        energy=found.sum_error,
        flip=found.flip,
    )

"""The voxel extractor: splats of the voxels that a transfer function asks for.  [M98 §5]

It reads the volume slab by slab.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.splat.classification.post import PostClassified, active_range
from splatgl.splat.classification.transfer import Transfer
from splatgl.splat.extraction.post import extract_post
from splatgl.splat.extraction.pre import extract_pre
from splatgl.splat.extraction.splats import MOST_KEPT, Grid, Splats
from splatgl.splat.kernel.kernels import kernel as kernel_named

if TYPE_CHECKING:
    from splatgl.splat.layers.layers import Scene

# voxels in a slab: temporaries stay near 100 MB, numpy's overhead a thousandth
SLAB_VOXELS = 1 << 22
# kernel of values that are classified after reconstruction: its means are nearest to known fields
POST_KERNEL = "b-spline"
# ranges of values over which the steps of a table are numbers of float64
LEAST_SPAN, MOST_SPAN = 1e-290, 1e300
# largest ratio between reference length and spacing, either way: both fit float32
MOST_UNIT = 1e30

Progress = Callable[[Iterator[Any], int], Iterator[Any]]


@dataclass(frozen=True, eq=False)
class Source:
    """Where splats come from, so that pictures which take others of the same volume can extract them.

    many: whether values would be more than MOST_KEPT. made: those that are extracted, by classification and kernel.
    """

    volume: Volume
    transfer: Transfer
    threshold: float
    slab: int | None = None
    many: bool = False
    made: dict[tuple[str, str], Splats] = field(default_factory=dict)

    @property
    def only_pre(self) -> str | None:
        """What takes splats that are classified before reconstruction; None if both kinds can be extracted."""
        return only_pre(self.volume, self.transfer, self.threshold)

    def splats(self, classification: str, kernel: str) -> Splats:
        """The splats for that classification, and for that kernel if they are classified after; extracted once."""
        key = classification, kernel
        if key not in self.made:
            self.made[key] = extract(
                self.volume, self.transfer, self.threshold, self.slab, classification=classification, kernel=kernel
            )
        return self.made[key]


@overload
def extract(
    volume: Volume,
    transfer: Transfer,
    threshold: float = 0.0,
    slab: int | None = None,
    progress: Progress | None = None,
    classification: str = "auto",
    kernel: str = POST_KERNEL,
) -> Splats: ...


@overload
def extract(volume: Volume, transfer: Sequence[Transfer], threshold: float = 0.0) -> Scene: ...


def extract(
    volume: Volume,
    transfer: Transfer | Sequence[Transfer],
    threshold: float = 0.0,
    slab: int | None = None,
    progress: Progress | None = None,
    classification: str = "auto",
    kernel: str = POST_KERNEL,
) -> Splats | Scene:
    """The splats of all finite voxels that the transfer function asks for, in row order. Of several transfer functions,
    one for each of the volume's channels: the scene of these layers, extracted when it is drawn.

    classification "pre": colours and opacities of voxels with t = F(∇, ρ) > threshold. "post": values and gradients
    for `kernel`, which are classified after reconstruction, of all voxels that opaque points need; "post-all": of all,
    as blends of one value need; "post-lean": without the quarter of "post" that only the rims of kernels need, for
    pictures in motion; these for volumes without colours, and without a threshold. "auto": post where it is possible,
    of at most MOST_KEPT voxels, else pre; a picture whose settings take others extracts those once, from the volume,
    which the splats keep.

    threshold is an opacity per reference length in [0, 1); slab: planes, or as many voxels, read at a time.
    progress wraps the iteration over such parts (parts, their number). Raises InputError for a threshold
    outside [0, 1), for a unit that float32 can't hold in spacings, and for more or fewer functions than channels.
    """
    if not isinstance(transfer, Transfer):
        return _layers(volume, list(transfer), threshold)
    if not 0.0 <= threshold < 1.0:
        raise expected("threshold", "an opacity of at least 0 and less than 1", threshold)
    if classification not in ("auto", "pre", "post", "post-all", "post-lean"):
        raise expected("classification", "auto, pre, post, post-all or post-lean", repr(classification))
    spacing = Grid(volume.world_from_index, np.asarray(volume.origin)).mean_spacing
    unit = transfer.unit or spacing
    if not 1 / MOST_UNIT <= unit / spacing <= MOST_UNIT:
        raise expected("unit", f"a length within {MOST_UNIT:g} of the spacing, {spacing:g}", f"{unit:g}")
    depth, height, width = volume.shape
    planes = slab or max(1, SLAB_VOXELS // (height * width))
    why = only_pre(volume, transfer, threshold)
    if classification == "pre" or (classification == "auto" and why):
        found = extract_pre(volume, transfer, threshold, planes, progress)
    elif why:
        raise InputError(f"{volume.name or 'volume'}: only classification pre is possible, because of {why}")
    else:
        post = PostClassified.of(transfer, kernel, (width, height, depth), classification == "post-all")
        post = replace(post, lean=classification == "post-lean")
        found = extract_post(volume, post, kernel_named(kernel), planes * height * width, progress)
    found = replace(found, frame=volume.frame)
    if classification != "auto":
        return found
    many = found.post is not None and len(found) > MOST_KEPT
    if many:
        found = replace(extract_pre(volume, transfer, threshold, planes, progress), frame=volume.frame)
    return replace(found, source=Source(volume, transfer, threshold, slab, many))


def _layers(volume: Volume, transfers: list[Transfer], threshold: float) -> Scene:
    """The scene of a volume's channels."""
    from splatgl.splat.layers.layers import Layer, Scene

    channels = volume.channels or (volume,)
    if len(transfers) != len(channels):
        raise expected("transfer", f"one, or one for each of {len(channels)} channels", len(transfers))
    looks = zip(channels, transfers, strict=True)
    return Scene([Layer(channel, each, threshold=threshold) for channel, each in looks])


def only_pre(volume: Volume, transfer: Transfer, threshold: float) -> str | None:
    """What takes splats that are classified before reconstruction; None if both kinds can be extracted."""
    if threshold > 0:
        return "threshold"
    if transfer.labels:
        return "labels"
    low, high = active_range(transfer)
    if low < high and not LEAST_SPAN <= high - low <= MOST_SPAN:
        return f"values from {low:g} to {high:g}"
    return "colours of its own" if volume.color is not None else None

"""`extract`: splats of a volume; voxels classified before reconstruction.

The volume is read slab by slab. Each splat depends only on its voxel and six neighbours, so the result is
bit-identical for any slab size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from splatgl.coercion import public
from splatgl.data.color import linear_from_srgb
from splatgl.data.volume import Slab, Volume
from splatgl.errors import InputError, expected
from splatgl.geometry.grid import Grid
from splatgl.splat.extract_values import extract_post, gradients
from splatgl.splat.hidden_interior import HiddenInterior
from splatgl.splat.kernels import kernel as kernel_named
from splatgl.splat.lighting import HALO, LabelNormals
from splatgl.splat.splats import (
    MOST_KEPT,
    NORMAL_SCALE,
    GrowingRecords,
    Splats,
    assemble,
    in_parts,
    record_type,
    stored_color,
)
from splatgl.transfer.preintegration import ValueClassifier, active_range, nearest_transparent, opaque_intervals
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.planning.scene import Scene


# voxels in a slab: temporaries stay near 200 MB, the planes that two slabs share are few
SLAB_VOXELS = 1 << 23
# kernel of values that are classified after reconstruction: its means are nearest to known fields
POST_KERNEL = "b-spline"
# ranges of values over which the steps of a table are numbers of float64
LEAST_SPAN, MOST_SPAN = 1e-300, 1e306
# largest ratio between reference length and spacing, either way: both fit float32
MOST_UNIT = 1e30

Progress = Callable[[Iterator[Any], int], Iterator[Any]]


@dataclass(frozen=True, eq=False)
class SplatSource:
    """Volume and transfer function of splats, to extract other splats from them when a picture needs these.

    many: whether there would be more than MOST_KEPT values, hidden ones included. made: extracted splats by
    classification, kernel and reach.
    """

    volume: Volume
    transfer: Transfer
    threshold: float
    slab: int | None = None
    many: bool = False
    made: dict[tuple[str, str, int], Splats] = field(default_factory=dict)

    @property
    def only_pre(self) -> str | None:
        """Reason why only classification before reconstruction is possible; None if both kinds are."""
        return why_only_pre(self.volume, self.transfer, self.threshold)

    def splats(self, classification: str, kernel: str, reach: int = 0) -> Splats:
        """Extracts splats once for each classification, kernel and reach; reach: see `_extract_visible`; 0: of all
        voxels, hidden ones included. More than MOST_KEPT values of maxima are classified before reconstruction.
        """
        key = classification, kernel, reach
        if key not in self.made:
            how = self.volume, self.transfer, self.threshold, self.slab
            self.made[key] = (
                _extract_visible(*how, kernel=kernel, reach=reach)
                if reach
                else extract(*how, classification=classification, kernel=kernel)
            )
            if classification == "post-max" and len(self.made[key]) > MOST_KEPT:
                self.made[key] = self.splats("pre", "")
        return self.made[key]


@overload
def extract(
    volume: Volume | Any,
    transfer: Transfer | str | Path | Mapping[str, Any],
    threshold: float = 0.0,
    slab: int | None = None,
    progress: Progress | None = None,
    classification: str = "auto",
    kernel: str = POST_KERNEL,
) -> Splats: ...


@overload
def extract(volume: Volume | Any, transfer: Sequence[Transfer | Any], threshold: float = 0.0) -> Scene: ...


@public
def extract(
    volume: Volume | Any,
    transfer: Transfer | Sequence[Transfer | Any] | Any,
    threshold: float = 0.0,
    slab: int | None = None,
    progress: Progress | None = None,
    classification: str = "auto",
    kernel: str = POST_KERNEL,
) -> Splats | Scene:
    """Extracts splats of all finite voxels that the transfer function shows, in row order. With one transfer function
    for each of the volume's channels: returns the scene of these layers, extracted when it is drawn.

    classification "pre": colours and opacities of voxels with t = F(∇, ρ) > threshold. "post": values and gradients
    for `kernel`, classified after reconstruction, of all voxels that opaque points need; "post-all": of all voxels, for
    blends of one value; "post-max": of those that maxima above all transparent values need; "post-lean": without the
    quarter that only the rims of kernels need, for pictures in motion.
    The post kinds need a volume without colours, and no threshold. "auto": post where possible with at most MOST_KEPT
    voxels, else pre; the splats refer to the volume, so that pictures can extract the other kind once. Large interiors
    that no eye outside sees are left out, too, and extracted with the rest for pictures that may show them; see
    hidden_interior.py.

    threshold: opacity per reference length in [0, 1). slab: planes, or as many voxels, to read at a time. progress
    wraps the iteration over these parts (parts, their number). Raises InputError for a threshold outside [0, 1), for a
    unit that float32 can't hold in spacings, and for more or fewer functions than channels.
    """
    if not isinstance(transfer, Transfer):
        return _layers(volume, list(transfer), threshold)
    if not 0.0 <= threshold < 1.0:
        raise expected("threshold", "an opacity of at least 0 and less than 1", threshold)
    if classification not in ("auto", "pre", "post", "post-all", "post-max", "post-lean"):
        raise expected("classification", "auto, pre, post, post-all, post-max or post-lean", repr(classification))
    if volume.points is not None and classification in ("auto", "pre"):
        splats = Splats.of_points(volume.points, float(transfer.opacity(np.array([1.0]))[0]))
        return replace(splats, name=volume.name, frame=volume.frame)
    spacing = Grid.of(volume).mean_spacing
    transfer, unit = transfer.on(volume), transfer.length(volume)
    if not 1 / MOST_UNIT <= unit / spacing <= MOST_UNIT:
        raise expected("unit", f"a length within {MOST_UNIT:g} of the spacing, {spacing:g}", f"{unit:g}")
    why = why_only_pre(volume, transfer, threshold)
    _check_iso(volume, transfer, why or ("classification pre" if classification == "pre" else None))
    if classification == "auto" and not why:
        return _extract_visible(volume, transfer, threshold, slab, progress, kernel)
    if classification in ("auto", "pre"):
        splats = extract_pre(volume, transfer, threshold, _planes(volume, slab), progress)
        source = SplatSource(volume, transfer, threshold, slab) if classification == "auto" else None
        return replace(splats, frame=volume.frame, source=source, box=volume.corners)
    if why:
        raise InputError(f"{volume.name or 'volume'}: only classification pre is possible, because of {why}")
    every, largest = classification == "post-all", classification == "post-max"
    post = ValueClassifier.of(transfer, kernel, volume.shape[::-1], every, largest)
    post = replace(post, lean=classification == "post-lean")
    return replace(_extract_values(volume, post, slab, progress), frame=volume.frame)


def _extract_visible(
    volume: Volume,
    transfer: Transfer,
    threshold: float,
    slab: int | None,
    progress: Progress | None = None,
    kernel: str = POST_KERNEL,
    reach: int = 1,
) -> Splats:
    """Extracts the values of a volume without hidden interiors; colours of all voxels if there are more than MOST_KEPT.

    reach: cells of hidden_interior.py that the kernels of pictures reach.
    """
    post = ValueClassifier.of(transfer, kernel, volume.shape[::-1])
    hidden = HiddenInterior.of(volume, post, transfer.length(volume), reach)
    splats = _extract_values(volume, post, slab, progress, hidden)
    many = len(splats) + (hidden.count if hidden else 0) > MOST_KEPT
    if many and len(splats) > MOST_KEPT:
        _check_iso(volume, transfer, f"more than {MOST_KEPT:,} values")
        splats = extract_pre(volume, transfer, threshold, _planes(volume, slab), progress, hidden)
    source = SplatSource(volume, transfer, threshold, slab, many)
    return replace(
        splats, frame=volume.frame, source=source, skipped_interior=reach if hidden else 0, box=volume.corners
    )


def _extract_values(
    volume: Volume,
    post: ValueClassifier,
    slab: int | None,
    progress: Progress | None,
    hidden: HiddenInterior | None = None,
) -> Splats:
    """Splats of the values that `post` wants, without a hidden interior."""
    _, height, width = volume.shape
    inside = hidden.inside if hidden else None
    return extract_post(
        volume, post, kernel_named(post.kernel), _planes(volume, slab) * height * width, progress, inside
    )


def _planes(volume: Volume, slab: int | None) -> int:
    """Planes to read at a time."""
    return slab or max(1, SLAB_VOXELS // (volume.shape[1] * volume.shape[2]))


def _check_iso(volume: Volume, transfer: Transfer, why: str | None) -> None:
    """Raises InputError for iso-surfaces of voxels that are classified before reconstruction, for a reason `why`."""
    if transfer.iso and why:
        raise expected(f"iso of {volume.name or 'a volume'}", "values classified after reconstruction", why)


def _layers(volume: Volume, transfers: list[Transfer], threshold: float) -> Scene:
    from splatgl.planning.scene import Layer, Scene

    channels = volume.channels or (volume,)
    if len(transfers) != len(channels):
        raise expected("transfer", f"one, or one for each of {len(channels)} channels", len(transfers))
    looks = zip(channels, transfers, strict=True)
    return Scene([Layer(channel, look, threshold=threshold) for channel, look in looks])


def why_only_pre(volume: Volume, transfer: Transfer, threshold: float) -> str | None:
    """Reason why only classification before reconstruction is possible; None if both kinds are."""
    if volume.points is not None:
        return "points"
    if threshold > 0:
        return "threshold"
    if transfer.labels:
        return "labels"
    low, high = active_range(transfer)
    if low < high and not LEAST_SPAN <= high - low <= MOST_SPAN:
        return f"values from {low:g} to {high:g}"
    return "colours of its own" if volume.color is not None else None


# integer types up to this many bytes use a lookup table over all values
TABLE_BYTES = 2
# records computed at a time
RECORDS = 1 << 16
# gradients below this may not be multiplied exactly in float64
TINY = 2.0**-1000


@dataclass(frozen=True, eq=False)
class ExtinctionTable:
    """Opacity, threshold test and record colour of values: tabulated for integer types, computed for others."""

    transfer: Transfer
    threshold: float
    record: np.dtype
    first: int | None
    opacities: np.ndarray
    colors: np.ndarray

    @classmethod
    def of(cls, transfer: Transfer, dtype: np.dtype, threshold: float, record: np.dtype) -> ExtinctionTable:
        """Tabulates all values of bool and of integers up to TABLE_BYTES; other types get no table."""
        if dtype.kind == "b":
            values = np.array([0, 1])
        elif dtype.kind in "ui" and dtype.itemsize <= TABLE_BYTES:
            values = np.arange(np.iinfo(dtype).min, np.iinfo(dtype).max + 1)
        else:
            return cls(transfer, threshold, record, None, np.zeros(0), np.zeros((0, 3)))
        opacity, color = transfer.largest_opacity(values), stored_color(transfer.color(values), record)
        return cls(transfer, threshold, record, int(values[0]), opacity, color)

    def keeps(self, samples: np.ndarray) -> np.ndarray:
        """bool [...]: whether opacities of values may exceed the threshold at any gradient."""
        if self.first is None:
            return self.opacity(samples) > self.threshold
        return np.take(self.opacities > self.threshold, self._entry(samples))

    def opacity(self, values: np.ndarray) -> np.ndarray:
        """The transfer function's largest opacity of values [...] at any gradient, float64."""
        if self.first is None:
            return np.asarray(self.transfer.largest_opacity(values))
        return np.take(self.opacities, self._entry(values))

    def color(self, values: np.ndarray) -> np.ndarray:
        """The record's colour of values [...]: [..., 3]."""
        if self.first is None:
            return stored_color(self.transfer.color(values), self.record)
        return np.take(self.colors, self._entry(values), axis=0)

    def _entry(self, values: np.ndarray) -> np.ndarray:
        if not self.first:
            return values.view(np.uint8) if values.dtype == bool else values
        return values.astype(np.int32) - self.first


def extract_pre(
    volume: Volume,
    transfer: Transfer,
    threshold: float,
    planes: int,
    progress: Progress | None = None,
    interior: HiddenInterior | None = None,
) -> Splats:
    """Splats of all finite voxels with t > threshold, in row order, without a hidden interior; planes: of a slab."""
    depth = volume.shape[0]
    grid = Grid.of(volume)
    lookup = ExtinctionTable.of(transfer, volume.samples.dtype, threshold, record_type(volume.shape, post=False))
    unit = transfer.length(volume)
    dropped = DroppedDepths(volume.shape) if threshold > 0 else None

    normals = LabelNormals.empty(volume) if transfer.labels else None
    slabs = volume.slabs(planes, halo=1 if normals is None else HALO)
    gathered = GrowingRecords(lookup.record)
    for part in progress(slabs, -(-depth // planes)) if progress else slabs:
        part = replace(part, samples=np.ascontiguousarray(part.samples))
        inner = part.samples[part.before : part.before + part.stop - part.start]
        # voxels whose opacity may exceed the threshold
        hidden = None if not volume.masks else ~_kept_by_masks(volume, part.start, len(inner))
        if interior:
            within = interior.inside((part.start, 0, 0), (part.stop, *volume.shape[1:]))
            hidden = within if hidden is None else hidden | within
        flat = np.flatnonzero(lookup.keeps(inner) if hidden is None else lookup.keeps(inner) & ~hidden)
        color = None if volume.color is None or not len(flat) else np.asarray(volume.color[part.start : part.stop])
        if normals is not None:
            normals.add(volume, part, _label_opacity(lookup, volume, part))
        work = partial(_records, volume, _ClassifiedSlab(part, color, normals), flat, lookup, unit / grid.mean_spacing)
        results = in_parts(len(flat), RECORDS, work)
        for records, _ in results:
            gathered.add(records)
        if dropped:
            dropped.add(lookup, inner, part.start, flat, [opacity for _, opacity in results], hidden)

    lost = dropped.largest() * grid.mean_spacing / unit if dropped else 0.0
    position = gathered.records["position"]
    splats = assemble(gathered.records, position, grid, unit, volume.name, transfer.shading, lost)
    if normals is None or not len(position):
        return splats
    return replace(
        splats, labels=normals.crop(position.min(axis=0).astype(np.int64), position.max(axis=0).astype(np.int64))
    )


@dataclass(frozen=True, eq=False)
class _ClassifiedSlab:
    """A slab, the colours of its inner voxels, and the normals that shade labels instead of gradients."""

    slab: Slab
    color: np.ndarray | None
    normals: LabelNormals | None


def _kept_by_masks(volume: Volume, first: int, planes: int) -> np.ndarray:
    """bool: which voxels of some planes the masks keep."""
    return volume.kept((first, 0, 0), (first + planes, *volume.shape[1:]))


def _label_opacity(lookup: ExtinctionTable, volume: Volume, part: Slab) -> np.ndarray:
    """Opacities, float32, of a slab's voxels: 0 where hidden or masked."""
    opacity = np.where(lookup.keeps(part.samples), lookup.opacity(part.samples), 0.0).astype(np.float32)
    if volume.masks:
        opacity *= _kept_by_masks(volume, part.start - part.before, len(opacity))
    return opacity


def _records(
    volume: Volume,
    part: _ClassifiedSlab,
    flat: np.ndarray,
    lookup: ExtinctionTable,
    unit_in_spacings: float,
    which: slice,
) -> tuple[np.ndarray, np.ndarray]:
    """Records of some voxels, given by flat indices into a slab's inner voxels; and t of all of them."""
    transfer, slab, color = lookup.transfer, part.slab, part.color
    _, height, width = slab.samples.shape
    flat = flat[which] + slab.before * height * width
    samples = slab.samples.reshape(-1)
    values = np.take(samples, flat)
    opacity = lookup.opacity(values)
    z, rest = np.divmod(flat, height * width)
    y, x = np.divmod(rest, width)

    # gradients if needed; F(∇, ρ)
    gradient = np.zeros((len(flat), 3))
    if (transfer.shading and part.normals is None) or transfer.needs_gradients:
        # faces at the ends are lit; opacity by gradients would show them
        if transfer.varies_by_gradient:
            gradient = gradients(slab.samples, x, y, z, 2)
        else:
            # values that are tiny are not halved exactly
            is_tiny = values.dtype == np.float64 and np.abs(values).max(initial=0.0) < TINY
            gradient = _directions(slab.samples, (x, y, z), opaque_intervals(transfer), 2.0**60 if is_tiny else 1.0)
        gradient = gradient @ np.linalg.inv(volume.world_from_index)
    rgb = None
    if transfer.needs_gradients:
        opacity, rgb = transfer.classify(values, np.hypot(np.hypot(*gradient.T[:2]), gradient[:, 2]))
    everyone = opacity
    if rgb is not None:
        keep = opacity > lookup.threshold
        values, opacity, gradient, rgb = values[keep], opacity[keep], gradient[keep], rgb[keep]
        x, y, z = x[keep], y[keep], z[keep]

    records = np.zeros(len(values), lookup.record)
    z -= slab.before
    if color is not None:
        linear = linear_from_srgb(np.arange(256) / 255)
        records["color"] = stored_color(linear, lookup.record)[color[z, y, x]]
    else:
        records["color"] = lookup.color(values) if rgb is None else stored_color(rgb, lookup.record)
    z += slab.start
    records["position"][:, 0], records["position"][:, 1], records["position"][:, 2] = x, y, z
    records["optical_depth"] = transfer.extinction(opacity, unit_in_spacings)
    if transfer.shading:
        records["normal"] = _snorm(gradient if part.normals is None else part.normals.of_voxels(x, y, z))
    return records, everyone


def _directions(
    samples: np.ndarray, places: tuple[np.ndarray, np.ndarray, np.ndarray], opaque: np.ndarray, scale: float
) -> np.ndarray:
    """Gradients [N, 3] per grid step whose length does not matter, of scaled values. opaque [n, 2]: intervals of values
    whose missing neighbours count as transparent.
    """

    def around(center: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        outside, within = nearest_transparent(opaque, center / scale)
        return outside * scale, within

    gradient = gradients(samples if scale == 1.0 else samples * scale, *places, 2, around)
    gradient[np.abs(gradient).max(axis=1) < TINY] *= 2.0**60
    return gradient


def _snorm(gradient: np.ndarray) -> np.ndarray:
    """Unit vectors as 16-bit fractions; zero and tiny gradients give zero."""
    x, y, z = np.abs(gradient.T)
    largest = np.maximum(np.maximum(x, y), z)[:, None]
    scaled = gradient / np.where(largest > 0, largest, 1.0)
    length = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))[:, None]
    return np.rint(scaled / np.where(length > 0, length, 1.0) * NORMAL_SCALE).astype(np.int16)


class DroppedDepths:
    """Optical depth per reference length removed by the threshold, summed along every axis line."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        d, h, w = shape
        self.sums = [np.zeros((h, w)), np.zeros((d, w)), np.zeros((d, h))]

    def add(
        self,
        lookup: ExtinctionTable,
        inner: np.ndarray,
        start: int,
        flat: np.ndarray,
        parts: list[np.ndarray],
        hidden: np.ndarray | None = None,
    ) -> None:
        """Adds a slab's inner voxels, except hidden ones and those kept at `flat`. parts: opacities t of the latter."""
        opacity = np.concatenate([*parts, np.zeros(0)])
        left = lookup.opacity(inner)
        if hidden is not None:
            left = np.where(hidden, 0.0, left)
        if lookup.transfer.needs_gradients:
            # voxels dropped by value count in full (an upper bound); the others with their t
            np.put(left, flat, np.where(opacity > lookup.threshold, 0.0, opacity))
        else:
            np.put(left, flat, 0.0)
        depth = lookup.transfer.extinction(left, 1.0)
        stop = start + len(inner)
        self.sums[0] += depth.sum(axis=0)
        self.sums[1][start:stop] += depth.sum(axis=1)
        self.sums[2][start:stop] += depth.sum(axis=2)

    def largest(self) -> float:
        """The largest of the sums."""
        return float(max(total.max() for total in self.sums))

"""`splatgl info FILE`: page on a volume: grid, samples, and a histogram of the values."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

import numpy as np

from splatgl.cli.parser import one_line
from splatgl.data.image import EXR, TIFF, Image, load_tiff
from splatgl.data.volume import Label, Volume
from splatgl.errors import InputError, MissingOption
from splatgl.fileio import budget, format_bytes
from splatgl.planning.bricks import MOST_FINE, bricks_of, estimate_need, excess_need, needed_together
from splatgl.planning.scene import channel_transfers
from splatgl.readers.common import is_mapped
from splatgl.splat.settings import Settings
from splatgl.transfer.colormaps import labels_of
from splatgl.transfer.presets import default_transfer

# columns of the page, for terminals of 80 columns
WIDTH = 78
# most times that are listed
MOST_TIMES = 8
# most segments that are listed
MOST_SEGMENTS = 40
# bars of the histogram, which fit a screen together with the text above
BINS = 16
# samples per slab, so that mapped files are never read whole: bins and copies take some 30 MiB
SLAB_SAMPLES = 2**20
# largest measured level, voxels
MOST = 2**28
# pixels of the image in the estimate of memory
SIZE = (512, 512)
# width of labels
_LABEL = 11
_EIGHTHS = " ▏▎▍▌▋▊▉"


@dataclass(frozen=True)
class SampleStatistics:
    """Minimum, maximum and mean of the finite samples; counts of finite and other samples. NaN if none is finite."""

    low: float
    high: float
    mean: float
    finite: int
    not_finite: int


def describe(volume: Volume) -> str:
    """Page on a volume, at most 78 columns wide. Reads the samples twice, in slabs; a coarser level of large images."""
    if volume.points is not None:
        return "\n".join(line[:WIDTH].rstrip() for line in [_fit(volume.name) or "points", *_point_lines(volume)])
    levels, number = _measured_level(volume)
    statistics = measure(levels[number])
    lines = [
        *_grid_lines(volume),
        *_channel_lines(volume),
        *_segment_lines(volume),
        *_level_lines(levels, number),
        *_sample_lines(volume, statistics),
    ]
    if statistics.finite:
        lines += _drawing_lines(volume)
        lines += ["", *_bars(*histogram(levels[number], statistics))]
    return "\n".join(line[:WIDTH].rstrip() for line in [_fit(volume.name) or "volume", *lines])


def as_json(source: str, volume: Volume) -> str:
    """One line of JSON on a volume. Reads the samples as `describe`; of points only their number is stated."""
    levels, number = _measured_level(volume)
    statistics = None if volume.points is not None else measure(levels[number])
    bins = histogram(levels[number], statistics) if statistics is not None and statistics.finite else None
    record = {
        "source": source,
        **{name: getattr(volume, name) for name in ("name", "unit", "frame", "quantity", "value_unit")},
        "voxels": volume.shape[::-1],
        **{name: getattr(volume, name) for name in ("spacing", "origin", "times", "time_step")},
        "opacity_lengths": volume.lengths._asdict(),
        "time_values": None if volume.moments is None else volume.moments.values,
        "time_unit": "" if volume.moments is None else volume.moments.unit,
        "direction": volume.direction.tolist(),
        "dtype": volume.samples.dtype.name,
        "levels": [level.shape[::-1] for level in levels],
        "measured": number,
        "range": None if bins is None or statistics is None else [statistics.low, statistics.high],
        "mean": None if bins is None or statistics is None else statistics.mean,
        "not_finite": 0 if statistics is None else statistics.not_finite,
        "histogram": None if bins is None else {"edges": bins[0].tolist(), "counts": bins[1].tolist()},
        "channels": [
            {"name": channel.name, "color": channel.hints.color, "window": channel.hints.window}
            for channel in volume.channels
        ],
        "labels": None
        if volume.labels is None
        else [
            {"number": label.number, "name": label.name, "color": label.color, "voxels": count}
            for label, count in _segments(volume)
        ],
        "points": sum(len(part.points) for part in volume.channels or (volume,) if part.points is not None),
        "notes": volume.notes,
    }
    return json.dumps(record, allow_nan=False, ensure_ascii=False)


def _measured_level(volume: Volume) -> tuple[list[Volume], int]:
    """All levels, and the number of the finest of at most MOST voxels."""
    levels = [volume, *volume.coarser]
    return levels, next((n for n, level in enumerate(levels) if level.count <= MOST), len(levels) - 1)


def drawn_picture(source: str) -> Image | None:
    """A picture of splatgl with its provenance; None for other files."""
    path, suffix = Path(source), Path(source).suffix.lower()
    if suffix not in (".png", *TIFF, *EXR) or not path.is_file():
        return None
    try:
        # other files of TIFF may be large stacks
        found = load_tiff(path) if suffix in TIFF else None
        picture = Image.load(path) if suffix not in TIFF else Image(*found) if found else None
    except InputError:
        return None
    return picture if picture is not None and "renderer" in picture.info else None


def describe_picture(picture: Image) -> str:
    """Page on a picture of splatgl: what it shows, its settings, and its accuracy."""
    info, (height, width, _) = picture.info, picture.pixels.shape
    known = {"pixels": f"{width} × {height}", "source": info.get("source", info.get("scene"))}
    known |= {name: info.get(name) for name in ("blend", "splats", "classification", "kernel", "technique", "renderer")}
    known |= {"splatgl": info.get("version")}
    lines = [f"{name:<15}{value}" for name, value in known.items() if value is not None]
    lines += [
        "accuracy",
        *(f"  {line}" for text in str(picture.accuracy).splitlines() for line in wrap(text, WIDTH - 2)),
    ]
    transfer = str(info.get("transfer", "")).strip().splitlines()
    return "\n".join([*lines, *["transfer function"] * bool(transfer), *(f"  {line}" for line in transfer)])


def describe_choice(source: str, choice: MissingOption, message: str) -> str:
    """Page on a file with several arrays: their names, and the option that selects one. message: of the error."""
    advice = message.split("; ")[1:2] or [f"--{choice.option}"]
    lines = [f"  {name:<{_LABEL - 1}} {about}" for name, about in (*choice.choices, ("to see it", advice[0]))]
    return "\n".join(_fit(one_line(line)) for line in (Path(source).name, *lines))


def measure(volume: Volume) -> SampleStatistics:
    """Range, mean and counts of a volume's samples."""
    low, high, total, finite = np.inf, -np.inf, 0.0, 0
    for values in _slabs(volume):
        if values.size:
            low, high = min(low, float(values.min())), max(high, float(values.max()))
            total, finite = total + float(values.sum(dtype=np.float64)), finite + values.size
    if not finite:
        return SampleStatistics(np.nan, np.nan, np.nan, 0, volume.count)
    return SampleStatistics(low, high, total / finite, finite, volume.count - finite)


def histogram(volume: Volume, statistics: SampleStatistics) -> tuple[np.ndarray, np.ndarray]:
    """Edges [bins + 1] of at most BINS equal bins, of integer width for integer samples, and counts [bins] of samples.
    The last bin includes its upper edge.
    """
    low, high = statistics.low, statistics.high
    if volume.samples.dtype.kind in "bui":
        step = max(1, -(-(int(high) - int(low) + 1) // BINS))
        bins = -(-(int(high) - int(low) + 1) // step)
        edges = low + step * np.arange(bins + 1, dtype=np.float64)
    else:
        # halved, so that the range of float64 itself does not overflow
        edges = 2 * np.linspace(low / 2, high / 2, (BINS if high > low else 1) + 1)
    counts = np.zeros(len(edges) - 1, np.int64)
    for values in _slabs(volume):
        places = np.searchsorted(edges, values, side="right") - 1
        counts += np.bincount(np.clip(places, 0, len(counts) - 1), minlength=len(counts))
    return edges, counts


def _slabs(volume: Volume) -> Iterator[np.ndarray]:
    """Finite samples of each slab, flat."""
    for slab in volume.slabs(max(1, SLAB_SAMPLES // (volume.shape[1] * volume.shape[2])), halo=0):
        values = np.asarray(slab.samples).ravel()
        yield values[np.isfinite(values)] if values.dtype.kind == "f" else values


def _grid_lines(volume: Volume) -> list[str]:
    depth, height, width = volume.shape
    unit = f" {volume.unit}" if volume.unit else ""
    size = np.array([width, height, depth]) * volume.spacing
    lengths = (volume.lengths.spacing, unit, volume.lengths.extent, unit)
    lines = [
        _line("voxels", f"{width} × {height} × {depth}   ({width * height * depth:,})"),
        _line("spacing", _times(volume.spacing) + unit),
        _line("size", _times(size) + unit),
        _line("opacities", "per {:.4g}{}, the mean spacing; --unit extent: per {:.4g}{}".format(*lengths)),
        _line("origin", ", ".join(_number(value) for value in volume.origin)),
    ]
    if not np.allclose(volume.direction, np.eye(3), atol=1e-9):
        rows = ["".join(f"{value:10.5f}" for value in row) for row in volume.direction + 0.0]
        lines += [_line("direction", rows[0]), _line("", rows[1]), _line("", rows[2])]
    frames = {"LPS": "LPS (+x left, +y back, +z head)", "RAS": "RAS (+x right, +y front, +z head)"}
    return [*lines, _line("frame", frames.get(volume.frame or "", "not stated"))]


def _point_lines(volume: Volume) -> list[str]:
    """Lines with the number, size and box of points."""
    clouds = [part.points for part in volume.channels or (volume,) if part.points is not None]
    low = np.min([cloud.bounds[0] for cloud in clouds], axis=0)
    high = np.max([cloud.bounds[1] for cloud in clouds], axis=0)
    unit = f" {volume.unit}" if volume.unit else ""
    sizes = [f"{cloud.size:.4g}{unit}: {len(cloud):,}" for cloud in clouds]
    return [
        _line("points", f"{sum(map(len, clouds)):,}"),
        *(_line("drawn as" * (not n), text) for n, text in enumerate(sizes)),
        _line("from", ", ".join(f"{value:.10g}" for value in low) + unit),
        _line("to", ", ".join(f"{value:.10g}" for value in high) + unit),
    ]


def _channel_lines(volume: Volume) -> list[str]:
    """Lines with channels and time points, and the options that select them."""
    lines = []
    for number, channel in enumerate(volume.channels):
        window = channel.hints.window
        text = " ".join(part for part in (channel.name, channel.hints.color or "") if part)
        text += f"   {_number(window[0])} … {_number(window[1])}" if window else ""
        lines.append(_line("channels" * (not number), f"{number}: {text}"))
    if volume.channels:
        lines.append(_line("", "all are drawn; --channel N|NAME,… picks"))
    if volume.times > 1:
        step = f", {_number(volume.time_step)} s apart" if volume.time_step else ""
        text = f"0 … {volume.times - 1}{step}: --time N picks; splatgl animate plays them"
        lines.append(_line("times", text))
        if volume.moments is not None:
            texts = [volume.time_text(n) for n in range(volume.times)]
            few = texts if len(texts) <= MOST_TIMES else [*texts[: MOST_TIMES - 2], "…", texts[-1]]
            lines.append(_line("", ", ".join(few) + ": --time TIME picks, too"))
    return lines


def _segments(volume: Volume) -> list[tuple[Label, int | None]]:
    """The segments of a volume or its channels, with the numbers of their voxels; None beyond MOST voxels."""
    found = list[tuple[Label, int | None]]()
    for part in volume.channels or (volume,):
        counts, is_counted = Counter[float](), part.count <= MOST
        for values in _slabs(part) if part.labels is not None and is_counted else ():
            counts.update(dict(zip(*(row.tolist() for row in np.unique(values, return_counts=True)), strict=True)))
        table = labels_of(part) if part.labels is not None and (part.labels or is_counted) else ()
        found += [(label, counts[label.number] if is_counted else None) for label in table]
    return found


def _segment_lines(volume: Volume) -> list[str]:
    """Lines with the numbers, names, colours and sizes of segments, millilitres where the unit of length is mm."""
    voxel = abs(float(np.linalg.det(volume.world_from_index)))
    lines, segments = [], _segments(volume)
    for number, (label, count) in enumerate(segments[:MOST_SEGMENTS]):
        size = "" if count is None else f"{count:,} voxels"
        size += f", {count * voxel / 1000:.4g} mL" if count and volume.unit == "mm" else ""
        text = "   ".join(filter(None, (" ".join(filter(None, (label.name, label.color))), size)))
        lines.append(_line("segments" * (not number), f"{label.number}: {text}"))
    more = len(segments) - MOST_SEGMENTS
    return [*lines, _line("", f"and {more} more: --json lists all")] if more > 0 else lines


def _level_lines(levels: list[Volume], measured: int) -> list[str]:
    """Lines with the sizes of multiscale levels, and with the measured level if it is not the finest."""
    if len(levels) == 1:
        return []
    lines = [_line("levels" * (not n), f"{n}: {_times(level.shape[::-1])}") for n, level in enumerate(levels)]
    return [*lines, _line("measured", f"level {measured}: range, mean and values below")] if measured else lines


def _sample_lines(volume: Volume, statistics: SampleStatistics) -> list[str]:
    dtype = volume.samples.dtype
    order = ", big-endian" if dtype.byteorder == ">" else ""
    chunks = getattr(volume.samples, "chunks", None)
    where = "read in parts" + (f", chunks {_times(chunks[::-1])}" if chunks else "")
    if isinstance(volume.samples, np.ndarray):
        where = "mapped from the file" if is_mapped(volume.samples) else "in memory"
    lines = [_line("samples", f"{dtype.name}{order}   {format_bytes(volume.count * dtype.itemsize)}, {where}")]
    if statistics.finite:
        span = f"{_number(statistics.low)} … {_number(statistics.high)}"
        lines.append(_line("range", f"{span}   mean {_number(statistics.mean)}"))
    if statistics.not_finite:
        total = statistics.finite + statistics.not_finite
        lines.append(_line("not finite", f"{statistics.not_finite:,} of {total:,}"))
    extras = [name for name, array in (("colour", volume.color), ("vectors", volume.vectors)) if array is not None]
    return [*lines, _line("also", " and ".join(extras) + " per voxel")] if extras else lines


def _drawing_lines(volume: Volume) -> list[str]:
    """Lines with memory and bricks of `splatgl render`; none for pre-classified volumes, and without a default
    transfer function.
    """
    try:
        glow = len(volume.channels) > 1 and not any(channel.labels for channel in volume.channels)
        looks = channel_transfers(volume, {}, {}) if glow else map(default_transfer, volume.channels or (volume,))
        bricks = [bricks_of(*part, Settings()) for part in zip(volume.channels or (volume,), looks, strict=True)]
    except InputError:
        return []
    parts = [part for part in bricks if part is not None]
    if len(parts) < len(bricks):
        return []
    most = budget()
    samples = MOST_FINE * SIZE[0] * SIZE[1]
    needed = needed_together([estimate_need(part, samples, 0) for part in parts])
    many = [excess for part in parts if (excess := excess_need(part, samples, most)) is not None]
    how = "whole" if not many else f"{sum(len(part.low) for part in parts):,} bricks" if len(parts) == 1 else "too much"
    level = "level 0; render takes the coarsest level that is right"
    texts = wrap(f"{needed}, of {format_bytes(most)}: {how}", WIDTH - _LABEL - 2)
    lines = [_line("to render" * (not n), text) for n, text in enumerate(texts)]
    return [*lines, *([_line("", level)] if volume.coarser else [])]


def _bars(edges: np.ndarray, counts: np.ndarray) -> list[str]:
    """A bar per bin, with length proportional to the logarithm of its count."""
    # labels of equal width: the bins' lower edges, and the counts
    labels = [_number(edge) for edge in edges[:-1]]
    texts = [f"{count:,}" for count in counts]
    left, right = max(map(len, labels)), max(map(len, texts))
    room = WIDTH - left - right - 8
    # bars in eighths of a column; a count of one stays visible
    lengths = np.log1p(counts) / np.log1p(max(counts.max(), 1)) * room
    lines = [_line("values", "voxels from this value up to the next; bars on a log scale")]
    for label, count, length in zip(labels, texts, lengths, strict=True):
        full, eighth = divmod(round(float(length) * 8), 8)
        bar = "█" * full + (_EIGHTHS[eighth] if eighth else "")
        lines.append(f"  {label:>{left}} │{bar:<{room}} {count:>{right}}")
    return lines


def _line(label: str, text: str) -> str:
    return f"  {label:<{_LABEL}}{text}"


def _fit(text: str) -> str:
    return text if len(text) <= WIDTH else text[: WIDTH - 1] + "…"


def _times(values: tuple[float, ...] | np.ndarray) -> str:
    return " × ".join(_number(value) for value in values)


def _number(value: float) -> str:
    """Formats a number with six digits; integers of up to fifteen digits in full."""
    if float(value).is_integer() and abs(value) < 1e15:
        return str(int(value))
    return f"{value:.6g}"

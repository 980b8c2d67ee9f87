"""The page of `splatgl info`: right numbers, no line too wide, a mapped file read slab by slab."""

from __future__ import annotations

import json
import re
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli import volume_info
from splatgl.cli.main import main
from splatgl.cli.volume_info import WIDTH, as_json, describe, histogram, measure
from splatgl.data.volume import Label, Volume
from splatgl.readers import load


def page(volume: Volume) -> str:
    text = describe(volume)
    assert max(map(len, text.splitlines())) <= WIDTH
    return text


def test_page() -> None:
    samples = np.arange(24, dtype=">i2").reshape(2, 3, 4)
    direction = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    volume = Volume(
        samples, (0.5, 1, 2), (1, -2, 3.25), direction, "mm", "small", "LPS", vectors=np.zeros((2, 3, 4, 3))
    )
    text = page(volume)
    for part in (
        "small\n",
        "voxels     4 × 3 × 2   (24)",
        "spacing    0.5 × 1 × 2 mm",
        "size       2 × 3 × 4 mm",
        "origin     1, -2, 3.25",
        "direction     0.00000  -1.00000   0.00000",
        "LPS (+x left, +y back, +z head)",
        "int16, big-endian   48 bytes, in memory",
        "range      0 … 23   mean 11.5",
        "also       vectors per voxel",
    ):
        assert part in text
    assert "not finite" not in text
    assert "direction" not in page(Volume(samples)) and "not stated" in page(Volume(samples))


@pytest.mark.parametrize(
    "samples",
    [
        np.random.default_rng(1).normal(size=(9, 8, 7)).astype(np.float32),
        np.random.default_rng(2).integers(-900, 1000, (9, 8, 7), np.int16),
        np.random.default_rng(3).integers(0, 2, (9, 8, 7)).astype(bool),
        np.full((2, 2, 2), 3.5),
        np.array([[[-1e308, 1e308]]]),
        np.array([[[0, 2**64 - 1]]], np.uint64),
        np.array([[[np.iinfo(np.int64).min, 5]]]),
    ],
    ids=["normal", "int16", "bool", "constant", "widest float", "uint64", "int64"],
)
def test_every_sample_is_in_one_bar(samples: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(volume_info, "SLAB_SAMPLES", 100)
    volume = Volume(samples)
    statistics = measure(volume)
    assert (statistics.low, statistics.high) == (float(samples.min()), float(samples.max()))
    edges, counts = histogram(volume, statistics)
    assert counts.sum() == samples.size and len(counts) <= volume_info.BINS
    assert counts[0] > 0 and counts[-1] > 0 and np.isfinite(edges).all()
    page(volume)


def test_bars_agree_with_numpy() -> None:
    samples = np.random.default_rng(4).normal(size=(9, 8, 7))
    _, counts = histogram(Volume(samples), measure(Volume(samples)))
    np.testing.assert_array_equal(counts, np.histogram(samples, bins=volume_info.BINS)[0])
    np.testing.assert_array_equal(
        histogram(Volume(np.arange(32).reshape(2, 4, 4)), measure(Volume(np.arange(32).reshape(2, 4, 4))))[1],
        [2] * 16,
    )


def test_not_finite_samples_are_counted_and_left_out() -> None:
    samples = np.array([[[1.0, np.nan, 3.0, np.inf, -np.inf]]])
    text = page(Volume(samples))
    assert "range      1 … 3   mean 2" in text and "not finite 3 of 5" in text
    text = page(Volume(np.full((1, 1, 2), np.nan)))
    assert "not finite 2 of 2" in text and "range" not in text and "values" not in text


def test_a_long_name_is_cut() -> None:
    assert page(Volume(np.zeros((1, 1, 1)), name="n" * 200)).splitlines()[0].endswith("…")


@pytest.mark.long
def test_a_mapped_file_is_read_slab_by_slab(tmp_path: Path) -> None:
    path = tmp_path / "big_512x512x256_uint8.raw"
    with path.open("wb") as file:
        file.truncate(512 * 512 * 256)
    volume = load(path)
    tracemalloc.start()
    text = page(volume)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "mapped from the file" in text and "67,108,864" in text
    # the sample that the default transfer function is made of
    assert peak < 80 * 2**20


def test_what_render_would_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimated splats and memory, and whether they fit; nothing of volumes with colours of their own."""
    volume = sg.scenes.ball(20)
    found = r"to render up to about [\d,]+ splats take [\d.]+ [kM]iB, .* [\d.]+ MiB, of [\d.]+ GiB: whole"
    assert re.search(found, " ".join(describe(volume).split()))
    monkeypatch.setattr("splatgl.cli.volume_info.budget", lambda: 1000)
    assert re.search(r"of 1000 bytes: \d+ bricks", " ".join(describe(volume).split()))
    assert "to render" not in describe(sg.Volume(volume.samples, color=np.zeros((*volume.shape, 3), np.uint8)))


def test_levels_are_told_and_a_coarse_one_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tests.helpers.levels import with_levels, write

    samples = np.zeros((24, 20, 16), np.uint8)
    samples[::2, ::2, ::2] = 8
    volume = with_levels(sg.Volume(samples), 2)
    write(tmp_path / "v.zarr", volume)
    told = describe(sg.load(tmp_path / "v.zarr"))
    assert "  levels     0: 16 × 20 × 24\n             1: 8 × 10 × 12\n             2: 4 × 5 × 6\n" in told
    assert "measured" not in told and "0 … 8" in told
    monkeypatch.setattr(volume_info, "MOST", 1000)
    told = describe(sg.load(tmp_path / "v.zarr"))
    assert "measured   level 1: range, mean and values below" in told and "1 … 1   mean 1" in told
    assert "chunks 16 × 16 × 16" in describe(sg.load(tmp_path / "v.zarr").coarser[0])


def test_channels_count_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The splats of all channels, as the picture has them; one channel alone has fewer."""
    z, y, x = np.indices((12, 12, 12))
    shown = [np.where((x - 6) ** 2 + (y - 6) ** 2 + (z - 6) ** 2 < r * r, 200, 3).astype(np.uint8) for r in (3, 5)]
    parts = tuple(Volume(samples, name=name) for samples, name in zip(shown, "AB", strict=True))

    def count(volume: Volume) -> int:
        (line,) = [line for line in describe(volume).splitlines() if "splats take" in line]
        return int(line.partition("up to about ")[2].split()[0].replace(",", ""))

    both = replace(parts[0], channels=parts)
    drawn = sg.render(both, size=16).info["splats"]
    assert count(both) == drawn
    alone = [count(replace(part, channels=())) for part in parts]
    assert max(alone) < count(both)


@pytest.mark.parametrize("suffix", ["png", "tif", "exr"])
def test_a_picture_tells_what_it_shows(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    if suffix in ("tif", "exr"):
        pytest.importorskip({"tif": "tifffile", "exr": "OpenEXR"}[suffix])
    path = tmp_path / f"a.{suffix}"
    sg.render(np.indices((8, 8, 8))[0].astype(np.uint8), size=32).save(path)
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out
    assert "pixels         32 × 32" in said and "accuracy" in said and "transfer function" in said
    assert main(["info", str(path), "--json"]) == 0 and json.loads(capsys.readouterr().out)["size"] == [32, 32]


def test_segments_are_listed_with_their_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of overlapping ones in channels, too; a volume without a table lists its numbers, and many are cut."""
    samples = np.zeros((4, 5, 6), np.uint8)
    samples[0], samples[1, 0] = 3, 7
    first = Volume(samples, (2.0, 2.0, 5.0), unit="mm", labels=(Label(3, "Liver", "#ff0000"), Label(7, "Cyst")))
    page = describe(first).splitlines()
    assert (
        "  segments   3: Liver #ff0000   30 voxels, 0.6 mL" in page
        and "             7: Cyst   6 voxels, 0.12 mL" in page
    )
    both = replace(first, channels=(first, replace(first, labels=(Label(7, "Vein"),))))
    assert "             7: Vein   6 voxels, 0.12 mL" in describe(both).splitlines()
    assert "  segments   3: 30 voxels, 0.6 mL" in describe(replace(first, labels=())).splitlines()
    assert [row["voxels"] for row in json.loads(as_json("a", first))["labels"]] == [30, 6]
    monkeypatch.setattr("splatgl.cli.volume_info.MOST_SEGMENTS", 1)
    assert "             and 1 more: --json lists all" in describe(first).splitlines()

"""The voxel extractor: rows, gradients, thresholds, slabs, and what is absent."""

from __future__ import annotations

import numpy as np
import pytest

import splatgl as sg
from splatgl.splat.splats import COLOR_SCALE, MOST_ALONG, NORMAL_SCALE, VALUE, VOXEL

RAMP = sg.Transfer([(0.2, 0.0), (1.0, 0.9)], colormap="hot")


def noise(shape: tuple[int, int, int] = (9, 10, 11), dtype: str = "float32") -> np.ndarray:
    samples = np.random.default_rng(4).random(shape)
    return samples.astype(dtype) if np.dtype(dtype).kind == "f" else (samples * 100).astype(dtype)


@pytest.mark.parametrize(
    "dtype", ["uint8", "int8", "int16", ">u2", "uint16", "int32", "float16", "float32", ">f8", "bool"]
)
@pytest.mark.parametrize("threshold", [0.0, 0.3])
def test_slabs_do_not_matter(dtype: str, threshold: float) -> None:
    """The same splats bit for bit whatever the slab; a gradient term included."""
    transfer = sg.Transfer([(0, 0), (1, 0.9), (100, 0.95)], gradient=[(0, 0.6), (60, 1.0)])
    volume = sg.Volume(noise(dtype=dtype), spacing=(1, 2, 0.5))
    whole = sg.extract(volume, transfer, threshold, classification="pre")
    assert len(whole) > 50
    for slab in (1, 2, 5):
        part = sg.extract(volume, transfer, threshold, slab=slab, classification="pre")
        assert part.records.tobytes() == whole.records.tobytes()
        assert (part.row_start == whole.row_start).all()
        assert part.dropped_depth == pytest.approx(whole.dropped_depth, rel=1e-12)


def test_rows_are_compressed_and_sorted() -> None:
    volume = sg.Volume(noise())
    splats = sg.extract(volume, RAMP, classification="pre")
    position = splats.positions
    assert (volume.samples[tuple(position[:, ::-1].astype(int).T)] > 0.2).all()
    assert len(splats) == int((volume.samples > 0.2).sum())
    for row in range(len(splats.row_z)):
        cells = position[splats.row_start[row] : splats.row_start[row + 1]]
        assert (cells[:, 2] == splats.row_z[row]).all()
        assert (cells[:, 1] == splats.row_y[row]).all()
        assert (np.diff(cells[:, 0]) > 0).all()


def test_threshold_is_strict_and_what_it_drops_is_kept() -> None:
    samples = np.zeros((1, 1, 5), np.uint8)
    samples[0, 0] = [0, 10, 20, 30, 20]
    transfer = sg.Transfer([(0, 0.0), (100, 1.0)], unit=2.0, shading=False)
    splats = sg.extract(sg.Volume(samples), transfer, threshold=0.2, classification="pre")
    assert splats.positions[:, 0].tolist() == [3]
    # optical depth of 10, 20 and 20 along x, one voxel each, per 2 world lengths
    assert splats.dropped_depth == pytest.approx(-(np.log1p(-0.1) + 2 * np.log1p(-0.2)) / 2)
    assert splats.records["optical_depth"][0] == pytest.approx(-np.log1p(-0.3) / 2, rel=1e-6)


def test_gradient_term() -> None:
    """t = F(∇, ρ): flat regions go, the edge stays."""
    samples = np.zeros((8, 8, 8), np.float32)
    samples[:, :, 4:] = 1
    transfer = sg.Transfer([(0.5, 0), (0.5, 0.8)], gradient=[(0.1, 0.0), (0.4, 1.0)])
    splats = sg.extract(sg.Volume(samples), transfer, classification="pre")
    assert set(splats.positions[:, 0]) == {4.0}
    # twice the voxel, half the gradient: 0.25 per world length is half way up the weight
    wide = sg.extract(sg.Volume(samples, spacing=(2, 2, 2)), transfer, classification="pre")
    assert wide.records["optical_depth"] == pytest.approx(-np.log1p(-0.4), rel=1e-6)


def test_normals_are_world_gradients_on_the_original_grid() -> None:
    """A linear field has one world gradient, whatever the grid's spacing, shear or turn."""
    direction = np.array([[0.8, -0.6, 0.2], [0.6, 0.8, 0.0], [0.1, 0.0, 1.0]])
    grid = sg.Volume(np.zeros((5, 6, 7)), spacing=(0.5, 1, 3), direction=direction)
    wanted = np.array([0.3, -1.0, 0.7])
    z, y, x = np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij")
    field = np.stack([x, y, z], axis=-1) @ grid.world_from_index.T @ wanted + 50
    volume = sg.Volume(field, spacing=(0.5, 1, 3), direction=direction)
    splats = sg.extract(volume, sg.Transfer([(0, 0.5)]), classification="pre")
    normals = splats.records["normal"] / NORMAL_SCALE
    assert np.abs(normals - wanted / np.linalg.norm(wanted)).max() < 5e-5


def test_absent_voxels_and_their_neighbours() -> None:
    """NaN and ±Inf voxels are absent, and gradients beside them use the neighbours that exist."""
    field = np.broadcast_to(np.arange(7.0), (5, 5, 7)).copy() + 1
    field[2, 2, 3], field[1, 1, 2], field[3, 3, 4] = np.nan, np.inf, -np.inf
    splats = sg.extract(sg.Volume(field), sg.Transfer([(0, 0.5)]), classification="pre")
    assert len(splats) == field.size - 3
    # the field rises along x everywhere, so every normal is +x, next to the gaps too
    assert (splats.records["normal"] == [NORMAL_SCALE, 0, 0]).all()
    # the same as if they were cut out: nothing but the three is missing
    whole = sg.extract(
        sg.Volume(np.broadcast_to(np.arange(7.0), (5, 5, 7)) + 1), sg.Transfer([(0, 0.5)]), classification="pre"
    )
    gaps = {(3, 2, 2), (2, 1, 1), (4, 3, 3)}
    kept = [n for n, p in enumerate(whole.positions.astype(int)) if tuple(p) not in gaps]
    assert whole.records[kept].tobytes() == splats.records.tobytes()


def test_a_voxel_alone_has_no_normal() -> None:
    samples = np.full((3, 3, 3), np.nan)
    samples[1, 1, 1] = 1
    splats = sg.extract(sg.Volume(samples), sg.Transfer([(0, 0.5)]), classification="pre")
    assert splats.records["normal"].tolist() == [[0, 0, 0]]


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 4, 5), (4, 1, 1), (1, 1, 6), (3, 4, 1)])
def test_thin_volumes(shape: tuple[int, int, int]) -> None:
    assert len(sg.extract(sg.Volume(np.ones(shape)), sg.Transfer([(0, 0.5)]), classification="pre")) == np.prod(shape)


def test_colors_of_a_coloured_volume_are_linear() -> None:
    color = np.zeros((1, 1, 2, 3), np.uint8)
    color[0, 0, 1] = [255, 188, 0]
    splats = sg.extract(
        sg.Volume(np.ones((1, 1, 2)), color=color), sg.Transfer([(0, 0.5)], shading=False), classification="pre"
    )
    # sRGB 188/255 is linear 0.5029
    assert splats.colors[1] == pytest.approx([1, 0.5029, 0], abs=1e-4)


def test_voxels_beside_what_is_opaque_are_not(rng: np.random.Generator) -> None:
    """Of voxels among whose 26 neighbours no sample is opaque, which only serve others, no coefficient is, either."""
    samples = rng.random((12, 12, 12)).astype(np.float32)
    splats = sg.extract(sg.Volume(samples), sg.Transfer([(0.99, 0), (0.9901, 0.9)], unit=1.0), classification="post")
    padded = np.pad(samples, 1, mode="edge")
    most = np.max([padded[z : z + 12, y : y + 12, x : x + 12] for z, y, x in np.ndindex(3, 3, 3)], axis=0)
    x, y, z = np.rint(splats.records["position"]).astype(int).T
    outer = most[z, y, x] < 0.99
    assert 50 < outer.sum() < len(splats) < 12**3
    value = splats.post.value(splats.records["value"])
    assert (value[outer] <= most[z, y, x][outer] + 1e-6).all()
    assert (splats.post.extinction(splats.records["value"][outer]) == 0).all()


@pytest.mark.parametrize("classification", ["pre", "post"])
def test_depths_are_over_a_mean_spacing(classification: str) -> None:
    """Whatever the length to which opacities refer."""
    volume = sg.Volume(np.ones((3, 4, 5), np.float32), (1.0, 2.0, 4.0))
    for unit in (0.5, 3.0):
        splats = sg.extract(volume, sg.Transfer([(0, 0.3)], unit=unit), classification=classification)
        assert splats.deepest == pytest.approx(-np.log(0.7) * 2 / unit, rel=1e-5)
        assert splats.total_depth == pytest.approx(60 * splats.deepest, rel=1e-5)


def test_big_volumes_are_read_slab_by_slab() -> None:
    """The extractor never asks for more planes than a slab and its halo."""
    asked: list[int] = []

    class Watched(sg.Volume):
        def slabs(self, depth: int, halo: int = 1):  # type: ignore[no-untyped-def]
            for slab in super().slabs(depth, halo):
                asked.append(len(slab.samples))
                yield slab

    sg.extract(Watched(noise((20, 5, 5))), RAMP, slab=3, classification="pre")
    assert max(asked) == 5
    assert len(asked) == 7


def test_from_points_keeps_order_and_drops_what_is_not_there() -> None:
    points = np.array([[2.2, 0, 0], [1.9, 0.1, 0], [0, 0, 1], [np.nan, 0, 0], [5, 5, 5], [1, 0, 0]])
    extinctions = np.array([1.0, 2.0, 3.0, 4.0, 0.0, 6.0])
    splats = sg.Splats.from_points(points, np.ones((6, 3)), extinctions)
    # rows (z, y), cells by x, ties in the input's order
    assert splats.records["optical_depth"].tolist() == [6, 1, 2, 3]
    assert splats.cell_x.tolist() == [1, 2, 2, 0]
    assert not splats.shaded


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((3, 2))}, "points: expected shape"),
        ({"colors": np.zeros((2, 3))}, "colors: expected shape"),
        ({"extinctions": np.zeros(2)}, "extinctions: expected shape"),
        ({"extinctions": -np.ones(3)}, "at least 0"),
        ({"spacing": 0.0}, "spacing: expected a positive"),
        ({"spacing": (1, 2)}, "spacing: expected a positive"),
    ],
)
def test_bad_points(change: dict, message: str) -> None:
    good = {"points": np.zeros((3, 3)), "colors": np.ones((3, 3)), "extinctions": np.ones(3)}
    with pytest.raises(sg.InputError, match=message):
        sg.Splats.from_points(**{**good, **change})


def test_bad_threshold() -> None:
    with pytest.raises(sg.InputError, match="threshold: expected an opacity"):
        sg.extract(sg.Volume(noise()), RAMP, threshold=1.0, classification="pre")


def test_record_size_is_stated() -> None:
    assert VOXEL.itemsize == VALUE.itemsize == 24


@pytest.mark.few(1)
@pytest.mark.parametrize("classification", ["pre", "post"])
def test_volumes_too_long_for_narrow_records(classification: str, renderer: sg.Renderer) -> None:
    """Voxels beyond 2^16 along an axis are drawn as those of a short volume are, where they are."""
    values = np.zeros((3, 4, MOST_ALONG + 9), np.uint8)
    values[:, :, -8:] = 40 * np.arange(1, 5)[:, None] + 3 * np.arange(8)
    short = sg.Volume(values[:, :, -16:], origin=(values.shape[2] - 16, 0, 0))
    camera = sg.Camera.orbit(short, 40, 20, size=(48, 36))
    found = [sg.extract(v, RAMP, classification=classification) for v in (sg.Volume(values), short)]
    assert found[0].records.itemsize == 36 and found[1].records.itemsize == 24
    assert (found[0].positions - found[1].positions == (values.shape[2] - 16, 0, 0)).all()
    settings = sg.Settings(tolerance=1e-6, antialias="off")
    pictures = [renderer.render(splats, camera, settings).pixels for splats in found]
    assert pictures[0][..., 3].max() > 0.05
    assert np.abs(pictures[0] - pictures[1]).max() < 4e-5


def test_stored_colors() -> None:
    """Colours of voxels are 16-bit fractions: half a step from the transfer function's at most."""
    values = np.arange(256, dtype=np.uint8).reshape(4, 8, 8)
    transfer = sg.Transfer([(0, 0.1), (255, 0.9)], colormap="viridis", window=(0, 255))
    splats = sg.extract(sg.Volume(values), transfer, classification="pre")
    assert np.abs(splats.colors - transfer.color(values.ravel())).max() <= 0.5001 / COLOR_SCALE

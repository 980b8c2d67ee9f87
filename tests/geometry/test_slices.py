"""Slices: planes by text, their directions, and values between voxels, by closed forms."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.errors import InputError
from splatgl.geometry.grid import Grid
from splatgl.geometry.resample import Raster, sample_places, sample_raster
from splatgl.geometry.slices import SliceLayer, SlicePainter, SlicePlane, parse_slices
from tests.helpers.noise import GRIDS

SLOPE = np.array([0.7, -1.3, 2.1])


def linear(grid: str) -> sg.Volume:
    """Values that are linear in the world."""
    empty = sg.Volume(np.zeros((9, 11, 13)), **GRIDS[grid])
    z, y, x = np.indices(empty.shape)
    world = np.stack([x, y, z], axis=-1) @ empty.world_from_index.T + empty.origin
    return replace(empty, samples=world @ SLOPE + 5)


def sampled(volume: sg.Volume, plane: SlicePlane, size: tuple[int, int] = (23, 17)) -> tuple[Any, ...]:
    """Values, whether they are known, and world points of pixels that cover a plane's outline."""
    low, high = plane.box
    raster = plane.raster(volume, low, (high - low) / size, size)
    values, known = sample_raster(volume, raster)
    points = raster.places @ volume.world_from_index.T + np.asarray(volume.origin)
    return values.ravel(), known.ravel(), points


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("text", ["x=0", "y=3.3", "z=100%", "oblique"])
def test_a_slice_of_a_linear_field_is_the_field(grid: str, text: str) -> None:
    """Up to the faces of the outer voxels; along the axes by rows and columns, and place by place."""
    volume = linear(grid)
    where = f"{','.join(map(str, volume.center))}:1,2,-1" if text == "oblique" else text
    (plane,) = parse_slices(where, volume)
    values, known, points = sampled(volume, plane)
    assert np.abs((points - plane.point) @ plane.normal).max() < 1e-9
    assert known.mean() > (0.3 if text == "oblique" else 0.5)
    assert np.abs(values - points @ SLOPE - 5)[known].max() < 1e-9
    one, other = sample_places(volume, Grid.of(volume).index_from_world(points[::7]))
    assert (other == known[::7]).mean() > 0.97 and np.abs(one - values[::7])[other & known[::7]].max() < 1e-9


def test_values_pass_through_the_samples_and_follow_parabolas() -> None:
    rng = np.random.default_rng(3)
    volume = sg.Volume(rng.integers(0, 4000, (7, 8, 9)).astype(np.int16))
    z, y, x = np.indices(volume.shape)
    values, known = sample_places(volume, np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(float))
    assert known.all() and np.abs(values - volume.samples.ravel()).max() < 1e-9
    curved = sg.Volume(0.3 * x**2 - x * y + 0.5 * z**2 + y)
    places = rng.uniform(2, 5, (200, 3))
    a, b, c = places.T
    assert np.abs(sample_places(curved, places)[0] - (0.3 * a**2 - a * b + 0.5 * c**2 + b)).max() < 1e-9


@pytest.mark.parametrize("text", ["y=3.3", "oblique"])
def test_equal_samples_give_their_value_bit_for_bit(text: str) -> None:
    """A constant volume's colours are a step at its value: a rounding below it was the other colour."""
    volume = sg.Volume(np.full((9, 11, 13), 0.7))
    (plane,) = parse_slices("6,5,4:1.05,0.89,-0.26" if text == "oblique" else text, volume)
    values, known, _ = sampled(volume, plane)
    assert known.any() and (values[known] == 0.7).all()


def test_rows_along_axes_are_the_places_one_by_one() -> None:
    """Also turned, mirrored, and reaching beyond the box; amounts and colours."""
    rng = np.random.default_rng(4)
    color = rng.integers(0, 255, (6, 7, 8, 3)).astype(np.uint8)
    for volume in (sg.Volume(rng.random((6, 7, 8))), sg.Volume(rng.random((6, 7, 8)), color=color)):
        for across, down in (([0.31, 0, 0], [0, -0.4, 0]), ([0, 0, 0.35], [0.5, 0, 0]), ([0, -0.3, 0], [0, 0, -0.2])):
            start = np.array([4.2, 3.3, 2.6]) - 12 * np.array(across) - 9 * np.array(down)
            raster = Raster(start, np.array(across), np.array(down), (24, 18))
            values, known = sample_raster(volume, raster)
            right, there = sample_places(volume, raster.places)
            assert raster.axes is not None and (known.ravel() == there).all() and 0 < known.mean() < 1
            assert np.abs(values.reshape(right.shape) - right)[there].max() < 1e-12


def test_missing_samples_and_masks_are_holes_of_voxels() -> None:
    samples = np.full((5, 5, 5), 3.0)
    samples[2, 2, 2] = np.nan
    keep = np.ones((5, 5, 5), bool)
    keep[:, 0] = False
    volume = sg.Volume(samples).masked(keep.astype(np.uint8))
    (plane,) = parse_slices("z=2", volume)
    values, known, points = sampled(volume, plane, (50, 50))
    x, y, _ = points.T
    hole = (np.abs(x - 2) < 0.5) & (np.abs(y - 2) < 0.5)
    assert (known == ~hole & (y > 0.5)).all()
    assert np.abs(values[known] - 3).max() < 1e-12


def test_labels_are_never_averaged() -> None:
    numbers = np.random.default_rng(5).choice([0, 3, 70], (6, 6, 6)).astype(np.uint8)
    volume = sg.Volume(numbers, labels=())
    for text in ("z=2.2", "2.5,2.5,2.5:1,1,2"):
        (plane,) = parse_slices(text, volume)
        low, high = plane.box
        places = plane.raster(volume, low, (high - low) / 40, (40, 40)).places
        values, known = sample_places(volume, places, nearest=True)
        x, y, z = np.clip(np.rint(places[known]), 0, 5).astype(int).T
        assert values.dtype == np.uint8 and (values[known] == numbers[z, y, x]).all()


def test_volumes_that_are_read_in_parts_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    volume = sg.Volume(np.random.default_rng(6).random((12, 12, 12)))
    places = np.random.default_rng(7).uniform(-1, 12, (500, 3))
    whole = sample_places(volume, places)
    monkeypatch.setattr("splatgl.geometry.resample.VOXELS", 300)
    parts = sample_places(volume, places)
    assert (parts[1] == whole[1]).all() and np.abs(parts[0] - whole[0]).max() < 1e-12


@pytest.mark.parametrize("frame", ["LPS", "RAS"])
@pytest.mark.parametrize(
    ("text", "right", "down"), [("axial", "L", "P"), ("coronal", "L", "I"), ("sagittal", "P", "I")]
)
def test_slices_of_patients_are_drawn_as_radiologists_do(frame: str, text: str, right: str, down: str) -> None:
    """Whatever the order and the signs of the grid's axes."""
    from splatgl.annotations.world_lines import letters

    for order in ((0, 1, 2), (2, 0, 1)):
        direction = np.eye(3)[:, order] * [1, -1, -1]
        volume = sg.Volume(np.zeros((6, 7, 8)), frame=frame, direction=direction, unit="mm")
        for where in (
            text,
            f"{text}=40%",
            f"{text}={volume.center[{'axial': 2, 'coronal': 1, 'sagittal': 0}[text]]}mm",
        ):
            (plane,) = parse_slices(where, volume)
            assert (letters(frame, plane.right), letters(frame, plane.down)) == (right, down)


def test_texts_of_slices() -> None:
    """Numbers of voxels follow the grid, lengths the world."""
    direction = np.eye(3)[:, [2, 0, 1]]
    volume = sg.Volume(np.zeros((10, 20, 30)), (1, 2, 3), (5, 6, 7), direction, unit="mm")
    # the grid's z runs along the world's y
    planes = parse_slices(["z=2", "z=2:9:3", "y=25%", "z=10mm", "x"], volume)
    assert [plane.title for plane in planes] == ["z 2", "z 2", "z 5", "z 8", "y 25%", "z 10 mm", "x 15"]
    assert np.allclose(planes[0].point[1], 6 + 3 * 2) and np.abs(planes[0].normal[1]) == 1
    assert np.allclose(planes[4].point[0], 5 + 2 * 4.5) and np.allclose(planes[5].point[2], 10)
    half = replace(volume, spacing=(1, 2, 3), origin=(0, 0, 0))
    (oblique,) = parse_slices("10, 5, 9 : 0, 0.3, 0.4", half)
    assert np.allclose(np.abs(oblique.normal), [0, 0.6, 0.8]) and "through 10,5,9" in oblique.title


def test_the_box_of_a_plane_is_that_of_its_polygon() -> None:
    """The diagonal of a cube: a regular hexagon; a corner: a triangle."""
    volume = sg.Volume(np.zeros((10, 10, 10)))
    (middle,) = parse_slices("4.5,4.5,4.5:1,1,1", volume)
    side = np.linalg.norm(middle.outline - np.roll(middle.outline, 1, axis=0), axis=1)
    assert len(middle.outline) == 6 and np.allclose(side, 50**0.5)
    (corner,) = parse_slices("0.5,0.5,-0.5:1,1,1", volume)
    assert len(corner.outline) == 3


BAD = {
    "z=10": "slice: expected a voxel from 0 to 9 along z, got 'z=10'; z=10units is a position in the world",
    "z=101%": "slice: expected a share from 0% to 100%, got 'z=101%'",
    "z=99units": "slice: expected a plane through the volume, got 'z=99units'",
    "z=3mm": "slice: expected a length in units, got 'z=3mm'",
    "axial": "slice: expected x, y or z, as the file states no patient directions, got axial",
    "z=5:2": "slice: expected START:STOP:STEP",
    "z=0:9:0": "slice: expected START:STOP:STEP",
    "z=1:2:3:4": "slice: expected AXIS=PLACE",
    "z=1:2mm": "slice: expected AXIS=PLACE",
    "z=": "slice: expected AXIS=PLACE",
    "w=3": "slice: expected AXIS=PLACE",
    "z=nan": "slice: expected AXIS=PLACE",
    "1,2,3:0,0,0": "slice: expected AXIS=PLACE",
    "1,2:3,4,5": "slice: expected AXIS=PLACE",
    "50,50,50:1,0,0": "slice: expected a plane through the volume",
}


@pytest.mark.parametrize("text", BAD)
def test_texts_that_are_no_slices(text: str) -> None:
    with pytest.raises(InputError) as error:
        parse_slices(text, sg.Volume(np.zeros((10, 10, 10))))
    assert str(error.value).startswith(BAD[text])


def test_slices_of_python() -> None:
    assert sg.Slice("z=3@0.25").opacity == 0.25 and sg.Slice("z=3").opacity == 1
    assert sg.Slice(((1, 2, 3), (0, 0.5, 1))).place == "1.0,2.0,3.0:0.0,0.5,1.0"
    for bad in ("z=3@2", "z=3@x", "q", 3, ((1, 2), (3, 4, 5))):
        with pytest.raises(InputError, match="slice: expected"):
            sg.Slice(bad)  # type: ignore[arg-type]


def test_layers_lie_over_the_first_and_channels_add_up() -> None:
    volume = sg.Volume(np.full((4, 4, 4), 1.0))
    gray = sg.Transfer([(0, 0), (2, 1)], "gray", window=(0, 2))
    red = sg.Transfer([(0, 0), (2, 0.5)], "#ff0000", window=(0, 2), shading=False)
    points = np.array([[1.5, 1.5, 1.5], [9, 9, 9]])
    base = gray.color(1.0)
    over = SlicePainter([SliceLayer(volume, gray), SliceLayer(volume, red, 0.5)]).light(points)
    # half of the red one's largest opacity, which the layer's halves again
    assert np.allclose(over[0], [*(base * 0.75 + 0.25 * np.array([0.5, 0, 0])), 1]) and not over[1].any()
    green = replace(red, colormap="#00ff00")
    both = SlicePainter([SliceLayer(volume, red), SliceLayer(volume, green)]).light(points[:1])
    assert np.allclose(both, [[0.5, 0.5, 0, 1]])

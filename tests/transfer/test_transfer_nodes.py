"""Opacity curves by shape, and colours at values: nodes in closed form, percentiles, and messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.color import srgb_from_linear
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.colormaps import CORE, colormap
from splatgl.transfer.presets import cut_of
from splatgl.transfer.statistics import statistics
from splatgl.transfer.transfer_nodes import (
    SHAPES,
    color_points,
    curve_of,
    opacity_curve,
    read_color_points,
    shape_nodes,
    shape_of,
    with_color_points,
)

# values 0 … 999, each once
VOLUME = sg.Volume(np.arange(1000.0).reshape(10, 10, 10))


@pytest.mark.parametrize(
    ("text", "values", "right"),
    [
        ("step:60", (59, 60, 200), (0, 0.8, 0.8)),
        ("ramp:60,120", (60, 90, 120, 500), (0, 0.4, 0.8, 0.8)),
        ("sigmoid:0,160:0.5", (0, 40, 80, 120, 160), (0, 0.5 * 0.15625, 0.25, 0.5 * 0.84375, 0.5)),
        ("gate:100,140:0.2", (99, 100, 139, 140), (0, 0.2, 0.2, 0)),
        ("band:100,140:1", (100, 105, 110, 130, 135, 140), (0, 0.5, 1, 1, 0.5, 0)),
        ("tent:100,140:1", (100, 110, 120, 130, 140), (0, 0.5, 1, 0.5, 0)),
        (" tent : 10% , 90% : 0.4 ", (99.9, 499.5, 899.1), (0, 0.4, 0)),
    ],
    ids=str,
)
def test_shapes(text: str, values: tuple[float, ...], right: tuple[float, ...]) -> None:
    found = sg.Transfer(sg.opacity_curve(text, VOLUME)).opacity(np.array(values))
    assert np.allclose(found, right, rtol=0, atol=1e-9)


def test_a_sigmoid_is_a_smooth_step() -> None:
    x = np.linspace(0, 1, 501)
    assert np.abs(sg.Transfer(opacity_curve("sigmoid:0,1:1")).opacity(x) - x**2 * (3 - 2 * x)).max() < 3e-3


def test_shapes_without_values_lie_over_the_object() -> None:
    ball = sg.scenes.ball(12)
    stats = statistics(ball)
    cut, top = cut_of(stats, None), stats.percentile(99.9)
    assert opacity_curve("step", ball)[0][0] == cut.value
    for name in set(SHAPES) - {"step"}:
        low, high = (opacity_curve(name, ball)[end][0] for end in (0, -1))
        assert low < cut.value < high == top


def test_shapes_are_known_by_their_nodes() -> None:
    for scale in ("linear", "log"):
        for name in SHAPES:
            points = shape_nodes(name, (2.0, 50.0), 0.7, scale)
            assert shape_of(sg.Transfer(points, scale=scale)) == name
    assert shape_of(sg.Transfer([(0, 0.1), (1, 0.5), (3, 0.2)])) is None
    middle = curve_of("tent:1,100", None, "log")[1][0]
    assert middle == pytest.approx(10)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tnt:1,2", r"curve: expected SHAPE\[:VALUES\[:OPACITY\]\] .* got 'tnt:1,2'; did you mean tent\?"),
        ("ramp:1,2:0.5:7", "curve: expected SHAPE"),
        (5, "text: expected text, got 5"),
        ("step:1,2", "curve: expected one value for step, got '1,2'"),
        ("ramp:1", "curve: expected two values for ramp, got '1'"),
        ("band:140,100", "curve: expected the lower value of band first, and another one, got 140,100"),
        ("gate:a,2", "curve: expected values, or percentiles such as 90%, got 'a'"),
        ("gate:-1%,50%", "curve: expected percentiles from 0% to 100%, got -1%"),
        ("tent:1,2:3", "curve: expected an opacity from 0 to 1 behind the values, got '3'"),
        ("tent:1,nan", "curve: expected values, or percentiles"),
    ],
    ids=str,
)
def test_curves_that_are_none(text: Any, said: str) -> None:
    with pytest.raises(sg.InputError, match=f"^{said}") as error:
        opacity_curve(text, VOLUME)
    assert "\n" not in str(error.value)


def test_percentiles_need_values() -> None:
    with pytest.raises(sg.InputError, match="curve: expected values, or a volume whose percentiles are meant, got 10%"):
        opacity_curve("ramp:10%,90%")
    with pytest.raises(sg.InputError, match="curve: expected values, or a volume of several, for tent, got none"):
        opacity_curve("tent")
    same = sg.Volume(np.where(np.arange(1000) < 900, 3.0, 7.0).reshape(10, 10, 10))
    with pytest.raises(sg.InputError, match="got 10%,50%, which are 3 and 3"):
        opacity_curve("ramp:10%,50%", same)
    with pytest.raises(sg.InputError, match="curve: expected values above 0 on a logarithmic scale, got 0"):
        opacity_curve("ramp:0,5", scale="log")


@pytest.mark.parametrize("name", [*CORE, "#204060", "viridis[0.2:0.7]", "0:#000000,0.3:#ff0000,0.3:#00ff00,1:#ffffff"])
def test_colour_points_are_the_map(name: str) -> None:
    """To three levels, but beside a step; edited back and forth they stay."""
    transfer = sg.Transfer([(10, 0), (30, 1)], name, window=(5, 45))
    points = color_points(transfer)
    assert len(points) <= 17 and points[0][0] == 5
    again = with_color_points(transfer, points)
    apart = np.abs(srgb_from_linear(colormap(again.colormap)) - srgb_from_linear(colormap(name))).max(axis=1)
    assert np.sort(apart)[-2] < 3 / 255 and again.color_range == transfer.color_range
    third = with_color_points(again, color_points(again))
    assert third == again


def test_colours_at_values() -> None:
    """Where they are said, also on a logarithmic scale, and by percentiles; mixed in sRGB between."""
    points = read_color_points("60:red,120:#00ff00,160:#00f", None)
    assert points == ((60, "#ff0000"), (120, "#00ff00"), (160, "#0000ff"))
    for scale in ("linear", "log"):
        transfer = with_color_points(sg.Transfer([(1, 0), (200, 1)], scale=scale), points)
        found = transfer.color(np.array([1, 60, 120, 160, 500]))
        right = np.array([[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]])
        # a map has 256 entries
        assert np.abs(found - right).max() < 0.03 and transfer.window == (60, 160)
    assert read_color_points([("10%", "black"), (950, "white")], statistics(VOLUME))[0][0] == pytest.approx(99.9)
    one = with_color_points(sg.Transfer([(1, 0), (2, 1)]), ((7.0, "#123456"),))
    assert one.colormap == "#123456" and one.window == (1, 2)


@pytest.mark.parametrize(
    ("colors", "said"),
    [
        ("60", "colors: expected VALUE:COLOUR,…, such as .*, got '60'"),
        ("60:reddish", "colors: expected #rgb, #rrggbb or a CSS name such as red, got 'reddish'"),
        ("60:red,20:blue", "colors: expected values that never fall, got 60, 20"),
        ("x:red", "colors: expected values, or percentiles such as 90%, got 'x'"),
        ((), r"colors: expected VALUE:COLOUR,…, such as .*, got \(\)"),
        (7, "colors: expected VALUE:COLOUR,…"),
    ],
    ids=str,
)
def test_colours_that_are_none(colors: Any, said: str) -> None:
    with pytest.raises(sg.InputError, match=f"^{said}"):
        read_color_points(colors, None)


def test_scenes_take_curves_and_colours(tmp_path: Any) -> None:
    """Over the default look, whose colours stay; options replace those of a scene file; both at once are refused."""
    ball = sg.scenes.ball(12)
    default = sg.default_transfer(ball)
    scene = SceneFile("ball", held=ball)
    curved = scene.with_options(curve="band:0.2,0.6:0.3").transfer_for(ball)
    assert curved.points == opacity_curve("band:0.2,0.6:0.3")
    assert (curved.colormap, curved.window) == (default.colormap, default.color_range)
    colored = scene.with_options(colors="0.1:red,0.9:white").transfer_for(ball)
    assert colored.window == (0.1, 0.9) and colored.points == default.points
    assert colored.colormap == "0:#ff0000,1:#ffffff"
    (tmp_path / "scene.toml").write_text(
        'volume = "ball"\n[transfer]\ncurve = "tent:0.1,0.5"\ncolors = [[0.1, "red"], [0.5, "blue"]]\n'
    )
    read = SceneFile.from_toml(tmp_path / "scene.toml")
    assert read.transfer_for(ball).points == opacity_curve("tent:0.1,0.5")
    assert read.with_options(points=((0, 0.0), (1, 0.5))).transfer_for(ball).points == ((0, 0), (1, 0.5))
    assert read.with_options(colormap="hot").transfer_for(ball).colormap == "hot"
    for options in ({"curve": "tent", "points": ((0, 0.0),)}, {"colors": "0:red", "window": (0, 1)}):
        with pytest.raises(sg.InputError, match=r"^transfer: expected (curve or points|colors or window), got both"):
            scene.with_options(**options).transfer_for(ball)
    segments = sg.Volume(np.arange(8, dtype=np.uint8).reshape(2, 2, 2)).of_values("labels")
    with pytest.raises(sg.InputError, match=r"^labels: expected none of the options of amounts, got curve"):
        SceneFile("segments", held=segments).with_options(curve="tent").transfer_for(segments)


def test_a_picture_by_curve_and_colours(renderer: sg.Renderer) -> None:
    """The same as by its nodes."""
    ball = sg.scenes.ball(12)
    one = sg.render(ball, curve="band:50%,99%:0.5", colors="0.2:red,0.9:#ffd0a0", size=32)
    transfer = with_color_points(
        sg.Transfer(opacity_curve("band:50%,99%:0.5", ball), shading=sg.default_transfer(ball).shading),
        ((0.2, "#ff0000"), (0.9, "#ffd0a0")),
    )
    two = sg.render(ball, transfer, size=32)
    assert one.pixels.any() and (one.pixels == two.pixels).all()

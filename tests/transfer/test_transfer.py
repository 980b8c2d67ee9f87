"""Transfer functions and colour maps."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.errors import InputError
from splatgl.transfer import colormaps
from splatgl.transfer.colormaps import CORE, colormap
from splatgl.transfer.regions import OPAQUE
from splatgl.transfer.transfer import Transfer

# --- sRGB ---


def test_srgb_known_values_and_round_trip() -> None:
    assert np.allclose(
        linear_from_srgb([0.0, 0.04045, 0.5, 1.0]), [0.0, 0.0031308049535603713, 0.21404114048223255, 1.0]
    )
    encoded = np.linspace(0.0, 1.0, 4097)
    # the standard's two knees are rounded, so the inverse is off by up to 3e-8 there
    assert np.abs(srgb_from_linear(linear_from_srgb(encoded)) - encoded).max() < 5e-8


# --- opacity, weight, colour, extinction ---


def test_opacity_is_linear_between_nodes_and_constant_outside() -> None:
    transfer = Transfer(((10, 0.2), (20, 0.6), (40, 0.0)))
    assert np.allclose(transfer.opacity([-5, 10, 15, 20, 30, 40, 99]), [0.2, 0.2, 0.4, 0.6, 0.3, 0.0, 0.0], atol=1e-15)


def test_a_step_takes_its_upper_side() -> None:
    transfer = Transfer([(5, 0.1), (10, 0.2), (10, 0.9), (12, 0.9)])
    below = np.nextafter(10.0, 0.0)
    assert np.allclose(transfer.opacity([below, 10.0]), [0.2, 0.9], atol=1e-12)
    assert Transfer([(3, 0.0), (3, 1.0)]).opacity([2.9, 3.0, 3.1]).tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_transparent(value: float) -> None:
    transfer = Transfer(((0, 0.5), (1, 0.5)), gradient=((0, 1.0), (1, 1.0)))
    assert transfer.opacity(value) == 0.0
    assert transfer.weight(value) == 0.0
    assert np.isfinite(transfer.color(value)).all()


def test_integers_and_shapes_pass_through() -> None:
    transfer = Transfer(((0, 0.0), (255, 1.0)))
    values = np.arange(6, dtype=np.uint8).reshape(2, 3)
    assert transfer.opacity(values).shape == (2, 3)
    assert transfer.color(values).shape == (2, 3, 3)
    assert transfer.opacity(values).dtype == transfer.color(values).dtype == np.float64


def test_weight_of_the_gradient() -> None:
    assert np.allclose(Transfer(((0, 1),), gradient=((1, 0.0), (3, 1.0))).weight([0, 2, 9]), [0.0, 0.5, 1.0])
    assert np.array_equal(Transfer(((0, 1),)).weight([0, 2, 9]), np.ones(3))


def test_extinction_keeps_tiny_and_full_opacities() -> None:
    tiny = 1e-12
    # −log1p(−a) = a + a²/2 + …
    assert abs(Transfer.extinction(tiny, 2.0) / ((tiny + tiny**2 / 2) / 2.0) - 1) < 1e-15
    full = Transfer.extinction([1.0, 2.0], 1.0)
    assert np.array_equal(full, np.full(2, -np.log1p(-OPAQUE)))
    assert full[0] == pytest.approx(24 * np.log(2))
    assert Transfer.extinction(0.5, 0.5) == pytest.approx(2 * np.log(2))
    assert Transfer.extinction(0.0, 1.0) == 0.0


def test_color_spans_the_window() -> None:
    transfer = Transfer(((0, 0), (9, 1)), window=(10, 20))
    assert np.allclose(transfer.color([0, 10, 15, 20, 30])[:, 0], [0, 0, 0.2140, 1, 1], atol=1e-3)
    from_points = Transfer(((10, 0), (20, 1)))
    assert np.array_equal(from_points.color([10, 13, 20]), transfer.color([10, 13, 20]))


def test_colormaps_have_paraviews_names(caplog: pytest.LogCaptureFixture) -> None:
    """Those of the core without a library; the library is silent on names that several packages have."""
    assert np.array_equal(colormap("Cool to Warm"), colormap("cool-warm"))
    assert np.array_equal(colormap("Grayscale"), colormap("gray"))
    pytest.importorskip("cmap")
    assert np.array_equal(colormap("X Ray"), colormap("gray_r")) and colormap("coolwarm").shape == (256, 3)
    assert not caplog.records


def test_color_of_a_step_without_a_window() -> None:
    transfer = Transfer(((5, 0), (5, 1)))
    assert transfer.color([4, 5, 6])[:, 0].tolist() == [0.0, 1.0, 1.0]


# --- what is refused ---


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"points": ()}, "at least one"),
        ({"points": ((0, 1.5),)}, "opacity from 0 to 1"),
        ({"points": ((0, -0.1),)}, "opacity from 0 to 1"),
        ({"points": ((2, 0), (1, 1))}, "never fall"),
        ({"points": ((0, np.nan),)}, "finite"),
        ({"points": ((np.inf, 1),)}, "finite"),
        ({"points": ((0, 1, 2),)}, "pairs"),
        ({"points": "abc"}, "pairs"),
        ({"points": 7}, "pairs"),
        ({"gradient": ((0, 2),)}, "weight from 0 to 1"),
        ({"window": (2, 2)}, "low < high"),
        ({"window": (2, 1)}, "low < high"),
        ({"window": (0, np.nan)}, "low < high"),
        ({"window": 5}, "two numbers"),
        ({"unit": 0}, "positive"),
        ({"unit": -1}, "positive"),
        ({"unit": "mm"}, "length"),
        ({"colormap": "no such map"}, "viridis"),
        ({"colormap": "#12345"}, "#rrggbb"),
        ({"shading": "yes"}, "true or false"),
    ],
)
def test_bad_fields_are_refused_in_one_line(changes: dict, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        Transfer(**{"points": ((0, 1),), **changes})
    assert "\n" not in str(caught.value)


# --- files ---


FULL = Transfer([[0.1, 0], [0.1, 1 / 3], [1e-300, 1]][:2], "#a0B1c2", (-1e9, 1 / 7), 0.3, [(0, 0), (2.5, 1)], False)


@pytest.mark.parametrize("transfer", [FULL, Transfer(((1, 1),))])
def test_toml_round_trip_is_exact(transfer: Transfer, tmp_path: Path) -> None:
    assert Transfer.from_toml(transfer.to_toml()) == transfer
    transfer.save(tmp_path / "t.toml")
    assert Transfer.load(tmp_path / "t.toml") == transfer
    assert [path.name for path in tmp_path.iterdir()] == ["t.toml"]


def test_lists_and_tuples_are_the_same_transfer() -> None:
    assert Transfer([[0, 1]], window=[0, 1]) == Transfer(((0.0, 1.0),), window=(0.0, 1.0))
    assert hash(Transfer([[0, 1]])) == hash(Transfer(((0, 1),)))


@pytest.mark.parametrize(
    "text", ["points = [", "colormap = 'gray'", "points = [[0, 1]]\ncolour = 'gray'", "points = 3"]
)
def test_bad_toml_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        Transfer.from_toml(text)
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(InputError, match=r"bad\.toml"):
        Transfer.load(tmp_path / "bad.toml")


def test_a_failed_save_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.toml"
    FULL.save(path)

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(InputError, match=r"t\.toml"):
        Transfer(((9, 1),)).save(path)
    assert Transfer.load(path) == FULL
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.toml"]


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.toml"):
        Transfer.load(tmp_path / "none.toml")
    FULL.save(tmp_path / "no_folder" / "t.toml")
    assert Transfer.load(tmp_path / "no_folder" / "t.toml") == FULL
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"[Nn]ot a directory|a folder"):
        FULL.save(tmp_path / "file" / "t.toml")


# --- colour maps ---


@pytest.mark.parametrize("name", [*CORE, "#ff8000"])
def test_core_maps(name: str) -> None:
    table = colormap(name)
    assert table.shape == (256, 3)
    assert table.dtype == np.float64
    assert table.min() >= 0.0
    assert table.max() <= 1.0


def test_maps_are_linear_light() -> None:
    assert np.allclose(colormap("gray")[:, 0], linear_from_srgb(np.arange(256) / 255))
    assert np.allclose(colormap("#ff8000"), linear_from_srgb([1.0, 128 / 255, 0.0]))
    nodes = srgb_from_linear(colormap("0:#000000,0.2:#ff0000,1:#0000ff"))
    assert np.allclose(nodes[[0, 51, 153, 255]], [[0, 0, 0], [1, 0, 0], [0.5, 0, 0.5], [0, 0, 1]], atol=1e-6)
    assert colormap(colormaps.colormap_name([0, 0.2, 1], [[0, 0, 0], [1, 0, 0], [0, 0, 1]])) is colormap(
        "0:#000000,0.2:#ff0000,1:#0000ff"
    )
    for wrong in ("0:#000000,0.5:red", "0.5:#000000,0.2:#ffffff", "0:#000000,2:#ffffff", "-:#000000"):
        with pytest.raises(InputError, match="colormap: expected POSITION:#rrggbb"):
            colormap(wrong)


def test_other_maps_come_from_a_library() -> None:
    matplotlib = pytest.importorskip("matplotlib")
    expected = linear_from_srgb(matplotlib.colormaps["magma"](np.linspace(0, 1, 256))[:, :3])
    assert np.abs(colormap("magma") - expected).max() < 0.01
    own = srgb_from_linear(colormap("viridis"))
    assert np.abs(own - matplotlib.colormaps["viridis"](np.linspace(0, 1, 256))[:, :3]).max() < 0.03


def test_without_a_library_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(colormaps, "find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"splatgl\[colormaps\]"):
        Transfer(((0, 1),), colormap="plasma")
    Transfer(((0, 1),), colormap="viridis")


def test_points_follow_from_regions_or_labels() -> None:
    regions, labels = ["box:30,90,2,50:0.5"], [(1, "#ff0000", 0.5), (3, "#00ff00", 0.9)]
    points: tuple[dict[str, Any], ...] = ({}, {"points": []}, {"points": ()})
    for given in points:
        by_regions, by_labels = Transfer(**given, regions=regions), Transfer(**given, labels=labels)
        assert by_regions.points == ((30.0, 0.0), (90.0, 0.0)) and [value for value, _ in by_labels.points] == [
            1.0,
            3.0,
        ]
        for transfer in (by_regions, by_labels):
            assert Transfer.from_toml(transfer.to_toml()) == transfer
        with pytest.raises(InputError, match="regions or labels, got none"):
            Transfer(**given)
    assert Transfer.from_table({"labels": labels}) == Transfer(labels=labels)

"""Streamlines and arrows of fields with known lines, on every grid; where they lie; what is refused; commands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.errors import InputError
from splatgl.splat.vector_field import VectorField, lines_through, spread_lines
from tests.helpers.noise import GRIDS

pytestmark = pytest.mark.usefixtures("shared_programs")

Flow = Callable[[np.ndarray], np.ndarray]


def flowing(flow: Flow, grid: str = "cubes", size: int = 21) -> sg.Volume:
    """Vectors of places around the middle, world units."""
    empty = sg.Volume(np.zeros((size, size, size), np.float32), origin=(4.0, -3.0, 2.0), **GRIDS[grid])
    z, y, x = np.indices(empty.shape)
    places = np.stack([x, y, z], axis=-1) @ empty.world_from_index.T + empty.origin - empty.center
    kept = {name: getattr(empty, name) for name in ("samples", "spacing", "origin", "direction")}
    return sg.Volume(**kept, vectors=flow(places).astype(np.float32), name="flow")


def rotation(p: np.ndarray) -> np.ndarray:
    return np.stack([-p[..., 1], p[..., 0], 0 * p[..., 2]], axis=-1)


def saddle(p: np.ndarray) -> np.ndarray:
    return np.stack([p[..., 0], -p[..., 1], 0 * p[..., 2]], axis=-1)


def through(volume: sg.Volume, place: list[float], **options: Any) -> np.ndarray:
    """The line through a place, from the middle; from there too."""
    field = VectorField.of(volume)
    index = np.linalg.solve(volume.world_from_index, volume.center + place - volume.origin)
    return np.asarray(lines_through(field, index[None], **options).points[0] - volume.center)


@pytest.mark.parametrize("grid", list(GRIDS))
def test_rotations_close(grid: str) -> None:
    """After a whole turn, to a thousandth of the radius."""
    radius = 6.0
    line = through(flowing(rotation, grid), [radius, 0, 0], length=4 * np.pi * radius)
    far = np.linalg.norm(line[:, :2], axis=1)
    assert np.abs(far - radius).max() < 1e-3 * radius and np.abs(line[:, 2]).max() < 1e-6
    turned = np.unwrap(np.arctan2(line[:, 1], line[:, 0]))
    assert (np.diff(turned) > 0).all() and turned[-1] - turned[0] == pytest.approx(4 * np.pi, abs=0.1)


@pytest.mark.parametrize("grid", list(GRIDS))
def test_constant_fields_have_straight_lines(grid: str) -> None:
    """From end to end of the samples."""
    along = np.array([0.3, 0.5, 0.2])
    volume = flowing(lambda p: np.zeros_like(p) + along, grid)
    line = through(volume, [0.0, 0.0, 0.0])
    unit = along / np.linalg.norm(along)
    assert np.abs(line - np.outer(line @ unit, unit)).max() < 1e-6
    assert np.abs(np.diff(line @ unit) - 0.25 * np.linalg.norm(volume.world_from_index, axis=0).min()).max() < 1e-9
    for end in (line[0], line[-1]):
        index = np.linalg.solve(volume.world_from_index, end + volume.center - volume.origin)
        assert np.abs(index - 10).max() > 10 - 0.3 and np.abs(index - 10).max() <= 10 + 1e-6


@pytest.mark.parametrize("grid", list(GRIDS))
def test_saddles_have_hyperbolas(grid: str) -> None:
    """x y stays what it is."""
    line = through(flowing(saddle, grid), [1.5, 2.0, 0.5])
    assert len(line) > 30 and np.abs(line[:, 0] * line[:, 1] - 3.0).max() < 1e-3


def test_lines_are_near_everything_fast_and_nowhere_else() -> None:
    """The more lines, the nearer; none where the flow is slow; always the same."""

    def pipe(p: np.ndarray) -> np.ndarray:
        # along x within 6 of the axis
        inside = np.hypot(p[..., 1], p[..., 2]) < 6
        return np.stack([inside * 1.0, 0 * p[..., 0], 0 * p[..., 0]], axis=-1)

    volume = flowing(pipe)
    z, y, x = np.nonzero(np.asarray(volume.vectors)[..., 0] > 0)
    kept = np.stack([x, y, z], axis=1) + volume.origin
    reached = []
    for count in (10, 40):
        lines = spread_lines(volume, count)
        assert len(lines.points) == count and min(map(len, lines.points)) > 40
        points = np.concatenate(lines.points)
        assert np.hypot(*(points - volume.center)[:, 1:].T).max() < 6.9
        near = np.full(len(kept), np.inf)
        for line in lines.points:
            near = np.minimum(near, np.linalg.norm(kept[:, None] - line[None, ::2], axis=2).min(axis=1))
        reached.append(near.max())
    # discs of that radius around 10 and 40 lines more than cover the pipe
    assert reached[0] < 4.5 and reached[1] < 2.3
    again = spread_lines(volume, 40)
    assert all((a == b).all() for a, b in zip(lines.points, again.points, strict=True))


def test_meshes_of_lines_and_arrows() -> None:
    """Tubes of their radius; arrows as long as the flow is fast, along it, the fastest yellow, the slowest dark."""
    volume = flowing(rotation)
    tubes = sg.streamlines(volume, 5, radius=0.2)
    assert tubes.mapped and len(tubes) > 500 and len(np.unique(tubes.values)) >= 3
    found = sg.arrows(volume, 60, length=3.0)
    corners = found.vertices.reshape(60, -1, 3)
    along = corners[:, -1] - corners[:, -2]
    middle = (corners[:, -1] + corners[:, -2]) / 2 - volume.center
    flow = rotation(middle)
    greatest = VectorField.of(volume).greatest
    assert np.allclose(along, flow * 3.0 / greatest, atol=1e-5)
    inward = np.linalg.det(found.vertices[found.faces] - middle[0] - volume.center)
    # closed, and all round the same way: the volume within is positive
    one = found.vertices[found.faces[: len(found) // 60]] - found.vertices[0]
    assert (
        np.isfinite(inward).all() and np.abs(np.cross(one[:, 1] - one[:, 0], one[:, 2] - one[:, 0]).sum(0)).max() < 1e-9
    )
    fast = np.linalg.norm(flow, axis=1)
    assert np.allclose(np.asarray(found.values).reshape(60, -1)[:, 0], fast, atol=1e-5)
    assert (found.quantity, found.colormap, found.window) == ("speed", "viridis", (0.0, greatest))
    # values that are the vectors' lengths name them
    speed = np.linalg.norm(np.asarray(volume.vectors), axis=-1)
    about = {"vectors": volume.vectors, "quantity": "wind", "value_unit": "m/s"}
    for named, title in ((sg.Volume(speed, **about), "wind, m/s"), (sg.Volume(speed + 1, **about), "speed")):
        assert sg.arrows(named, 9).quantity == sg.streamlines(named, 9).quantity == title
        assert sg.magnitudes(named).quantity == title.removesuffix(", m/s")
    # by default of twice their mean distance: each has its share of the volume
    every = flowing(lambda places: np.ones(places.shape))
    default = sg.arrows(every, 60).vertices.reshape(60, -1, 3)
    room = every.count * abs(np.linalg.det(every.world_from_index)) / 60
    assert np.allclose(np.linalg.norm(default[:, -1] - default[:, -2], axis=1), 2 * room ** (1 / 3), rtol=1e-4)


def test_directions_and_magnitudes() -> None:
    """A vector along y is green, as long as it is; one along x and y red and green alike."""
    vectors = np.zeros((2, 2, 2, 3), np.float32)
    vectors[0, 0, 0], vectors[1, 1, 1] = (0, -3, 0), (2, 2, 0)
    volume = sg.Volume(np.zeros((2, 2, 2)), vectors=vectors)
    found = sg.directions(volume)
    assert found.samples[0, 0, 0] == 3 and (found.color[0, 0, 0] == (0, 255, 0)).all()
    assert (found.color[1, 1, 1] == (180, 180, 0)).all() and (sg.magnitudes(volume).samples == found.samples).all()


def test_vectors_that_are_missing_or_none() -> None:
    """NaNs and zeros end lines; all of them are refused."""

    def broken(p: np.ndarray) -> np.ndarray:
        found = np.zeros_like(p)
        found[..., 0] = 1.0
        found[:, :, 15:] = np.nan
        return found

    line = through(flowing(broken), [0.0, 0.0, 0.0])
    assert np.isfinite(line).all() and line[:, 0].max() < 5.1 and line[:, 0].min() < -9.5
    for vectors, message in (
        (None, "expected vectors"),
        (np.zeros((3, 3, 3, 3)), "which are not zero"),
        (np.full((3, 3, 3, 3), np.nan), "which are not zero"),
    ):
        volume = sg.Volume(np.ones((3, 3, 3)), vectors=vectors, name="still")
        for draw in (sg.streamlines, sg.arrows, sg.directions, sg.magnitudes):
            with pytest.raises(InputError, match=message):
                draw(volume)
    one = sg.Volume(np.ones((1, 1, 1)), vectors=np.ones((1, 1, 1, 3)))
    assert len(sg.streamlines(one)) == 0 and len(sg.arrows(one)) == 60
    with pytest.raises(InputError, match="count: expected a whole number"):
        sg.streamlines(flowing(rotation), 0)


def vtk_file(path: Path) -> None:
    """A legacy VTK file of a rotation."""
    volume = flowing(rotation, size=9)
    head = "# vtk DataFile Version 3.0\nflow\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS 9 9 9\nORIGIN 0 0 0\n"
    head += "SPACING 1 1 1\nPOINT_DATA 729\nVECTORS v float\n"
    path.write_bytes(head.encode() + np.asarray(volume.vectors).astype(">f4").tobytes())


def test_commands_draw_vectors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same by options, a scene file and in Python."""
    source, out = tmp_path / "v.vtk", tmp_path / "o.npy"
    vtk_file(source)
    options = ["-o", str(out), "--size", "40", "--quiet", "--check", "0"]
    assert main(["render", str(source), *options, "--vectors", "direction", "--streamlines", "9", "--arrows", "7"]) == 0
    first = np.load(out)
    assert first[..., 3].max() > 0.99
    given = 'volume = "v.vtk"\n[vectors]\nshow = "direction"\nstreamlines = 9\narrows = 7\n'
    (tmp_path / "s.toml").write_text(given)
    assert main(["render", str(tmp_path / "s.toml"), *options]) == 0
    assert (np.load(out) == first).all()
    same = sg.render(str(source), size=40, vectors="direction", streamlines=9, arrows=7)
    assert (same.pixels == first).all()
    np.save(tmp_path / "a.npy", np.random.default_rng(1).random((8, 8, 8)))
    assert main(["render", str(tmp_path / "a.npy"), *options, "--streamlines"]) == 2
    assert "a: expected vectors" in capsys.readouterr().err
    (tmp_path / "s.toml").write_text('volume = "v.vtk"\n[vectors]\nlines = 3\n')
    assert main(["render", str(tmp_path / "s.toml"), *options]) == 2
    assert "keys show, streamlines, arrows, colormap" in capsys.readouterr().err

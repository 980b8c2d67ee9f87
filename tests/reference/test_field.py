"""Pictures of scalar fields: convergence, known integrals, which reconstruction is nearest, and sheets beside them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.planning.resolve import select_splats
from splatgl.reference.field import field_integral, kept_field_integral, kernel_field, trilinear_field
from splatgl.reference.march import LatticeTerms
from splatgl.splat.kernels import FREE, kernel
from splatgl.splat.prefilter import margin_of, prefilter
from splatgl.splat.settings import BLENDS
from splatgl.transfer.preintegration import ValueClassifier
from tests.helpers.noise import GRIDS, LOOKS, inside, views

STEP = 1e-5
KINDS = "b-spline", FREE


def balls(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Two soft balls in the unit cube."""
    total = np.zeros(np.broadcast(x, y, z).shape)
    for center, radius in (((0.4, 0.45, 0.5), 0.25), ((0.65, 0.6, 0.45), 0.18)):
        r = np.sqrt((x - center[0]) ** 2 + (y - center[1]) ** 2 + (z - center[2]) ** 2)
        total += 1 / (1 + np.exp((r - radius) / 0.035))
    return total


def sinusoid(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 + 0.5 * np.sin(9 * x + 1) * np.sin(8 * y) * np.sin(10 * z + 0.5))


FORMULAS = {"balls": balls, "sinusoid": sinusoid}


@dataclass(frozen=True, eq=False)
class Known:
    """A formula sampled on a grid whose z spacing is `ratio` times the others."""

    formula: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    volume: sg.Volume
    transfer: sg.Transfer

    @classmethod
    def of(cls, name: str, ratio: int, size: int = 24) -> Known:
        axes = [(np.arange(count) + 0.5) / count for count in (size // ratio, size, size)]
        z, y, x = np.meshgrid(*axes, indexing="ij")
        points = [(0.45, 0), (0.6, 0.8)] if name == "balls" else [(0.6, 0), (0.75, 0.8)]
        volume = sg.Volume(FORMULAS[name](x, y, z), spacing=(1, 1, ratio))
        return cls(FORMULAS[name], volume, sg.Transfer(points, colormap="hot", shading=True))

    def field(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and world gradients at grid positions."""
        sizes = np.array(self.volume.shape[::-1])[:, None]
        world = np.linalg.norm(self.volume.world_from_index, axis=0) * sizes[:, 0]
        at = (places + 0.5) / sizes
        slopes = [self.formula(*(at + e)) - self.formula(*(at - e)) for e in STEP * np.eye(3)[..., None]]
        return self.formula(*at), np.stack(slopes, axis=1) / (2 * STEP) / world

    def __hash__(self) -> int:
        return id(self)

    @cache  # noqa: B019
    def picture(self, field: str = "", steps: int = 8) -> np.ndarray:
        return field_integral(self.volume, self.transfer, self.camera(), field or self.field, steps).pixels

    def camera(self) -> sg.Camera:
        return sg.Camera.orbit(self.volume, 30, 20, size=(20, 20))


@cache
def known(name: str, ratio: int) -> Known:
    return Known.of(name, ratio, 30 if ratio > 1 else 24)


def rmse(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sqrt(((a - b) ** 2).mean()))


@pytest.mark.few(1)
@pytest.mark.parametrize("ratio", [1, 3])
@pytest.mark.parametrize("name", FORMULAS)
def test_the_b_spline_is_nearer_than_trilinear(name: str, ratio: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its ends unlit as those of the others: the formulas go on beyond the grid."""
    monkeypatch.setattr(ValueClassifier, "around", lambda _, u: (u, np.zeros(len(u), bool)))
    # its pictures are kept for no other test
    case = Known.of(name, ratio, 30 if ratio > 1 else 24)
    right = case.picture()
    # alpha, then colours, which gradients shade
    for part in (slice(3, 4), slice(0, 3)):
        spline, linear = (rmse(case.picture(field)[..., part], right[..., part]) for field in ("b-spline", "trilinear"))
        assert spline <= (0.6 if name == "balls" else 0.9) * linear
    alpha = [rmse(case.picture(field)[..., 3], right[..., 3]) for field in ("b-spline", "trilinear")]
    assert alpha[0] < (0.5 if name == "balls" else 0.7) * alpha[1]


@pytest.mark.few(1)
@pytest.mark.parametrize("ratio", [1, 3])
@pytest.mark.parametrize("name", FORMULAS)
def test_sheets_draw_the_kernels_field(name: str, ratio: int) -> None:
    """The nearer, the more sheets; nearer to the formula than the trilinear field."""
    case = known(name, ratio)
    splats = sg.extract(case.volume, case.transfer, classification="post")
    field, right = case.picture("b-spline"), case.picture()
    found = [
        sg.reference.render(splats, case.camera(), sg.Settings(antialias="off", sheets=count, steps=3)).pixels
        for count in (2, 3, 4)
    ]
    missed = [rmse(picture, field) for picture in found]
    assert missed[1] < 0.9 * missed[0] and missed[2] < 1.15 * missed[1] and missed[1] < 0.012
    assert (ratio == 1 and name == "balls") or rmse(found[1], right) < rmse(case.picture("trilinear"), right)


def test_the_midpoint_rule_converges() -> None:
    case = known("sinusoid", 3)
    found = [case.picture(steps=steps) for steps in (4, 8, 16, 32)]
    off = [rmse(one, two) for one, two in pairwise(found)]
    assert all(3 < coarse / fine < 5.5 for coarse, fine in pairwise(off)) and off[-1] < 2e-4
    # samples are means of rays
    large = field_integral(case.volume, case.transfer, case.camera().resized((40, 40)), case.field, 4).pixels
    means = field_integral(case.volume, case.transfer, case.camera(), case.field, 4, samples=2).pixels
    assert np.abs(means - large.reshape(20, 2, 20, 2, 4).mean(axis=(1, 3))).max() < 1e-12


def lengths(volume: sg.Volume, camera: sg.Camera) -> np.ndarray:
    """World lengths of a perspective camera's rays in the volume's box, by small steps of its index axes."""
    (width, height), pitch = camera.size, float(camera.pixel_pitch(1.0))
    y, x = np.indices((height, width))
    eye = np.stack([(x + 0.5 - width / 2) * pitch, (y + 0.5 - height / 2) * pitch, np.ones(x.shape)], axis=-1)
    ray = eye / np.linalg.norm(eye, axis=-1, keepdims=True) @ camera.eye_from_world
    index = np.linalg.inv(volume.world_from_index)
    start, step = index @ (camera.eye - np.asarray(volume.origin)), ray @ index.T
    low, high = (-0.5 - start) / step, (np.array(volume.shape[::-1]) - 0.5 - start) / step
    first = np.maximum(np.minimum(low, high).max(axis=-1), 0)
    return np.maximum(np.maximum(low, high).min(axis=-1) - first, 0)


@pytest.mark.few(1)
@pytest.mark.parametrize("grid", [*GRIDS, "8:1"])
def test_constant_matter_has_a_known_opacity(renderer: sg.Renderer, grid: str) -> None:
    """1 − (1 − α)^(length/unit), up to the box; also of sheets, which see it as it is."""
    placed = {"spacing": (1.0, 1.0, 8.0)} if grid == "8:1" else GRIDS[grid]
    volume = sg.Volume(np.full((6, 7, 8), 0.5), **placed)
    transfer = sg.Transfer([(0, 0.2), (1, 0.2)], colormap="hot", unit=2.0)
    splats = sg.extract(volume, transfer, classification="post")
    assert len(splats) == volume.samples.size
    for camera in (views(splats)["fitted"].resized((24, 18)), inside(splats, LOOKS[4]).resized((15, 10))):
        right = 1 - 0.8 ** (lengths(volume, camera) / 2.0)
        assert right.max() > 0.1 and np.ptp(right) > 0.05
        for field in ("b-spline", "trilinear")[grid != "cubes" :]:
            assert np.abs(field_integral(volume, transfer, camera, field, 2).pixels[..., 3] - right).max() < 1e-9
        for settings in (sg.Settings(antialias="off"), sg.Settings(antialias="off", sheets=2, steps=1)):
            found = sg.reference.render(splats, camera, settings).pixels
            assert np.abs(found[..., 3] - right).max() < 1e-9
            # a colour for one value
            seen = right > 0.01
            assert np.ptp((found[..., :3] / np.maximum(right, 1e-9)[..., None])[seen], axis=0).max() < 1e-9
        drawn = renderer.render(splats, camera, sg.Settings(antialias="off", sheets=2, steps=1)).pixels
        assert np.abs(drawn[..., 3] - right).max() < 3e-6


def test_fields_pass_through_what_they_interpolate() -> None:
    """Trilinear through samples; the b-spline's coefficients near them, unlike a kernel without prefilter."""
    case = known("balls", 1)
    samples = case.volume.samples
    post = ValueClassifier.of(case.transfer, "b-spline", samples.shape[::-1])
    places = np.stack([index.ravel() for index in np.indices(samples.shape)[::-1]])
    value, gradient = trilinear_field(case.volume, post)(places)
    assert np.abs(value - samples.ravel()).max() < 1e-6
    right, slope = case.field(places)
    assert np.abs(right - samples.ravel()).max() < 1e-12 and rmse(gradient, slope) < 0.15 * rmse(slope, np.zeros(()))
    off = {name: kernel_field(case.volume, kernel(name), post)(places) for name in ("b-spline", "crawfis-max")}
    missed = {name: rmse(value, right) for name, (value, _) in off.items()}
    assert missed["b-spline"] < 5e-4 and missed["crawfis-max"] > 5 * missed["b-spline"]
    assert rmse(off["b-spline"][1], slope) < 0.15 * rmse(slope, np.zeros(()))
    # between grid points a slope is linear
    (one,) = trilinear_field(case.volume, post)(np.full((3, 1), 11.0))[1]
    (two,) = trilinear_field(case.volume, post)(np.array([[12.0], [11.0], [11.0]]))[1]
    (half,) = trilinear_field(case.volume, post)(np.array([[11.5], [11.0], [11.0]]))[1]
    assert np.abs(half - (one + two) / 2).max() < 1e-12


GRID = np.stack(np.meshgrid(*[np.arange(26.0)] * 3, indexing="ij"))
APART = np.sqrt(((GRID - np.array([12.3, 12.5, 12.1])[:, None, None, None]) ** 2).sum(axis=0))
STEEP = {
    "ball": APART < 7.3,
    "padding": np.where(GRID[2] < 6, -1000.0, np.where(APART < 7.3, 300.0, 0.0)),
    "metal": np.where(APART < 3, 10.0, APART < 7.3),
    "slab": GRID[2] + 0.43 * GRID[1] - 0.2 * GRID[0] > 14,
    "thin": abs(GRID[2] + 0.43 * GRID[1] - 0.2 * GRID[0] - 14) < 0.6,
    "two planes": (GRID[2] > 11.5) & (GRID[2] < 13.5),
    "shell": abs(APART - 8) < 0.7,
    "rod": np.hypot(GRID[2] - 12.2, GRID[1] - 12.4) < 1.6,
    "checker": (GRID // 4).sum(axis=0) % 2,
    "labels": np.random.default_rng(4).integers(0, 3, (26, 26, 26)),
}


def coefficients(samples: np.ndarray, name: str = "b-spline") -> np.ndarray:
    return prefilter(np.asarray(samples, np.float32), kernel(name))


def means(c: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The kernel's means of coefficients at places [3, P] (z, y, x), those missing or beyond the ends left out."""
    c = np.pad(c.astype(np.float64), 2, constant_values=np.nan)
    sums, mass = np.zeros((2, places.shape[1]))
    for step in np.ndindex(4, 4, 4):
        cell = np.floor(places).astype(int) + np.array(step)[:, None] - 1
        value = c[tuple(cell + 2)]
        weight = kernel("b-spline").value(np.linalg.norm(places - cell, axis=0)) * np.isfinite(value)
        sums, mass = sums + weight * np.nan_to_num(value), mass + weight
    return np.asarray(sums / mass)


def beyond(samples: np.ndarray, values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """By how much values leave the range of the 4³ samples around their places, of that of all."""
    samples = np.asarray(samples, np.float64)
    low, high = np.full((2, values.size), np.array([[np.inf], [-np.inf]]))
    for step in np.ndindex(4, 4, 4):
        value = samples[tuple(np.floor(places).astype(int) + np.array(step)[:, None] - 1)]
        low, high = np.minimum(low, value), np.maximum(high, value)
    return np.asarray(np.maximum(low - values, values - high) / np.ptp(samples))


@pytest.mark.few(5)
@pytest.mark.parametrize("name", STEEP)
def test_values_stay_within_the_samples_around_them(name: str, rng: np.random.Generator) -> None:
    """Without limits of coefficients, a tenth to a third of a step beyond them; rods keep 3 % in a thousandth."""
    places = 2 + rng.random((3, 20000)) * 21
    limited, free = (
        beyond(STEEP[name], means(coefficients(STEEP[name], kind), places), places) for kind in ("b-spline", FREE)
    )
    assert free.max() > 0.09
    assert (
        limited.max() < (0.03 if name in ("rod", "thin", "shell", "labels") else 0.01)
        and (limited > 0.01).mean() < 2e-3
    )


@pytest.mark.few(2)
@pytest.mark.parametrize("blend", BLENDS)
def test_where_all_samples_are_transparent_nothing_is_drawn(renderer: sg.Renderer, blend: str) -> None:
    """0 beside a padded plane and holes of −1000: without limits a fifth of the picture has an alpha of up to 0.9."""
    samples = np.where((GRID[2] < 6) | (APART < 5), -1000.0, 0.0)
    points = [(-1060, 0.5), (-1040, 0), (0, 0)] if blend == "minip" else [(0, 0), (40, 0), (60, 0.5)]
    transfer, volume = sg.Transfer(points, colormap="hot"), sg.Volume(samples.astype(np.float32))
    camera = sg.Camera.orbit(volume, 30, 25, size=(32, 32))
    most = {}
    for kind in KINDS:
        splats = sg.extract(volume, transfer, classification="post-all", kernel=kind)
        most[kind] = renderer.render(splats, camera, sg.Settings(blend=blend)).pixels[..., 3].max()
    assert most["b-spline"] == 0 and most[FREE] > 0.01


@pytest.mark.parametrize("most", [0.0, 10.0])
def test_the_sides_of_steps_are_flat(most: float) -> None:
    """Beside a padded plane no value differs from the plateau by more than rounding: nothing rings."""
    samples = np.full((20, 20, 20), most)
    samples[:, :, :6] = -1000
    c = coefficients(samples)
    assert np.abs(c[..., 6:] - most).max() < 1e-3 * 1000 and c.min() >= -1000
    assert np.abs(coefficients(samples, FREE)[..., 6:] - most).max() > 100


def test_limits_leave_smooth_fields_as_they_are(rng: np.random.Generator) -> None:
    """RMSE of what is between samples, beside that without limits; waves of less than about five samples lose some."""
    places = 3 + rng.random((3, 8000)) * 19
    z, y, x = places

    def loss(field: Callable[..., np.ndarray]) -> float:
        limited, free = (rmse(means(coefficients(field(*GRID), kind), places), field(z, y, x)) for kind in KINDS)
        return limited / free

    def edge(z: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.asarray(1 / (1 + np.exp((np.sqrt((z - 12.3) ** 2 + (y - 12) ** 2 + (x - 12.6) ** 2) - 7) / 0.8)))

    def blob(z: np.ndarray, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-((z - 12.3) ** 2 + (y - 11.8) ** 2 + (x - 12.6) ** 2) / (2 * 1.2**2)))

    def wave(z: np.ndarray, y: np.ndarray, x: np.ndarray, period: float = 8.0) -> np.ndarray:
        return np.asarray(np.sin(2 * np.pi / period * (x + 2 * y + 0.5 * z) / np.sqrt(5.25)))

    assert max(map(loss, (edge, blob, wave, lambda z, y, x: x + 2 * y - z))) < 1.02
    assert loss(partial(wave, period=4.5)) < 1.2


@pytest.mark.parametrize("shape", [(9, 9, 1), (9, 1, 1), (1, 1, 1)])
def test_limits_keep_thin_things(shape: tuple[int, int, int]) -> None:
    """A sheet, a line and a point of one voxel keep what a prefilter without limits gives them: 98, 89 and 74 %."""
    samples = np.zeros((19, 19, 19))
    samples[tuple(slice(9 - n // 2, 10 + n // 2) for n in shape)] = 1
    middle = np.full((3, 1), 9.0)
    limited, free = (means(coefficients(samples, kind), middle)[0] for kind in KINDS)
    assert limited > free - 0.005
    # unlimited, values beside them are below all samples
    assert coefficients(samples).min() == 0


@pytest.mark.parametrize("name", STEEP)
def test_coefficients_of_a_part_are_those_of_the_whole(name: str) -> None:
    """As bricks have them: a part with its margin."""
    whole, n = coefficients(STEEP[name]), margin_of(kernel("b-spline"))
    part = coefficients(STEEP[name][8 - n : 16 + n, 9 - n : 15 + n, 10 - n : 14 + n])
    assert np.array_equal(part[n:-n, n:-n, n:-n], whole[8:16, 9:15, 10:14])


def test_what_is_missing_is_as_the_ends(rng: np.random.Generator) -> None:
    """Coefficients of samples within NaN are those of the same samples alone."""
    alone = rng.random((9, 8, 7)).astype(np.float32)
    around = np.full((17, 16, 15), np.nan, np.float32)
    around[4:-4, 4:-4, 4:-4] = alone
    found = coefficients(around)
    assert np.abs(found[4:-4, 4:-4, 4:-4] - coefficients(alone)).max() < 1e-5 and np.isfinite(found).sum() == alone.size


def test_missing_samples_leave_a_field_of_the_others() -> None:
    """A NaN has no share: the mean of the others is what is left."""
    cells = np.full((6, 6, 6), 0.7)
    cells[2, 3, 3] = np.nan
    post = ValueClassifier.of(sg.Transfer([(0, 0), (1, 1)]), "b-spline", (6, 6, 6))
    places = np.random.default_rng(1).uniform(0, 5, (3, 200))
    for field in (kernel_field(sg.Volume(cells), kernel("b-spline"), post), trilinear_field(sg.Volume(cells), post)):
        value, _ = field(places)
        far = np.abs(places - np.array([[3], [3], [2]])).max(axis=0) > 1
        assert np.abs(value - 0.7)[far].max() < 1e-6 and np.isfinite(value).all()


@pytest.mark.parametrize("name", ["b-spline", "crawfis-max"])
def test_cells_by_table_are_near_exact_ones(name: str, rng: np.random.Generator) -> None:
    """Within the lattice, at its ends, and far from it, where nothing is; missing entries have no share."""
    places = rng.permutation(np.argwhere(np.ones((5, 6, 7))))[:150]
    terms, at = [1.0, rng.random(150)], np.column_stack([rng.uniform(-3, 9, (3, 400)), np.full(3, 40.0)])
    table, exact = (LatticeTerms(places, terms, kernel(name), is_exact).sums(at) for is_exact in (False, True))
    right = kernel(name).value(np.linalg.norm(at[:, None] - places.T[..., None], axis=0)).sum(axis=0)
    assert np.abs(exact[0] - right).max() < 1e-14 and exact[0, -1] == table[0, -1] == 0 < right.max()
    assert np.abs(table - exact).max() < 1e-4


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"field": "box"}, "^kernel: expected"),
        ({"steps_per_voxel": 0}, "^steps_per_voxel: expected a number of at least 1"),
        ({"samples": 0}, "^samples: expected a number of at least 1"),
    ],
    ids=str,
)
def test_unknown_fields_and_numbers_below_one(changes: dict, said: str) -> None:
    case = known("balls", 1)
    with pytest.raises(sg.InputError, match=said):
        field_integral(case.volume, case.transfer, case.camera(), **changes)


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_pixels_of_kept_values(blend: str, renderer: sg.Renderer) -> None:
    """The field of what is kept is that of all samples where it is opaque, and tells coarse sheets from fine."""
    volume = sg.scenes.ball(12)
    transfer, camera = sg.default_transfer(volume), sg.Camera.orbit(volume, 30, 20, size=(40, 30))
    splats, settings = sg.extract(volume, transfer), sg.Settings(blend=blend, antialias="off")
    pixels = np.flatnonzero(np.random.default_rng(1).random(1200) < 0.2)
    kept = select_splats(splats, settings, moving=False)
    found = kept_field_integral(kept, camera, pixels, settings=settings)
    right = field_integral(volume, transfer, camera, "b-spline", 4, blend=blend).pixels.reshape(-1, 4)[pixels]
    assert right.max() > 0.3 and np.abs(found - right).max() < 1e-3 * max(right.max(), 1.0)
    off = []
    for chosen in (settings, settings.replace(sheets=2, steps=1)):
        image = sg.check(renderer.render(splats, camera, chosen), splats, camera, chosen, 320, field=True)
        checked: Any = image.info["checked"]
        off.append(checked["field"]["rmse"])
    assert 0 < off[0] < 0.02 and (blend != "composite" or off[0] < 0.5 * off[1])


@pytest.mark.long
def test_pixels_of_the_matter_are_compared_not_of_the_background(renderer: sg.Renderer) -> None:
    """With the picture's own shading and background: as far off as without."""
    volume = sg.scenes.ball(12)
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(volume, 30, 20, size=(40, 30), zoom=0.5)
    found: list[dict[str, Any]] = []
    xray = {"blend": "xray", "background": (1, 0, 0)}
    for changes in ({}, {"background": (1.0, 1.0, 1.0)}, {"shading": "off"}, xray):
        settings = sg.Settings(**changes)
        image = sg.check(renderer.render(splats, camera, settings), splats, camera, settings, field=True)
        found.append(image.info["checked"])
        seen = renderer.render(splats, camera, settings.replace(background=None)).pixels[..., 3] > 0
        assert seen.mean() < 0.5
    assert all(0 < each["largest"] < 2e-3 and 0 < each["field"]["rmse"] < 0.02 for each in found)
    # of the drawn pixels, those that no splat reaches are left out, and show matter half of the time at least
    assert all(each["empty"] > 500 and each["field"]["pixels"] > 20 for each in found)


@pytest.mark.parametrize(
    ("settings", "amount", "said"),
    [
        (sg.Settings(compositing="splats"), None, "got voxels classified before \\(compositing splats\\)"),
        (sg.Settings(classification="pre"), None, "got voxels classified before \\(classification pre\\)"),
        (sg.Settings(), 0, "--check: expected pixels or seconds of at least 1, with --field, got 0"),
    ],
    ids=str,
)
def test_a_field_that_is_no_picture_is_refused_before_work(
    settings: sg.Settings, amount: int | None, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = sg.scenes.ball(6)
    splats, camera = sg.extract(volume, sg.default_transfer(volume)), sg.Camera.orbit(volume, size=(8, 6))
    monkeypatch.setattr("splatgl.reference.check.render_pixels", lambda *_: pytest.fail("pixels are drawn"))
    with pytest.raises(sg.InputError, match=said):
        sg.check(sg.Image(np.ones((6, 8, 4), np.float32)), splats, camera, settings, amount, field=True)


@pytest.mark.long
def test_no_spike_is_stepped_over() -> None:
    """Of a thin shell of opacity in a smooth field: a picture is held against what fine steps find."""
    z, y, x = np.indices((14, 14, 14)) - 6.5
    volume = sg.Volume(np.exp(-(x * x + y * y + z * z) / 40).astype(np.float32))
    spike = sg.Transfer([(0.5, 0.0), (0.503, 0.99), (0.506, 0.0)], window=(0, 1), unit=1.0)
    camera = sg.Camera.orbit(volume, 30, 20, size=(4, 4))
    splats = sg.extract(volume, spike, classification="post")
    right = field_integral(volume, spike, camera, "b-spline", 768).pixels.reshape(-1, 4)
    found = kept_field_integral(splats, camera, np.arange(16), settings=sg.Settings(antialias="off"))
    assert right.max() > 0.1 and np.abs(found - right).max() < 0.01

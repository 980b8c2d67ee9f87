"""Regions over value and gradient: closed forms, means over lines, techniques and twins, extraction, files, texts."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.reference.field import field_integral, kept_field_integral
from splatgl.splat.settings import Technique
from splatgl.transfer.regions import GAUSS_ERROR, SHAPES, Region, extinction_of, matter_at
from splatgl.transfer.transfer_nodes import load_transfer
from tests.helpers.bricks import noise
from tests.helpers.marcher import Field
from tests.helpers.noise import GRIDS, close_up, inside, views
from tests.helpers.regions import SOME, half_flat
from tests.helpers.regions import painting as painting

EXACT = sg.Settings(tolerance=1e-6, antialias="off")
TECHNIQUES = ("tiles", "quads")


@cache
def noisy(grid: str = "cubes") -> sg.Volume:
    return sg.Volume(noise(np.random.default_rng(5), (11, 12, 10)), **GRIDS[grid])


def matter(regions: Any, grid: str = "cubes", classification: str = "post", **more: Any) -> sg.Splats:
    return sg.extract(noisy(grid), sg.Transfer(regions=regions, **more), classification=classification)


def ramp(slope: float, spacing: float = 2.0, size: int = 24) -> sg.Volume:
    """Values that rise by `slope` per world length along z."""
    return sg.Volume(np.indices((size, 12, 12))[0] * slope * spacing, spacing=(spacing,) * 3)


def alpha_of(renderer: sg.Renderer, volume: sg.Volume, regions: Any, **changes: Any) -> np.ndarray:
    """A ray's colour along z, away from the sides."""
    ray = sg.Camera.orthographic((11.3, 10.7, -9), (11.3, 10.7, 0), (0, 1, 0), 0.5, (1, 1))
    transfer = sg.Transfer(regions=regions, unit=2.0, shading=False)
    splats = sg.extract(volume, transfer, classification=changes.pop("classification", "post"))
    return renderer.render(splats, ray, EXACT.replace(**changes)).pixels[0, 0]


@pytest.mark.parametrize("text", [*SOME, "triangle:0.3,0.8,0.05,0.4", "image", "box:0.4,inf,0.05,inf"])
def test_means_over_lines(text: str, painting: str) -> None:
    """Of random lines, long and short: means of many points; an image's at the gradient in the middle."""
    region = Region.parse(text if text != "image" else f"image:0.2,0.9,0.01,0.3:{painting}:0.9")
    rng = np.random.default_rng(2)
    first = rng.uniform((0.0, 0.0), (1.1, 0.4), (150, 2)).T
    last = first + rng.normal(0, (0.4, 0.1), (150, 2)).T * 10 ** rng.uniform(-4, 0, 150)
    last[1] = first[1] if region.is_image else np.abs(last[1])
    at = (np.arange(4000) + 0.5) / 4000
    right = np.stack([
        matter_at([region], *(a[:, None] + (b - a)[:, None] * at)).mean(axis=0)
        for a, b in zip(first.T, last.T, strict=True)
    ])  # fmt: skip
    found = region.mean(first, last)
    assert (right[:, 3] > 0).sum() > 8 and (found >= 0).all()
    # ends of the sum's points, besides
    assert np.abs(found - right).max() < (GAUSS_ERROR + 4e-4) * region.extinction


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", TECHNIQUES)
def test_a_ramp_has_one_gradient(renderer: sg.Renderer, technique: Technique) -> None:
    """A box then is a function of values alone; a triangle has half its extinction; others are empty, exactly."""
    volume, slope = ramp(0.25), 0.25
    length = 4.0 / slope
    box = "box:3,7,0.2,0.3:#ff0000:0.1"
    pixel = alpha_of(renderer, volume, box, technique=technique)
    assert np.abs(pixel - (1 - 0.9 ** (length / 2)) * np.array([1, 0, 0, 1])).max() < 2e-4
    plain = sg.Transfer([(3, 0), (3, 0.1), (7, 0.1), (7, 0)], "#ff0000", unit=2.0, shading=False)
    camera = sg.Camera.orbit(volume, 30, 20, size=(24, 24))
    settings = EXACT.replace(technique=technique)
    # beside the ends of the volume gradients are halved; a step of points is a ramp in a cell of their table
    inner = "box:3,7,0.1,0.3:#ff0000:0.1"
    pictures = [
        renderer.render(sg.extract(volume, look, classification="post"), camera, settings).pixels
        for look in (plain, replace(plain, points=(), regions=[inner]))
    ]
    assert pictures[0][..., 3].max() > 0.3 and np.abs(pictures[0] - pictures[1]).max() < 1e-4
    # half as wide half-way up, and the mean of its profile is a half
    tent = alpha_of(renderer, volume, "triangle:3,7,0,0.5:#ff0000:0.1", technique=technique)
    assert abs(tent[3] - (1 - 0.9 ** (length / 2 / 2 / 2))) < 2e-4
    for empty in ("box:3,7,0.2501,9", "box:3,7,0,0.2499", "triangle:3,7,0.26,9", "gaussian:7,9,0.3,0.4"):
        assert not alpha_of(renderer, volume, empty, technique=technique).any()


@pytest.mark.parametrize("thickness", [0.5, 0.01])
def test_no_spike_is_lost(renderer: sg.Renderer, thickness: float) -> None:
    """A box much narrower than a step between two places of a ray."""
    volume, opacity = ramp(1.0, spacing=1.0), 0.6
    volume = replace(volume, spacing=(2.0, 2.0, 2.0))
    box = f"box:{9.3},{9.3 + thickness},0.4,0.6::{opacity}"
    found = alpha_of(renderer, volume, box, steps=1)[3]
    assert abs(found - (1 - (1 - opacity) ** thickness)) < 0.02 * found


@pytest.mark.parametrize("technique", TECHNIQUES)
def test_a_shell_of_known_gradients(renderer: sg.Renderer, technique: Technique) -> None:
    """r²/2 has gradient r: a box over gradients is a shell, whose chords are known."""
    size, unit, low, high = 25, 1.0, 5.0, 8.0
    middle = (size - 1) / 2
    radius2 = ((np.indices((size, size, size)) - middle) ** 2).sum(axis=0)
    transfer = sg.Transfer(regions=[f"box:-inf,inf,{low},{high}:#ffffff:0.2"], unit=unit, shading=False)
    splats = sg.extract(sg.Volume(radius2 / 2), transfer, classification="post")
    camera = sg.Camera.orthographic((middle, middle, -9), (middle, middle, 0), (0, 1, 0), 20, (40, 40))
    alpha = renderer.render(splats, camera, EXACT.replace(technique=technique)).pixels[..., 3]
    x = (np.arange(40) + 0.5) / 2 - 10
    apart = np.hypot(*np.meshgrid(x, x))
    chords = [2 * np.sqrt(np.maximum(r * r - apart**2, 0)) for r in (low, high)]
    off = np.abs(alpha - (1 - 0.8 ** (chords[1] - chords[0])))
    # rays that graze the shell bend most
    away = (np.abs(apart - low) > 0.7) & (np.abs(apart - high) > 0.7)
    assert off[away].max() < 0.006 and off.max() < 0.1 and off.mean() < 0.005


@pytest.mark.few(2)
@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize(
    ("grid", "view", "changes"),
    [
        ("cubes", "fitted", {}),
        ("sheared", "close", {"sheets": 2, "steps": 1}),
        ("1:2:5", "parallel", {"shading": "off"}),
        ("cubes", "inside", {"blend": "xray", "sheets": 4, "steps": 2}),
        ("cubes", "fitted", {"points": [(0.5, 0), (0.8, 0.4)], "gradient": [(0, 0), (0.1, 1)]}),
        ("cubes", "fitted", {"clip": ((0.3, 0.9, 0.2, 7.0),), "ambient_occlusion": 0.5}),
    ],
    ids=str,
)
def test_the_picture_is_its_twin(
    renderer: sg.Renderer, grid: str, view: str, changes: dict[str, Any], technique: Technique, painting: str
) -> None:
    own = {name: changes[name] for name in ("points", "gradient") if name in changes}
    splats = matter([*SOME, f"image:0.2,0.9,0.01,0.3:{painting}:0.9"], grid, **own)
    camera = inside(splats, (0.3, 0.9, -0.3)) if view == "inside" else views(splats)[view]
    settings = EXACT.replace(technique=technique, **{name: changes[name] for name in changes.keys() - own.keys()})
    found = renderer.render(splats, camera, settings, verify_bound=False)
    right = sg.reference.render(splats, camera, settings).pixels
    assert found.info["technique"] == technique and right[..., 3].max() > 0.1
    assert np.abs(found.pixels - right).max() < 1.5e-4 * max(right.max(), 1.0)


def test_both_shapes_draw_the_same(processor: sg.Renderer, card: sg.Renderer, painting: str) -> None:
    splats = matter([*SOME, f"image:0.2,0.9,0.01,0.3:{painting}:0.9"])
    camera = views(splats)["fitted"]
    both = [one.render(splats, camera, EXACT.replace(technique="tiles")).pixels for one in (processor, card)]
    assert both[0].any() and np.abs(both[0] - both[1]).max() < 2e-5


@pytest.mark.parametrize(("width", "low", "high"), [(0.6, 0.93, 1.0), (1.0, 0.985, 1.015), (1.5, 0.985, 1.015)])
def test_gradients_are_those_of_the_field(width: float, low: float, high: float) -> None:
    """Across edges of so many voxels, wherever they are between voxels, the largest gradient is that of the field."""
    ratios = []
    for normal in ((1, 0, 0), (0, 2, 1), (1, 1, 1)):
        unit = np.array(normal) / np.linalg.norm(normal)
        for offset in (0.0, 0.25, 0.5, 0.75):
            across = (np.indices((24, 24, 24))[::-1].T - 11.5 - offset) @ unit
            edge = np.vectorize(math.erf)(across / width / math.sqrt(2)).T
            splats = sg.extract(sg.Volume(edge), sg.Transfer(regions=["box:-2,2,0,9"]), classification="post-all")
            field, along = Field(splats), np.linspace(-2, 2, 161)
            places = 11.5 + offset + unit[:, None] * along
            values, gradients = field.at(places)
            own = np.abs(np.gradient(values, along)).max()
            ratios.append(np.linalg.norm(gradients, axis=1).max() * splats.post.span / own)
    assert low < np.mean(ratios) < high


@pytest.mark.parametrize("kernel", ["b-spline", "crawfis-max"])
def test_gradients_beside_missing_samples(kernel: str) -> None:
    """They are those of the samples that there are, in reach of the differences by any kernel."""
    samples = noise(np.random.default_rng(3), (13, 12, 11))
    samples[6, 6, 5] = np.nan
    splats = sg.extract(sg.Volume(samples), sg.Transfer(regions=["box:0,1,0,inf"]), kernel=kernel)
    assert len(splats) == samples.size - 1 and np.isfinite(splats.records["gradient"]).all()


@pytest.mark.few(1)
@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize("cut", ["mask", "scissors", "missing", "whole", "classified before"])
def test_regions_are_lit_as_points(renderer: sg.Renderer, technique: Technique, cut: str) -> None:
    """A region of all gradients, points that end at it, points over a wider range and equal weights draw one picture,
    of noisy matter that meets the ends, in values of any size.
    """
    size, rng = 1e-4, np.random.default_rng(6)
    samples = (sg.scenes.ball(9).samples[4:] + rng.normal(0, 0.05, (17, 21, 21))) * size
    kept = (np.indices(samples.shape) - np.array(samples.shape)[:, None, None, None] / 2)[1:].sum(axis=0) < 1
    volume = sg.Volume(np.where(kept, samples, np.nan) if cut == "missing" else samples)
    camera = sg.Camera.orbit(volume, 35, 25, size=(24, 24))
    if cut in ("mask", "scissors"):
        volume = volume.masked(kept if cut == "mask" else sg.Scissors("0,0 0.6,0 0.6,1 0,1", True, camera))
    step = [(0.4 * size, 0), (0.4 * size, 0.6)]
    looks = {
        "points": sg.Transfer(step, "#e0c060"),
        "region": sg.Transfer(regions=[f"box:{0.4 * size},inf,0,inf:#e0c060:0.6"]),
        "wide": sg.Transfer([(-size, 0), *step, (5 * size, 0.6)], "#e0c060"),
        "weights": sg.Transfer(step, "#e0c060", gradient=[(0, 1), (size, 1)]),
    }
    how = "pre" if cut == "classified before" else "post"
    pictures = {
        name: renderer.render(sg.extract(volume, look, classification=how), camera, EXACT.replace(technique=technique))
        for name, look in looks.items()
    }
    right = pictures.pop("points").pixels
    assert right[..., 3].max() > 0.9
    assert {name for name, each in pictures.items() if np.abs(each.pixels - right).max() > 1e-4} == set()


def test_sheets_are_near_the_field(painting: str) -> None:
    """The field marched finely, as it was kept, and whole: no visible voxel is lost."""
    splats = matter(SOME)
    camera = close_up(splats, 30, 20, (12, 12))
    drawn = sg.reference.render(splats, camera, sg.Settings(antialias="off")).pixels.reshape(-1, 4)
    kept = kept_field_integral(splats, camera, np.arange(144))
    whole = field_integral(noisy(), splats.post.transfer, camera, steps_per_voxel=8).pixels.reshape(-1, 4)
    assert drawn[:, 3].max() > 0.3
    assert np.sqrt(((drawn - kept) ** 2).mean()) < 0.006 and np.sqrt(((kept - whole) ** 2).mean()) < 0.003


@pytest.mark.parametrize("classification", ["post", "pre"])
@pytest.mark.parametrize("scale", [2.0**-960, 2.0**-640, 2.0**-110, 2.0**980])
def test_scaled_values_draw_the_same_picture(renderer: sg.Renderer, scale: float, classification: str) -> None:
    """Regions, weights by gradient and the default's window, drawn and in float64, of values of any size."""
    drawn = []
    for by in (1.0, scale):
        volume = sg.Volume(noise(np.random.default_rng(5), (6, 5, 7)).astype(float) * by)
        regions = [f"gaussian:{0.3 * by},{0.7 * by},0,{by}:red:0.5", f"box:{0.1 * by},{0.3 * by},0,inf:blue:0.5"]
        points, gradient = [(0.2 * by, 0.0), (0.9 * by, 0.6)], [(0.0, 0.2), (0.5 * by, 1.0)]
        transfer = sg.Transfer(points, regions=regions, gradient=gradient)
        splats = sg.extract(volume, transfer, classification=classification)
        scene = splats, sg.Camera.orbit(volume, size=(8, 8)), EXACT
        default = sg.render(volume, size=8, classification=classification)
        drawn.append([renderer.render(*scene).pixels, sg.reference.render(*scene).pixels, default.pixels])
    for at_one, scaled in zip(*drawn, strict=True):
        assert np.abs(scaled - at_one).max() < 1e-6


def test_no_visible_voxel_is_lost() -> None:
    """Pictures of all voxels are those of the kept ones."""
    rising = ((np.indices((17, 17, 17)) - 8.0) ** 2).sum(axis=0) / 2
    transfer = sg.Transfer(regions=["box:10,14,4.6,5.1:#ff8800:0.9", "triangle:24,28,0,9:#2266ff:0.5"])
    some, every = (sg.extract(sg.Volume(rising), transfer, classification=kind) for kind in ("post", "post-all"))
    assert len(some) < 0.8 * len(every)
    camera = sg.Camera.orbit(every, 30, 20, size=(20, 16))
    pictures = [sg.reference.render(one, camera, EXACT).pixels for one in (some, every)]
    assert pictures[1][..., 3].max() > 0.3 and np.abs(pictures[0] - pictures[1]).max() < 1e-4


@pytest.mark.parametrize("grid", ["cubes", "sheared"])
def test_only_voxels_near_steep_ones_are_kept(grid: str) -> None:
    """Pictures of all voxels are those of the kept ones: where gradients are flat everywhere around, none is."""
    samples = half_flat(np.random.default_rng(6))
    samples[4, 5, 26] = np.nan
    volume = sg.Volume(samples, **GRIDS[grid])
    flat, steep = (sg.Transfer(regions=[f"box:0.4,0.7,{least},9:#ff8800:0.9"]) for least in (0.0, 0.12))
    by_value = sg.extract(volume, flat, classification="post")
    some, every = (sg.extract(volume, steep, classification=kind) for kind in ("post", "post-all"))
    assert len(some) < 0.8 * len(by_value)
    camera = sg.Camera.orbit(every, 30, 20, size=(20, 16))
    pictures = [sg.reference.render(one, camera, EXACT).pixels for one in (some, every)]
    assert pictures[1][..., 3].max() > 0.3 and np.abs(pictures[0] - pictures[1]).max() < 1e-6
    # values that were kept for steep gradients do not serve flat ones
    assert by_value.post.holds(steep) and some.post.holds(steep) and not some.post.holds(flat)


def test_voxels_classified_before(renderer: sg.Renderer) -> None:
    """Each by its own gradient; where points and regions meet, extinctions add and colours mix by them."""
    transfer = sg.Transfer([(0.5, 0.2), (0.6, 0.2)], "#0000ff", regions=["box:0.4,0.6,0.05,0.15:#ff0000:0.5"], unit=1.0)
    volume = noisy()
    splats = sg.extract(volume, transfer, threshold=0.3, classification="pre")
    x, y, z = np.rint(splats.records["position"]).astype(int).T
    slope = np.stack(np.gradient(volume.samples))[:, z, y, x]
    value, size = volume.samples[z, y, x], np.linalg.norm(slope, axis=0)
    inner = ((np.stack([x, y, z]) > 0) & (np.array(volume.shape[::-1]) - 1 > np.stack([x, y, z]).T).T).all(axis=0)
    assert inner.sum() > 20
    assert ((value >= 0.4) & (value <= 0.6) & (size >= 0.05) & (size <= 0.15))[inner].all()
    parts = extinction_of([0.5, 0.2])
    assert np.allclose(splats.records["optical_depth"], parts.sum(), rtol=1e-5)
    assert np.allclose(splats.colors, np.array([parts[0], 0, parts[1]]) / parts.sum(), atol=1e-4)
    everyone = (np.linalg.norm(np.gradient(volume.samples), axis=0) > 0)[1:-1, 1:-1, 1:-1].sum()
    assert inner.sum() < everyone


def test_one_value_has_no_gradient(renderer: sg.Renderer) -> None:
    splats = matter(SOME, classification="post-all")
    with pytest.raises(sg.InputError, match="blend: expected composite or xray with regions over gradients, got mip"):
        renderer.render(splats, views(splats)["fitted"], sg.Settings(blend="mip"))


def test_the_plan_tells_the_error() -> None:
    splats = matter(SOME)
    text = sg.plan(splats, views(splats)["fitted"]).explain()
    assert "1 × box (exact), 1 × triangle (within 0.1% of its extinction), 1 × gaussian" in text


def test_texts(painting: str, tmp_path: Path) -> None:
    texts = [*SOME, f"image:0.2,0.9,0.01,0.3:{painting}:0.9", "box:1,inf,0,2"]
    transfer = sg.Transfer(regions=texts)
    assert sg.Transfer(regions=[str(region) for region in transfer.regions]) == transfer
    assert sg.Transfer(regions=transfer.regions) == transfer and transfer.points == ((0.2, 0.0), (1.0, 0.0))
    transfer.save(tmp_path / "regions.toml")
    assert sg.Transfer.load(tmp_path / "regions.toml") == transfer
    assert transfer.regions[2].color == "#00ff00" and transfer.regions[4].opacity == 0.5
    half = transfer.weakened(0.5)
    assert [region.opacity for region in half.regions] == [region.opacity / 2 for region in transfer.regions]
    assert {region.shape for region in transfer.regions} == set(SHAPES)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("circle:0,1,0,1", "region: expected box, triangle, gaussian or image, got 'circle'"),
        ("box:0,1,0", "region: expected SHAPE:VALUE,VALUE,GRADIENT,GRADIENT[:COLOR[:OPACITY]], got 'box:0,1,0'"),
        ("box:1,0,0,1", "region's values: expected low < high, got 1, 0"),
        ("box:0,1,-1,1", "region: expected gradients of at least 0, got -1"),
        ("triangle:0,inf,0,1", "region's values: expected finite numbers for a triangle, got 0, inf"),
        ("box:0,1,0,1:purplish", "region's color: expected #rrggbb or a name in CSS, got 'purplish'"),
        ("box:0,1,0,1:red:2", "region: expected an opacity from 0 to 1, got 2.0"),
        ("image:0,1,0,1:missing.png", "region missing.png: expected a picture with alpha, got"),
    ],
)
def test_bad_regions_are_told_in_a_line(text: str, message: str) -> None:
    with pytest.raises(sg.InputError) as caught:
        sg.Transfer(regions=[text])
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_too_many_regions_are_refused(painting: str) -> None:
    with pytest.raises(sg.InputError, match="regions: expected at most 16, got 17"):
        sg.Transfer(regions=["box:0,1,0,1"] * 17)
    with pytest.raises(sg.InputError, match="regions: expected at most one image, got several"):
        sg.Transfer(regions=[f"image:0,1,0,1:{painting}"] * 2)
    with pytest.raises(sg.InputError, match="regions: expected values with gradients, got labels"):
        sg.Transfer([(0, 0)], regions=["box:0,1,0,1"], labels=[(1, "#ff0000", 1.0)])


SLICER = """1
1
0.9
0.1
0.2
10
8 -3024 0 -16 0 641 0.72 3071 0.71
6 0 0 10 0.5 255 1
16 -3024 0 0 0 -16 0.73 0.25 0.3 641 0.9 0.82 0.56 3071 1 1 1
"""


def test_volume_properties_of_slicer(tmp_path: Path) -> None:
    """Gradients are per mean spacing there, opacities per 1 world length, colours as displayed."""
    (tmp_path / "CT.vp").write_text(SLICER)
    transfer = load_transfer(tmp_path / "CT.vp", spacing=2.0)
    assert transfer.points == ((-3024, 0), (-16, 0), (641, 0.72), (3071, 0.71))
    assert transfer.gradient == ((0, 0), (5, 0.5), (127.5, 1)) and transfer.unit == 1.0 and transfer.shading
    assert transfer.window == (-3024, 3071)
    shown = sg.Transfer([(0, 0)], colormap="#ba404d").color([0.0])
    assert np.abs(transfer.color([-16]) - shown).max() < 0.02
    (tmp_path / "plain.vp").write_text(SLICER.replace("6 0 0 10 0.5 255 1", "4 0 1 255 1"))
    assert load_transfer(tmp_path / "plain.vp", spacing=2.0).gradient == ()
    for old, new in (("8 -3024", "9 -3024"), ("0.72", "much"), ("16 -3024 0 0 0", "2 -3024 0"), ("10\n", "")):
        (tmp_path / "bad.vp").write_text(SLICER.replace(old, new))
        with pytest.raises(sg.InputError, match=r"bad\.vp: expected|bad\.vp: volume property: expected"):
            load_transfer(tmp_path / "bad.vp", spacing=2.0)


def test_transfer_functions_of_paraview(tmp_path: Path) -> None:
    boxes = "[100, 10, 50, 40, 1, 0.5, 0, 0.25]"
    (tmp_path / "boxes.json").write_text(f'[{{"Name": "edges", "Boxes": {boxes}}}]')
    transfer = load_transfer(tmp_path / "boxes.json", spacing=2.0)
    assert [str(region) for region in transfer.regions] == ["gaussian:100,150,5,25:#ff8000:0.25"]
    # a deviation of 0.3 of a side; at a side's middle exp(−½ (0.5/0.3)²)
    share = matter_at(transfer.regions, [125.0, 100.0], [15.0, 15.0])[:, 3]
    assert abs(share[1] / share[0] - np.exp(-0.5 * (0.5 / 0.3) ** 2)) < 1e-12
    (tmp_path / "points.json").write_text(
        '{"Points": [0, 0, 0.5, 0, 9, 0.7, 0.5, 0], "RGBPoints": [0, 1, 0, 0, 9, 0, 0, 1]}'
    )
    plain = load_transfer(tmp_path / "points.json", spacing=2.0)
    assert plain.points == ((0, 0), (9, 0.7)) and plain.window == (0, 9) and not plain.regions
    assert np.abs(plain.color([0, 9]) - [[1, 0, 0], [0, 0, 1]]).max() < 1e-9
    for bad in ("[]", "{", '{"Points": [1, 2]}', '{"Boxes": "none"}', "3"):
        (tmp_path / "bad.json").write_text(bad)
        with pytest.raises(sg.InputError, match=r"bad\.json: "):
            load_transfer(tmp_path / "bad.json", spacing=2.0)

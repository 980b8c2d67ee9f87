"""Volumes cut by masks: closed forms, the float64 reference, masks on other grids, and masks that are none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.data.mask import parse_mask
from splatgl.errors import InputError
from splatgl.geometry import mask_field
from splatgl.geometry.clipping import index_plane
from splatgl.geometry.mask_field import AROUND, EDGE, REACH, MaskField
from splatgl.planning.ambient_occlusion import CoarseGrid
from splatgl.planning.bricks import Bricks
from splatgl.reference.field import field_integral, kept_field_integral
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.kernels import KERNELS
from splatgl.splat.lighting import AMBIENT, DIFFUSE
from tests.helpers.blocks import FOG, OPACITY, PLAIN, SOLID, block, field, lengths
from tests.helpers.noise import GRIDS, views
from tests.helpers.splatting import each_two

pytestmark = pytest.mark.usefixtures("shared_programs")


def blob(volume: sg.Volume, seed: int = 1) -> np.ndarray:
    """A ball, and some voxels alone, bool [D, H, W]."""
    z, y, x = np.indices(volume.shape) - np.array(volume.shape).reshape(3, 1, 1, 1) / 2
    return (x * x + y * y + z * z < 30) | (np.random.default_rng(seed).random(volume.shape) < 0.02)


def half(volume: sg.Volume, axis: int = 0, size: int = 8) -> np.ndarray:
    """The first voxels along an axis (x, y, z)."""
    return np.indices(volume.shape)[2 - axis] < size


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("grid", "view", "technique"), each_two(GRIDS, ("fitted", "parallel", "wide"), ("quads", "tiles"))
)
def test_a_block_is_as_deep_as_what_its_mask_keeps(grid: str, view: str, technique: Any, renderer: sg.Renderer) -> None:
    """X-rays of fog: within a hundredth of a voxel of the closed form, on every grid."""
    volume = block(grid)
    camera = views(sg.extract(volume, FOG))[view]
    for axis in (0, 2):
        splats = sg.extract(volume.masked(half(volume, axis)), FOG)
        image = renderer.render(splats, camera, PLAIN.replace(blend="xray", technique=technique))
        right = lengths(volume, camera, (index_plane(volume, axis, -1, 7.5),))
        assert 0.2 < right.sum() / lengths(volume, camera, ()).sum() < 0.7
        apart = np.abs(image.pixels[..., 3] / -np.log(1 - OPACITY) - right)
        assert apart.max() < 0.01 * splats.grid.mean_spacing


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("blend", "technique"),
    [("composite", "tiles"), ("composite", "quads"), ("xray", "quads"), ("mip", "quads"), ("mean", "tiles")],
)
def test_masked_pictures_are_the_reference(blend: str, technique: Any, renderer: sg.Renderer) -> None:
    volume = field("sheared")
    how = "post" if blend in ("composite", "xray") else "post-all"
    splats = sg.extract(volume.masked(blob(volume)), SOLID, classification=how)
    whole = sg.extract(volume, SOLID, classification=how)
    settings = PLAIN.replace(blend=blend, technique=technique)
    for name in ("fitted", "parallel", "close"):
        camera = views(whole)[name]
        found = renderer.render(splats, camera, settings).pixels
        right = reference.render(splats, camera, settings).pixels
        assert np.abs(right - reference.render(whole, camera, settings).pixels).max() > 0.1
        off = np.abs(found - right) / max(np.abs(right).max(), 1.0)
        assert off.max() < 2e-3 and off.mean() < 1e-5


@pytest.mark.long
@pytest.mark.parametrize("blend", ["composite", "xray", "mip"])
def test_masked_pictures_are_those_of_the_field(blend: str, renderer: sg.Renderer) -> None:
    """Of the field marched in small steps, which is cut at each: the error is about that of the picture without."""
    volume = field(size=20)
    camera = views(sg.extract(volume, SOLID))["fitted"]
    pixels = np.arange(camera.size[0] * camera.size[1])[::3]
    settings, off = sg.Settings(blend=blend, antialias="off", tolerance=1e-4), []
    # extremes of voxels alone depend on the steps
    mask = half(volume, 1, 13) if blend == "mip" else blob(volume)
    for each in (volume, volume.masked(mask)):
        splats = sg.extract(each, SOLID, classification="post-all" if blend == "mip" else "post")
        image = renderer.render(splats, camera, settings).pixels.reshape(-1, 4)[pixels]
        right = kept_field_integral(splats, camera, pixels, settings=settings)
        off.append(np.sqrt(((image - right) ** 2).mean()) / np.abs(right).max())
    assert off[1] < max(1.5 * off[0], 0.012)


def test_the_integral_of_a_volume_is_masked() -> None:
    volume = block()
    camera = views(sg.extract(volume, FOG))["parallel"].resized((12, 9))
    found = field_integral(volume.masked(half(volume)), FOG, camera, "trilinear", 16, blend="xray").pixels[..., 3]
    right = lengths(volume, camera, (index_plane(volume, 0, -1, 7.5),))
    assert np.abs(found / -np.log(1 - OPACITY) - right).max() < 0.1


@pytest.mark.long
def test_what_is_kept_is_as_without_a_mask(renderer: sg.Renderer) -> None:
    """Nothing of values changes: a mask with a plane face cuts as the plane does; one that keeps all, nothing."""
    volume, settings = field(), PLAIN.replace(shading="off")
    whole = sg.extract(volume, SOLID)
    camera = views(whole)["fitted"]
    masked = renderer.render(sg.extract(volume.masked(half(volume)), SOLID), camera, settings).pixels
    clip = [index_plane(volume, 0, -1, 7.5)]
    assert np.abs(masked - renderer.render(whole, camera, settings.replace(clip=clip)).pixels).max() < 2e-4
    every = renderer.render(sg.extract(volume.masked(np.ones(volume.shape)), SOLID), camera, PLAIN).pixels
    plain = renderer.render(whole, camera, PLAIN)
    assert np.abs(every - plain.pixels).max() < 1e-6
    assert not renderer.plan(whole, camera, PLAIN).program.appearance.masked


def test_values_as_far_as_a_kernel_reaches_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Values within depend on those around: of noise under the widest kernel, more of them change nothing."""
    # the radial B-spline at half its frequency, of radius 4
    wide = sg.PiecewiseCubic("wide", (2.0, 4.0), ((1 / 12, 0.0, -1 / 32, 1 / 128), (1 / 6, -1 / 8, 1 / 32, -1 / 384)))
    monkeypatch.setitem(KERNELS, "wide", wide)
    samples = np.random.default_rng(5).random((12, 16, 12)).astype(np.float32)
    rough = sg.Transfer([(0.45, 0), (0.55, 0.3)], colormap="gray", shading=False)
    camera = sg.Camera.orthographic((5.5, 30, 5.5), (5.5, 5.5, 5.5), (0, 0, 1), height=12, size=(6, 6))
    found = []
    for reach in (mask_field.REACH, 16):
        monkeypatch.setattr(mask_field, "REACH", reach)
        splats = sg.extract(sg.Volume(samples).masked(np.indices(samples.shape)[1] < 7), rough, kernel="wide")
        found.append(reference.render(splats, camera, PLAIN.replace(kernel="wide")).pixels)
    assert found[1][..., 3].max() > 0.5
    assert np.abs(found[0] - found[1]).max() < 1e-6


@pytest.mark.long
def test_no_values_are_invented_at_the_border(renderer: sg.Renderer) -> None:
    """Bright matter within a mask is grey to its border; with 0 in place of what is cut, a red skin lies around it."""
    volume = block()
    points = [(0.1, 0), (0.2, 0.9), (0.8, 0.9), (0.9, 0.5)]
    skin = sg.Transfer(points, colormap="0:#ff0000,0.85:#ff0000,0.95:#808080,1:#808080", window=(0, 1))
    camera = views(sg.extract(volume, skin))["fitted"]
    mask = blob(volume)
    found = renderer.render(sg.extract(volume.masked(mask), skin), camera, PLAIN).pixels
    assert found[..., 3].max() > 0.9 and (found[..., 0] - found[..., 1]).max() < 1e-4
    zeros = sg.Volume(np.where(mask, volume.samples, 0))
    assert np.ptp(renderer.render(sg.extract(zeros, skin), camera, PLAIN).pixels[..., :2], axis=2).max() > 0.3


@pytest.mark.long
def test_faces_are_lit_by_the_mask(renderer: sg.Renderer) -> None:
    """Opaque matter without gradients: ambient and diffuse light by the angle to the mask's face."""
    volume = block()
    opaque = sg.Transfer([(0.0, 0.999999)], colormap="gray", window=(0, 1), unit=0.05, shading=True)
    splats = sg.extract(volume.masked(half(volume, 1, 10)), opaque)
    middle = volume.corners.mean(axis=0)
    angle = np.radians(35)
    eye = middle + 60 * np.array([np.sin(angle), np.cos(angle), 0])
    camera = sg.Camera.orthographic(eye, middle, (0, 0, 1), height=6, size=(8, 8))
    found = renderer.render(splats, camera, PLAIN).pixels
    assert np.abs(found[..., :3] - (AMBIENT + DIFFUSE * np.cos(angle))).max() < 0.01


def test_voxels_classified_before_are_kept_whole(renderer: sg.Renderer) -> None:
    """And the error bound holds; what a mask hides is not what a threshold dropped."""
    volume = field()
    mask = blob(volume)
    splats = sg.extract(volume, SOLID, 0.1, classification="pre")
    x, y, z = splats.records["position"].T
    kept = splats.part(mask[z, y, x])
    masked = sg.extract(volume.masked(mask), SOLID, 0.1, slab=3, classification="pre")
    assert (kept.records == masked.records).all() and 0 < len(masked) < len(splats)
    assert masked.dropped_depth < splats.dropped_depth
    camera = views(splats)["fitted"]
    drawn = renderer.render(masked, camera, PLAIN.replace(compositing="splats"))
    right = reference.render(masked, camera, PLAIN.replace(compositing="splats")).pixels
    assert drawn.info["error_bound"] and np.abs(drawn.pixels - right).max() <= drawn.info["error_bound"]


@pytest.mark.parametrize("grid", list(GRIDS))
def test_masks_lie_in_the_world(grid: str) -> None:
    """On a grid of their own: a voxel is kept if its centre lies in a voxel that is."""
    volume, rng = field(grid), np.random.default_rng(4)
    turned = sg.Volume(
        rng.random((9, 11, 8)) < 0.5,
        spacing=(1.7, 2.3, 1.4),
        origin=(2.1, -3.2, 4.3),
        direction=np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]) if grid == "cubes" else np.eye(3),
    )
    z, y, x = (each.ravel() for each in np.indices(volume.shape))
    world = np.stack([x, y, z], axis=1) @ volume.world_from_index.T + volume.origin
    i = np.rint((world - turned.origin) @ np.linalg.inv(turned.world_from_index).T).astype(int)
    there = ((i >= 0) & (i < turned.shape[::-1])).all(axis=1)
    i = np.where(there[:, None], i, 0)
    right = (there & turned.samples[i[:, 2], i[:, 1], i[:, 0]]).reshape(volume.shape)
    assert 0 < right.sum() < right.size
    assert (volume.masked(turned).kept((0, 0, 0), volume.shape) == right).all()
    part = volume.masked(turned, outside=True).part((3, 2, 1), (9, 12, 13))
    assert (part.kept((0, 0, 0), part.shape) == ~right[3:9, 2:12, 1:13]).all()


def test_masks_in_another_frame_are_turned() -> None:
    samples = np.zeros((4, 5, 6), np.uint8)
    samples[1, 3, 4] = 1
    volume = sg.Volume(np.ones((4, 5, 6)), origin=(10, 20, 30), frame="LPS")
    turned = sg.Volume(samples, (1, 1, 1), (-10, -20, 30), np.diag([-1.0, -1.0, 1.0]), frame="RAS")
    assert (volume.masked(turned).kept((0, 0, 0), volume.shape) == (samples > 0)).all()
    with pytest.raises(InputError, match=r"x 9\.5…15\.5"):
        volume.masked(sg.Volume(samples, (1, 1, 1), (-10, -20, 30), np.diag([-1.0, -1.0, 1.0]), name="own"))


def test_labels_outsides_and_several() -> None:
    volume = block()
    numbers = np.arange(volume.count).reshape(volume.shape) % 5
    gone = numbers.astype(np.float32)
    gone[0] = np.nan

    def kept(*masks: Any, **how: Any) -> np.ndarray:
        found = volume
        for mask in masks:
            found = found.masked(mask, **how)
        return found.kept((0, 0, 0), volume.shape)

    assert (kept(numbers) == (numbers != 0)).all()
    assert (kept(numbers, labels=[3, 4]) == (numbers >= 3)).all()
    assert (kept(numbers, labels=[3, 4], outside=True) == (numbers < 3)).all()
    assert (kept(gone) == (numbers != 0) & (np.arange(20) > 0)[:, None, None]).all()
    assert (kept(numbers, half(volume)) == (numbers != 0) & half(volume)).all()
    assert volume.masked(half(volume)).notes == ("mask keeps 40.0% of the voxels",)
    assert "masked" in repr(volume.masked(numbers))


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a.nrrd", ("a.nrrd", (), False)),
        ("a.nrrd:3,7", ("a.nrrd", (3, 7), False)),
        ("a.nrrd:outside", ("a.nrrd", (), True)),
        ("a.nrrd:3:outside", ("a.nrrd", (3,), True)),
        ("https://a.b:80/c.zarr:12", ("https://a.b:80/c.zarr", (12,), False)),
        ("a.h5:/b/3", ("a.h5:/b/3", (), False)),
    ],
)
def test_masks_in_words(text: str, found: Any) -> None:
    assert parse_mask(text) == found


@pytest.mark.long
def test_layers_labels_and_channels_are_masked(renderer: sg.Renderer) -> None:
    """Each layer by masks of its own, as the reference has them; segmentations and voxels of colours too."""
    first, second = field(), field("1:2:5")
    masked = second.masked(blob(second))
    numbers = sg.Volume((np.indices((16, 16, 16))[0] // 4).astype(np.uint8), labels=())
    looks = [sg.Layer(first, SOLID, 0.3), sg.Layer(masked, SOLID), sg.Layer(numbers.masked(half(numbers)))]
    scene = sg.Scene(looks)
    camera = sg.Camera.orbit(first, 30, 20, size=(48, 36))
    image = renderer.render(scene, camera, PLAIN).pixels
    assert np.abs(image - reference.render(scene, camera, PLAIN).pixels).max() < 2e-3
    plain = sg.Scene([looks[0], sg.Layer(second, SOLID), sg.Layer(numbers)])
    assert np.abs(image - renderer.render(plain, camera, PLAIN).pixels).max() > 0.1
    several = sg.Volume(first.samples, channels=(first, field(size=16)))
    assert all(each.masks for each in several.masked(half(first)).channels)


@pytest.mark.long
def test_bricks_beside_the_mask_are_not_read(renderer: sg.Renderer) -> None:
    """The picture is the whole one's."""
    volume = field(size=64)
    z, y, x = np.indices(volume.shape)
    masked = volume.masked((x - 12) ** 2 + (y - 12) ** 2 + (z - 12) ** 2 < 60)
    splats = sg.extract(masked, SOLID)
    camera = sg.Camera.orbit(splats, 30, 20, size=(48, 36))
    bricks = Bricks.of(masked, splats.post, 16)
    image = renderer.render_bricks(bricks, camera, PLAIN)
    assert np.abs(image.pixels - renderer.render(splats, camera, PLAIN).pixels).max() < 1e-6
    assert image.pixels.any() and sum(n > 0 for n in bricks.found.values()) == 8


def test_what_is_cut_off_keeps_no_light_off() -> None:
    volume = block()
    splats = sg.extract(volume.masked(half(volume)), FOG)
    extinction = CoarseGrid.of([(splats, ())]).extinction
    alone = CoarseGrid.of([(sg.extract(volume, FOG), ())]).extinction
    assert extinction.sum() == pytest.approx(alone.sum() * 8 / 20, rel=1e-6)


def test_depths_and_picked_places_end_at_the_mask() -> None:
    """An opaque block, seen along x from where it is cut: right to a thousandth of a voxel."""
    volume = block()
    wall = sg.Transfer([(0.0, 0.999999)], unit=0.01)
    masked = volume.masked(half(volume, 0, 10))
    camera = sg.Camera.orthographic((50, 9.3, 9.6), (0, 9.3, 9.6), (0, 0, 1), height=9, size=(9, 9))
    depths = sg.depth_map(masked, wall, camera)
    assert np.abs(depths - (50 - 9.5)).max() < 1e-3
    found = sg.pick(masked, camera, (4, 4), wall)
    assert found and found.place[0] == pytest.approx(9.5, abs=0.3)
    assert sg.depth_map(volume, wall, camera)[4, 4] == pytest.approx(50 - 19.5, abs=1e-3)
    rising = sg.Volume(np.broadcast_to(np.arange(20.0), (20, 20, 20)).copy()).masked(half(volume, 0, 10))
    most = sg.depth_map(rising, sg.Transfer([(0, 0.5)]), camera, at="max")
    assert np.abs(most - (50 - 9.5)).max() < 0.1
    best = sg.pick(rising, camera, (4, 4), sg.Transfer([(0, 0.5)]), mode="max")
    assert best and best.value == pytest.approx(9.5, abs=0.3)


@pytest.mark.long
def test_the_view_is_fitted_to_what_is_kept() -> None:
    volume = block(size=30)
    small = volume.masked(half(volume, 0, 4) & half(volume, 1, 4) & half(volume, 2, 4))
    look: Any = {"points": [(0, 0.5)], "size": 32, "background": "transparent", "fit": "visible"}
    near, far = (sg.render(each, **look).pixels[..., 3] for each in (small, volume))
    assert (near > 0).sum() > 0.7 * (far > 0).sum()


def test_a_mask_field() -> None:
    """Linear between voxels, in a box around what is kept; normals of plane faces have length 1."""
    volume = block(size=30)
    inside = np.zeros(volume.shape, bool)
    inside[12:20, 10:18, 9:21] = True
    mask = MaskField.of(volume.masked(inside))
    assert mask is not None and mask.kept.shape == tuple(np.array([8, 8, 12]) + 2 * AROUND)
    places = np.array([[15.0, 14, 8.5], [15, 14, 8.75], [19.5, 14, 15], [0, 0, 0], [29, 29, 29]])[:, ::-1].T
    assert np.allclose(mask.at(places), np.array([0.5, 0.75, 0.5, 0, 0]) - EDGE)
    normals = mask.normals(np.array([[8.5, 14.0, 16.0], [20.5, 14, 16]]).T)
    assert np.allclose(normals, [[1, 0, 0], [-1, 0, 0]], atol=0.01)
    near = mask.near((0, 0, 0), volume.shape)
    assert near.sum() == np.prod(np.array([8, 8, 12]) + 2 * REACH)
    assert (mask.near((3, 4, 5), (20, 21, 30)) == near[3:20, 4:21, 5:30]).all()
    assert MaskField.of(volume) is None


def save(path: Path, samples: np.ndarray) -> str:
    np.save(path, samples)
    return str(path)


@pytest.mark.long
def test_commands_and_scene_files_mask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`--mask`, the key of a scene file and `sg.render` draw the same; a layer's empty text is no mask."""
    volume = field()
    source = save(tmp_path / "a.npy", volume.samples)
    mask = save(tmp_path / "m.npy", np.where(blob(volume), 3, half(volume) * 2).astype(np.uint8))
    options = ["--size", "48", "--check", "0", "--quiet", "--points", "0.3:0,0.9:0.7"]
    out = tmp_path / "o.npy"
    assert main(["render", source, "-o", str(out), "--mask", f"{mask}:3", *options]) == 0
    same = sg.render(source, size=48, points=((0.3, 0), (0.9, 0.7)), mask=blob(volume))
    assert (np.load(out) == same.pixels).all()
    assert (np.load(out) == sg.render(source, size=48, points=((0.3, 0), (0.9, 0.7)), mask=f"{mask}:3").pixels).all()
    layers = (SceneFile(source, mask=()), SceneFile(source), SceneFile(source, mask=(f"{mask}:2,3:outside",)))
    scene = SceneFile(source, mask=(f"{mask}:3", mask), layers=layers)
    path = tmp_path / "scene.toml"
    path.write_text(scene.to_toml(tmp_path))
    assert '"m.npy:3", "m.npy"' in path.read_text()
    again = SceneFile.from_toml(path)
    assert again.mask == scene.mask and [each.mask for each in again.layers] == [each.mask for each in layers]
    path.write_text('volume = "a.npy"\nmask = "m.npy:3"\n[transfer]\npoints = [[0.3, 0], [0.9, 0.7]]\n')
    assert main(["render", str(path), "-o", str(out), "--size", "48", "--check", "0", "--quiet"]) == 0
    assert (np.load(out) == same.pixels).all()
    assert main(["pick", source, "24,24", "--mask", f"{mask}:3", "--size", "48", "--points", "0.3:0,0.9:0.7"]) == 0
    assert "mask m keeps" in capsys.readouterr().err


def test_masks_that_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    volume = field()
    source, size = save(tmp_path / "a.npy", volume.samples), volume.shape
    empty = save(tmp_path / "empty.npy", np.zeros(size, np.uint8))
    every = save(tmp_path / "every.npy", np.ones(size, np.uint8))
    dark = save(tmp_path / "dark.npy", volume.samples < 0.15)
    (tmp_path / "cut.nrrd").write_text("NRRD0004\ntype: uint8\n")
    told = {
        empty: "mask empty: expected voxels that are not 0, got none",
        f"{every}:7": "mask every: expected labels among 1, got 7",
        f"{every}:outside": "got none outside of it",
        str(tmp_path / "none.npy"): "got no such file",
        str(tmp_path): "mask ",
        str(tmp_path / "cut.nrrd"): "mask ",
        ":outside": "FILE[:N,N…][:outside]",
        dark: "expected visible voxels inside its masks, got none",
    }
    for mask, words in told.items():
        assert main(["render", source, "-o", str(tmp_path / "o.png"), "--points", "0.2:0,0.9:1", "--mask", mask]) == 2
        line = capsys.readouterr().err.splitlines()[-1]
        assert line.startswith("splatgl: ") and words in line, line
    assert main(["render", source, "-o", str(tmp_path / "o.png"), "--size", "16", "--mask", every]) == 0
    assert "mask every keeps all of the voxels" in capsys.readouterr().err
    far = sg.Volume(np.ones((2, 2, 2)), origin=(500, 0, 0), name="far")
    with pytest.raises(InputError, match=r"mask far: .* which lies at x -0\.5…15\.5.* it lies at x 499\.5…501\.5"):
        volume.masked(far)
    with pytest.raises(InputError, match=r"an array \(16, 16, 16\) on the volume's grid"):
        volume.masked(np.ones((3, 3, 3)))
    with pytest.raises(InputError, match="mask: expected FILE"):
        SceneFile.from_toml(Path(_toml(tmp_path, "mask = [3]")))


def _toml(folder: Path, line: str) -> str:
    (folder / "bad.toml").write_text(f'volume = "a.npy"\n{line}\n')
    return str(folder / "bad.toml")

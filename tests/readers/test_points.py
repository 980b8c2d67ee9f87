"""Point clouds: what is read of each format, sizes and spacing, and pictures in closed form and beside float64."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.data.points import Points, median_spacing, size_classes
from splatgl.data.volume import empty_volume
from splatgl.planning.ray_overlap import ray_overlap
from splatgl.readers.points import SOLID
from splatgl.splat.splats import HALF_WIDTH
from tests.helpers.points import BYTES, COLORED, PLACES, write_las, write_pcd, write_ply

pytestmark = pytest.mark.usefixtures("shared_programs")

Said = pytest.CaptureFixture[str]


def points_of(path: Path, **options: Any) -> Points:
    points = sg.load(path, **options).points
    assert points is not None
    return points


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_in_float64_with_colours_of_both_depths(suffix: str, tmp_path: Path) -> None:
    for shift in (0, 8):
        path = write_las(tmp_path / f"{shift}{suffix}", BYTES.astype(np.uint16) << shift)
        points = points_of(path)
        assert np.array_equal(points.places, PLACES) and sg.load(path).unit == "m"
        assert np.allclose(points.colors, linear_from_srgb(BYTES / 255), atol=0.003)


def test_clouds_without_colours_show_values(tmp_path: Path, capsys: Said) -> None:
    bright = points_of(write_las(tmp_path / "i.las", None, [0, 500, 1000])).colors
    assert np.array_equal(bright, np.repeat(bright[:, :1], 3, axis=1)) and bright[0, 0] < bright[1, 0] < bright[2, 0]
    black = sg.load(write_las(tmp_path / "h.las", np.zeros((3, 3), np.uint16)))
    assert black.notes[0] == "without colours the points show their height: --array picks another"
    assert black.points is not None and black.points.colors[1, 2] > black.points.colors[2, 2]
    assert np.array_equal(points_of(tmp_path / "i.las", array="height").colors, black.points.colors)
    with pytest.raises(sg.InputError, match="array: expected one of classification, height, intensity, return_number"):
        sg.load(tmp_path / "i.las", array="x")


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply(form: str, tmp_path: Path) -> None:
    columns = [*PLACES.T, *BYTES.T]
    points = points_of(write_ply(tmp_path / "a.ply", form, COLORED, columns))
    assert np.array_equal(points.places, PLACES)
    assert np.allclose(points.colors, linear_from_srgb(BYTES / 255), atol=1e-6)
    if form == "ascii":
        camera = "element camera 1\nproperty float a\nproperty float b"
        assert np.array_equal(points_of(write_ply(tmp_path / "b.ply", form, COLORED, columns, camera)).places, PLACES)
        (tmp_path / "named-otherwise.txt").write_bytes((tmp_path / "a.ply").read_bytes())
        assert len(points_of(tmp_path / "named-otherwise.txt")) == 3
        faces = "element face 1\nproperty list uchar int vertex_indices"
        with pytest.raises(sg.InputError, match="PLY: expected points without faces"):
            sg.load(write_ply(tmp_path / "c.ply", form, COLORED, columns, faces))


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd(kind: str, tmp_path: Path) -> None:
    places = write_pcd(tmp_path / "a.pcd", kind)
    volume = sg.load(tmp_path / "a.pcd")
    assert (
        volume.points is not None
        and volume.notes[0] == "1 of 40 points have no position or are withheld, and are skipped"
    )
    assert np.array_equal(volume.points.places, np.delete(places, 3, axis=0))
    assert np.allclose(volume.points.colors, linear_from_srgb(BYTES[1] / 255), atol=1e-6)


def test_spacing_is_that_of_a_surface(rng: np.random.Generator) -> None:
    lattice = np.stack([*np.mgrid[:60, :60], np.zeros((60, 60))], axis=-1).reshape(-1, 3) * 0.5
    assert median_spacing(lattice) == pytest.approx(0.5, rel=0.15)
    random = np.concatenate([rng.random((4000, 2)) * 60, np.zeros((4000, 1))], axis=1) + 1e6
    assert median_spacing(random) == pytest.approx(60 / 4000**0.5, rel=0.1)
    # far outliers, several in one place, and a single one
    assert median_spacing(np.concatenate([random, [[1e9, 0, 0]]])) == pytest.approx(60 / 4000**0.5, rel=0.1)
    assert median_spacing(np.zeros((50, 3))) == 1.0 and median_spacing(np.ones((1, 3))) == 1.0


def test_sizes_of_their_own(tmp_path: Path, rng: np.random.Generator) -> None:
    names = {**dict.fromkeys("xyz", "double"), "radius": "float"}
    radius = rng.uniform(0.5, 2.0, 30).astype(np.float32)
    volume = sg.load(write_ply(tmp_path / "a.ply", "ascii", names, [*rng.random((3, 30)), radius]))
    sizes = [part.points.size for part in volume.channels if part.points is not None]
    right = [size for size, _ in size_classes(2.0 * radius.astype(np.float64))]
    assert (
        len(sizes) == 7 and np.allclose(sizes, right) and sum(len(part.points or ()) for part in volume.channels) == 30
    )
    for size, which in size_classes(2.0 * radius):
        assert np.abs(np.log(2.0 * radius[which] / size)).max() <= np.log(4) / 14 + 1e-3
    assert points_of(tmp_path / "a.ply", point_size=3.0).size == 3.0
    assert len(size_classes(np.full(5, 2.0))) == 1


def test_up_to_seven_sizes_are_drawn_as_they_are() -> None:
    sizes = np.array([2.0, 6.0, 2.0000001, 2.1, 6.0, 9.0])
    classes = {round(size, 4): which.tolist() for size, which in size_classes(sizes)}
    assert classes == {2.0: [0, 2], 2.1: [3], 6.0: [1, 4], 9.0: [5]}


def test_a_point_is_as_wide_as_its_size(renderer: sg.Renderer) -> None:
    """At half of full opacity; its opacity in all is a disc's."""
    size, where = 4.0, np.array([[10.0, -4.0, 7.0]])
    splats = sg.extract(volume := cloud(where, [1.0, 1.0, 1.0], size), sg.default_transfer(volume))
    camera = sg.Camera.orthographic(where[0] - [0, 20, 0], where[0], (0, 0, 1), 8.0, (64, 64))
    alpha = renderer.render(splats, camera).pixels[..., 3].astype(np.float64)
    pitch = 8.0 / 64
    assert (alpha[32] > 0.5).sum() * pitch == pytest.approx(size, abs=1.5 * pitch)
    assert alpha.sum() * pitch**2 == pytest.approx(np.pi * size**2 / 4, rel=0.1)


def cloud(places: np.ndarray, colors: Any, size: float) -> sg.Volume:
    """The volume of points, as the reader makes it."""
    points = Points(places, np.broadcast_to(np.asarray(colors, np.float32), places.shape), size)
    low, high = points.bounds
    return empty_volume(low, high, SOLID, points=points)


@pytest.mark.parametrize(("pixels", "antialias"), [(8.0, "auto"), (0.5, "auto"), (0.25, "paper"), (0.1, "paper")])
def test_a_point_sums_to_its_matter(pixels: float, antialias: str, renderer: sg.Renderer) -> None:
    """The optical depths of all pixels are σ·s³ over the area of one; before z_k, and beyond, where it is stretched."""
    size, where = 0.5, np.array([[10.3, -4.2, 7.7]])
    splats = sg.extract(volume := cloud(where, [0.2, 0.5, 1.0], size), sg.default_transfer(volume))
    assert len(splats) == 1
    camera = sg.Camera.orthographic(where[0] - [0, 20, 0], where[0], (0, 0, 1), size / pixels * 32, (32, 32))
    image = renderer.render(splats, camera, sg.Settings(blend="xray", antialias=antialias, align="exact"))
    total = image.pixels.sum(axis=(0, 1), dtype=np.float64)
    right = -np.log(1 - SOLID) * (size / HALF_WIDTH) ** 2 * (pixels / size) ** 2
    assert total[3] == pytest.approx(right, rel=0.01)
    assert total[:3] == pytest.approx(np.array([0.2, 0.5, 1.0]) * right, rel=0.01)


def test_pictures_are_those_of_float64(renderer: sg.Renderer, rng: np.random.Generator) -> None:
    """A thousand points of one size, and of two, at places far from the origin."""
    places, colors = rng.normal(size=(1000, 3)) * 3 + [5e5, 4e6, 100], rng.random((1000, 3))
    volume = cloud(places, colors, 0.4)
    settings = sg.Settings(background=(1.0, 1.0, 1.0))
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(splats, 30, 20, 40, (16, 16))
    right = sg.reference.render(splats, camera, settings)
    image = renderer.render(splats, camera, settings)
    assert np.abs(image.pixels - right.pixels).max() < 1e-3
    scene = sg.Scene([sg.Layer(volume), sg.Layer(cloud(places[:300] + 0.2, colors[:300], 0.9))])
    right = sg.reference.render(scene, camera, settings)
    assert np.abs(renderer.render(scene, camera, settings).pixels - right.pixels).max() < 1e-3
    # nearer points hide others, whatever their order in the file
    near = np.array([[0.0, -1, 0], [0, 1, 0]])
    for order in ([0, 1], [1, 0]):
        pair = cloud(near[order], np.eye(3)[order], 1.0)
        front = sg.Camera.look_at((0, -8, 0), (0, 0, 0), (0, 0, 1), 20, (9, 9))
        middle = renderer.render(sg.extract(pair, sg.default_transfer(pair)), front).pixels[4, 4]
        assert middle[0] > 0.5 > 4 * middle[1]


@pytest.mark.parametrize("part", [2**20, 1000])
def test_the_bound_counts_the_points_of_a_surface(
    part: int, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not those of the blocks around it: no more than three times as many as a ray meets, in one part or several."""
    monkeypatch.setattr("splatgl.planning.ray_overlap.PART", part)
    places = rng.normal(size=(10_000, 3))
    places *= 10 / np.linalg.norm(places, axis=1)[:, None]
    volume = cloud(places, 0.5, 0.3 * HALF_WIDTH)
    splats = sg.extract(volume, sg.default_transfer(volume))
    camera = sg.Camera.orbit(splats, 30, 20, 40, (256, 256))
    met = ray_overlap(splats, view := sg.plan(splats, camera, sg.Settings()).view)
    # distances of all points from 16 × 16 rays
    eye = (places - camera.eye) @ camera.eye_from_world.T
    at = (np.indices((16, 16)).reshape(2, -1).T[:, ::-1] + 0.5 - 8) * camera.extent / 16
    rays = np.concatenate([at, np.ones((256, 1))], axis=1)
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    far = np.sqrt((eye**2).sum(axis=1)[None] - (rays @ eye.T) ** 2)
    most = int((far < view.kernel.radius * 0.3).sum(axis=1).max())
    assert most <= met.count <= 3 * most


def test_commands(tmp_path: Path, capsys: Said, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_ply(Path("a.ply"), "ascii", COLORED, [*PLACES.T, *BYTES.T])
    assert main(["info", "a.ply", "--point-size", "2"]) == 0
    said = capsys.readouterr()
    assert said.err == "splatgl: 3 points of 2\n"
    assert "points     3" in said.out and "to         500007.25, 4000003.5, 4.5" in said.out
    assert main(["render", "a.ply", "-o", "a.png", "--size", "16", "--point-size", "2"]) == 0
    assert "3 splats on white\ntransfer function: opacity 0.99 of a surface of points" in capsys.readouterr().out
    # whose volume is empty: nothing is said of it as if it were the points
    for command in (["pick", "a.ply", "8,8", "--size", "16"], ["render", "a.ply", "-o", "b.png", "--depth", "d.npy"]):
        assert main(command) == 2 and "a volume of voxels, got 3 points" in capsys.readouterr().err
    assert main(["render", "a.ply", "-o", "b.png", "--crop", "0:1,0:1,0:1"]) == 2
    assert "crop: expected voxels along x, y and z, got 3 points" in capsys.readouterr().err
    assert main(["convert", "a.ply", "a.nii"]) == 2 and "expected voxels, got 3 points" in capsys.readouterr().err


def test_damaged_files_are_told_in_a_line(tmp_path: Path, rng: np.random.Generator) -> None:
    files = [
        write_las(tmp_path / "a.las", BYTES.astype(np.uint16)),
        write_las(tmp_path / "a.laz", BYTES.astype(np.uint16)),
        write_ply(tmp_path / "a.ply", "binary_little_endian", COLORED, [*PLACES.T, *BYTES.T]),
    ]
    for path in files:
        whole = path.read_bytes()
        for cut in (5, len(whole) // 2, len(whole) - 1):
            (damaged := tmp_path / f"cut{path.suffix}").write_bytes(whole[:cut])
            if path.suffix == ".laz" and cut == len(whole) - 1:
                continue
            with pytest.raises(sg.InputError) as error:
                sg.load(damaged)
            assert "\n" not in str(error.value)
    # more records than fit, which the library would allocate
    whole = files[0].read_bytes()
    (tmp_path / "b.las").write_bytes(whole[:100] + b"\xff\xff\xff\x7f" + whole[104:])
    with pytest.raises(sg.InputError, match="records of variable length"):
        sg.load(tmp_path / "b.las")
    # chunks that are longer than the file, which the decoder would allocate
    packed = files[1].read_bytes()
    table = int.from_bytes(packed[(start := int.from_bytes(packed[96:100], "little")) : start + 8], "little")
    for changed in (packed[: table + 4] + b"\xff\xff\xff\x7f" + packed[table + 8 :], packed[: table + 8] + b"\xff" * 4):
        (tmp_path / "b.laz").write_bytes(changed)
        with pytest.raises(sg.InputError, match=r"may be damaged|is damaged|cut short"):
            sg.load(tmp_path / "b.laz")
    # a chunk of a billion points, for which the decoder would end the process
    record = packed.index(b"laszip encoded") - 2 + 54
    (tmp_path / "b.laz").write_bytes(packed[: record + 12] + b"9999" + packed[record + 16 :])
    with pytest.raises(sg.InputError, match="may be damaged"):
        sg.load(tmp_path / "b.laz")
    # items without bytes, by which the decoder would divide and print a trace
    item = record + 36
    (tmp_path / "b.laz").write_bytes(packed[:item] + bytes(2) + packed[item + 2 :])
    with pytest.raises(sg.InputError, match="may be damaged"):
        sg.load(tmp_path / "b.laz")
    assert median_spacing(np.array([[0, 0, 0], [0, 0, 5e-320]])) == 1.0
    write_pcd(tmp_path / "a.pcd", "binary_compressed")
    head, mark, data = (tmp_path / "a.pcd").read_bytes().partition(b"binary_compressed\n")
    # a copy of bytes before the first, behind both sizes
    (tmp_path / "b.pcd").write_bytes(head + mark + data[:8] + bytes([224, 0, 255]) + data[11:])
    with pytest.raises(sg.InputError, match="cannot be read as points"):
        sg.load(tmp_path / "b.pcd")


def test_withheld_points_are_left_out(tmp_path: Path) -> None:
    """LAS keeps points that were deleted, with a mark."""
    laspy = pytest.importorskip("laspy")
    cloud = laspy.LasData(laspy.LasHeader(point_format=7, version="1.4"))
    cloud.x, cloud.y, cloud.z = np.mgrid[:3, :4, :5].reshape(3, -1)
    cloud.withheld = np.arange(60) % 4 == 0
    cloud.write(tmp_path / "a.las")
    volume = sg.load(tmp_path / "a.las")
    assert volume.points is not None and len(volume.points.places) == 45
    assert "15 of 60 points have no position or are withheld" in volume.notes[0]

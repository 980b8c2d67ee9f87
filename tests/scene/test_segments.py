"""Surfaces of segments: closed forms of balls and boxes, borders, grids, pictures, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl import reference
from splatgl.cli.main import main
from splatgl.data.color import linear_from_srgb
from splatgl.data.volume import Label
from splatgl.fileio import within
from splatgl.scene.scene_file import SceneFile

pytestmark = pytest.mark.usefixtures("shared_programs")

MIDDLE = np.array([11.7, 11.4, 11.9])
TABLE = (Label(1, "liver", "#c04020"), Label(2, "tumour", "#20c040", 0.5), Label(9, "vein", hidden=True))
PLAIN = sg.Settings(antialias="off", occlusion="off")


def ball(radius: float = 9.0, size: int = 24, middle: np.ndarray = MIDDLE) -> np.ndarray:
    z, y, x = np.indices((size,) * 3)
    return (np.linalg.norm([x - middle[0], y - middle[1], z - middle[2]], axis=0) <= radius).astype(np.uint8)


def halves() -> np.ndarray:
    """A ball whose one half is 2."""
    found = ball()
    found[:, :, 12:] *= 2
    return found


def of(samples: np.ndarray, **grid: Any) -> sg.Volume:
    return sg.Volume(samples, **{"labels": (), "name": "seg", **grid})


def volume_in(mesh: sg.Mesh) -> float:
    a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum() / 6)


def is_closed(mesh: sg.Mesh) -> bool:
    """Whether each edge is passed as often one way as the other."""
    there = np.concatenate([mesh.faces[:, [n, (n + 1) % 3]] for n in range(3)])
    forth, back = (np.sort(a * len(mesh.vertices) + b) for a, b in (there.T, there[:, ::-1].T))
    return len(mesh) > 0 and np.array_equal(forth, back)


def rms(distances: np.ndarray) -> float:
    return float(np.sqrt((distances**2).mean()))


def test_a_ball_keeps_its_volume_and_is_round() -> None:
    samples = ball()
    (mesh,) = sg.surfaces(of(samples))
    assert is_closed(mesh)
    assert volume_in(mesh) == pytest.approx(samples.sum(), rel=2e-3)
    assert volume_in(mesh) == pytest.approx(4 / 3 * np.pi * 9**3, rel=0.01)
    off = np.linalg.norm(mesh.vertices - MIDDLE, axis=1) - 9
    (faces,) = sg.surfaces(of(samples), smoothing=0)
    before = np.linalg.norm(faces.vertices - MIDDLE, axis=1) - 9
    assert rms(off) < 0.12 and np.abs(off).max() < 0.5 and rms(before) > 0.4


def test_a_box_keeps_its_faces() -> None:
    """Edges alone are rounded, by a third of a voxel, and corners."""
    samples = np.zeros((24, 24, 24), np.uint8)
    samples[4:20, 4:20, 4:20] = 1
    (mesh,) = sg.surfaces(of(samples))
    from_faces = (np.abs(mesh.vertices - 11.5) - 8).max(axis=1)
    assert volume_in(mesh) == pytest.approx(16**3, rel=2e-3)
    assert rms(from_faces) < 0.14 and np.abs(from_faces).max() < 0.4
    (sharp,) = sg.surfaces(of(samples), smoothing=0)
    assert np.array_equal((np.abs(sharp.vertices - 11.5) - 8).max(axis=1), np.zeros(len(sharp.vertices)))


@pytest.mark.parametrize("strength", [0.1, 0.5, 1.0])
def test_what_is_thin_stays(strength: float) -> None:
    """One voxel, a rod of one voxel's width on a block, and a segment at the ends of the grid."""
    samples = np.zeros((12, 12, 30), np.uint8)
    samples[5, 5, 3] = 1
    samples[2:10, 2:10, 8:16], samples[6, 6, 16:28] = 2, 2
    voxel, rod = sg.surfaces(of(samples), smoothing=strength)
    assert volume_in(voxel) == pytest.approx(1, abs=0.03) and is_closed(voxel)
    across = rod.vertices[np.abs(rod.vertices[:, 0] - 22) < 3][:, 1:] - 6
    assert np.abs(across).mean() == pytest.approx(0.5, abs=0.05)
    whole = np.ones((3, 4, 5), np.uint8)
    (mesh,) = sg.surfaces(of(whole), smoothing=strength)
    assert is_closed(mesh) and volume_in(mesh) == pytest.approx(60, rel=0.02)


def test_borders_are_shared() -> None:
    samples = halves()
    first, second = sg.surfaces(of(samples))
    assert is_closed(first) and is_closed(second)
    triangles = [{each.tobytes() for each in np.sort(m.vertices[m.faces], axis=1)} for m in (first, second)]
    (whole,) = sg.surfaces(of(np.minimum(samples, 1)))
    border = triangles[0] & triangles[1]
    assert len(border) + len(whole) == len(first) + len(second) - len(border)
    assert volume_in(first) + volume_in(second) == pytest.approx(samples.astype(bool).sum(), rel=2e-3)
    for mesh, number in ((first, 1), (second, 2)):
        assert volume_in(mesh) == pytest.approx((samples == number).sum(), rel=3e-3)
    off = [np.linalg.norm(m.vertices - MIDDLE, axis=1) - 9 for m in (first, second)]
    outer = [each[np.abs(m.vertices[:, 0] - 11.5) > 1] for each, m in zip(off, (first, second), strict=True)]
    assert max(rms(each[each > -1]) for each in outer) < 0.14


def test_lines_between_three_segments_are_smooth() -> None:
    """Where an oblique plane halves a ball: a third of a voxel off it, if the surfaces beside drew the line about."""
    _, y, x = np.indices((24, 24, 24))
    samples = ball() * np.where(x + 0.4 * y > 16.3, 2, 1).astype(np.uint8)
    first, second = sg.surfaces(of(samples))
    there = {each.tobytes() for each in first.vertices}
    both = np.array([each for each in second.vertices if each.tobytes() in there])
    line = both[np.linalg.norm(both - MIDDLE, axis=1) > 8.2]
    assert len(line) > 60 and rms((line @ [1, 0.4, 0] - 16.3) / np.hypot(1, 0.4)) < 0.2


def test_a_picture_has_each_border_once() -> None:
    """In the more opaque segment, or that of the lower number."""
    volume = of(halves(), labels=TABLE)
    closed, open_ = (sg.surfaces(volume, closed=each) for each in (True, False))
    assert len(open_[0]) == len(closed[0]) and is_closed(open_[0])
    (whole,) = sg.surfaces(of(np.minimum(volume.samples, 1)))
    assert len(open_[1]) + len(open_[0]) - (len(closed[1]) - len(open_[1])) == len(whole)


@pytest.mark.parametrize(
    ("spacing", "direction"),
    [
        ((1, 2, 5), np.eye(3)),
        ((1, 1, 3), [[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
        ((2, 1, 1), [[1, 0.3, 0], [0, 0.9, 0.2], [0, 0, -1]]),
    ],
)
def test_grids_of_any_kind(spacing: Any, direction: Any) -> None:
    """Surfaces are those of the unit grid, placed as its voxels are; faces look outward in mirrored ones too."""
    plain = sg.surfaces(of(halves()))
    volume = of(halves(), spacing=spacing, direction=direction, origin=(5, 6, 7))
    for mesh, unit in zip(sg.surfaces(volume), plain, strict=True):
        assert np.allclose(mesh.vertices, unit.vertices @ volume.world_from_index.T + volume.origin)
        assert volume_in(mesh) == pytest.approx(volume_in(unit) * abs(np.linalg.det(volume.world_from_index)), rel=5e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.int16, np.float32, np.uint64])
def test_names_colours_and_opacities(dtype: Any) -> None:
    samples = halves().astype(dtype)
    samples[2, 2, 2] = 9
    if dtype is np.float32:
        samples[0, 0, 0] = np.nan
    table, high = TABLE, 1
    if dtype is np.uint64:
        # beyond what signed numbers hold, which come last all the same
        samples[samples == 2], high = 2**63 + 5, 2**63 + 5
        table = (TABLE[0], Label(high, "tumour", "#20c040", 0.5), TABLE[2])
    volume = of(samples, labels=table)
    first, second = sg.surfaces(volume)
    assert [(each.name, each.opacity) for each in (first, second)] == [("liver", 1.0), ("tumour", pytest.approx(0.5))]
    for mesh, color in ((first, 0xC04020), (second, 0x20C040)):
        srgb = [(color >> shift & 255) / 255 for shift in (16, 8, 0)]
        assert np.allclose(mesh.color, linear_from_srgb(np.array(srgb)))
    assert volume_in(first) == pytest.approx((samples == 1).sum(), rel=3e-3)
    assert sg.surfaces(of(np.zeros((3, 3, 3), np.uint8), labels=table)) == ()


def test_masks_cut_segments() -> None:
    volume = of(halves())
    (mesh,) = sg.surfaces(volume.masked(volume.samples == 2))
    assert is_closed(mesh) and volume_in(mesh) == pytest.approx((volume.samples == 2).sum(), rel=3e-3)


@pytest.mark.long
def test_pictures_are_the_reference(renderer: sg.Renderer) -> None:
    """Two segments, one of them clear, in fog that a plane cuts with them; the view is that of boxes."""
    fog = sg.Volume(np.ones((24, 24, 24), np.float32))
    look = sg.Transfer([(0.0, 0.02)], colormap="gray", window=(0, 2), unit=1.0)
    volume = of(halves(), labels=TABLE)
    scene = sg.Scene([sg.Layer(fog, look), sg.Layer(volume, surfaces=0.5)], clip="y>0.3")
    camera = sg.Camera.orbit(scene, 30, 20, size=(40, 36))
    found, right = renderer.render(scene, camera, PLAIN), reference.render(scene, camera, PLAIN).pixels
    off = np.abs(found.pixels - right).max(axis=2)
    assert (off > 2e-3).mean() < 0.01 and np.median(off) < 2e-5
    boxes = sg.Scene([sg.Layer(fog, look), sg.Layer(volume)], clip="y>0.3")
    other = renderer.render(boxes, camera, PLAIN).pixels
    assert (np.abs(found.pixels - other).max(axis=2) > 0.03).mean() > 0.05
    assert found.info["notes"] == scene.notes and "seg: 2 segments drawn as smoothed surfaces (0.5)" in scene.notes[0]
    assert np.concatenate([each.vertices for each in scene.meshes])[:, 1].min() > 0.3 * 24 - 0.51
    assert np.allclose(sg.Camera.orbit(boxes, 30, 20).eye, sg.Camera.orbit(scene, 30, 20).eye, atol=0.3)
    picked = sg.pick(scene, camera, (20, 18))
    assert picked is not None and picked.name in ("liver", "tumour")


def test_one_call_and_masks_of_two_values() -> None:
    info = sg.render(ball(), surfaces=True, size=(24, 24)).info
    assert isinstance(info["triangles"], int) and info["triangles"] > 1000 and info["splats"] == 0
    assert "1 segment drawn as smoothed surfaces (0.5)" in str(info["notes"])


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    np.save("seg.npy", halves())
    np.save("none.npy", np.zeros((5, 5, 5), np.uint8))
    np.save("gray.npy", np.indices((24, 24, 24)).sum(axis=0).astype(np.int16))
    return tmp_path


@pytest.mark.parametrize(
    ("command", "told"),
    [
        (
            "render gray.npy --surfaces",
            "surfaces: expected a segmentation among the volumes, got amounts",
        ),
        ("render none.npy --values labels --surfaces", "none.npy: expected layers with an opacity, got none"),
        ("render seg.npy --surfaces 2", "surfaces: expected a strength of smoothing from 0 to 1, got 2.0"),
        ("render seg.npy --surfaces --blend xray", "meshes: expected blend composite, got xray"),
        ("render seg.npy --surfaces --workers 2", "--surfaces: expected none, with --workers or --scheduler"),
        ("view gray.npy --surfaces", "surfaces: expected a segmentation among the volumes, got amounts"),
        ("pyramid scene.toml -o out.zarr", "surfaces: expected none, got 0.5; splatgl render draws them"),
        ("presets scene.toml -o out.png", "surfaces: expected none, got 0.5; splatgl render draws them"),
        ("report scene.toml", "surfaces: expected none, got 0.5; splatgl render draws them"),
        ("report amounts.toml", "layers: expected none, got 1; splatgl render draws them"),
        ("render many.toml", "[[layer]] 1: surfaces: expected a strength of smoothing from 0 to 1, got -1"),
        ("render amounts.toml", "surfaces of gray: expected a segmentation, got amounts"),
    ],
)
def test_refused(command: str, told: str, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("scene.toml").write_text('volume = "seg.npy"\nsurfaces = 0.5\n')
    Path("many.toml").write_text('volume = "gray.npy"\n[[layer]]\nvolume = "seg.npy"\nsurfaces = -1\n')
    Path("amounts.toml").write_text('volume = "seg.npy"\n[[layer]]\nvolume = "gray.npy"\nsurfaces = 1\n')
    output = ["-o", "out.png", "--size", "16"] if command.startswith("render") else []
    assert main([*command.split(), *output]) == 2
    assert told in capsys.readouterr().err.splitlines()[-1] and not Path("out.png").exists()


@pytest.mark.compute
def test_commands(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Over a volume, picked, in frames, and from a scene file."""
    look = ["--points", "0:0,70:0.01", "--labels", "seg.npy", "--surfaces", "--size", "24"]
    assert main(["render", "gray.npy", *look, "-o", "out.png"]) == 0
    out, err = capsys.readouterr()
    assert "splats and" in out and err.count("drawn as smoothed surfaces (0.5)") == 1
    assert main(["pick", "gray.npy", "12,12", *look, "--quiet"]) == 0
    assert "mesh: " in capsys.readouterr().out
    scene = SceneFile("seg.npy", load={"values": "labels"}, surfaces=0.25, layers=(SceneFile("seg.npy", surfaces=1.0),))
    Path("scene.toml").write_text(scene.to_toml(files))
    found = SceneFile.from_toml(Path("scene.toml"))
    assert found.surfaces == 0.25 and found.layers[0].surfaces == 1.0
    assert main(["animate", "scene.toml", "--frames", "2", "--size", "16", "-o", "f{frame}.png", "--quiet"]) == 0
    assert Path("f1.png").exists() and capsys.readouterr().err == ""


def test_memory_that_is_too_small_is_told() -> None:
    with within(1000), pytest.raises(sg.InputError, match="surfaces of seg: expected a segmentation that needs up to"):
        sg.surfaces(of(halves()))

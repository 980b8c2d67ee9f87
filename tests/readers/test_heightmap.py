"""Height maps: which way up, how high, which colour, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from splatgl.errors import InputError
from splatgl.readers import load
from splatgl.readers.heightmap import terrain_from_heights

ROWS = np.array([[0, 50, 100], [200, 150, 250]], np.uint8)
"""Heights in picture order: row 0 is the northern edge. The span is 250."""


def tops(samples: np.ndarray) -> np.ndarray:
    """Solid voxels in each column [H, W]; fails if a column has a gap."""
    solid = samples == 255
    assert set(np.unique(samples)) <= {0, 255}
    assert (np.diff(solid.astype(int), axis=0) <= 0).all()
    return solid.sum(axis=0)


@pytest.mark.parametrize("kind", ["png8", "png16", "rgb", "tif", "float tif"])
def test_picture_row_0_is_the_northern_edge(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("map.tif" if "tif" in kind else "map.png")
    if "tif" in kind:
        pytest.importorskip("tifffile").imwrite(path, ROWS.astype(np.float32) if "float" in kind else ROWS)
    else:
        grey = ROWS.astype(np.uint16) * 200 if kind == "png16" else ROWS
        Image.fromarray(np.stack([grey] * 3, axis=-1) if kind == "rgb" else grey).save(path)
    volume = load(path, levels=11, relief=5.0)
    assert volume.shape == (11, 2, 3) and volume.samples.dtype == np.uint8
    assert volume.spacing == (1, 1, 0.5) and volume.name == "map"
    # levels 0 … 10 over heights 0 … 250: a column of height h is round(h / 25) + 1 voxels high
    np.testing.assert_array_equal(tops(volume.samples), [[9, 7, 11], [1, 3, 5]])
    assert volume.hints.shading is True and volume.hints.points is not None


def test_csv_row_0_is_the_southern_edge(tmp_path: Path) -> None:
    (tmp_path / "dem.csv").write_text("0,0.5,1\n2,1.5,nan\n")
    np.testing.assert_array_equal(tops(load(tmp_path / "dem.csv", levels=5).samples), [[1, 2, 3], [5, 4, 0]])


def test_colour_follows_the_heights_and_takes_no_memory(tmp_path: Path) -> None:
    Image.fromarray(ROWS).save(tmp_path / "map.png")
    colors = np.repeat(np.repeat(np.arange(18, dtype=np.uint8).reshape(2, 3, 3), 4, axis=0), 4, axis=1)
    Image.fromarray(colors).save(tmp_path / "photo.png")
    color = load(tmp_path / "map.png", color=tmp_path / "photo.png").color
    assert color is not None and color.shape == (103, 2, 3, 3) and color.strides[0] == 0
    np.testing.assert_array_equal(color[50], np.arange(18).reshape(2, 3, 3)[::-1])


def test_tint_without_a_colour_picture_depends_on_height() -> None:
    color = terrain_from_heights(np.array([[0.0, 1.0], [1.0, np.nan]])).color
    assert color is not None
    assert (color[0, 0, 0] != color[0, 0, 1]).any() and (color[0, 0, 1] == color[0, 1, 0]).all()


def test_paper_terrain_has_cubic_voxels() -> None:
    volume = terrain_from_heights(np.arange(512 * 512).reshape(512, 512))
    assert volume.shape == (103, 512, 512) and volume.spacing == (1, 1, 1)


def test_flat_terrain_is_one_level() -> None:
    np.testing.assert_array_equal(tops(terrain_from_heights(np.full((2, 3), 7.0)).samples), np.ones((2, 3)))


def test_refused(tmp_path: Path) -> None:
    Image.fromarray(ROWS).save(tmp_path / "map.png")
    Image.fromarray(np.stack([ROWS, ROWS, ROWS // 2], axis=-1)).save(tmp_path / "photo.png")
    with pytest.raises(InputError, match="a grey picture"):
        load(tmp_path / "photo.png")
    with pytest.raises(InputError, match="nothing named"):
        load(tmp_path / "map.png", color=tmp_path / "none.png")
    with pytest.raises(InputError, match="relief"):
        load(tmp_path / "map.png", relief=0.0)
    with pytest.raises(InputError, match="fewer levels"):
        load(tmp_path / "map.png", levels=10**9)
    with pytest.raises(InputError, match="at least one finite number"):
        terrain_from_heights(np.full((2, 2), np.nan))
    with pytest.raises(InputError, match="a 2-D map"):
        terrain_from_heights(np.zeros(4))

"""Real files: dimensions, spacing and range as their catalogue states them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from splatgl.readers import load
from splatgl.readers.common import is_mapped

DATA = Path(os.environ.get("SPLATGL_DATA", Path(__file__).parents[3] / "shared" / "data"))

ISABEL = (4.0080321286, 4.0080321286, 4.0408163266)
FILES = [
    # name, (x, y, z), spacing, type, lowest, highest, mapped
    ("neuron_a_409x415x119.tif", (409, 415, 119), (1, 1, 1), "u1", 0, 255, False),
    ("stent_ct_128x128x256.nrrd", (128, 128, 256), (1, 1, 1), "f4", 0, 1, False),
    ("head_mri_160x232x160.nii.gz", (160, 232, 160), (1, 0.898437, 0.898437), "f4", 0, 512, False),
    ("lung_ct_115x157x129.mha", (115, 157, 129), (1.366, 1.366, 2.5), "i2", -1255, 1474, False),
    ("HeadMRVolume.mhd", (48, 62, 42), (4, 4, 4), "u1", 0, 255, True),
    ("visible_male_128x256x256_uint8.raw", (128, 256, 256), (1, 1, 1), "u1", 1, 254, True),
    ("tooth.nhdr", (103, 94, 161), (1, 1, 1), "u2", 0, 1300, True),
    ("carotid_76x49x45_scalar_and_velocity.vtk", (76, 49, 45), (1, 1, 1), "f4", 0, 580, True),
    *[(f"isabel/isabel_windspeed_t{t}.nrrd", (125, 125, 25), ISABEL, "f4", 0, None, False) for t in ("02", "30", "48")],
    ("terrain_asama/dem.csv", (256, 256, 103), (1, 1, 0.5), "u1", 0, 255, False),
    ("terrain_asama/height_u16_256.png", (256, 256, 103), (1, 1, 0.5), "u1", 0, 255, False),
    ("terrain_puget/height_u8_512.png", (512, 512, 103), (1, 1, 1), "u1", 0, 255, False),
]


def data_file(name: str) -> Path:
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"real data not there: {path}")
    return path


@pytest.mark.parametrize("case", FILES, ids=lambda case: case[0])
def test_catalogue(case: tuple) -> None:
    name, sizes, spacing, code, low, high, mapped = case
    volume = load(data_file(name))
    assert volume.shape == sizes[::-1]
    assert volume.samples.dtype.newbyteorder("=") == np.dtype(code)
    assert is_mapped(volume.samples) == mapped
    np.testing.assert_allclose(volume.spacing, spacing, rtol=1e-6)
    assert volume.samples.min() == low
    assert volume.samples.max() == high if high is not None else 50 < volume.samples.max() < 78.7


def test_frames_units_and_origins() -> None:
    head, lung = load(data_file("head_mri_160x232x160.nii.gz")), load(data_file("lung_ct_115x157x129.mha"))
    assert (head.frame, head.unit, lung.frame) == ("RAS", "mm", "LPS")
    np.testing.assert_allclose(lung.origin, (-153.827, -150.352, -1434.5))
    np.testing.assert_allclose(head.origin, (-388.26, -81.12, 405.421), rtol=1e-6)
    assert load(data_file("stent_ct_128x128x256.nrrd")).frame is None
    assert load(data_file("carotid_76x49x45_scalar_and_velocity.vtk")).origin == (100, 80, 1)


def test_velocity() -> None:
    path = data_file("carotid_76x49x45_scalar_and_velocity.vtk")
    volume, speed = load(path), load(path, array="speed")
    assert volume.vectors is not None and volume.vectors.shape == (45, 49, 76, 3)
    assert speed.samples.min() == 0 and abs(speed.samples.max() - 22.7) < 0.05


def test_table_and_picture_of_the_same_terrain_agree() -> None:
    """The picture is the table flipped top to bottom: both must stand the same way up."""
    table = load(data_file("terrain_asama/dem.csv"))
    picture = load(data_file("terrain_asama/height_u16_256.png"), color=data_file("terrain_asama/satellite_2048.jpg"))
    assert np.mean(table.samples != picture.samples) < 1e-4
    assert np.mean(table.samples != picture.samples[:, ::-1]) > 0.01
    assert picture.color is not None and picture.color.shape == (103, 256, 256, 3)

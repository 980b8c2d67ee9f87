"""BigDataViewer's XML and HDF5, written by h5py after the documented layout."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from splatgl.errors import InputError, MissingOption
from splatgl.readers import hdf5_files, list_volumes, load
from tests.helpers.microscope_files import NAMES

pytestmark = pytest.mark.usefixtures("sound_files")

h5py = pytest.importorskip("h5py")

# angle, time, channel, z, y, x; numbers above those of int16, as which the format stores them
VIEWS = np.random.default_rng(6).integers(0, 2**16, (2, 2, 2, 8, 12, 16)).astype(np.uint16)
SPACING = (0.5, 0.5, 2.0)
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def write(path: Path, registered: Sequence[float] = SPACING, loader: str = "bdv.hdf5", times: str = "range") -> Path:
    """Two angles, the second one turned about z, of two channels at two times, with two levels."""
    setups, registrations = "", ""
    with h5py.File(path.with_suffix(".h5"), "w") as file:
        for angle, channel in np.ndindex(2, 2):
            number = 2 * angle + channel
            file[f"s{number:02}/resolutions"] = np.array([[1.0, 1, 1], [2, 2, 1]])
            file[f"s{number:02}/subdivisions"] = np.array([[16, 16, 16]] * 2, np.int32)
            setups += (
                f"<ViewSetup><id>{number}</id><name>setup {number}</name><size>16 12 8</size><voxelSize>"
                f"<unit>micrometer</unit><size>{' '.join(map(str, SPACING))}</size></voxelSize><attributes>"
                f"<channel>{channel}</channel><angle>{angle}</angle></attributes></ViewSetup>"
            )
            for time in range(2):
                samples = VIEWS[angle, time, channel]
                for level, data in enumerate((samples, samples[:, ::2, ::2])):
                    name = f"t{time:05}/s{number:02}/{level}/cells"
                    file.create_dataset(name, data=data.view(np.int16), chunks=(8, 6, 8), compression="gzip")
                scaled = np.diag([*registered, 1.0])
                turned = np.eye(4)
                turned[:3, :3], turned[:3, 3] = (TURN if angle else np.eye(3)), (10 * angle, 0, 0)
                registrations += f'<ViewRegistration timepoint="{time}" setup="{number}">'
                for each in (turned, scaled):
                    numbers = " ".join(map(str, each[:3].ravel()))
                    registrations += f'<ViewTransform type="affine"><affine>{numbers}</affine></ViewTransform>'
                registrations += "</ViewRegistration>"
    named = "".join(f"<Channel><id>{n}</id><name>{name}</name></Channel>" for n, name in enumerate(NAMES))
    points = {"range": "<first>0</first><last>1</last>", "pattern": "<integerpattern>0-1</integerpattern>"}[times]
    path.write_text(
        f'<?xml version="1.0"?><SpimData version="0.2"><BasePath type="relative">.</BasePath><SequenceDescription>'
        f'<ImageLoader format="{loader}"><hdf5 type="relative">{path.stem}.h5</hdf5></ImageLoader><ViewSetups>{setups}'
        f'<Attributes name="channel">{named}</Attributes></ViewSetups><Timepoints type="{times}">{points}</Timepoints>'
        f"</SequenceDescription><ViewRegistrations>{registrations}</ViewRegistrations></SpimData>"
    )
    return path


@pytest.mark.parametrize("times", ["range", "pattern"])
def test_views(tmp_path: Path, times: str) -> None:
    path = write(tmp_path / "a.xml", times=times)
    assert list_volumes(path) == ["* 1   angle 0 16×12×8×2×2", "  2   angle 1 16×12×8×2×2"]
    with pytest.raises(MissingOption, match="got 2 channels"):
        load(path)
    for angle, time, channel in np.ndindex(2, 2, 2):
        volume = load(path, series=angle + 1, time=time, channel=NAMES[channel])
        np.testing.assert_array_equal(volume.samples, VIEWS[angle, time, channel])
        assert (volume.unit, volume.times, len(volume.coarser)) == ("um", 2, 1)
        np.testing.assert_allclose(volume.spacing, SPACING)
        # the box of a level is that of the finest
        coarse = volume.coarser[0]
        np.testing.assert_array_equal(coarse.samples, VIEWS[angle, time, channel][:, ::2, ::2])
        np.testing.assert_allclose(coarse.corners, volume.corners)
    np.testing.assert_allclose(volume.direction, TURN, atol=1e-12)
    np.testing.assert_allclose(volume.origin, (10, 0, 0))
    assert load(path, channel=0, level=1).shape == (8, 6, 8)


@pytest.mark.parametrize(
    ("registered", "spacing"),
    [((1, 1, 4), SPACING), ((1, 1, 1), SPACING), ((0.5, 0.5, 3), (0.5, 0.5, 3))],
    ids=["in widths of a voxel", "none", "of its own"],
)
def test_registrations(tmp_path: Path, registered: Sequence[float], spacing: Sequence[float]) -> None:
    volume = load(write(tmp_path / "a.xml", registered), channel=0)
    np.testing.assert_allclose(volume.spacing, spacing)
    assert volume.unit == ("um" if tuple(spacing) == SPACING else "")


def test_large_views_are_read_in_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.xml")
    monkeypatch.setattr(hdf5_files, "WHOLE_BYTES", 100)
    samples: Any = load(path, channel=1, time=1).samples
    assert not isinstance(samples, np.ndarray) and samples.dtype == np.uint16
    np.testing.assert_array_equal(samples[2:7, 3, ::2], VIEWS[0, 1, 1, 2:7, 3, ::2])


def test_what_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.xml", loader="bdv.n5")
    with pytest.raises(InputError, match=r"ImageLoader: expected bdv\.hdf5, got 'bdv\.n5'; save it again"):
        load(path, channel=0)
    (tmp_path / "b.xml").write_text("<a/>")
    with pytest.raises(InputError, match=r"b\.xml: XML: expected an element SpimData, got 'a'"):
        load(tmp_path / "b.xml")
    text = write(tmp_path / "c.xml").read_text()
    (tmp_path / "c.xml").write_text(text.replace(">c.h5<", ">../c.h5<"))
    with pytest.raises(InputError, match="--anywhere"):
        load(tmp_path / "c.xml", channel=0)
    (tmp_path / "c.xml").write_text(text.replace("<last>1</last>", "<last>2</last>"))
    with pytest.raises(InputError, match="t00002/s00/0/cells: expected whole numbers"):
        load(tmp_path / "c.xml", channel=0, time=2)

"""Segments that overlap lie in layers of a file, whose numbers may repeat: each is drawn in its own colour."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from splatgl.scene.scene_file import SceneFile
from splatgl.transfer.colormaps import select_labels
from splatgl.viewer.document import Document
from splatgl.viewer.saving import render_scene, scene_of
from splatgl.viewer.segments import list_segments
from splatgl.viewer.state import State

pytestmark = pytest.mark.usefixtures("shared_programs")

COLORS = {"Lung": "0.2 0.4 1", "Rib": "1 0.9 0.2", "Nodule": "1 0.1 0.1"}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Two layers of 3D Slicer: Lung 1 and Rib 2, and Nodule 1 inside of the lung."""
    nrrd = pytest.importorskip("nrrd")
    data = np.zeros((2, 24, 20, 16), np.uint8)
    data[0, 4:14, 4:14, 4:12], data[0, 16:20, 4:8, 4:8], data[1, 8:12, 8:12, 6:10] = 1, 2, 1
    header = {
        "space": "left-posterior-superior",
        "kinds": ["list", "domain", "domain", "domain"],
        "space directions": np.array([[np.nan] * 3, [1.5, 0, 0], [0, 1.5, 0], [0, 0, 2.0]]),
        "space origin": [10.0, -20.0, 5.0],
    }
    for n, ((name, color), value, layer) in enumerate(zip(COLORS.items(), (1, 2, 1), (0, 0, 1), strict=True)):
        header |= {f"Segment{n}_Name": name, f"Segment{n}_LabelValue": str(value), f"Segment{n}_Layer": str(layer)}
        header |= {f"Segment{n}_ID": f"Segment_{n}", f"Segment{n}_Color": color}
    nrrd.write(str(tmp_path / "a.seg.nrrd"), data, header)
    return tmp_path / "a.seg.nrrd"


def hues(pixels: np.ndarray) -> set[str]:
    """The segments whose colours are seen."""
    red, green, blue, alpha = np.moveaxis(pixels, -1, 0)
    seen = {
        "Lung": blue > 2 * red,
        "Rib": (red > 0.2) & (green > 4 * blue),
        "Nodule": (red > 2 * blue) & (red > 4 * green),
    }
    return {name for name, where in seen.items() if (where & (alpha > 0.2)).sum() > 4}


def test_each_segment_of_layers_with_equal_numbers(file: Path, tmp_path: Path, renderer: sg.Renderer) -> None:
    """By the command, from a file and a volume, over another volume, and in the window."""
    everything = set(COLORS)
    assert (
        main(["render", str(file), "-o", str(tmp_path / "a.npy"), "--slice", "z=50%", "--size", "64", "--quiet"]) == 0
    )
    assert hues(np.load(tmp_path / "a.npy")) >= {"Lung", "Nodule"}
    options = {"size": (64, 64), "only_labels": [(1, 0.1), (2, 1.0)], "background": None}
    pictures = [sg.render(source, **options).pixels for source in (str(file), sg.load(file))]
    assert hues(pictures[0]) >= {"Rib", "Lung"} and np.array_equal(*pictures)
    samples = np.zeros((16, 20, 24), np.float32)
    samples[0, 0, :2] = 1.0, 2.0
    ground = sg.Volume(samples, (1.5, 1.5, 2.0), (10.0, -20.0, 5.0), frame="LPS")
    over = sg.render(ground, labels=str(file), **options).pixels
    assert hues(over) == hues(pictures[0])
    document = Document.open(SceneFile(str(file)), quiet=True)
    tables = [
        list_segments(tuple(s.base.labels), layer.volume.labels)
        for s, layer in zip(document.styles, document.layers, strict=True)
    ]
    assert [[segment.name for segment in table] for table in tables] == [["Lung", "Rib"], ["Nodule"]]
    state = State.of(document, (64, 64))
    picture = render_scene(replace(scene_of(state, document), annotate=()), document, renderer.render)
    assert {"Lung", "Rib"} <= hues(picture.pixels) <= everything


def test_the_first_label_of_a_number_counts() -> None:
    labels = [Label(1, "a", "#ff0000"), Label(2, "b", "#00ff00"), Label(1, "c", "#0000ff")]
    assert [color for _, color, _ in select_labels(labels)] == ["#ff0000", "#00ff00"]

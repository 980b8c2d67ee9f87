"""Tables of labels of other programs, which `--names` reads: FreeSurfer, ITK-SNAP, 3D Slicer, CSV and TSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.data.volume import Label
from splatgl.readers.label_table import read_label_table
from splatgl.scene.scene_file import SceneFile
from splatgl.viewer.document import Document
from splatgl.viewer.state import State

ROWS = ((2, "Left kidney", "#ff0000"), (9, "Vein 2", "#000910"))
BARE = tuple((number, name, None) for number, name, _ in ROWS)
TABLES = {
    "lut.txt": "#No. Label Name:  R G B A\n\n2  Left kidney   255 0 0 0\n9  Vein 2  0 9 16 0\n",
    "slicer.ctbl": '# Color table file\n2 "Left kidney" 255 0 0 255\n9 "Vein 2" 0 9 16 255\n',
    "snap.label": '# IDX -R- -G- -B- -A- VIS MSH LABEL\n2 255 0 0 1 1 1 "Left kidney"\n9 0 9 16 1 1 1 "Vein 2"\n',
    "bids.tsv": "index\tname\tabbreviation\tcolor\n2\tLeft kidney\tLK\t#ff0000\n9\tVein 2\tV2\t#000910\n",
    "slicer.csv": "LabelValue,Name,Color_R,Color_G,Color_B\n2,Left kidney,255,0,0\n9,Vein 2,0,9,16\n",
    "bare.csv": "2,Left kidney,255,0,0\n9,Vein 2,0,9,16\n",
    "words.csv": "name;id;colour\nLeft kidney;2;red\nVein 2;9;#000910\n",
}
WITHOUT_COLORS = {
    "names.csv": "2,Left kidney\n9,Vein 2\n",
    "names.txt": "2 Left kidney\n9 Vein 2\n",
    "header.tsv": "id\tlabel\n2\tLeft kidney\n9\tVein 2\n",
}


@pytest.fixture
def seg(tmp_path: Path) -> Path:
    samples = np.zeros((6, 6, 6), np.uint8)
    samples[1:3], samples[3:5] = 2, 9
    np.save(tmp_path / "seg.npy", samples)
    return tmp_path / "seg.npy"


@pytest.mark.parametrize("name", [*TABLES, *WITHOUT_COLORS])
def test_tables_of_other_programs(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text((TABLES | WITHOUT_COLORS)[name], encoding="utf-8-sig")
    labels = read_label_table(path).values()
    assert [(label.number, label.name, label.color) for label in labels] == list(ROWS if name in TABLES else BARE)


@pytest.mark.parametrize("text", ["", "volume\nsurface\n", "1 liver\nspleen 2\n", "a,b\nc,d\n", "1,2,3\n", "# none\n"])
def test_texts_that_are_no_tables(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(sg.InputError, match="a number and a name on each line"):
        read_label_table(tmp_path / "a.txt")


def test_names_from_a_table_in_every_door(seg: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Command, Python, scene file and window; a single name comes before, and other numbers of the table are unused."""
    table = tmp_path / "lut.txt"
    table.write_text(TABLES["lut.txt"] + "77 Other 1 2 3 0\n")
    right = (Label(2, "Left kidney", "#ff0000"), Label(9, "Vein", "#000910"))
    load = {"values": "labels"}
    scene = SceneFile(str(seg), load).with_options(names=table, name_of={9: "Vein"})
    assert scene.open().labels == right and str(table) in scene.files
    (tmp_path / "scene.toml").write_text(scene.to_toml(tmp_path))
    assert 'names = "lut.txt"' in (tmp_path / "scene.toml").read_text()
    document = Document.open(SceneFile.from_toml(tmp_path / "scene.toml"))
    assert document.volume.labels == right
    assert document.styles[0].names == ((2, "Left kidney"), (9, "Vein"))
    assert State.of(document, (64, 64)).styles[0].base.labels[0][1] == "#ff0000"
    by_name = sg.render(np.load(seg), names=str(table), size=16, values="labels").pixels
    by_color = sg.render(sg.Volume(np.load(seg), labels=right), size=16).pixels
    assert np.array_equal(by_name, by_color)
    command = ["render", str(seg), "--values", "labels", "--size", "16", "-o", str(tmp_path / "a.png"), "--names"]
    assert main([*command, str(table)]) == 0
    table.write_text("3 Liver\n")
    assert main([*command, str(table)]) == 2 and main([*command, str(seg.with_name("lut.tx"))]) == 2
    told = capsys.readouterr().err
    assert "--names: expected some of 2, 9, got other numbers in" in told and "did you mean lut.txt?" in told

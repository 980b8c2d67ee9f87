"""Files that PyVista knows: OpenFOAM, whose marker is empty, and XDMF with its times."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from splatgl.errors import InputError
from splatgl.readers import LoadOptions, load, vtk_files

# points of two cells of size 1 along x
POINTS = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1, 2)]
FACES = ["1 4 10 7", "0 6 9 3", "0 1 7 6", "3 9 10 4", "0 3 4 1", "6 7 10 9", "2 5 11 8", "1 2 8 7", "4 10 11 5"]
FACES += ["1 4 5 2", "7 8 11 10"]


def write_foam(folder: Path) -> Path:
    """A case of OpenFOAM with a temperature of 3 and 5 in two cells."""

    def write(place: str, kind: str, body: str) -> None:
        path = folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        head = f'FoamFile {{ version 2.0; format ascii; class {kind}; location "{path.parent}"; object {path.name}; }}'
        path.write_text(f"{head}\n{body}\n")

    def write_list(name: str, kind: str, rows: list[str]) -> None:
        write(f"constant/polyMesh/{name}", kind, f"{len(rows)}\n(\n" + "\n".join(rows) + "\n)")

    write_list("points", "vectorField", [f"({x} {y} {z})" for x, y, z in POINTS])
    write_list("faces", "faceList", [f"4({face})" for face in FACES])
    write_list("owner", "labelList", ["0"] * 6 + ["1"] * 5)
    write_list("neighbour", "labelList", ["1"])
    write_list("boundary", "polyBoundaryMesh", [f"walls {{ type wall; nFaces {len(FACES) - 1}; startFace 1; }}"])
    write("system/controlDict", "dictionary", "startTime 0;\nendTime 1;\ndeltaT 1;\nwriteInterval 1;")
    walls = "boundaryField { walls { type zeroGradient; } }"
    scalars = f"dimensions [0 0 0 1 0 0 0];\ninternalField nonuniform List<scalar> 2(3 5);\n{walls}"
    for step in ("0", "1"):
        write(f"{step}/T", "volScalarField", scalars.replace("(3 5)", f"(3 {5 + int(step)})"))
    (folder / "case.foam").touch()
    return folder / "case.foam"


def test_openfoam(tmp_path: Path) -> None:
    pytest.importorskip("pyvista", reason="the extra pyvista reads it")
    path = write_foam(tmp_path)
    volume = load(path, array="T", time=1)
    np.testing.assert_array_equal(volume.samples.ravel(), [3, 6])
    assert volume.times == 2 and volume.spacing == (1, 1, 1) and volume.notes[0].startswith("2 cells, resampled")
    (tmp_path / "constant/polyMesh/faces").write_text("damaged")
    with pytest.raises(InputError, match=r"case\.foam: "):
        load(path)


def test_xdmf(tmp_path: Path) -> None:
    pytest.importorskip("pyvista", reason="the extra pyvista reads it")
    numbers = " ".join(map(str, range(36)))

    def item(sizes: str, text: str) -> str:
        return f'<DataItem Dimensions="{sizes}" Format="XML">{text}</DataItem>'

    (tmp_path / "a.xdmf").write_text(
        '<?xml version="1.0"?><Xdmf Version="2.0"><Domain><Grid Name="g" GridType="Uniform"><Time Value="0.5"/>'
        f'<Topology TopologyType="3DCoRectMesh" Dimensions="3 3 4"/><Geometry GeometryType="ORIGIN_DXDYDZ">'
        f'{item("3", "1 2 3")}{item("3", "1 1 2")}</Geometry><Attribute Name="a" AttributeType="Scalar" Center="Node">'
        f"{item('3 3 4', numbers)}</Attribute></Grid></Domain></Xdmf>"
    )
    volume = load(tmp_path / "a.xdmf")
    np.testing.assert_array_equal(volume.samples, np.arange(36).reshape(3, 3, 4))
    assert volume.spacing == (2, 1, 1) and volume.origin == (3, 2, 1)


def test_missing_libraries_are_told_with_their_extras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.vtk").write_text("# vtk DataFile Version 3.0\n")
    for module, with_pyvista, said in (
        ("vtkmodules.vtkIOLegacy", False, r"vtk; install it with: pip install 'splatgl\[vtk\]'"),
        ("pyvista", True, r"pyvista; install it with: pip install 'splatgl\[pyvista\]'"),
    ):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(InputError, match=said):
            vtk_files.read_data(tmp_path / "a.vtk", LoadOptions(), with_pyvista)

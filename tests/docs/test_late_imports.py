"""Bad input is told before what draws and compares is imported, which takes longer than everything before it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import nibabel
import numpy as np
import pytest

from splatgl.cli.main import main
from splatgl.gl.screen import GROUNDS
from splatgl.viewer.viewer import Options

pytestmark = pytest.mark.usefixtures("shared_programs")

# the exit code, and all that was imported
TELL = """
import sys
from splatgl.cli.main import main
try:
    code = main()
except SystemExit as stop:
    code = stop.code
print("\\n", code, *sys.modules)
"""
DRAWS, COMPARES = ("moderngl", "splatgl.gl"), ("splatgl.comparison", "splatgl.readers.tiff")
NUMBERS = ("numpy", "splatgl.data.readers")
CASES = {
    "render missing.nrrd": (*DRAWS, *COMPARES),
    "render missing.nrrd --size a": (*DRAWS, *COMPARES),
    "render missing.nrrd -o /dev/null/x.png": (*DRAWS, *COMPARES),
    "render missing.nrrd --ref missing.png": (*DRAWS, "splatgl.reference.check", "splatgl.comparison.reports"),
    "render --help": (*DRAWS, *COMPARES),
    "view missing.nrrd": (*DRAWS, *COMPARES),
    "view missing.nrrd --frame-time 0": (*DRAWS, *COMPARES),
    "animate missing.nrrd -o x.gif": (*DRAWS, *COMPARES),
    "animate missing.nrrd -o x.gif --fps 0": (*DRAWS, *COMPARES),
    "info missing.nrrd": (*DRAWS, *COMPARES),
    "compare missing.png missing.png": (*DRAWS, "splatgl.splat", "splatgl.comparison.reports"),
    "report missing.nrrd": (*DRAWS, "splatgl.report.export"),
    "report --rounds 0": (*DRAWS, "splatgl.report.export"),
    "doctor --device a": NUMBERS,
    "--help": NUMBERS,
}


@pytest.mark.few(4)
@pytest.mark.parametrize("command", CASES)
def test_told_before_imports(command: str, tmp_path: Path) -> None:
    run = [sys.executable, "-c", TELL, *command.split()]
    told = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, check=True)
    code, *imported = told.stdout.splitlines()[-1].split()
    assert (code == "0", len(told.stderr.splitlines())) == ((True, 0) if "--help" in command else (False, 1))
    late = [name for name in imported if name.startswith(tuple(f"{each}." for each in CASES[command]))]
    assert late + sorted({*CASES[command]} & {*imported}) == []


def test_imports_of_nifti(tmp_path: Path) -> None:
    """Neither numpy's masked arrays nor pydicom, which nibabel and `np.unique` import, are needed to read amounts."""
    path, values = tmp_path / "cloud.nii", np.random.default_rng(1).integers(0, 1000, (6, 5, 4)).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), path)
    told = subprocess.run([sys.executable, "-c", TELL, "info", path], capture_output=True, text=True, check=True)
    code, *imported = told.stdout.splitlines()[-1].split()
    assert code == "0" and "nibabel" in imported and not {"numpy.ma", "pydicom"} & {*imported}


def test_a_program_imports_all_of_nibabel(tmp_path: Path) -> None:
    """The command alone leaves pydicom out of nibabel, and reads DICOM afterwards; importers are Python's own."""
    path = tmp_path / "cloud.nii"
    nibabel.save(nibabel.Nifti1Image(np.ones((6, 5, 4), np.int16), np.eye(4)), path)
    finders = "importers = sys.meta_path[:]\n"
    ends = (
        "import nibabel.nifti1, pydicom\nprint(nibabel.nifti1.have_dicom, sys.meta_path == importers, pydicom.config)"
    )
    program = f"import sys\n{finders}import splatgl\nsplatgl.load(sys.argv[2])\n{ends}"
    command = f"import sys\n{finders}from splatgl.cli.main import main\nmain()\n{ends}"
    for text, expected in ((program, ["True", "True"]), (command, ["False", "True"])):
        run = [sys.executable, "-c", text, "info", path]
        told = subprocess.run(run, capture_output=True, text=True, check=True)
        assert told.stdout.splitlines()[-1].split()[:2] == expected


def test_help_tells_the_defaults_of_the_window(capsys: pytest.CaptureFixture[str]) -> None:
    """They are imported with what draws; the help names them before."""
    for arguments in (["--help-all"], ["missing.nrrd", "--ground", "blue"]):
        with pytest.raises(SystemExit):
            main(["view", *arguments])
    told = capsys.readouterr()
    assert f"--ground {'|'.join(GROUNDS)}" in told.out and f"expected {' or '.join(GROUNDS)}" in told.err
    assert Options.ground == GROUNDS[0]

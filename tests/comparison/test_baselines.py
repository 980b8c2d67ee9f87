"""Where baselines lie: names as files, classes of renderers, and which pictures count."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.comparison.image_regression import LONGEST, Baselines, file_stem, renderer_class


@pytest.mark.parametrize(
    ("renderer", "found"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe"),
        ("NVIDIA H200/PCIe/SSE2", "nvidia"),
        ("NVIDIA GeForce RTX 3060/PCIe/SSE2", "nvidia"),
        ("NV137", "nvidia"),
        ("AMD Radeon RX 6800 (radeonsi, navi21, LLVM 17)", "amd"),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", "intel"),
        ("ANGLE (Apple, Apple M1, OpenGL 4.1 Metal)", "apple"),
        ("D3D12 (AMD Radeon(TM) Graphics)", "amd"),
        ("virtio-vga corporation", None),
        ("", None),
    ],
)
def test_renderer_classes(renderer: str, found: str | None) -> None:
    assert renderer_class(sg.Image(np.zeros((1, 1, 4)), {"renderer": renderer})) == found


def test_names_as_files(tmp_path: Path) -> None:
    assert file_stem("test_it") == "test_it"
    assert file_stem("test_it[front-2]") == "test_it-front-2"
    assert len({file_stem(name) for name in ("t[a/b]", "t[a.b]", "t[a b]", "t[a-b]")}) == 4
    assert "." not in file_stem("a.nvidia") and "." not in file_stem("a.portable-2")
    assert LONGEST <= len(file_stem("x" * 300)) < LONGEST + 10
    assert file_stem("é").isascii() and file_stem("é") != file_stem("è")
    # one name's files are not another's
    for name in ("front.png", "front.nvidia.png", "front-2.png", "front.nvidia-2.png", "frontal.nvidia.png"):
        (tmp_path / name).touch()
    mine = Baselines(tmp_path, "front", ("nvidia",))
    assert [path.name for path in mine.valid()] == ["front.nvidia.png", "front.nvidia-2.png"]
    assert [path.name for path in Baselines(tmp_path, "front", ("amd",)).valid()] == ["front.png"]
    assert Baselines(tmp_path, "front-3", ("amd",)).valid() == []
    assert mine.fresh().name == "front.nvidia-3.png"

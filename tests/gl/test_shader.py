"""Shader text is composed strictly, and its mistakes are told by file and line."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.gl import shader
from splatgl.gl.features import FRAME, STYLE
from splatgl.gl.program import build
from splatgl.gl.shader import ShaderError, compose, folder
from tests.helpers.twins import read_again


@pytest.fixture
def shaders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(shader, "folder", lambda: tmp_path)
    read_again()
    yield tmp_path
    read_again()


def test_switches_and_includes(shaders: Path) -> None:
    (shaders / "a.vert").write_text('// one\n// switch DEEP 3\n#include "b.glsl"\nvoid main() {}\n')
    (shaders / "b.glsl").write_text("int two;  // two\n// switch WIDE 0  both\n")
    text = compose("a.vert", {"WIDE": True})
    assert text.source.splitlines()[:3] == ["#version 330 core", "#define DEEP 3", "#define WIDE 1"]
    place = text.source.splitlines().index("int two;")
    assert text.lines[place] == "b.glsl:1"


def test_a_feature_that_is_off_has_a_twin(shaders: Path) -> None:
    """Switches of either file are declared, whichever is included."""
    (shaders / "a.vert").write_text(
        '// switch NEAR 0\n// switch FAR 0\n#include "b.glsl" if NEAR or FAR else "c.glsl"\n'
    )
    (shaders / "b.glsl").write_text("// switch WIDE 0\nint on;\n")
    (shaders / "c.glsl").write_text("int off;\n")
    for switches in ({"NEAR": True}, {"FAR": True, "WIDE": 1}, {"FAR": False}, {}):
        lines = compose("a.vert", switches).source.splitlines()
        assert ("int on;" in lines) == any(map(bool, switches.values())) != ("int off;" in lines)
    (shaders / "d.vert").write_text('#include "b.glsl" if MISSING else "c.glsl"\n')
    with pytest.raises(ShaderError, match=r"d\.vert:1: no such switch: MISSING"):
        compose("d.vert", {})


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"a.vert": '#include "none.glsl"\n'}, "a.vert:1: no such file: none.glsl"),
        ({"a.vert": '\n#include "b.glsl"\n', "b.glsl": '#include "a.vert"\n'}, "b.glsl:1: includes a.vert"),
        ({}, "a.vert: no such shader"),
        (
            {"a.vert": '#include "b.glsl"\n', "b.glsl": "\n// version 430\n"},
            "b.glsl:2: a version is declared by the stage that is composed",
        ),
        ({"a.vert": "// switch SHAPE 1\n"}, "a.vert: no such switch: COLOUR; it has SHAPE"),
    ],
)
def test_mistakes_are_errors(files: dict[str, str], message: str, shaders: Path) -> None:
    for name, text in files.items():
        (shaders / name).write_text(text)
    with pytest.raises(ShaderError, match=message):
        compose("a.vert", {"COLOUR": 1})


def test_only_compute_shaders_and_what_feeds_them_ask_for_more_than_3_3() -> None:
    newer = {path.name for path in folder().iterdir() if path.suffix == ".comp"} | {"tile_project.frag"}
    for path in folder().iterdir():
        if path.suffix != ".glsl":
            version = "430" if path.name in newer else "330"
            assert compose(path.name, {}).source.startswith(f"#version {version} core\n"), path.name
    assert compose("tile_project.frag", {"COMPUTE": False}).source.startswith("#version 330 core\n")


def test_a_compiler_message_names_file_and_line(shaders: Path, renderer: sg.Renderer) -> None:
    (shaders / "a.vert").write_text('#include "b.glsl"\nvoid main() { gl_Position = vec4(0.0); }\n')
    (shaders / "b.glsl").write_text("// fine\nfloat wrong = missing;\n")
    with pytest.raises(ShaderError, match=r"b\.glsl:2"):
        build(renderer.ctx, "a.vert", None, {})


def test_blocks_mirror_the_shader(renderer: sg.Renderer) -> None:
    """Every field of both blocks, written from numpy, is echoed by the shader from its own layout."""
    fields = {name: (FRAME, "frame") for name in FRAME.names} | {name: (STYLE, "style") for name in STYLE.names}
    for name, (dtype, block) in fields.items():
        shape = dtype[name].shape
        wide = {(): "{}", (2,): "{}.x * 3.0 + {}.y", (4,): "{}.x * 3.0 + {}.z", (3, 4): "{}[1].x * 3.0 + {}[2].z"}
        value = wide[shape].replace("{}", f"{block}.{name}")
        source = "\n".join(["#version 330 core", (folder() / "frame.glsl").read_text(), "out float echo;",
                            f"void main() {{ echo = {value}; gl_Position = vec4(0.0); }}"])  # fmt: skip
        program = renderer.ctx.program(vertex_shader=source, varyings=("echo",))
        record = np.zeros((), dtype)
        numbers = np.arange(1, 1 + int(np.prod(shape)), dtype=np.float32).reshape(shape)
        record[name] = numbers
        title = block.capitalize()
        assert program[title].size <= dtype.itemsize
        program[title].binding = 0
        buffer, out = renderer.ctx.buffer(record.tobytes()), renderer.ctx.buffer(reserve=4)
        buffer.bind_to_uniform_block(0)
        array = renderer.ctx.vertex_array(program, [])
        array.transform(out, vertices=1)
        right = {(): lambda n: n, (2,): lambda n: n[0] * 3 + n[1], (4,): lambda n: n[0] * 3 + n[2],
                 (3, 4): lambda n: n[1, 0] * 3 + n[2, 2]}[shape](numbers)  # fmt: skip
        assert np.frombuffer(out.read(), np.float32)[0] == right, name
        for thing in (array, program, buffer, out):
            thing.release()

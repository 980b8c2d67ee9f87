"""Shader texts keep to what every compiler accepts, and to what each OpenGL has at least."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from collections import Counter, defaultdict
from functools import cache
from itertools import chain
from pathlib import Path

import pytest
import shader_texts
from shader_texts import PICTURES, Text, plan_of, programs, splats

import splatgl as sg
from splatgl.gl.features import FEATURES, FRAME, STYLE
from splatgl.gl.shader import SHAPES, compose, declared_switches, folder
from tests.helpers.covering import covering

COMPILER = "glslangValidator"

# switches that are no part of a plan's look but of how it is drawn
OPTIONS = {feature.switch for feature in FEATURES} | shader_texts.OPTIONS | {"SHADING", "PERSPECTIVE"}
# those that are off, or on, in all programs of a stage
CONSTANT = {
    "sheet_show.frag": OPTIONS,
    "near_field.frag": OPTIONS,
    "surface.frag": {"SKY", "SHADOWS"},
    "splat.frag": {"LIMITED"},
    "sheet_close.frag": {"LIMITED", "LAYERED", "CARRIED"},
    "box_draw.comp": {"PACKED"},
    "tile_draw.comp": {"PACKED"},
    "sheet_draw.comp": {"PIECE"},
}

# GLSL 4.60, 3.6: keywords by the version that brought them, and those that are reserved for later versions
KEYWORDS = {
    400: "patch sample subroutine precise double dvec2 dvec3 dvec4 dmat2 dmat3 dmat4 samplerCubeArray",
    420: "atomic_uint coherent volatile restrict readonly writeonly image1D iimage1D uimage1D image2D iimage2D uimage2D"
    " image3D iimage3D uimage3D imageCube imageBuffer iimageBuffer uimageBuffer image2DArray image2DMS",
    430: "buffer shared",
}
RESERVED = (
    "common partition active asm class union enum typedef template this resource goto inline noinline public static"
    " extern external interface long short half fixed unsigned superp input output hvec2 hvec3 hvec4 fvec2 fvec3 fvec4"
    " filter"
    " sizeof cast namespace using sampler3DRect attribute varying highp mediump lowp precision packed row_major"
    # names of Direct3D and Metal, to which some drivers translate
    " matrix vector pass technique texture2D textureCube device constant thread threadgroup"
)
BUILT_IN = (
    "radians degrees sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh pow exp log exp2 log2 sqrt inversesqrt"
    " abs sign floor trunc round roundEven ceil fract mod modf min max clamp mix step smoothstep isnan isinf fma frexp"
    " ldexp length distance dot cross normalize faceforward reflect refract outerProduct transpose determinant inverse"
    " lessThan greaterThan equal notEqual any all not texture textureSize textureLod texelFetch dFdx dFdy fwidth noise1"
    " bitCount bitfieldExtract bitfieldInsert findLSB findMSB floatBitsToInt floatBitsToUint intBitsToFloat"
    " uintBitsToFloat packUnorm2x16 unpackUnorm2x16 packHalf2x16 unpackHalf2x16 packUnorm4x8"
    " unpackUnorm4x8 imageLoad imageStore imageSize textureGrad textureProj textureOffset barrier"
    " memoryBarrier atomicAdd atomicMin atomicMax atomicAnd atomicOr atomicXor atomicExchange"
)
GL_NAMES = (
    "gl_Position gl_VertexID gl_FragCoord gl_WorkGroupID gl_NumWorkGroups gl_LocalInvocationID gl_GlobalInvocationID"
    " gl_LocalInvocationIndex gl_FragDepth"
)
TYPE = r"(?:void|bool|int|uint|float|[biu]?vec[234]|mat[234](?:x[234])?|[A-Z]\w+)"
# what passes from a vertex shader to a fragment shader
INPUT, OUTPUT = r"^\s*(flat )?in (\w+ \w+);", r"^\s*(flat )?out (\w+ \w+);"
SIZES = {"bool": 1, "int": 1, "uint": 1, "float": 1, "mat3": 12, "mat4": 16}
# least of each OpenGL 3.3, or with compute shaders 4.3; of a work group by fewer cards: 16 KiB
LIMITS = {
    "outputs": 8,
    "textures": 16,
    "storage": 8,
    "images": 8,
    "varyings": 15,
    "blocks": 12,
    "uniforms": {"vertex": 1024, "fragment": 1024, "compute": 512},
    "shared": 2**14,
}
# as many outputs as any OpenGL has: four sheets, each with its mass
MOST_OUTPUTS = {"splat.frag": 8}


@cache
def drawn() -> list[tuple[Text, ...]]:
    """The programs of both shapes."""
    return list(dict.fromkeys(chain.from_iterable(programs(shape, 1) for shape in SHAPES.values())))


@cache
def texts() -> list[Text]:
    return list(dict.fromkeys(chain.from_iterable(drawn())))


@cache
def lines() -> dict[tuple[int, str], str]:
    """Names of texts by versions of GLSL and lines: most lines are in many texts."""
    return {(text.version, line): text.name for text in texts() for line in text.source.splitlines()}


def test_all_shaders_and_switches_occur() -> None:
    """A new shader, switch or form needs a picture in scripts/shader_texts.py."""
    found: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for text in texts():
        for switch, value in text.switches.items():
            found[text.shader][switch].add(value)
    stages = {path.name for path in folder().iterdir() if path.suffix != ".glsl"}
    # fragments are tried on drivers by tests of sheet_fragments; a driver that rejects them draws quads
    assert stages - {"sheet_draw.frag", "fragments_spread.frag"} == {text.shader for text in texts()}
    stages = {text.shader for text in texts()}
    known: dict[str, set[str]] = defaultdict(set)
    for stage in stages:
        assert set(found[stage]) == declared_switches(stage)
        missing = {switch for switch, values in found[stage].items() if switch in OPTIONS and len(values) < 2}
        assert missing <= CONSTANT.get(stage, set()), f"{stage}: always the same: {missing}"
        for switch, values in found[stage].items():
            known[switch] |= values
    forms = "\n".join(path.read_text() for path in folder().iterdir())
    for switch, values in known.items():
        named = set(re.findall(rf"^#define ({switch}_\w+) \d", forms, re.MULTILINE))
        assert values >= named, f"{switch}: {named - values}"
        # quantised splats are drawn for pages alone: tests/exporters compiles them in OpenGL and in WebGL
        assert len(values) > 1 or switch in ("SIDE", "QUANTIZED", "COMPUTE"), f"{switch}: always {values}"
    assert known["SHEETS"] == {"0", "2", "3", "4"}


@pytest.mark.compute
@pytest.mark.parametrize("technique", ["tiles", "quads"])
def test_what_is_drawn_is_among_the_texts(technique: str) -> None:
    """Programs that pictures of three kinds compile."""
    with sg.Renderer() as own:
        known = {(text.shader, text.source) for text in texts()}
        for kind in ("", "labels", "splats"):
            plan = plan_of(PICTURES[kind][0])
            drawn = splats(PICTURES[kind][0].voxels, False, False, False)
            own.render(drawn, plan.resolved.camera.resized((32, 24)), plan.settings.replace(technique=technique))
        compiled = set(own.passes.device.programs.kept)
    assert len(compiled) > 4
    for stages, chosen in compiled:
        declared = frozenset().union(*map(declared_switches, stages))
        for stage in stages:
            assert (stage, compose(stage, dict(chosen), declared).source) in known, f"{stage}: {chosen}"


@pytest.mark.long
@pytest.mark.skipif(shutil.which(COMPILER) is None, reason=f"needs {COMPILER}: apt-get install glslang-tools")
def test_the_reference_compiler_accepts_all(tmp_path: Path) -> None:
    """Of pictures of one change and, in a card's shape, of two: texts in which any two values of switches meet."""
    every = dict.fromkeys(chain(texts(), chain.from_iterable(programs(SHAPES["card"], 2))))
    by_switches: dict[tuple[object, ...], Text] = {(text.shader, *text.switches.items()): text for text in every}
    chosen = [by_switches[key] for key in covering(by_switches)]
    # pictures of either shape have the same names
    names = [f"{n}.{text.name}" for n, text in enumerate(chosen)]
    for name, text in zip(names, chosen, strict=True):
        (tmp_path / name).write_text(text.source)
    print(f"{len(names)} texts of {len(every)}")
    assert len(every) > len(names) > len(texts()) > 500
    answer = subprocess.run([COMPILER, *names], cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stdout[-3000:]


def test_stages_fit_together() -> None:
    """What a fragment shader reads its vertex shader writes, of the same type."""
    links = {program for program in drawn() if len(program) > 1}
    read = 0
    for vertex, fragment in links:
        ends = re.findall(INPUT, preprocess(fragment.source)[0], re.MULTILINE)
        assert set(ends) <= set(re.findall(OUTPUT, preprocess(vertex.source)[0], re.MULTILINE)), fragment.name
        read = max(read, len(ends))
    assert len(links) > 200 and read > 8


def test_no_name_means_something_to_a_compiler() -> None:
    for (version, line), name in lines().items():
        code = re.sub(r"^#(version|extension).*$", "", line)
        words = set(re.findall(r"\b[A-Za-z_]\w*", code))
        newer = {
            *RESERVED.split(),
            *" ".join(names for since, names in KEYWORDS.items() if since > version).split(),
        }
        assert not words & newer, f"{name}: {words & newer}"
        strange = {word for word in words if "__" in word or (word.startswith("gl_") and word not in GL_NAMES.split())}
        assert not strange, f"{name}: {strange}"
        # of built-in functions only calls, and none that is defined again
        used = set(re.findall(r"\b([a-z]\w*)\b(?!\s*\()", code)) & {*BUILT_IN.split()}
        used |= set(re.findall(rf"\b{TYPE} ([a-z]\w*)\s*\(", code)) & {*BUILT_IN.split()}
        assert not used, f"{name}: {used}"


def test_nothing_that_older_compilers_refuse() -> None:
    for text in texts():
        source, first = text.source, text.source.split("\n", 2)
        assert source.isascii(), text.name
        assert first[0] == f"#version {text.version} core" and source.count("#version") == 1
        # an extension comes before everything else
        assert source.count("#extension") == first[1].startswith("#extension")
        functions = Counter(re.findall(rf"^{TYPE} (\w+)\([^;{{]*\) \{{", source, re.MULTILINE))
        assert functions["main"] == 1 and max(functions.values()) == 1, f"{text.name}: {functions.most_common(2)}"
    for (version, line), name in lines().items():
        refused = {
            "uniform with a value": r"^\s*uniform [^;({]*=",
            "array of samplers": r"\bu?sampler\w+ \w+\[",
            "constant array": r"\bconst \w+ \w+\[|\bconst \w+\[",
            "value of an array": r"\w+ \w+\[\w+\] = \w+\[" if version < 420 else r"(?!)",
            "value in braces": r"= \{",
            "binding": r"binding =" if version < 420 else r"(?!)",
            "line that goes on": r"\\$" if version < 420 else r"(?!)",
            "comment": r"/\*|//",
        }
        for what, pattern in refused.items():
            found = re.search(pattern, line)
            assert not found, f"{name}: {what}: {found and found[0]}"


def test_limits_of_opengl() -> None:
    """One below what each OpenGL has at least."""
    most: Counter[tuple[str, str]] = Counter()
    for text in texts():
        found = counts(text)
        for what, count in found.items():
            most[text.shader, what] = max(most[text.shader, what], count)
            limit = LIMITS[what]
            limit = limit[text.stage] if isinstance(limit, dict) else limit
            if what == "outputs" and text.shader in MOST_OUTPUTS:
                assert count <= MOST_OUTPUTS[text.shader]
                continue
            assert count < limit, f"{text.name}: {count} {what}"
        assert all(int(unit) < 8 for unit in re.findall(r"binding = (\d+)", text.source)), text.name
        if text.version >= 430:
            assert found["outputs"] + found["storage"] + found["images"] <= 8, text.name
    # what is counted is there
    assert most["tile_project.frag", "outputs"] == 7 and most["splat.frag", "outputs"] == 8
    assert most["sheet_draw.comp", "storage"] > 3 and most["sheet_draw.comp", "textures"] > 5
    assert most["splat.vert", "varyings"] > 9 and most["layers_over.comp", "uniforms"] > 20
    assert most["sheet_draw.comp", "shared"] > 1000
    assert max(FRAME.itemsize, STYLE.itemsize) < 2**14


def counts(text: Text) -> dict[str, int]:
    """Numbers of what a stage declares: its resources; vectors between stages, components of uniforms, and bytes that
    a work group shares.
    """
    code, names = preprocess(text.source)
    names = names | {name: value for name, value in re.findall(r"^const \w+ (\w+) = ([^;]+);", code, re.MULTILINE)}

    def total(pattern: str, unit: int = 0) -> int:
        """Variables of declarations, or their components in vectors of `unit`."""
        size = 0
        for kind, variables in re.findall(pattern, code, re.MULTILINE):
            for array in re.findall(r"\w+(?:\[([^]]*)\])?(?:,|$)", variables):
                components = SIZES.get(kind, int(kind[-1]) if "vec" in kind else 1)
                size += (evaluate(array, names) if array else 1) * (math.ceil(components / unit) * unit if unit else 1)
        return size

    layout, variables = r"^\s*(?:layout\([^)]*\)\s*)?", r"(\w+)\s+(\w[^;({]*);"
    ends = "out" if text.stage == "vertex" else "in"
    return {
        "outputs": total(rf"{layout}out\s+{variables}") if text.stage == "fragment" else 0,
        "varyings": total(rf"{layout}(?:flat )?\s*{ends}\s+{variables}", 4) // 4 if text.stage != "compute" else 0,
        "textures": total(r"^uniform ([ui]?sampler\w+) (\w+);"),
        "images": total(rf"{layout}(?:uniform|writeonly|readonly|\s)+([ui]?image2D) (\w+);"),
        "storage": len(re.findall(r"\bbuffer \w+ \{", code)),
        "blocks": len(re.findall(r"\buniform \w+ \{", code)),
        "uniforms": total(r"^uniform (bool|u?int|float|[biu]?vec\d|mat\d) (\w[^;]*);", 4),
        "shared": 4 * total(r"^shared (\w+) ([^;]+);", 1),
    }


@cache
def preprocess(source: str) -> tuple[str, dict[str, str]]:
    """The lines outside bodies that conditions keep, with names that are defined replaced; and the definitions."""
    names: dict[str, str] = {}
    lines: list[str] = []
    # of each condition: whether its lines are kept, and whether any were
    stack: list[tuple[bool, bool]] = []
    for line in source.splitlines():
        word, _, rest = line.strip().partition(" ")
        if word in ("#if", "#ifdef", "#ifndef", "#elif"):
            before = stack.pop()[1] if word == "#elif" else False
            named = {"#ifdef": rest in names, "#ifndef": rest not in names}
            on = not before and bool(named[word] if word in named else evaluate(rest, names))
            stack.append((on, on or before))
        elif word == "#else":
            stack.append((not stack[-1][1], True) if stack else (True, True))
            stack.pop(-2)
        elif word == "#endif":
            stack.pop()
        elif all(on for on, _ in stack):
            if word == "#define" and re.fullmatch(r"\w+", rest.split(" ")[0]):
                name, _, names_value = rest.partition(" ")
                names[name] = names_value.strip()
            elif word != "#define" and not line.startswith(" "):
                lines.append(expand(line, names))
    assert not stack
    return "\n".join(lines), names


def expand(line: str, names: dict[str, str]) -> str:
    """The line with names replaced by their definitions, which may hold names."""
    while True:
        before, line = line, re.sub(r"\b[A-Za-z_]\w*", lambda match: names.get(match[0], match[0]), line)
        if line == before:
            return line


def evaluate(expression: str, names: dict[str, str]) -> int:
    """The value of an expression of numbers and names; a name that is not defined is 0."""
    expression = re.sub(r"\b(\d+)u\b", r"\1", expand(expression, names))
    expression = re.sub(r"(.*) \? (.*) : (.*)", r"(\2) if (\1) else (\3)", expression)
    expression = expression.replace("&&", " and ").replace("||", " or ").replace("!=", "≠").replace("!", " not ")
    words = {
        word: 0
        for word in re.findall(r"\b[A-Za-z_]\w*\b", expression)
        if word not in ("and", "or", "not", "if", "else")
    }
    return int(eval(expression.replace("≠", "!="), {"__builtins__": {}}, words))


def test_what_counts_counts() -> None:
    source = """#version 430 core
#define WIDE 2
#define VARYING out
#if WIDE == 1 && !NONE
out vec4 never[4];
#elif WIDE == 2
const uint MANY = WIDE == 2 ? 8u : 1u;
VARYING vec4 light[WIDE];
#else
out vec4 never[5];
#endif
layout(location = 2) out float mass;
layout(rgba32f, binding = 0) uniform writeonly image2D target;
uniform sampler2D first;
uniform usampler2D second;
uniform mat3 turn;
uniform vec2 size, place[WIDE];
layout(std430, binding = 1) buffer Heads { uint heads[]; };
shared vec4 four[MANY], more[2];
void main() {}
"""
    expected = {"outputs": 3, "varyings": 0, "textures": 2, "images": 1, "storage": 1, "blocks": 0, "uniforms": 24}
    assert counts(Text("a", "a.frag", source)) == {**expected, "shared": 160}
    assert counts(Text("a", "a.vert", source))["varyings"] == 3


def test_loops_over_uniform_arrays_stay_loops() -> None:
    """Mesa repeats a loop whose counter indexes an array as often as it is long, and compiles that for seconds."""
    for file in folder().glob("*.*"):
        text = file.read_text()
        arrays = re.findall(r"^uniform \w+ (\w+)\[MOST_\w+\];", text, re.MULTILINE)
        counters = re.findall(r"for \(int (\w+) = 0; \1 < [a-z_]+; \1\+\+\)", text)
        assert not [f"{file.name}: {array}[{k}]" for array in arrays for k in counters if f"{array}[{k}]" in text]

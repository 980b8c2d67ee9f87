"""GLSL functions and their float64 twins of the same name on the same random numbers, each with a stated bound.

Here are opacity, matter, light and colours; the other files of this name have footprints, geometry and motion. A twin
is a function of the package, or, where the package needs none, of these files.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.color import linear_from_srgb, srgb_from_linear
from splatgl.planning.resolve import END_CORRECTION
from splatgl.reference.blend import blend_opacity, pixel_means
from splatgl.reference.rays import FootprintRow
from splatgl.splat.footprint import fill_depth, run_lengths
from splatgl.splat.lighting import apply_light
from splatgl.splat.splats import OCTAVES, POINT, POINT_VALUE, VALUE, VOXEL, is_points, linear_color
from tests.helpers.noise import GRIDS, noise, views
from tests.helpers.page_reference import octahedral_normal
from tests.helpers.splatting import SPLATS
from tests.helpers.streaks import run_length_along
from tests.helpers.twins import COUNT, Twin, functions

CALL = re.compile(r"\b(\w+)\(")
# functions that only move data, or only choose which other computes
PLUMBING = {
    *("choose", "exact_quad", "give_matter", "listed_at", "plain_quad", "projected", "read_record", "read_splat"),
    *("splat_quad", "texel_of", "unpacked_extent", "scaled", "next_base", "placed", "class_texel", "weight_at"),
    *("open_pixel", "read_pixel", "write_pixel", "read_column", "write_column", "take_sheet", "any_column"),
    *("any_open", "least_opacity", "begin_row", "turn_sheets", "turn_matter", "value_of"),
    *("center_of", "take_plane", "is_plane", "planes", "set_mask_ray", "mask_above", "mask_part", "mask_face"),
    *("head_of", "kept_pixel", "packed_piece", "matter_of_piece", "ends_of_piece", "add_matter", "end_matter"),
    *("head_of_row", "last_piece", "part_of"),
    *("first_pixel", "read_texels", "joined", "stage_splat", "staged_splat", "wait_for_all", "is_opaque", "is_behind"),
    # parts of mean_matter
    *("region_depths", "region_place", "region_density", "region_integral", "image_texel", "image_mean"),
    *("composite_tile", "add_batch", "entry", "held_sums", "cell_of"),
    # layers by quads, which tests/scene/test_layers.py compares with those by tiles
    *("boxed_piece", "packed_pair", "set_range", "signs_of", "take", "unpacked_pair"),
    # lists on a card, which tests/gl/test_card_lists.py compares
    *("begin_state", "blocks_of", "count_pairs", "first_sheet_of", "scan_group", "scanned_before", "set_entries"),
    *("set_state", "splat_of", "tile_number", "tiles_of"),
    # pixels of one sample, which tests/gl/test_adaptive_samples.py compares
    *("between", "is_single"),
    # quads on a card, which tests/gl/test_shapes.py compares
    *("filtered", "give_place", "quad_place"),
    # depths of surfaces, which tests/scene/test_meshes.py compares with float64
    "buffer_depth",
    # iso-surfaces, which tests/gl/test_iso.py compares with closed forms and float64
    *("begin_segments", "close_segment", "segment_of", "crossings", "meets_iso", "lit_surface", "light_direction"),
    # textures of meshes, which tests/scene/test_slices.py compares with float64
    *("is_hole", "keys_weights", "mesh_paint", "texel_at"),
    # how rows of a tile join values, which tests/planning/test_one_value.py compares with float64
    "join_values",
    *("set_column", "begin_matter", "set_layer", "keep_piece", "boxed", "within_depths"),
    # fragments of tiles, which tests/gl/test_sheet_fragments.py compares with compute shaders
    *("fragment_of", "lane_of", "tile_of"),
}
# Python names of functions that GLSL names otherwise
OTHER_NAMES = {
    **{"attenuated_depth": "attenuate_depth", "blended": "blend_opacity", "dwelt_opacity": "moving_opacity"},
    "blurred": "blur",
    **{"filled_depth": "fill_depth", "kept_part": "clip_to_mask", "light_of": "shade_part", "weighed": "shade_part"},
    **{
        "mapped_color": "map_color",
        "passing": "pass_kernels",
        "reached": "light_shares",
        "run_along": "run_length_along",
    },
    **{"shone": "apply_light", "stretched": "stretched_footprint", "weighted": "weight_extinction"},
}


def one_minus_exp(x: np.ndarray) -> np.ndarray:
    return np.asarray(-np.expm1(-x))


def quick_one_minus_exp(y: np.ndarray, doublings: int) -> np.ndarray:
    """1 − 2^−y of a depth that was halved `doublings` times."""
    return np.asarray(-np.expm1(-y * 2.0**doublings * np.log(2)))


def hidden_by(depth: np.ndarray) -> np.ndarray:
    return one_minus_exp(depth)


def join_splat(light: np.ndarray, color: np.ndarray, value: np.ndarray, how: str) -> np.ndarray:
    """Light [4, N] and a splat's behind it: colour [3, N] and opacity, or the sum's term, [N]."""
    added = np.concatenate([color, np.ones((1, len(value)))]) * value
    if how == "max":
        return np.maximum(light, added)
    return np.asarray(light + added * (1 - light[3] if how == "over" else 1.0))


def join_matter(light: np.ndarray, matter: np.ndarray, how: str) -> np.ndarray:
    """Light [4, N] and a box's emission and optical depth behind it, or its opacity."""
    if how == "over":
        matter = matter * -np.expm1(-matter[3]) / matter[3]
    return join_splat(light, matter[:3] / matter[3], matter[3], how)


def joined_length(length: np.ndarray, how: str) -> np.ndarray:
    return np.ones_like(length) if how == "max" else length


def record_position(records: np.ndarray) -> np.ndarray:
    return np.asarray(records["position"], np.float64)


def read_words(records: np.ndarray) -> np.ndarray:
    """[N, 11]: place, optical depth or value, colour or gradient, normal, runs; 0 where there is none."""
    names = records.dtype.names or ()
    post = "value" in names
    color = records["gradient"] if post else linear_color(records)
    found = [record_position(records), records["value" if post else "optical_depth"][:, None], color]
    found += [np.zeros((len(records), 4)) if post else np.column_stack([records["normal"], records["runs"]])]
    return np.concatenate(found, axis=1)


def packed_color(color: np.ndarray) -> np.ndarray:
    """uint64 [2, N]: 21 bits of red and 11 of green, 21 of blue and 10 of green."""
    r, g, b = np.rint(color * (2**21 - 1)).astype(np.uint64)
    return np.stack([r + (g % 2**11) * 2**21, b + (g // 2**11) * 2**21])


def unpacked_color(words: np.ndarray) -> np.ndarray:
    low, high = words % 2**21, words // 2**21
    return np.stack([low[0], high[0] + high[1] * 2**11, low[1]]) / (2**21 - 1)


def packed_gradient(gradient: np.ndarray, others: np.ndarray) -> np.ndarray:
    """uint32 [4, N]: the last bytes of 17 bits a component in those of three others; powers of two from −23 to 8."""
    power = np.clip(np.frexp(np.abs(gradient).max(axis=0))[1], -22, 9).astype(np.int64)
    parts = np.clip(np.rint(np.ldexp(gradient, 16 - power)), -65535, 65535).astype(np.int64)
    high = (parts >> 8) % 512
    word = high[0] + high[1] * 2**9 + high[2] * 2**18 + (power + 22) * 2**27
    return np.concatenate([others // 256 * 256 + parts % 256, word[None]])


def unpacked_gradient(words: np.ndarray) -> np.ndarray:
    high = np.stack([words[3] % 2**9, words[3] // 2**9 % 2**9, words[3] // 2**18 % 2**9])
    parts = ((high + 256) % 512 - 256) * 256 + words[:3] % 256
    return np.asarray(np.ldexp(parts.astype(float), words[3] // 2**27 - 22 - 16))


def weight(samples: int) -> np.ndarray:
    """Of samples −1 to `samples` in a pixel's mean, times `samples`: what a mean is of one sample alone."""
    means = []
    for j in range(-1, samples + 1):
        picture = np.zeros((3 * samples, samples, 1))
        picture[samples + j] = 1.0
        means.append(float(pixel_means(picture, samples)[1, 0, 0]))
    return np.array(means) * samples


def below(at: np.ndarray, ground: int) -> np.ndarray:
    """Linear light [N] of the ground at pixels [2, N]: black, white, or checks of 16 pixels."""
    checks = np.where((at // 16).sum(axis=0) % 2 == 0, 0.05, 0.1)
    return checks if ground == 2 else np.full(at.shape[1], float(ground))


def texts(tree: ast.Module) -> Iterator[str]:
    """All strings of a file but its docstrings."""
    said = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said:
            yield node.value


@pytest.mark.long
def test_every_function_has_a_twin() -> None:
    """A Python function or method of its name, or of OTHER_NAMES, also of tests, and a test that runs it."""
    root = Path(__file__).parents[2]
    tests = [ast.parse(path.read_text(encoding="utf-8")) for path in sorted(root.glob("tests/*/*twins*.py"))]
    paths = [
        *(root / "splatgl").rglob("*.py"),
        *(root / "tests" / "helpers").glob("*.py"),
        root / "scripts" / "paper" / "forms.py",
    ]
    files = [ast.parse(path.read_text(encoding="utf-8")) for path in paths]
    nodes = [node for tree in tests + files for node in ast.walk(tree)]
    named = {node.name.lstrip("_") for node in nodes if isinstance(node, ast.FunctionDef)}
    run = {name for tree in tests for text in texts(tree) for name in CALL.findall(text)}
    found = set(functions())
    assert found - PLUMBING - run == set()
    assert {OTHER_NAMES.get(name, name) for name in found - PLUMBING} - named == set()
    assert PLUMBING - found == set()


def test_opacities(twin: Twin, rng: np.random.Generator) -> None:
    depth = 10.0 ** rng.uniform(-9, 1.4, COUNT)
    exact = twin("optics.glsl", "result.x = one_minus_exp(x)", x=depth)[:, 0]
    missed = np.abs(exact / one_minus_exp(depth) - 1)
    # below 1/16 a series, to the last digit
    assert missed.max() < 3e-6 and missed[depth < 1 / 16].max() < 3e-7
    for doublings in (2, 5):
        # as deep as that many halvings are meant for
        y = depth[depth < 2**doublings * np.log(2)] / np.log(2) / 2**doublings
        expression = "result.x = quick_one_minus_exp(x)"
        quick = twin("optics.glsl", expression, state={"DOUBLINGS": doublings}, x=y)[:, 0]
        assert np.abs(quick / quick_one_minus_exp(y, doublings) - 1).max() < 2e-6
    for tiled in (0, 1):
        expression = f"result.x = hidden_by(x * {'QUICK_SCALE' if tiled else '1.0'})"
        found = twin("footprint_eval.glsl", expression, state={"TILED": tiled}, x=depth)[:, 0]
        assert np.abs(found / hidden_by(depth) - 1).max() < 3e-6


def test_blending(twin: Twin, rng: np.random.Generator) -> None:
    """A footprint's opacity by 3e−6 of itself, and what it adds to a pixel by 3e−7; sums and maxima take the value."""
    depth, share = 10.0 ** rng.uniform(-6, 1, COUNT), rng.uniform(0.05, 1, COUNT)
    light, color = rng.random((4, COUNT)), rng.random((3, COUNT))
    by_opacity = {"JOIN": "JOIN_OVER", "ATTENUATION": "ATTENUATION_OPACITY"}
    expression = "coverage = a.y; result.x = blended(a.x)"
    inputs = np.stack([depth, share], axis=1)
    found = twin("footprint_eval.glsl", expression, state=by_opacity, a=inputs)[:, 0]
    assert np.abs(found / blend_opacity(depth, share) - 1).max() < 3e-6
    expression = """
        Joined it;
        it.offset = vec2(0.0); it.shape = vec4(0.0); it.around = false;
        splat = vec4(c, d * (IN_ORDER ? QUICK_SCALE : 1.0));
        result = join_splat(light, c, blended(splat.a * share_at(it, Ray(1.0, 1.0, 1.0), 0.0)))
    """
    splats = noise()
    for how, blend in (("over", "composite"), ("sum", "xray"), ("max", "mip")):
        settings = SPLATS.replace(blend=blend, antialias="off", tolerance=1e-6)
        plan = sg.plan(splats, views(splats)["fitted"], settings, tiles=True)
        found = twin("tile_draw.comp", expression, plan, splats, {"DOUBLINGS": 5}, light=light.T, c=color.T, d=depth)
        value = blend_opacity(depth, np.ones(COUNT)) if how == "over" else depth
        assert np.abs(found.T - join_splat(light, color, value, how)).max() < 5e-6 * max(value.max(), 1.0)
        state, matter = {"JOIN": f"JOIN_{how.upper()}"}, np.concatenate([color * depth, depth[None]])
        found = twin("optics.glsl", "result = join_matter(l, m)", state=state, l=light.T, m=matter.T)
        assert np.abs(found.T - join_matter(light, matter, how)).max() < 5e-6 * max(value.max(), 1.0)
        found = twin("optics.glsl", "result.x = joined_length(d)", state=state, d=depth)[:, 0]
        assert np.abs(found / joined_length(depth, how) - 1).max() < 1e-6


@pytest.mark.parametrize("grid", GRIDS)
def test_matter_that_is_widened(grid: str, twin: Twin, rng: np.random.Generator) -> None:
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)["far"], SPLATS.replace(attenuation="fill"), tiles=True)
    depth = 10.0 ** rng.uniform(-4, 2, COUNT)
    codes = rng.integers(0, 20, (3, COUNT))
    runs = codes[0] + 32 * codes[1] + 1024 * codes[2]
    voxel = plan.view.voxels(rng.uniform(0, 12, (COUNT, 3)))
    pixel, coverage = rng.uniform(1, 12, COUNT), rng.uniform(0.01, 1, COUNT)
    index = plan.view.index_from_eye @ voxel
    expression = "result.x = filled_depth(a.x, i, a.y, a.z, int(a.w + 0.5))"
    inputs = np.stack([depth, coverage, pixel, runs], axis=1)
    found = twin("attenuation.glsl", expression, plan, splats, a=inputs, i=index.T)[:, 0]
    widths = np.linalg.norm(plan.view.eye_from_index, axis=0)
    along = index / np.linalg.norm(voxel, axis=0)
    right = fill_depth(depth, along, widths, pixel, coverage, runs)
    assert np.abs(found / right - 1).max() < 2e-5
    length = twin("attenuation.glsl", "result.xyz = run_lengths(int(a.w + 0.5))", plan, splats, a=inputs)[:, :3]
    assert np.abs(length.T / run_lengths(runs) - 1).max() < 1e-6
    assert (run_lengths(runs) == np.exp2(codes * OCTAVES)).all()
    expression = "result.x = run_along(i, int(a.w + 0.5))"
    found = twin("attenuation.glsl", expression, plan, splats, a=inputs, i=index.T)[:, 0]
    assert np.abs(found / run_length_along(index, runs) - 1).max() < 1e-5


@pytest.mark.parametrize("name", ["far", "parallel, far"])
@pytest.mark.parametrize("grid", GRIDS)
def test_matter_of_splats(grid: str, name: str, twin: Twin) -> None:
    """The depth that fills a splat's pixel as its matter does, by 2e−5 of itself."""
    splats = noise(grid)
    plan = sg.plan(splats, views(splats)[name], SPLATS.replace(attenuation="fill"), tiles=True)
    voxel = plan.view.voxels(splats.positions)
    coverage = plan.view.coverage(voxel[2])
    expression = "in_optical_depth = a.x; in_runs = int(a.y + 0.5); result.x = attenuated_depth(v, a.z)"
    inputs = np.stack([splats.records["optical_depth"], splats.runs, coverage], axis=1)
    found = twin("splat_setup.glsl", expression, plan, splats, v=voxel.T, a=inputs)[:, 0]
    right = FootprintRow.of(plan.view, "row1", voxel, splats.grid).attenuate_depth(splats, "fill")
    assert coverage.max() < 1 and np.abs(found / right - 1).max() < 2e-5


@pytest.mark.parametrize("light", ["head", "matte", "glossy", "flat"])
def test_light(light: Any, twin: Twin, rng: np.random.Generator) -> None:
    splats = noise("sheared")
    for camera in (views(splats)["fitted"], views(splats)["parallel"]):
        plan = sg.plan(splats, camera, SPLATS.replace(shading="on", light=light))
        voxel = plan.view.voxels(splats.positions)
        expression = "in_normal = ivec3(round(n)); in_color = c; result.rgb = shone(v)"
        normal = splats.records["normal"].astype(np.float64)
        color = rng.random((len(splats), 3))
        found = twin("splat_setup.glsl", expression, plan, splats, v=voxel.T, n=normal, c=color)[:, :3]
        assert np.abs(found - apply_light(color, splats, camera, voxel, plan.resolved)).max() < 5e-6


@pytest.mark.parametrize("record", [VOXEL, VALUE, POINT, POINT_VALUE])
def test_records(record: np.dtype, twin: Twin, rng: np.random.Generator) -> None:
    """Every field comes out of a record's words, colours of voxels to the last digit."""
    records = np.zeros(COUNT, record)
    for name in set(record.names or ()) - {"unused"}:
        field = records[name]
        kind = np.iinfo(field.dtype) if field.dtype.kind in "iu" else None
        field[:] = rng.integers(kind.min, kind.max + 1, field.shape) if kind else rng.normal(size=field.shape)
    # halves of words: floats hold them exactly
    halves = np.pad(records.view(np.uint16).reshape(COUNT, -1), ((0, 0), (0, 20 - record.itemsize // 2)))
    inputs = dict(zip("abcde", halves.reshape(COUNT, 5, 4).transpose(1, 0, 2), strict=True))
    pair = "uvec2({0}.xz + 0.5) + uvec2({0}.yw + 0.5) * 65536u"
    a, b, c, d, e = (pair.format(name) for name in "abcde")
    first, second, rest = f"uvec4({a}, {b})", f"uvec4({c}, {d})", f"{e}"
    state = {"POINTS": is_points(record), "STEPS": int("value" in (record.names or ()))}
    if not is_points(record):
        second, rest = "uvec4(0u)", c
    fields = "vec4(in_position, in_optical_depth)", "vec4(in_color, in_runs)", "vec4(in_normal, 0)"
    read = [
        twin("records.glsl", f"read_words({first}, {second}, {rest}); result = {some}", state=state, **inputs)
        for some in fields
    ]
    found, right = np.concatenate([*read[:2], read[2][:, :3]], axis=1), read_words(records)
    if "value" in (record.names or ()):
        found[:, 7:] = 0  # without light and runs
    assert np.abs(found[:, [0, 1, 2, 3, 4, 5, 6, 8, 9, 10, 7]] - right).max() <= (6e-8 if record == VOXEL else 0)
    place = twin("records.glsl", f"result.xyz = record_position({first})", state=state, **inputs)[:, :3]
    assert (place == record_position(records)).all()


def test_colours_of_tiles(twin: Twin, rng: np.random.Generator) -> None:
    """In words as in Python but for the last of 21 bits; they come back within half of 2⁻²¹, and float32."""
    color = rng.random((3, COUNT))
    # halves of words: floats hold them exactly
    expression = "uvec2 w = packed_color(a); result = vec4(w.x & 0xffffu, w.x >> 16, w.y & 0xffffu, w.y >> 16)"
    halves = twin("tiles.glsl", expression, a=color.T).T.astype(np.uint64)
    words = halves[::2] + halves[1::2] * 2**16
    assert np.abs(unpacked_color(words) - unpacked_color(packed_color(color))).max() < 1.01 * 2.0**-21
    expression = "uvec4 b = uvec4(a + 0.5); result.xyz = unpacked_color(b.xz + b.yw * 65536u)"
    found = twin("tiles.glsl", expression, a=halves.T)[:, :3].T
    assert np.abs(found - unpacked_color(words)).max() < 1e-7
    assert np.abs(found - color).max() < 3.5e-7


def test_gradients_of_tiles(twin: Twin, rng: np.random.Generator) -> None:
    """To 2⁻¹⁶ of the power of two above the largest component; what lends its last bytes keeps 15 bits."""
    gradient = rng.normal(size=(3, COUNT)) * 10.0 ** rng.uniform(-6, 2, COUNT)
    gradient[:, :4] = np.array([[0, 1, -2, 1e-30], [0, 0, 2, 0], [0, 0, -2, 0]])
    others = rng.uniform(0.01, 100, (3, COUNT)).astype(np.float32)
    words = packed_gradient(gradient.astype(np.float32), others.view(np.uint32).astype(np.int64))
    above = 2.0 ** np.clip(np.frexp(np.abs(gradient).max(axis=0))[1], -22, 9)
    assert (np.abs(unpacked_gradient(words) - gradient) <= 1.01 * 2.0**-16 * above).all()
    given = {"a": gradient.T, "b": others.T}
    packed = "uvec4 w = packed_gradient(a, floatBitsToUint(b)); "
    for half in ("w & 0xffffu", "w >> 16"):
        found = twin("tiles.glsl", packed + f"result = vec4({half})", **given).T
        right = words % 2**16 if "&" in half else words // 2**16
        # what is rounded in the middle may go either way
        assert (found == right).mean() > 0.999
    found = twin("tiles.glsl", packed + "result.xyz = unpacked_gradient(w)", **given)[:, :3].T
    assert (np.abs(found - gradient) <= 1.01 * 2.0**-16 * above).all()
    kept = twin("tiles.glsl", packed + "result.xyz = uintBitsToFloat(w.xyz)", **given)[:, :3].T
    assert np.abs(kept / others - 1).max() < 2.0**-15


@pytest.mark.parametrize("samples", [1, 2, 3, 5])
def test_weights_of_samples(samples: int, twin: Twin) -> None:
    state = {"samples": samples, "ends": END_CORRECTION}
    found = twin(
        "resolve.frag", "result.x = weight(int(round(j)), samples)", state=state, j=np.arange(-1, samples + 1)
    )[:, 0]
    assert np.abs(found - weight(samples)).max() < 1e-7


def test_the_window_s_colours(twin: Twin, rng: np.random.Generator) -> None:
    """sRGB by 0.01 of a level of 255; the ground to float32."""
    light = rng.random((COUNT, 3)) ** 3
    found = twin("screen.frag", "result.xyz = srgb_from_linear(a)", a=light)[:, :3]
    assert np.abs(found - srgb_from_linear(light)).max() < 0.0101 / 255
    at = rng.uniform(0, 500, (2, COUNT))
    for ground in (0, 1, 2):
        state = {"ground": ground, "background": (0.0, 0.0, 0.0, 0.0)}
        found = twin("screen.frag", "result.xyz = below(a)", state=state, a=at.T)[:, :3].T
        assert np.abs(found - below(at, ground)).max() < 1e-7


def test_splats_of_web_pages(twin: Twin, rng: np.random.Generator) -> None:
    """Linear light to float32; normals within half a step of 16 bits, zero without one."""
    page: Any = {"QUANTIZED": 1}
    color = rng.random((COUNT, 3))
    found = twin("splat_setup.glsl", "result.xyz = linear_from_srgb(a)", state=page, a=color)[:, :3]
    assert np.abs(found - linear_from_srgb(color)).max() < 1e-6
    code = rng.integers(1, 256, (COUNT, 2))
    code[0] = 0
    expression = "result.xyz = vec3(octahedral_normal(uvec2(a + 0.5)))"
    found = twin("splat_setup.glsl", expression, state=page, a=code)[:, :3]
    assert np.abs(found / 32767 - octahedral_normal(code)).max() < 0.51 / 32767 + 1e-6

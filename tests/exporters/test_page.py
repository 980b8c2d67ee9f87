"""Pages of `splatgl export`: what is in them, and what they draw, against float64 and the default picture."""

from __future__ import annotations

import base64
import io
import json
import re
import zlib
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl.cli.main import main
from splatgl.exporters.layers import LEFT_OUT
from splatgl.exporters.page import WebPage, camera_json, over, page_settings
from splatgl.gl.features import FRAME, frame_block
from splatgl.gl.passes import draw_quantized
from splatgl.planning.plan import plan
from splatgl.scene.api import opened, scene_of
from splatgl.scene.draw import DrawOptions
from splatgl.splat.kernels import kernel
from tests.helpers.page_reference import BROWSER, PageSplats, draw, in_browser, part

# largest and root mean square difference of a page from the float64 reference of its splats, linear light: the guide's;
# where voxels are much smaller than a pixel, half floats lose more of their faint opacities
MOST, MOST_RMS, MOST_FAR = 4 / 255, 1 / 255, 10 / 255
FIELDS: Any = FRAME.fields
KERNEL = kernel("crawfis-max")
SIZE = 40


def blobs(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), tilt: bool = False) -> sg.Volume:
    """Soft balls in 14×12×10 voxels."""
    z, y, x = np.mgrid[0:10, 0:12, 0:14].astype(float)
    values = 200 * np.exp(-((x - 5) ** 2 + (y - 5) ** 2 + (z - 4) ** 2) / 12)
    values += 120 * np.exp(-((x - 10) ** 2 + (y - 8) ** 2 + (z - 6) ** 2) / 6)
    turn = np.linalg.qr(np.array([[1, 0.3, 0], [-0.2, 1, 0.1], [0, 0.3, 1.0]]))[0] if tilt else np.eye(3)
    return sg.Volume(values.astype(np.float32), spacing, (3.0, -2.0, 5.0), turn, name="blobs")


LOOK: dict[str, Any] = {"points": [(20, 0.0), (120, 0.5), (200, 0.9)], "colormap": "hot", "window": (20, 200)}
SCENES: dict[str, tuple[sg.Volume, dict[str, Any]]] = {
    "cubes": (blobs(), {**LOOK, "shading": "on"}),
    "long voxels, tilted": (blobs((1.0, 0.8, 2.5), tilt=True), LOOK),
    "parallel": (blobs(), {**LOOK, "view": sg.View(orthographic=True, elevation=50)}),
    "maxima": (blobs((1.0, 0.8, 2.5)), {**LOOK, "blend": "mip"}),
    "far": (blobs(), {**LOOK, "zoom": 0.2}),
    "colours of its own": (sg.scenes.tunnel(), {"size": 24, "crop": "0:40,0:40,100:104"}),
}


def page_of(name: str, most: int = 600) -> WebPage:
    volume, options = SCENES[name]
    scene = opened(scene_of(volume, None, None, None, {"size": SIZE, **options}))
    return WebPage.of(scene, DrawOptions(is_shared=True), most, 8, "splatgl export blobs")


def read_page(x: Any, most: int, bits: int = 8, **options: Any) -> PageSplats:
    """The splats of a page, in float64."""
    scene = opened(scene_of(x, None, None, None, {"size": SIZE, **options}))
    return PageSplats(WebPage.of(scene, DrawOptions(is_shared=True), most, bits, "").html)


@pytest.mark.parametrize("name", [name for name in SCENES if name != "colours of its own"])
def test_pages_agree_with_float64(name: str, renderer: sg.Renderer) -> None:
    """By the shaders of pages in OpenGL, from what a page holds; half-float targets."""
    exported = page_of(name)
    page, matter, home = PageSplats(exported.html), exported.matter, exported.scene.camera
    assert len(page.position) == len(exported.splats) <= 600 < matter.found or matter.found <= 600
    for camera in (home, replace(home, eye=home.eye + 0.7)):
        planned = plan(matter.outline, camera, page_settings(exported.scene.settings))
        found = draw_quantized(renderer.passes, exported.splats, planned)
        right = draw(page, camera_json(camera), KERNEL)
        assert right[..., 3].max() > 0.3
        assert np.abs(found - right).max() < (MOST_FAR if name == "far" else MOST)
        assert np.sqrt(np.mean((found - right) ** 2)) < MOST_RMS


def test_a_page_holds_what_it_says(tmp_path: Path) -> None:
    target = tmp_path / "blobs.html"
    assert sg.export(blobs(), target, size=SIZE, splats=300, **LOOK) == target
    html = target.read_text("utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', html) and "http" not in re.sub(
        r"http://www.w3.org/2000/svg|http-equiv", "", html
    )
    # the first picture is the default one
    png = re.findall(r'src="data:image/png;base64,(.*?)"', html)[0]
    shown = np.asarray(Pillow.open(io.BytesIO(base64.b64decode(png))).convert("RGB"))
    default = sg.render(blobs(), size=SIZE, **LOOK)
    assert np.array_equal(shown, default.samples8((0, 0, 0))[..., :3])
    scene = json.loads(part(html, "scene"))
    assert scene["count"] <= 300 and [layer["name"] for layer in scene["layers"]] == ["blobs"]
    assert re.search(r"RMSE [\d.]+ levels of 255", html) and "joined from" in html
    for word in (
        "aria-label",
        "Opacity",
        "Window",
        "Full screen",
        "prefers-color-scheme",
        "@media print",
        "sg.export(",
    ):
        assert word in html


def test_the_stated_error_is_that_of_the_splats(renderer: sg.Renderer) -> None:
    volume, options = SCENES["cubes"]
    scene = opened(scene_of(volume, None, None, None, {"size": SIZE, **options}))
    page = WebPage.of(scene, DrawOptions(is_shared=True), 10_000, 8, "")
    right = draw(PageSplats(page.html), camera_json(scene.camera), KERNEL)
    ground = np.array(scene.settings.ground or (0, 0, 0))
    levels = 255 * (over(right, ground) - over(page.image.pixels, ground))
    assert page.rmse == pytest.approx(np.sqrt(np.mean(levels**2)), abs=0.25)
    # fewer splats, a larger error
    assert WebPage.of(scene, DrawOptions(is_shared=True), 100, 8, "").rmse > page.rmse > 0


def test_packed_splats_are_read_back() -> None:
    splats = page_of("cubes").splats
    data = splats.packed()
    halves = np.ascontiguousarray(np.frombuffer(zlib.decompress(data), np.uint8).reshape(16, -1).T).view("<u2")
    halves[:, :3] = np.cumsum(halves[:, :3], axis=0, dtype=np.uint16)
    halves[:, 3] ^= halves[:, 3] >> 8
    assert np.array_equal(halves, splats.records.view("<u2").reshape(-1, 8))
    # a shaded splat takes few bytes
    assert len(data) < 8 * len(splats)


def test_quantisation(renderer: sg.Renderer) -> None:
    """Positions are exact, opacities within a step of shares, values within half a step, normals within 1°."""
    exact = sg.extract(blobs(), sg.Transfer(**LOOK), classification="pre")
    for bits in (8, 16):
        splats = read_page(blobs(), 10**6, bits, **LOOK, shading="on")
        assert len(splats.depth) == len(exact) and (splats.size == 1).all()
        right = exact.positions @ exact.grid.world_from_index.T + exact.grid.origin
        assert np.abs(splats.world - right).max() < 1e-9
        color, depth = splats.color, splats.depth
        faint = exact.depths > 1e-3
        assert np.abs(np.log2(depth / exact.depths)[faint]).max() < 1 / 31
        assert np.abs(color - exact.colors).max() < (0.02 if bits == 8 else 0.01)
        normal = exact.records["normal"] / 32767.0
        lit = np.linalg.norm(normal, axis=1) > 0.5
        assert (splats.normal * normal).sum(axis=1)[lit].min() > np.cos(np.radians(1))
        assert not splats.normal[~lit].any()


def test_joined_splats_keep_matter(renderer: sg.Renderer) -> None:
    """Optical depth along axes is kept on average, and hidden matter is joined before what is seen."""
    samples = np.zeros((24, 24, 24), np.uint8)
    samples[4:20, 4:20, 4:20] = 200
    look: dict[str, Any] = {"points": [(100, 0.0), (200, 0.9)], "colormap": "gray", "shading": "off"}
    splats = read_page(sg.Volume(samples), 3000, **look)
    assert len(splats.depth) <= 3000 < 16**3
    large = splats.size > 1
    depth = np.abs(splats.position - splats.position.mean(axis=0)).max(axis=1)
    assert large.any() and depth[large].max() < depth.max() - 1
    assert (splats.depth * splats.size**3).sum() == pytest.approx(16**3 * -np.log(0.1), rel=0.03)
    assert len(read_page(sg.Volume(samples), 8, **look).depth) <= 8


def test_layers_share_a_page(tmp_path: Path, renderer: sg.Renderer) -> None:
    """Layers on one grid keep it; others are resampled to that of the finest; the picture has both."""
    one, two = replace(blobs(), unit="mm"), replace(blobs((2.0, 2.0, 2.0)), name="coarse", unit="mm")
    scene = sg.Scene([sg.Layer(one, sg.Transfer(**LOOK)), sg.Layer(two, sg.Transfer([(30, 0), (150, 0.5)], "viridis"))])
    view = opened(scene_of(scene, None, None, None, {"size": (SIZE, SIZE)}))
    exported = WebPage.of(view, DrawOptions(is_shared=True), 10**5, 8, "")
    splats = exported.splats
    assert [layer.name for layer in splats.layers] == ["blobs", "coarse"] and "resampled" in exported.notes[0]
    assert set(np.unique(splats.records["kind"] >> 3)) == {0, 1}
    # opacities refer to the spacing of the layer itself, twice the page's
    page = PageSplats(exported.html)
    assert page.scene["unit"] == "mm" and [bar["title"] for bar in page.scene["bars"]] == ["blobs", "coarse"]
    depth = page.depth[page.layer == 1].max()
    most = sg.Transfer([(30, 0), (150, 0.5)]).opacity(np.array([np.nanmax(two.samples)]))[0]
    assert depth == pytest.approx(-np.log1p(-most) / 2, rel=0.1)
    target = sg.export(scene, tmp_path / "two.html", size=(SIZE, SIZE))
    right = draw(PageSplats(target.read_text("utf-8")), camera_json(view.camera), KERNEL)
    assert np.abs(exported.pixels - right).max() < MOST


def test_points_are_in_a_page(tmp_path: Path) -> None:
    points = np.random.default_rng(3).uniform(0, 10, (200, 3))
    splats = sg.Splats.from_points(points, np.full((200, 3), 0.5), np.full(200, 2.0), spacing=0.5)
    page = PageSplats(sg.export(splats, tmp_path / "points.html", size=SIZE).read_text("utf-8"))
    apart = np.linalg.norm(page.world[:, None] - points[None], axis=2).min(axis=1)
    assert len(page.world) == 200 and apart.max() < 1e-3
    with pytest.raises(sg.InputError, match="splats: expected at least 200"):
        sg.export(splats, tmp_path / "few.html", size=SIZE, splats=50)
    with pytest.raises(sg.InputError, match="expected iso-surfaces, meshes or streamlines, got none"):
        sg.export(splats, tmp_path / "few.glb", size=SIZE)


def test_meshes_and_slices_are_left_out_of_pages() -> None:
    """With a note, or alone with an error."""
    with pytest.raises(sg.InputError, match="slices: expected a volume without slices, got some"):
        sg.export(blobs(), size=SIZE, slices="z")
    corners = np.array([[3.0, -2.0, 5.0], [9.0, -2.0, 5.0], [3.0, 8.0, 5.0]])
    mesh = sg.Mesh(corners, np.array([[0, 1, 2]]))
    page = sg.export(sg.Scene([blobs()], meshes=[mesh]), size=SIZE)
    assert page.notes == (LEFT_OUT,) and LEFT_OUT in page.html
    with pytest.raises(sg.InputError, match="got none; meshes, streamlines and slices are left out"):
        sg.export(sg.Scene([sg.Layer(blobs(), sg.Transfer([(900, 0), (1000, 1)]))], meshes=[mesh]), size=SIZE)


def test_frames_of_pages_are_those_of_opengl() -> None:
    """The page's module writes the fields that it needs by these offsets."""
    page = page_of("cubes")
    scene = json.loads(part(page.html, "scene"))
    assert scene["frame"]["size"] == FRAME.itemsize
    assert scene["frame"]["offsets"]["pixel_pitch"] == FIELDS["pixel_pitch"][1]
    assert len(page.splats) == scene["count"]


BAD = [
    (["blobs.txt"], "a name that ends in .html"),
    (["blobs.html", "--splats", "0"], "a whole number"),
    (["blobs.html", "--iso", "100"], "iso: expected no iso-surfaces among splats"),
    (["blobs.html", "--splats", "99999999"], "--splats: expected a whole number from 1 to 16777216"),
    (["blobs.spz", "--points", "900:0,1000:1"], "expected voxels with an opacity above the threshold 0, got none"),
    (
        ["blobs.html", "--blend", "xray"],
        "blend of a page: expected composite or mip, got xray",
    ),
    (["blobs.ply", "--blend", "mip"], "blend of Gaussians: expected composite, got mip"),
    (["blobs.html", "--max-size", "1kB"], "expected a page of at most"),
    (["missing/blobs.html", "--format", "obj"], "invalid choice"),
    (["blobs.html", "--points", "900:0,1000:1"], "expected"),
    (["blobs.glb"], "expected iso-surfaces, meshes or streamlines, got none"),
]


@pytest.mark.parametrize(("words", "message"), BAD, ids=lambda x: " ".join(x) if isinstance(x, list) else "")
def test_bad_input_is_one_line(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "blobs.nrrd"
    blobs().save(source)
    try:
        code = main(["export", str(source), "--size", "32", "-o", str(tmp_path / words[0]), *words[1:]])
    except SystemExit as error:
        code = int(error.code or 0)
    (line,) = capsys.readouterr().err.splitlines()
    assert code == 2 and message in line
    assert [path.name for path in tmp_path.iterdir()] == ["blobs.nrrd"]


def test_a_folder_is_no_page(tmp_path: Path) -> None:
    (tmp_path / "x.html").mkdir()
    with pytest.raises(sg.InputError, match="expected a file to write, got a directory"):
        sg.export(blobs(), tmp_path / "x.html")


def test_the_command_tells_size_and_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = tmp_path / "blobs.nrrd", tmp_path / "blobs.html"
    blobs().save(source)
    assert main(["export", str(source), "-o", str(target), "--size", "32", "--splats", "500"]) == 0
    told = r"blobs.html: [\d.]+ KiB, \d+ splats of [\d,]+ voxels, RMSE [\d.]+ levels of 255"
    assert re.search(told, capsys.readouterr().out)
    html = target.read_text("utf-8")
    assert "splatgl" in html and str(tmp_path) not in html


def test_a_notebook_keeps_a_page() -> None:
    """Without a path, in a frame; nothing is written."""
    page = sg.export(blobs(), size=SIZE, splats=300, **LOOK)
    (frame,) = re.findall(r'srcdoc="([^"]*)"', page._repr_html_())
    assert unescape(frame) == page.html and "sg.export(…, size=40, splats=300" in page.html
    assert repr(page).startswith("<WebPage: ") and "of 753 voxels, RMSE" in repr(page)
    with pytest.raises(sg.InputError, match="path: expected a file to write, got none"):
        sg.export(blobs(), format="ply")


CAMERAS = """
const found = [];
for (const [camera, antialias] of CAMERAS) {
  found.push(Array.from(view.painter.pixels(camera, camera.size, antialias, (each) => each.extent)));
}
return found;
"""


@pytest.mark.long
@pytest.mark.parametrize("name", SCENES)
def test_browsers_agree_with_float64(name: str, tmp_path: Path) -> None:
    """Chromium draws the splats of a page from several sides; so does float64."""
    if BROWSER is None:
        pytest.skip("Chromium is not here")
    html = page_of(name).html
    page, home = PageSplats(html), json.loads(part(html, "scene"))["camera"]
    views = [(home, True), (home, False)]
    for turn in (70.0, 140.0, 250.0):
        volume, options = SCENES[name]
        more = {} if name == "colours of its own" else {"azimuth": turn, "elevation": turn / 4}
        camera = opened(scene_of(volume, None, None, None, {"size": SIZE, **options, **more})).camera
        views.append((camera_json(camera), True))
    script = CAMERAS.replace("CAMERAS)", f"{json.dumps(views)})")
    for (camera, antialias), pixels in zip(views, in_browser(html, script, tmp_path), strict=True):
        width, height = camera["size"]
        found, right = np.array(pixels).reshape(height, width, 4), draw(page, camera, KERNEL, antialias)
        assert right[..., 3].max() > 0.3
        assert np.abs(found - right).max() < (MOST_FAR if name == "far" else MOST)
        assert np.sqrt(np.mean((found - right) ** 2)) < MOST_RMS


@pytest.mark.long
def test_a_page_in_a_browser(tmp_path: Path) -> None:
    """Its module draws what was told, turns, zooms, cuts, moves the window, and resets."""
    if BROWSER is None:
        pytest.skip("Chromium is not here")
    volume, options = SCENES["cubes"]
    scene = opened(scene_of(volume, None, None, None, {"size": SIZE, **options}))
    page = WebPage.of(scene, DrawOptions(is_shared=True), 600, 8, "")
    script = """
    const shot = () => Array.from(view.painter.pixels(view.camera, [SIZE, SIZE], true, (each) => each.extent));
    const size = [SIZE, SIZE], block = (name, count) => {
      const { frameBlock } = view.constructor;
      const { block } = frameBlock(view.camera, scene.grid, scene.frame, size, (each) => each.extent);
      return Array.from(block.slice(scene.frame.offsets[name] / 4, scene.frame.offsets[name] / 4 + count));
    };
    view.paint();
    const state = document.getElementById("state").textContent;
    const found = { first: shot(), live: view.stage.classList.contains("live"), state };
    found.frame = Object.fromEntries(["eye_from_index", "index_from_eye", "eye_from_world", "base", "eye_from_base",
      "clip_scale", "pixel_pitch", "near", "image_center", "blur"].map((name) => [name, block(name, NUMBERS[name])]));
    view.annotate(); const home = view.svg.innerHTML;
    view.press("ArrowLeft"); found.turned = shot();
    dispatchEvent(new Event("beforeprint")); found.printed = view.svg.innerHTML === home;
    dispatchEvent(new Event("afterprint")); found.back = view.svg.innerHTML !== home;
    view.press("r");
    view.stage.setPointerCapture = () => 0;
    const at = (type, finger) => view.stage.dispatchEvent(new PointerEvent(type, finger));
    const touch = (type, pointerId, clientX) => at(type, { pointerId, clientX });
    const distance = () => Math.hypot(...view.camera.eye.map((x, n) => x - view.target[n])), far = distance();
    touch("pointerdown", 1, 10); touch("pointerdown", 2, 30); touch("pointermove", 2, 50); touch("pointerup", 1, 10);
    found.pinched = far / distance(); touch("pointerup", 2, 50); view.press("r");
    view.zoom(2); found.near = shot(); view.press("r");
    view.cut("0-", 0.5); found.cut = shot(); view.cut("", 0);
    view.painter.classify(0.2, 0); found.faint = shot();
    view.painter.classify(1, 0.3); found.moved = shot(); view.painter.classify(1, 0);
    found.again = shot();
    found.texts = [...view.svg.querySelectorAll("text")].map((each) => each.textContent);
    return found;
    """
    names = ["eye_from_index", "index_from_eye", "eye_from_world", "base", "eye_from_base"]
    names += ["clip_scale", "pixel_pitch", "near", "image_center", "blur"]
    numbers = {name: FIELDS[name][0].itemsize // 4 for name in names}
    found = in_browser(
        page.html, script.replace("SIZE", str(SIZE)).replace("NUMBERS[", f"({json.dumps(numbers)})["), tmp_path
    )
    first = np.array(found["first"]).reshape(SIZE, SIZE, 4)
    assert found["live"] and found["state"] == "" and found["again"] == found["first"]
    # the picture whose error the page states
    assert np.abs(first - page.pixels).max() < MOST
    ground = np.array(scene.settings.ground or (0, 0, 0))
    levels = 255 * (over(first, ground) - over(page.image.pixels, ground))
    assert np.sqrt(np.mean(levels**2)) == pytest.approx(page.rmse, abs=0.2)
    planned = plan(page.matter.outline, scene.camera, page_settings(scene.settings))
    block = frame_block(planned.splats, planned)
    for name, values in found["frame"].items():
        assert np.allclose(np.ravel(block[name]), values, rtol=1e-5, atol=1e-6), name
    mass = {
        name: np.array(found[name]).reshape(-1, 4)[:, 3].sum()
        for name in ("first", "near", "cut", "faint", "moved", "turned")
    }
    assert mass["near"] > 1.3 * mass["first"] > mass["first"] > mass["cut"] > 0 and mass["faint"] < 0.8 * mass["first"]
    assert 0 < mass["moved"] < 0.9 * mass["first"] and found["turned"] != found["first"]
    assert {"x", "y", "z", "100"} <= set(found["texts"])
    # the printed picture is the first one, and has its axes
    assert found["printed"] and found["back"] and found["pinched"] == pytest.approx(2)


@pytest.mark.long
def test_a_notebook_s_page_turns(tmp_path: Path) -> None:
    """In the frame of a cell's output."""
    if BROWSER is None:
        pytest.skip("Chromium is not here")
    page = sg.export(blobs(), size=SIZE, splats=300, **LOOK)
    wait = "document.querySelector('iframe').onload = ({ target }) => done(target.contentWindow.splatgl)"
    script = f"globalThis.splatgl = new Promise((done) => {{ {wait}; }})"
    html = f"<!doctype html><html><body>{page._repr_html_()}<script>{script}</script></html>"
    turns = (
        "view.paint(); const home = view.isHome; view.press('ArrowLeft'); return [home, view.isHome, !!view.painter];"
    )
    assert in_browser(html, turns, tmp_path) == [True, False, True]


@pytest.mark.long
def test_a_page_without_webgl_shows_its_picture(tmp_path: Path) -> None:
    if BROWSER is None:
        pytest.skip("Chromium is not here")
    html = page_of("cubes").html
    blocked = html.replace(
        '<script type="module">',
        '<script>HTMLCanvasElement.prototype.getContext = () => null</script>\n<script type="module">',
        1,
    )
    script = """
    const at = (name) => document.getElementById(name);
    return [view.stage.classList.contains("live"), at("state").textContent, at("controls").hidden];
    """
    assert in_browser(blocked, script, tmp_path) == [
        False,
        "This picture stands still: WebGL 2 is not available.",
        True,
    ]

"""The renderer: settings and plan, caches, what is left behind, and any backend the same picture."""

from __future__ import annotations

import gc
import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import splatgl as sg
from splatgl.data.scenes import letter_f
from splatgl.gl.buffers import uneven
from splatgl.gl.target import settle
from splatgl.planning.plan import plan
from splatgl.splat.motion import Supersampling
from splatgl.viewer.adaptive_quality import return_free_memory, return_large_blocks
from tests.helpers.memory import resident_mebibytes
from tests.helpers.splatting import SPLATS


@pytest.fixture(scope="module")
def letter() -> sg.Splats:
    return sg.extract(letter_f(), sg.default_transfer(letter_f()), classification="pre")


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"blend": "add"}, "blend: expected composite or xray or mip or attenuated-mip or minip or mean, got 'add'"),
        ({"align": "sideways"}, "align: expected auto or exact or ray or grid"),
        ({"samples": 0}, "samples: expected a whole number from 1"),
        ({"table_bits": 12}, "table_bits: expected 8, 16 or 32"),
        ({"tolerance": 0}, "tolerance: expected a number in"),
        ({"z_s": -1}, "z_s: expected a depth"),
        ({"blur_width": 0.2}, "blur_width: expected a width from 0.25 to 4 pixels"),
        ({"background": (1, 2, 3)}, "background: expected three linear numbers"),
        ({"table_size": 1}, "table_size: expected a whole number"),
    ],
)
def test_bad_settings(asked: dict, message: str) -> None:
    with pytest.raises(sg.InputError, match=message):
        SPLATS.replace(**asked)
    with pytest.raises(sg.InputError, match="names of Settings"):
        SPLATS.replace(colour="red")  # type: ignore[call-arg]


def test_plan_leaves_out_what_is_not_needed(letter: sg.Splats) -> None:
    near = sg.Camera.orbit(letter, size=(400, 400))
    far = sg.Camera.orbit(letter, size=(40, 40))
    assert not plan(letter, near, SPLATS).program.seen.antialias
    assert plan(letter, far, SPLATS).program.seen.antialias
    assert not plan(letter, far, SPLATS.replace(antialias="off")).program.seen.antialias
    assert plan(letter, far, SPLATS).program.seen.cubic
    assert plan(letter, far, SPLATS).program.appearance.shading
    assert not plan(letter, far, SPLATS.replace(blend="mip")).program.appearance.shading
    assert plan(letter, near.parallel(letter)).program.align == "grid"
    assert "widening of voxels left out" in plan(letter, near, SPLATS).explain()
    # supersampling moves z_k to the finer pixel
    assert not plan(letter, far, SPLATS.replace(antialias="supersample", samples=10)).program.seen.antialias


def test_auto_never_picks_grid(letter: sg.Splats) -> None:
    assert plan(letter, sg.Camera.orbit(letter)).program.align == "exact"
    assert plan(letter, sg.Camera.orbit(letter), SPLATS.replace(tolerance=1.0)).program.align == "exact"


def test_leaving_antialiasing_out_changes_nothing(letter: sg.Splats, renderer: sg.Renderer) -> None:
    """Every splat before z_k: with and without, bit for bit the same."""
    camera = sg.Camera.orbit(letter, 30, 20, size=(150, 150))
    settings = SPLATS.replace(technique="quads")
    chosen = plan(letter, camera, settings)
    assert not chosen.program.seen.antialias
    # one far splat forces it on; the rest of the picture must stay
    forced = renderer.render(letter, camera, settings)

    with_it = renderer.passes.draw(letter, chosen.with_choices(antialias=True))
    assert (with_it == forced.pixels).all()


@pytest.mark.long
@pytest.mark.compute
def test_the_general_path_draws_cubes_alike(letter: sg.Splats, renderer: sg.Renderer) -> None:
    """Cubic voxels through the path for any grid: the same picture within float32."""

    camera = sg.Camera.orbit(letter, 30, 20, size=(64, 64))
    chosen = plan(letter, camera)
    assert chosen.program.seen.cubic
    simple = renderer.passes.draw(letter, chosen)
    general = renderer.passes.draw(letter, chosen.with_choices(cubic=False))
    assert np.abs(simple - general).max() < 2e-4
    assert not (simple == general).all()


@pytest.mark.compute
def test_programs_used_longest_ago_are_freed_and_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings after settings: the programs of each are few, and those of all would fill the memory."""
    splats = sg.extract(sg.scenes.ball(6), sg.default_transfer(sg.scenes.ball(6)))
    camera = sg.Camera.orbit(splats, size=(24, 24))
    many = [
        SPLATS.replace(blend=blend, technique=technique, samples=2, antialias="supersample")
        for technique in ("tiles", "quads")
        for blend in ("composite", "xray", "mip")
    ]
    with sg.Renderer() as own:
        right = [own.render(splats, camera, settings).pixels for settings in many]
        programs = own.passes.device.programs
        assert programs.compiled == len(programs.kept) > 8
        monkeypatch.setattr("splatgl.gl.program.MOST_PROGRAMS", 6)
        for _ in range(2):
            before = programs.compiled
            for settings, pixels in zip(many, right, strict=True):
                assert (own.render(splats, camera, settings).pixels == pixels).all()
                assert len(programs.kept) <= 6
            assert programs.compiled > before
        # the latest ones are there
        before = programs.compiled
        own.render(splats, camera, many[-1])
        assert programs.compiled == before


@pytest.mark.compute
def test_a_moving_camera_compiles_and_makes_nothing(letter: sg.Splats, renderer: sg.Renderer) -> None:
    first = sg.Camera.orbit(letter, 0, 20, size=(48, 48))
    renderer.render(letter, first, SPLATS)
    programs, target = renderer.passes.device.programs.compiled, renderer.passes.targets.kept["draw"]
    kept = renderer.passes.device.splats.of(letter).textured
    assert kept is not None
    records = kept.records
    turn = [sg.Camera.orbit(letter, azimuth, 20, size=(48, 48)) for azimuth in range(0, 360, 30)]
    for camera in turn:
        renderer.render(letter, camera, SPLATS)
    orders = dict(kept.orders.kept)
    for camera in turn:
        renderer.render(letter, camera, SPLATS)
    assert renderer.passes.device.programs.compiled <= programs + 2
    assert renderer.passes.device.splats.of(letter).textured is kept and kept.records is records
    assert len(orders) > 8 and dict(kept.orders.kept) == orders
    assert renderer.passes.targets.kept["draw"] is target


def test_pictures_repeat_bit_for_bit(letter: sg.Splats, renderer: sg.Renderer) -> None:
    camera = sg.Camera.orbit(letter, 30, 20, size=(64, 64))
    once = renderer.render(letter, camera, SPLATS).pixels
    renderer.render(letter, sg.Camera.orbit(letter, 200, -40, size=(32, 64)), SPLATS.replace(blend="xray"))
    assert (renderer.render(letter, camera, SPLATS).pixels == once).all()


@pytest.mark.long
def test_nothing_is_left_behind(letter: sg.Splats) -> None:
    """Everything made in a context is released by close(), also after pictures of every kind."""
    import moderngl

    def alive() -> int:
        gc.collect()
        kinds = (moderngl.Buffer, moderngl.Texture, moderngl.Program, moderngl.VertexArray, moderngl.Framebuffer)
        return sum(
            isinstance(thing, kinds) and not isinstance(thing.mglo, moderngl.InvalidObject)
            for thing in gc.get_objects()
        )

    before = alive()
    with sg.Renderer() as renderer:
        for blend in ("composite", "xray", "mip"):
            for size in ((16, 16), (20, 10)):
                settings = SPLATS.replace(blend=blend, antialias="supersample", samples=2, kernel="gaussian")
                renderer.render(letter, sg.Camera.orbit(letter, size=size), settings)
        assert alive() > before
        kept = renderer
    kept.close()
    del kept, renderer
    assert alive() == before


def test_no_splats_is_the_background(renderer: sg.Renderer) -> None:
    nothing = sg.extract(sg.Volume(np.zeros((4, 4, 4))), sg.Transfer([(0, 0), (1, 1)]), classification="pre")
    assert len(nothing) == 0
    volume = sg.Volume(np.zeros((4, 4, 4)))
    image = renderer.render(nothing, sg.Camera.orbit(volume, size=(8, 8)), SPLATS.replace(background=(0.5, 0, 1)))
    assert (image.pixels == np.array([0.5, 0, 1, 1], np.float32)).all()
    assert (renderer.render(nothing, sg.Camera.orbit(nothing, size=(8, 8)), SPLATS).pixels == 0).all()


def test_a_picture_tells_whether_its_tolerance_is_met(letter: sg.Splats, renderer: sg.Renderer) -> None:
    """Of X-rays relative to the brightest component: ten times the light is ten times the error."""
    camera = sg.Camera.orbit(letter, 20, 30, size=(24, 18))
    met = {}
    for name, settings in {
        "auto": SPLATS,
        "coarse": SPLATS.replace(target="rgba8", tolerance=1e-6),
        "paper": sg.Settings.paper(),
        "xray": SPLATS.replace(blend="xray"),
        "grid xray": SPLATS.replace(blend="xray", align="grid"),
    }.items():
        image = renderer.render(letter, camera, settings)
        top = image.pixels.max() if settings.blend == "xray" else 1.0
        met[name] = image.info["tolerance_met"]
        assert met[name] is bool(image.info["error_bound"] <= settings.tolerance * top), name
    assert met == {"auto": True, "coarse": False, "paper": False, "xray": True, "grid xray": False}
    bright = replace(letter, records=letter.records.copy())
    bright.records["optical_depth"] *= 300
    image = renderer.render(bright, camera, SPLATS.replace(blend="xray"))
    assert image.info["error_bound"] > image.info["tolerance"] and image.info["tolerance_met"] is True


def test_aliasing_is_not_counted(letter: sg.Splats, renderer: sg.Renderer) -> None:
    """The reference takes the same single sample of a pixel: the tolerance that is met says nothing of aliasing."""
    told = set()
    for size in ((12, 9), (200, 150)):
        camera = sg.Camera.orbit(letter, 20, 30, size=size)
        for name in ("off", "auto", "paper", "supersample"):
            image = renderer.render(letter, camera, SPLATS.replace(antialias=name, samples=2), verify_bound=False)
            assert ("aliasing is not counted" in image.accuracy.summary) is (
                "aliasing is not counted" in str(image.accuracy)
            )
            told |= {(name, size[0])} if "aliasing" in image.accuracy.summary else set()
    # in the larger one voxels are wider than pixels
    assert told == {("off", 12)}


def test_without_a_bound_no_tolerance_is_met(letter: sg.Splats, renderer: sg.Renderer) -> None:
    inside = sg.Camera.look_at(letter.corners.mean(axis=0), letter.corners[0], (0, 0, 1), size=(12, 9))
    motion = sg.Motion(spin=np.array([0.0, 0.0, 3.0]), center=letter.corners.mean(axis=0))
    image = renderer.render(letter, inside, SPLATS.replace(motion="exact"), motion)
    assert image.info["error_bound"] is None and image.info["tolerance_met"] is None


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("technique", ["auto", "quads", "tiles"])
def test_no_splats_is_the_background_whatever_draws_them(technique: str, renderer: sg.Renderer) -> None:
    nothing = sg.Splats.from_points(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    ground = (0.5, 0.0, 1.0)
    for eye in ((0, -5, 0), (0, 0.1, 0), (0, -1e20, 0)):
        camera = sg.Camera.look_at(eye, (0, 0, 0), (0, 0, 1), size=(9, 8))
        for changes in ({}, {"footprint": "table"}, {"align": "hybrid"}, {"antialias": "supersample", "samples": 2}):
            settings = SPLATS.replace(technique=technique, background=ground, **changes)
            image = renderer.render(nothing, camera, settings)
            assert (image.pixels == np.array([*ground, 1], np.float32)).all(), (eye, changes)
            assert image.info["error_bound"] <= 1e-6 and image.info["tolerance_met"] is True
            assert (renderer.render(nothing, camera, settings.replace(blend="xray")).pixels == 0).all()


@pytest.mark.long
def test_small_textures_have_no_power_of_two_of_rows(renderer: sg.Renderer) -> None:
    """Else llvmpipe compiles shaders once more; rows and columns beyond the picture are not in it."""
    splats = sg.extract(
        sg.Volume(np.random.default_rng(1).random((6, 5, 4), np.float32)), sg.Transfer([(0, 0), (1, 1)])
    )
    for size, changes in itertools.product(((16, 8), (1, 8)), ({}, {"technique": "quads"}, {"background": (1, 0, 0)})):
        settings = sg.Settings(antialias="supersample", samples=2, **changes)
        # whose edges show matter
        camera = sg.Camera.orbit(splats, size=size, zoom=3)
        found = renderer.render(splats, camera, settings, verify_bound=False).pixels
        right = sg.reference.render(splats, camera, settings).pixels
        assert right[:, -1, 3].max() > 0.1 and np.abs(found - right).max() < 0.01
        for target in renderer.passes.targets.kept.values():
            assert all(side & (side - 1) for side in target.texture.size)
    for rows in (1, 2, 3, 64, 1023):
        assert rows <= uneven(rows) <= rows + 2 and uneven(rows) & (uneven(rows) - 1)


def test_eye_inside_the_volume(renderer: sg.Renderer) -> None:
    volume = sg.Volume(np.ones((20, 20, 20), np.uint8))
    splats = sg.extract(volume, sg.Transfer([(0, 0.05)], unit=1.0, shading=False), classification="pre")
    camera = sg.Camera.look_at((9.5, 9.5, 9.5), (9.5, 9.5, 30), (0, 1, 0), 90, (32, 32))
    for align in ("ray", "grid"):
        pixels = renderer.render(splats, camera, SPLATS.replace(align=align)).pixels
        assert np.isfinite(pixels).all()
        # half the way through: about 1 − 0.95^10, less what the nearest splats' quads lose behind the eye
        assert pixels[..., 3].mean() == pytest.approx(1 - 0.95**10, abs=0.12)


def test_size_beyond_opengl(letter: sg.Splats, renderer: sg.Renderer) -> None:
    with pytest.raises(sg.InputError, match="image size: expected at most"):
        renderer.render(letter, sg.Camera.orbit(letter, size=(1_000_000, 2)), SPLATS)
    settings = SPLATS.replace(antialias="supersample", samples=64)
    with pytest.raises(sg.InputError, match="image size: expected at most"):
        renderer.render(letter, sg.Camera.orbit(letter, size=(4096, 2)), settings)


def test_far_from_the_origin(renderer: sg.Renderer) -> None:
    """At 1e7 from the origin the picture is the one at the origin."""
    rng = np.random.default_rng(8)
    samples = rng.random((10, 10, 10)).astype(np.float32)
    pictures = []
    for offset in (0.0, 1e7):
        volume = sg.Volume(samples, origin=(offset, -offset, offset))
        splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.5)], colormap="hot"), classification="pre")
        eye = np.array([20.0, -14, 25]) + volume.origin
        camera = sg.Camera.look_at(eye, np.array([4.0, 5, 5]) + volume.origin, (0, 0, 1), 40, (48, 48))
        pictures.append(renderer.render(splats, camera, SPLATS).pixels)
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-5


@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_any_unit_of_length(scale: float, renderer: sg.Renderer) -> None:
    samples = np.random.default_rng(8).random((6, 6, 6)).astype(np.float32)
    pictures = []
    for s in (1.0, scale):
        volume = sg.Volume(samples, spacing=(s, 2 * s, s))
        splats = sg.extract(volume, sg.Transfer([(0, 0), (1, 0.5)]), classification="pre")
        pictures.append(renderer.render(splats, sg.Camera.orbit(volume, 30, 20, size=(24, 24)), SPLATS).pixels)
    assert np.abs(pictures[0] - pictures[1]).max() < 1e-4


@pytest.mark.long
def test_egl_and_osmesa_draw_the_same_bits(letter: sg.Splats, renderer: sg.Renderer) -> None:
    """One Mesa, two ways in: every float the same."""
    try:
        other = sg.Renderer("osmesa")
    except sg.InputError as error:
        pytest.skip(str(error))
    with other:
        if other.info.version.split("Mesa")[-1] != renderer.info.version.split("Mesa")[-1]:
            pytest.skip(f"two drivers: {renderer.info.version} and {other.info.version}")
        camera = sg.Camera.orbit(letter, 30, 20, size=(64, 64))
        for settings in (SPLATS, SPLATS.replace(blend="xray"), sg.Settings.paper()):
            pictures = [each.render(letter, camera, settings).pixels for each in (renderer, other)]
            assert (pictures[0] == pictures[1]).all()


def test_paper_settings_sample_an_8_bit_table(letter: sg.Splats, renderer: sg.Renderer) -> None:
    image = renderer.render(letter, sg.Camera.orbit(letter, size=(32, 32)), sg.Settings.paper())
    assert image.info["footprint"] == "table 256×256 at 8 bits"
    texture = renderer.passes.device.tables.kept["crawfis-max", "table", 256, 8]
    assert (texture.size, texture.dtype) == ((256, 256), "f1")
    assert (image.info["align"], image.info["target"], image.info["attenuation"]) == ("hybrid", "rgba8", "opacity")


def test_the_last_few_splats_stay(renderer: sg.Renderer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who goes to and fro between some uploads each once; the oldest go when there are too many, or too large ones."""
    clouds = [sg.Splats.from_points(np.array([[0.0, 0, n]]), np.ones((1, 3)), np.ones(1)) for n in range(5)]
    kept = renderer.passes.device.splats
    for cloud in [*clouds[:3], *clouds[:3]]:
        renderer.render(cloud, sg.Camera.orbit(cloud, size=(8, 8)), SPLATS)
    assert [buffer.splats for buffer in kept.kept] == clouds[:3]
    first = kept.of(clouds[0])
    assert first.splats is clouds[0] and kept.of(clouds[0]) is first
    # the latest came last: the second is the oldest now
    kept.of(clouds[3])
    assert [buffer.splats for buffer in kept.kept] == [clouds[2], clouds[0], clouds[3]]
    monkeypatch.setattr("splatgl.gl.buffers.KEPT_BYTES", 0)
    kept.of(clouds[4])
    assert [buffer.splats for buffer in kept.kept] == [clouds[4]]


@pytest.mark.parametrize("technique", ["quads", "tiles"])
def test_what_is_freed_is_made_again(letter: sg.Splats, renderer: sg.Renderer, technique: str) -> None:
    camera, settings = sg.Camera.orbit(letter, size=(40, 30)), SPLATS.replace(technique=technique)
    once = renderer.render(letter, camera, settings).pixels
    assert renderer.passes.device.splats.kept
    renderer.free()
    kept = renderer.passes.device.splats.kept, renderer.passes.targets.kept, renderer.passes.tiles.buffers.kept
    assert not any(kept)
    assert (renderer.render(letter, camera, settings).pixels == once).all()
    # what is bound is none of what is freed: a window's OpenGL refuses to bind it again
    renderer.free()
    assert renderer.ctx.fbo.glo == 0


@pytest.mark.long
@pytest.mark.parametrize("what", ["sheets", "layers", "mesh"])
def test_what_is_freed_goes_back(what: str) -> None:
    """Also where the driver is software, whose textures are this process's memory."""
    layer = sg.Layer(letter_f(), sg.default_transfer(letter_f()))
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 9]], np.float32)
    drawn: sg.Splats | sg.Scene = sg.extract(layer.volume, layer.transfer)
    if what == "layers":
        drawn = sg.Scene([layer, layer])
    elif what == "mesh":
        drawn = sg.Scene([layer], meshes=[sg.Mesh(corners, np.array([[0, 1, 2]]))])
    settings = sg.Settings(technique="quads" if what == "sheets" else "auto", antialias="supersample", samples=2)
    return_large_blocks()
    with sg.Renderer() as own:
        render = partial(own.render, drawn, settings=settings, verify_bound=False)
        small, large = (sg.Camera.orbit(drawn, size=size) for size in ((8, 8), (900, 650)))
        render(camera=small)
        before, held = resident_mebibytes(), []
        for _ in range(4):
            render(camera=large)
            own.free()
            render(camera=small)
            return_free_memory()
            held.append(resident_mebibytes() - before)
        # it was one to three pictures of 36 MB that stayed, now and then
        assert max(held) < 20, held


@pytest.mark.parametrize("software", [True, False])
def test_only_software_is_waited_for(monkeypatch: pytest.MonkeyPatch, software: bool) -> None:
    waits: list[object] = []
    monkeypatch.setattr("splatgl.gl.target.is_software", lambda _: software)
    with sg.Renderer() as own:
        monkeypatch.setattr(type(own.ctx), "finish", lambda ctx: waits.append(ctx))
        settle(own.ctx)
    assert bool(waits) == software


def test_the_mean_of_moments_carries_the_mean_of_their_bounds(letter: sg.Splats, renderer: sg.Renderer) -> None:
    camera, each = sg.Camera.orbit(letter, size=(12, 9)), []

    def draw(splats: sg.Splats, view: sg.Camera, settings: sg.Settings) -> sg.Image:
        each.append(renderer.render(splats, view, settings))
        return each[-1]

    motion = sg.Motion(spin=np.array([0.0, 0.0, 9.0]), center=letter.corners.mean(axis=0))
    for tolerance, met in ((1 / 255, True), (1e-9, False)):
        each.clear()
        info = Supersampling(draw, motion, count=3)(letter, camera, SPLATS.replace(tolerance=tolerance)).info
        bounds = [image.info["error_bound"] for image in each]
        assert len(set(bounds)) == 3 and info["error_bound"] == pytest.approx(np.mean(bounds))
        assert info["tolerance_met"] is met

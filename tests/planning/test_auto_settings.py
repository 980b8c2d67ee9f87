"""What settings on auto draw: values classified after reconstruction, in sheets, at k×k samples a pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import splatgl as sg
from splatgl.cli.main import main
from splatgl.planning import resolve
from splatgl.planning.resolve import extract_for_settings, select_splats
from splatgl.reference.field import field_integral
from splatgl.scene.view import ViewOptions
from splatgl.splat import extract
from tests.helpers.splatting import SPLATS

pytestmark = pytest.mark.usefixtures("shared_programs")

TRANSFER = sg.Transfer([(0.3, 0.0), (0.8, 0.6)], colormap="hot", window=(0.0, 1.0))
DRAWN = ("classification", "kernel", "sheets", "samples")
TURNING = sg.Motion(spin=(0.0, 0.0, 30.0))


@pytest.fixture(scope="module")
def volume() -> sg.Volume:
    return sg.Volume(np.random.default_rng(1998).random((9, 10, 11), np.float32), (1.0, 1.2, 0.8))


@pytest.fixture(scope="module")
def splats(volume: sg.Volume) -> sg.Splats:
    return sg.extract(volume, TRANSFER)


@pytest.fixture(scope="module")
def camera(volume: sg.Volume) -> sg.Camera:
    return sg.Camera.orbit(volume, azimuth=20, elevation=30, size=(16, 14), zoom=2)


# settings, whether the scene moves → how it is drawn
PICTURES = {
    "default": (sg.Settings(), ("post", "b-spline", 3, 2)),
    "coarse": (sg.Settings(tolerance=0.1), ("post", "b-spline", 2, 2)),
    "kernel": (sg.Settings(kernel="gaussian"), ("post", "gaussian", 3, 2)),
    "mip": (sg.Settings(blend="mip"), ("post", "b-spline", 3, 2)),
    "minip": (sg.Settings(blend="minip"), ("post", "b-spline", 3, 2)),
    "xray": (sg.Settings(blend="xray"), ("post", "b-spline", 3, 2)),
    "quads": (sg.Settings(technique="quads"), ("post", "b-spline", 3, 2)),
    "pre": (sg.Settings(classification="pre"), ("pre", "crawfis-max", 3, 2)),
    "0.1": (SPLATS, ("pre", "crawfis-max", 0, 1)),
    "1998": (sg.Settings.paper(), ("pre", "crawfis-max", 0, 1)),
    "splats": (sg.Settings(compositing="splats"), ("pre", "crawfis-max", 0, 2)),
    "opacity": (sg.Settings(attenuation="opacity"), ("pre", "crawfis-max", 0, 2)),
    "order": (sg.Settings(order="back-to-front"), ("pre", "crawfis-max", 0, 2)),
    "target": (sg.Settings(target="rgba16f"), ("pre", "crawfis-max", 0, 2)),
    "table": (sg.Settings(footprint="table"), ("pre", "crawfis-max", 0, 2)),
    "grid": (sg.Settings(align="grid"), ("pre", "crawfis-max", 0, 2)),
}


@pytest.mark.few(2)
@pytest.mark.parametrize("name", PICTURES)
def test_settings_choose_the_splats(
    renderer: sg.Renderer, volume: sg.Volume, splats: sg.Splats, camera: sg.Camera, name: str
) -> None:
    """The picture of `extract` without further words is that of splats extracted for the settings."""
    settings, drawn = PICTURES[name]
    image = renderer.render(splats, camera, settings)
    assert tuple(image.info[key] for key in DRAWN) == drawn
    how = {"post": "post-all" if name in ("mip", "minip") else "post", "pre": "pre"}[drawn[0]]
    own = sg.extract(volume, TRANSFER, classification=how, kernel=drawn[1])
    assert own.source is None and image.info["splats"] == len(own)
    same = renderer.render(own, camera, settings.replace(classification="auto"))
    # records of maxima have no gradients, whose bytes are the last ones of other texels
    assert np.allclose(same.pixels, image.pixels, rtol=0, atol=1e-4 if name == "mip" else 0)
    right = sg.reference.render(splats, camera, settings)
    assert right.info["classification"] == drawn[0] and right.info["splats"] == len(own)


@pytest.mark.long
def test_a_moving_picture_is_classified_as_a_still(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera) -> None:
    """It is the mean of stills while the shutter is open; streaks are of voxels, for who asks for them."""
    image = renderer.render(splats, camera, motion=TURNING)
    assert image.info["classification"] == "post" and image.info["motion"] == "moments"
    count = image.info["moments"]
    assert isinstance(count, int) and count > 2 and image.info["eye"] == [float(x) for x in camera.eye]
    times = [-0.5 * (n + 0.5) / count for n in range(count)]
    stills = [renderer.render(splats, TURNING.view(camera, at)).pixels.astype(float) for at in times]
    assert np.abs(image.pixels - np.mean(stills, axis=0)).max() < 1e-6
    assert np.abs(image.pixels - stills[0]).max() > 0.02
    explained = renderer.plan(splats, camera, motion=TURNING).explain()
    assert f"the mean of pictures at {count} times, shutter 180°" in explained
    streaks = renderer.render(splats, camera, sg.Settings(motion="exact"), TURNING)
    assert streaks.info["classification"] == "pre" and streaks.info["motion"] == "exact"
    unblurred = renderer.render(splats, camera, sg.Settings(motion="off"), TURNING)
    assert unblurred.info["classification"] == "post" and "motion" not in unblurred.info
    for settings in (sg.Settings(), sg.Settings(motion="exact")):
        assert renderer.render(splats, camera, settings.replace(shutter=0), TURNING).info.get("motion") is None


def test_pictures_extract_others_once(renderer: sg.Renderer, volume: sg.Volume, camera: sg.Camera) -> None:
    splats = sg.extract(volume, TRANSFER)
    first, again = (select_splats(splats, SPLATS, False) for _ in range(2))
    assert first is again and first.post is None and select_splats(splats, sg.Settings(), False) is splats
    assert select_splats(first, sg.Settings(), False) is first
    own = extract_for_settings(volume, TRANSFER, sg.Settings(order="back-to-front"))
    assert own.post is None and select_splats(own, sg.Settings(), False).post is not None
    assert select_splats(splats, sg.Settings(blend="mip"), False) is not select_splats(splats, sg.Settings(), False)


def test_what_is_made_of_splats_is_not_extracted_again(splats: sg.Splats) -> None:
    """A part, a moved or a recoloured copy is drawn as it is."""
    post = splats.post
    assert post is not None and splats.source is not None
    flow = sg.Motion(flow=np.ones((len(splats), 3)))
    made = (
        splats.part(np.arange(len(splats)) % 2 == 0),
        splats.in_cells(splats.records.copy()),
        splats.with_classifier(post),
        flow.move(splats, -0.5),
    )
    assert all(each.source is None and select_splats(each, SPLATS, False) is each for each in made)


@pytest.mark.parametrize("fit", ["visible", "0.3"])
def test_a_view_may_be_fitted_to_what_is_visible(splats: sg.Splats, fit: str) -> None:
    """Values around opaque ones do not move the camera away; nor do those where all are transparent."""
    place = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0)
    ball = sg.Volume((place < 5).astype(np.float32))
    after, before = (sg.extract(ball, TRANSFER, classification=how) for how in ("post", "pre"))
    assert len(after) > len(before)
    first, second = (ViewOptions(size=(20, 20), fit=fit).camera(ball, each) for each in (after, before))
    assert first == second != ViewOptions(size=(20, 20)).camera(ball, after)
    assert splats.post is not None
    clear = splats.with_classifier(splats.post.with_transfer(sg.Transfer([(0.3, 0.0), (0.8, 0.0)])))
    assert ViewOptions(fit=fit).camera(ball, clear) == ViewOptions(fit=fit).camera(ball, ball)


@pytest.mark.parametrize("why", ["threshold", "colours of its own", "many values", "values from"])
def test_volumes_of_which_voxels_are_classified(
    renderer: sg.Renderer, volume: sg.Volume, camera: sg.Camera, monkeypatch: pytest.MonkeyPatch, why: str
) -> None:
    threshold, said, transfer = 0.0, why, TRANSFER
    if why == "threshold":
        threshold = 0.05
    elif why == "many values":
        most = len(sg.extract(volume, transfer, classification="pre"))
        monkeypatch.setattr(extract, "MOST_KEPT", most)
        monkeypatch.setattr(resolve, "MOST_KEPT", most)
        said = f"more than {most:,} values"
    elif why == "values from":
        volume = sg.Volume(volume.samples.astype(np.float64) * 1e-310)
        transfer = sg.Transfer([(0.3e-310, 0.0), (0.8e-310, 0.6)])
    else:
        volume = replace(volume, color=np.full((*volume.shape, 3), 200, np.uint8))
    splats = sg.extract(volume, transfer, threshold)
    image = renderer.render(splats, camera)
    assert image.info["classification"] == "pre" and image.info["sheets"] == 3
    before = sg.extract(volume, transfer, threshold, classification="pre")
    again = extract_for_settings(volume, transfer, sg.Settings(), threshold)
    assert select_splats(again, sg.Settings(), False) is again and len(again) == len(before)
    assert np.array_equal(renderer.render(before, camera).pixels, image.pixels)
    assert f"reconstruction left out: {said}" in renderer.plan(splats, camera).explain()


def test_maxima_of_many_voxels_are_of_values(
    renderer: sg.Renderer, camera: sg.Camera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where few of the voxels may be seen; else of colours, as for other blends of one value, and a note says so."""
    mip, place = sg.Settings(blend="mip"), np.indices((16, 16, 16))
    bright = sg.Volume((np.linalg.norm(place - 7.5, axis=0) < 2).astype(np.float32))
    noisy = sg.Volume(np.random.default_rng(1).random((16, 16, 16)))
    right = renderer.render(extract_for_settings(bright, TRANSFER, mip), camera, mip).pixels
    for module in (extract, resolve):
        monkeypatch.setattr(module, "MOST_KEPT", 3000)
    for made in (extract_for_settings(bright, TRANSFER, mip), sg.extract(bright, TRANSFER)):
        image = renderer.render(made, camera, mip)
        assert image.info["classification"] == "post" and np.array_equal(image.pixels, right)
    made = extract_for_settings(noisy, sg.Transfer([(0.1, 0.0), (0.8, 0.6)]), mip)
    assert select_splats(made, mip, False).post is None
    assert "more than 3,000 values" in renderer.plan(made, camera, mip).explain()


@pytest.mark.parametrize("blend", ["composite", "mip", "minip", "mean"])
def test_pictures_tell_of_limits(monkeypatch: pytest.MonkeyPatch, blend: str) -> None:
    """Layers of more values than are kept: maxima are of colours of voxels, and a note says so; the rest is refused."""
    values = np.random.default_rng(1).random((16, 16, 16))
    transfer = sg.Transfer([(0.1, 0.0), (0.8, 0.6)])

    def drawn() -> sg.Image:
        layers = [sg.Layer(sg.Volume(part), transfer) for part in (values, values[:8])]
        return sg.render(sg.Scene(layers), size=32, blend=blend)

    assert not any("limit" in note for note in drawn().notes)
    for module in (extract, resolve):
        monkeypatch.setattr(module, "MOST_KEPT", 3000)
    if blend == "mip":
        told = "classification after reconstruction left out: more than 3,000 values (a limit, changes the picture)"
        assert drawn().notes.count(told) == 1
    else:
        with pytest.raises(sg.InputError, match="3,000 splats"):
            drawn()


def test_explain_says_why_not(renderer: sg.Renderer, splats: sg.Splats, camera: sg.Camera) -> None:
    told = renderer.plan(splats, camera, sg.Settings(order="back-to-front")).explain()
    for part in ("classification after reconstruction", "sheets"):
        assert f"{part} left out: order back-to-front" in told
    assert "after reconstruction left out" not in renderer.plan(splats, camera, SPLATS).explain()
    assert "sheets left out" not in renderer.plan(splats, camera, sg.Settings(blend="mip")).explain()


def test_the_default_is_nearer_to_the_field(renderer: sg.Renderer) -> None:
    """Than the splats of version 0.1, by far."""
    volume = sg.scenes.balls()
    transfer = sg.default_transfer(volume)
    splats, camera = sg.extract(volume, transfer), sg.Camera.orbit(volume, size=(24, 24))
    right = field_integral(volume, transfer, camera, "b-spline", 4, samples=4).pixels
    off = [np.sqrt(((renderer.render(splats, camera, s).pixels - right) ** 2).mean()) for s in (sg.Settings(), SPLATS)]
    assert off[0] < 0.1 * off[1]


@pytest.mark.parametrize(
    ("options", "drawn"),
    [((), "post"), (("--like", "0.1"), "pre"), (("--paper",), "pre"), (("--threshold", "0.1"), "pre")],
    ids=["default", "0.1", "1998", "threshold"],
)
def test_the_command_draws_the_default(
    tmp_path: Path, volume: sg.Volume, options: tuple[str, ...], drawn: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save("v.npy", volume.samples)
    assert main(["render", "v.npy", "-o", "v.png", "--size", "24", "--quiet", *options]) == 0
    info = sg.Image.load("v.png").info
    assert info["classification"] == drawn and ("checked" in info) == (drawn == "post")

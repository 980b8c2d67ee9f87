"""The view of a notebook, driven by events as a browser sends them."""

from __future__ import annotations

import asyncio
import io
import json
import re
import shutil
import subprocess
import warnings
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

import splatgl as sg
from splatgl import fileio
from splatgl.scene.api import scene_of
from splatgl.viewer import notebook, show, thumbnails
from splatgl.viewer.adaptive_quality import FULL, LADDER, PreviewLevel
from splatgl.viewer.document import Document
from splatgl.viewer.notebook import STILL, Session


class Timed(Session):
    """A session whose clock is set."""

    clock = 0.0

    def now(self) -> float:
        return self.clock


@pytest.fixture
def volume() -> sg.Volume:
    z, y, x = np.indices((20, 24, 40)) - 12.0
    return sg.Volume((200 * np.exp(-((x - 8) ** 2 + y**2 + z**2) / 30)).astype(np.uint8), name="ball")


@pytest.fixture
def session(volume: sg.Volume) -> Timed:
    scene = scene_of(volume, None, None, None, {"size": (96, 64)})
    return Timed(scene)


def event(kind: str, x: float = 0.0, y: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"event_type": kind, "x": x, "y": y, "button": 0, "buttons": (), "modifiers": (), **more}


def drag(session: Session, x: float, y: float, **more: Any) -> None:
    session.handle(event("pointer_down", 48, 32, **{"button": 1, **more}))
    session.handle(event("pointer_move", 48 + x, 32 + y, buttons=(1,)))
    session.handle(event("pointer_up", 48 + x, 32 + y, button=1))


@pytest.mark.long
def test_the_first_frame_is_the_picture(session: Timed, volume: sg.Volume) -> None:
    frame = session.frame()
    assert np.array_equal(session.image.pixels, sg.render(volume, size=(96, 64)).pixels)
    assert frame is not None and frame.dtype == np.uint8 and frame.shape == (64, 96, 3)
    assert (frame == sg.Image(session.image.pixels).over((0, 0, 0)).samples8()[..., :3]).all()
    # once
    assert session.frame() is None and session.seconds_until_due() is None


def test_previews_of_cut_volumes_have_an_inside() -> None:
    """Splats that matter around them hides are left out only while no plane exposes them."""
    z = np.linspace(-1, 1, 24)
    near = np.sqrt(z[:, None, None] ** 2 + z[:, None] ** 2 + z**2) < 0.9
    options = {"clip": "z<0.5", "view": "superior", "size": (48, 48), "classification": "pre"}
    scene = scene_of(sg.Volume(near.astype(np.float32)), sg.Transfer([(0.5, 0.0), (0.6, 1.0)]), None, None, options)
    session = Session(scene)
    session._draw(PreviewLevel())
    preview = session.image.pixels
    assert len(session.document.layers[0].shell(1)) < len(session.document.layers[0].at(1))
    assert np.abs(preview - session.picture().pixels).max() < 0.2


def test_more_voxels_than_can_be_drawn_are_every_second_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """And a line says so, once; a few voxels that cannot be drawn are refused."""
    samples = np.random.default_rng(0).random((40, 40, 40), np.float32)
    scene = scene_of(sg.Volume(samples), None, None, None, {"blend": "minip", "size": (32, 32)})
    session, wanted = Session(scene), Session(scene)
    for name in ("planning.resolve", "viewer.notebook"):
        monkeypatch.setattr(f"splatgl.{name}.MOST_KEPT", 30000)
    for turned in (0.0, 5.0):
        drag(session, turned, 0)
        pixels = session.picture().pixels
    drag(wanted, 5.0, 0)
    assert np.array_equal(pixels, wanted._render(FULL, 2).pixels)
    assert capsys.readouterr().err.count("every second voxel is drawn, not all: splats: expected at most") == 1
    monkeypatch.setattr("splatgl.viewer.notebook.MOST_KEPT", 70000)
    with pytest.raises(sg.InputError, match="splats: expected at most"):
        Session(scene).picture()


def test_files_are_opened_within_the_budget(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    found, own = [], Document.open
    monkeypatch.setattr(Document, "open", lambda *given: found.append(fileio.stated_budget()) or own(*given))
    view: Any = sg.show(volume, size=(16, 12), memory="2GiB")
    view.change(blend="mip")
    assert found == [2 << 30] * 2 and fileio.stated_budget() is None


def test_drags_rotate_pan_and_zoom(session: Timed) -> None:
    home = session.pose.camera
    drag(session, 20, 0)
    turned = session.pose.camera
    reach = np.linalg.norm(home.eye - session.pose.pivot)
    assert np.linalg.norm(turned.eye - session.pose.pivot) == pytest.approx(reach)
    assert turned.forward @ home.forward < 0.9
    # a drag to the right turns the near side to the right: the eye moves to the left
    assert (turned.eye - home.eye) @ home.right < 0
    for more in ({"modifiers": ("Shift",)}, {"button": 3}):
        session.handle(event("double_click"))
        drag(session, 20, 0, **more)
        assert np.allclose(session.pose.camera.forward, home.forward)
        assert (session.pose.camera.eye - home.eye) @ home.right < 0
    session.handle(event("double_click"))
    assert np.allclose(session.pose.camera.eye, home.eye)
    session.handle(event("wheel", 48, 32, dy=-100.0))
    assert np.linalg.norm(session.pose.camera.eye - session.pose.pivot) < 0.9 * reach
    # a move without a button does nothing
    before = session.pose
    assert not session.handle(event("pointer_move", 3, 3)) and session.pose is before


def test_frames_are_reduced_while_it_moves_and_refined_once_still(session: Timed) -> None:
    session.frame()
    # as if pictures of all pixels took a second, and others a moment
    for level in (*range(len(LADDER)), *range(len(LADDER))):
        session.refiner.pace = session.refiner.pace.drawn(level, 0.01 if level > 1 else 1.0)
    session.clock = 10.0
    session.handle(event("pointer_down", 48, 32, button=1))
    session.handle(event("pointer_move", 60, 32))
    small = session.frame()
    assert session.level != FULL and small is not None and small.shape[0] < 64
    assert session.seconds_until_due() == pytest.approx(STILL)
    session.clock += STILL / 2
    assert session.frame() is None
    session.clock += STILL
    session.handle(event("pointer_up", 60, 32))
    full = session.frame()
    assert session.level == FULL == LADDER[0] and full is not None and full.shape == (64, 96, 3)
    assert session.seconds_until_due() is None


def test_places_are_in_css_pixels(session: Timed) -> None:
    """Twice the pixels in the same element: the same drag turns by the same angle."""
    drag(session, 20, 5)
    plain = session.pose.camera.forward
    session.handle(event("double_click"))
    session.handle({"event_type": "resize", "width": 96.0, "height": 64.0, "pixel_ratio": 2.0})
    frame = session.frame()
    assert frame is not None and session.pose.camera.size == (192, 128)
    drag(session, 20, 5)
    assert np.allclose(session.pose.camera.forward, plain)


def test_the_widget(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    view: Any = sg.show(volume, size=(96, 64))
    outputs: list[dict[str, Any]] = []
    monkeypatch.setattr(notebook, "display", lambda data, raw: outputs.append(data))
    view._ipython_display_()
    # a picture for pages without widgets; the place of errors and the view, which leave no text there
    still, *widgets = outputs
    assert len(widgets) == 2 and all("application/vnd.jupyter.widget-view+json" in data for data in widgets)
    assert {data["text/plain"] for data in outputs} == {""} and view.still in still["text/html"]
    right = sg.render(volume, size=(96, 64))
    assert (np.asarray(Pillow.open(io.BytesIO(b64decode(still["image/png"])))) == right.samples8()).all()
    # a busy machine draws frames of fewer pixels first
    monkeypatch.setattr(view.session.refiner, "took", lambda *measured: None)
    # the widget's own first frame, whatever was drawn for the still one; once, and again in a page that is loaded anew
    for _ in range(2):
        view.session.handle({"event_type": "resize", "width": 96.0, "height": 64.0})
        assert view.get_frame().shape == (64, 96, 3) and view.get_frame() is None
    drawn: list[np.ndarray] = []

    async def turned() -> None:
        """Requests as the widget answers them: a draw at once, and another when it is still."""
        monkeypatch.setattr(type(view), "request_draw", lambda self: drawn.append(self.get_frame()))
        view.handle_event(event("pointer_down", 48, 32, button=1))
        view.handle_event(event("pointer_move", 60, 32, buttons=(1,)))
        view.session.handle(event("pointer_up", 60, 32, button=1))
        await asyncio.sleep(STILL + 0.5)

    asyncio.run(turned())
    assert len(drawn) >= 1 and view.session.level == FULL and view.session.seconds_until_due() is None
    assert np.array_equal(view.image.pixels, view.session.image.pixels)
    assert not np.array_equal(view.image.pixels, sg.render(volume, size=(96, 64)).pixels)


def test_the_camera_and_the_settings_can_be_set(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    """The next frame is the picture of `render` with them; bad ones are refused and change nothing."""
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    view: Any = sg.show(volume, size=(48, 32))
    camera = sg.Camera.orbit(volume, 100, -20, size=(7, 7))
    view.camera, view.settings = camera, view.settings.replace(light="glossy")
    view.session.touched = -np.inf
    view.get_frame()
    right = sg.render(volume, camera=camera.resized((48, 32)), light="glossy")
    assert np.array_equal(view.image.pixels, right.pixels) and view.camera.size == (48, 32)
    with pytest.raises(sg.InputError, match="camera: expected a Camera, got str"):
        view.camera = "front"
    with pytest.raises(sg.InputError, match="settings: expected Settings"):
        view.settings = {"blend": "mip"}
    with pytest.raises(sg.InputError, match=r"options: .*got azimuth"):
        view.change(azimuth=3)
    assert view.get_frame() is None


def test_the_image_needs_no_browser(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the picture of the camera and the settings as they are, also before the view is displayed and in motion."""
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    view: Any = sg.show(volume, size=(48, 32))
    assert np.array_equal(view.image.pixels, sg.render(volume, size=(48, 32)).pixels)
    assert view.image is view.image
    camera = sg.Camera.orbit(volume, 100, -20, size=(48, 32))
    view.camera = camera
    for options in ({}, {"classification": "pre"}, {"light": "glossy"}, {"blend": "mip"}):
        view.change(**options)
        right = sg.render(volume, camera=camera, settings=view.settings)
        assert np.array_equal(view.image.pixels, right.pixels)
    # a frame of fewer pixels is not the picture
    view.session._draw(LADDER[-1])
    assert view.session.image.pixels.shape != right.pixels.shape == view.image.pixels.shape
    assert np.array_equal(view.image.pixels, right.pixels)


def test_layers_of_another_frame(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    first, turn = replace(volume, frame="RAS"), np.diag([-1.0, -1.0, 1.0])
    labels = sg.Volume(np.uint8(volume.samples > 100), origin=(3, -1, 0), direction=turn, frame="LPS", labels=())
    for options in (
        {"labels": labels},
        {"layers": [sg.Layer(replace(labels, labels=None), sg.Transfer([(0, 0), (1, 0.5)]))]},
    ):
        view: Any = sg.show(first, size=(48, 32), **options)
        assert np.array_equal(view.image.pixels, sg.render(first, size=(48, 32), **options).pixels)


@pytest.mark.long
def test_controls_change_the_view(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("jupyter_rfb", reason="notebooks' views need jupyter_rfb; it is in the extra notebook")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    view: Any = sg.show(volume, size=(48, 32))
    camera = view.camera
    controls = {widget.description: widget for widget in view.controls.children}
    assert list(controls) == ["preset", "blend", "light", "window"]

    def drawn() -> np.ndarray:
        # long after the last change
        view.session.touched = -np.inf
        view.get_frame()
        # where the full picture may take long, a preview is first
        while view.session.level != FULL:
            view.get_frame()
        return view.image.pixels

    first = drawn()
    for name, value, options in (
        ("preset", "ct-bone", {"transfer": "ct-bone"}),
        ("blend", "mip", {"transfer": "ct-bone", "blend": "mip"}),
        ("window", (20.0, 90.0), {"transfer": {"preset": "ct-bone", "window": (20.0, 90.0)}, "blend": "mip"}),
    ):
        controls[name].value = value
        right = sg.render(volume, camera=camera, **options)
        assert np.array_equal(drawn(), right.pixels), name
    controls["blend"].value, controls["preset"].value = "composite", "as opened"
    assert np.array_equal(drawn(), first)
    # and back: what code sets is what the widgets show, and nothing else changes
    view.settings = view.settings.replace(blend="xray", light="glossy")
    assert (controls["blend"].value, controls["light"].value) == ("xray", "glossy")
    view.change(preset="surface", window=(-50.0, 400.0), blend="composite")
    other = {widget.description: widget for widget in view.controls.children}
    for widgets in (controls, other):
        assert (widgets["preset"].value, widgets["window"].value) == ("surface", (-50.0, 400.0))
    assert view.session.scene.transfer == {"preset": "surface", "window": (-50.0, 400.0)}
    assert view.settings.blend == "composite"
    with pytest.raises(AttributeError):
        setattr(view, "image", view.image)  # noqa: B010


def test_the_view_needs_no_extension_of_the_server() -> None:
    """The protocol is anywidget's, whose script travels with the widget: VS Code and Colab show it, too."""
    anywidget = pytest.importorskip("anywidget", reason="jupyter_rfb brings it")
    from splatgl.viewer.notebook import NotebookView

    assert issubclass(NotebookView, anywidget.AnyWidget) and "export default" in NotebookView._esm


@pytest.mark.long
def test_the_script_in_a_browser(tmp_path: Path) -> None:
    """The view shows its first picture until a frame arrives, and hides that of pages without widgets."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("Chromium is not here")
    still = "data:image/gif;base64,R0lGODlhAQABAAAAACw="
    state = {"still": still, "css_width": "96px", "css_height": "64px", "cursor": "default", "title": ""}
    script = f"""
    const state = {json.dumps(state)}, nothing = () => undefined
    const model = {{ get: name => state[name], set: nothing, save_changes: nothing, on: nothing, send: nothing }}
    const {{ initialize, render }} = make()
    initialize({{ model }})
    render({{ model, el: document.getElementById('cell') }})"""
    page = f'<img class="splatgl-still" src="{still}"><img class="splatgl-still" src="x:"><div id="cell"></div>'
    page += f'<script type="module">{notebook.SCRIPT.replace("export default", "const make =")}{script}</script>'
    (tmp_path / "view.html").write_text(page, encoding="utf-8")
    look = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}", "--dump-dom"]
    look += ["--virtual-time-budget=500", (tmp_path / "view.html").as_uri()]
    shown = subprocess.run(look, capture_output=True, text=True, check=True, timeout=600).stdout
    pictures = re.findall("<img.*?>", re.sub("<script.*?</script>", "", shown, flags=re.DOTALL))
    assert [("display: none" in picture, still in picture) for picture in pictures] == [
        (True, True),
        (False, False),
        (False, True),
    ]
    assert "border: 0" in pictures[2]


def test_small_pictures_of_objects(volume: sg.Volume, monkeypatch: pytest.MonkeyPatch) -> None:
    transfer = sg.Transfer([(0, 0.0), (200, 1.0)], "#ff0000")
    bar = np.asarray(Pillow.open(io.BytesIO(thumbnails.transfer_png(transfer))).convert("RGB"))
    # red below; above, where it is opaque
    assert bar.shape == (48, 240, 3) and (bar[40] == (255, 0, 0)).all()
    assert (bar[2, -1] == (255, 0, 0)).all() and bar[2, 2, 2] > 100
    page = replace(volume, name="a<b", quantity="dose", value_unit="Gy", unit="mm")._repr_html_()
    assert "<caption>a&lt;b</caption>" in page and "<th>dose</th><td>0 … 2" in page and "Gy</td>" in page
    assert "<th>voxels</th><td>40×24×20 uint8</td>" in page and "<th>size</th><td>40×24×20 mm</td>" in page
    png = b64decode(re.findall('src="data:image/png;base64,(.*?)"', page)[0])
    found = [png, thumbnails.scene_png(sg.Scene([sg.Layer(volume, transfer, 0.5)]))]
    pictures = [np.asarray(Pillow.open(io.BytesIO(png or b"")).convert("RGB")) for png in found]
    assert all(picture.shape == (192, 192, 3) and picture.max() > 100 for picture in pictures)
    assert pictures[1][..., 1:].max() < 20 < pictures[1][..., 0].max()
    monkeypatch.setattr(thumbnails, "MOST_READ", 100)
    assert "<img" not in volume._repr_html_() and "<th>voxels</th>" in volume._repr_html_()


def test_without_the_library_the_cell_shows_the_image(
    volume: sg.Volume, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    monkeypatch.setattr(show, "find_spec", lambda name: None)
    assert isinstance(sg.show(volume, size=48), sg.Image)
    assert 'pip install "splatgl[notebook]"' in capsys.readouterr().out
    # splats have no samples to show in motion
    monkeypatch.undo()
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    assert isinstance(sg.show(sg.extract(volume, sg.default_transfer(volume)), size=48), sg.Image)


def test_notes_on_a_file_are_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The view prints them, as a window does: they are no warnings, too."""
    pytest.importorskip("jupyter_rfb")
    monkeypatch.setattr(show, "in_notebook", lambda: True)
    header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nspacings: 1 1 nan\n\n"
    (tmp_path / "a.nrrd").write_bytes(header.encode() + bytes(range(0, 256, 4)))
    with warnings.catch_warnings():
        warnings.simplefilter("error", sg.InputWarning)
        sg.show(tmp_path / "a.nrrd", size=(32, 24)).close()
    assert capsys.readouterr().err.count("spacing along z") == 1

"""The view of Jupyter notebooks."""

from __future__ import annotations

import asyncio
import time
from base64 import b64encode
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from html import escape
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from IPython.display import display
from IPython.utils.capture import capture_output
from jupyter_rfb import RemoteFrameBuffer
from traitlets import Unicode

from splatgl.data.image import Image
from splatgl.errors import InputError, expected
from splatgl.fileio import call_within
from splatgl.geometry.camera import Camera
from splatgl.gl.renderer import shared_renderer
from splatgl.options import declared, names_of, reject_unknown
from splatgl.scene.api import TRANSFER
from splatgl.scene.open_scene import print_lines
from splatgl.scene.scene_file import SceneFile
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import MOST_KEPT
from splatgl.transfer.presets import PRESETS
from splatgl.transfer.statistics import statistics
from splatgl.viewer.adaptive_quality import FULL, LADDER, REST, TARGET, InputTiming, PreviewLevel, Refiner, Wanted
from splatgl.viewer.document import Document
from splatgl.viewer.trackball import Mouse, Place, zoom_by_wheel

# seconds without input before the full picture; no event is handled while it is drawn
STILL = 0.3
# a wheel's distance per notch, and most notches of one event
NOTCH, MOST_NOTCHES = 100.0, 5.0
BUTTONS = {1: "left", 2: "right", 3: "middle"}
KEYS = {"Shift": "shift", "Control": "ctrl"}
BLACK = (0.0, 0.0, 0.0)


class Session:
    """A scene seen from a pose. Events are dictionaries as jupyter_rfb has them, places in CSS pixels. memory: the
    budget that files are opened within, bytes; None: the process's.
    """

    def __init__(self, scene: SceneFile, memory: int | None = None) -> None:
        self.scene, self.memory = scene, memory
        self.document = call_within(memory, Document.open, scene)
        self.pose = self.document.home(scene.view.size)
        self.mouse = Mouse()
        self.ratio = 1.0
        self.touched = -np.inf
        self.refiner = Refiner(self.document.counts, prod(scene.view.size), TARGET)
        # the latest picture, what it is of, and the seconds that it took
        self.image = Image(np.zeros((1, 1, 4), np.float32))
        self.level = FULL
        self.drawn: tuple[object, ...] = ()
        self.seconds = 0.0
        # the document whose voxels cannot all be drawn at once
        self.too_fine: Document | None = None

    def change(self, scene: SceneFile) -> None:
        """Draws the same volumes by other options; the camera stays. Raises InputError for bad values."""
        # the blend changes the default transfer function
        same = scene.transfer == self.scene.transfer and scene.settings.blend == self.scene.settings.blend
        document = self.document.with_settings(scene) if same else call_within(self.memory, Document.open, scene, True)
        self.scene, self.document = scene, document
        self.refiner.renew(document.counts, prod(self.pose.camera.size))
        self.touched = self.now()

    def look(self, camera: Camera) -> None:
        """Looks from a camera, in the size of the view."""
        self.pose = replace(self.pose, camera=camera.resized(self.pose.camera.size))
        self.touched = self.now()

    def handle(self, event: Mapping[str, Any]) -> bool:
        """Applies an event; True if there is something to draw."""
        kind = event.get("event_type") or event.get("type")
        before = self.pose
        if kind == "resize":
            self._resize(event)
        elif kind == "pointer_down":
            button = BUTTONS.get(event.get("button", 0), "")
            held: Collection[str] = [KEYS[key] for key in event.get("modifiers", ()) if key in KEYS]
            self.mouse = self.mouse.press(button, held, self._place(event), self.pose, self.now())
        elif kind == "pointer_move" and self.mouse.drag is not None:
            self.pose = self.mouse.drag.to(self._place(event)).resized(self.pose.camera.size)
        elif kind == "pointer_up":
            self.mouse = self.mouse.release()
        elif kind == "wheel":
            notches = float(np.clip(-event.get("dy", 0.0) / NOTCH, -MOST_NOTCHES, MOST_NOTCHES))
            self.pose = zoom_by_wheel(self.pose, self._place(event), notches)
        elif kind == "double_click":
            self.mouse = self.mouse.release()
            self.pose = self.document.home(self.pose.camera.size)
        if self.pose is not before:
            self.touched = self.now()
        return self.pose is not before

    def frame(self) -> np.ndarray | None:
        """The due picture, uint8 [H, W, 3], sRGB on black or the background; None if none is due."""
        level = self.refiner.step(self._wanted(), self._moment, lambda level: self._draw(LADDER[level]))
        if level is None:
            return None
        self.refiner.took(level, self.seconds, 0.0)
        return np.ascontiguousarray(self.image.samples8(BLACK)[..., :3])

    def picture(self) -> Image:
        """The picture of the current view at full resolution, drawn unless it is the latest one."""
        if self.level != FULL or self.drawn != self._wanted():
            self._draw(FULL)
        return self.image

    def seconds_until_due(self) -> float | None:
        """Seconds until the next frame is due without further events; None if none is."""
        return self.refiner.seconds_until_due(self._wanted(), self._moment)

    def now(self) -> float:
        """Monotonic clock in seconds."""
        return time.monotonic()

    def _wanted(self) -> tuple[object, ...]:
        return self.pose, self.document

    @property
    def _moment(self) -> InputTiming:
        return InputTiming(self.now() - self.touched - (STILL - REST))

    def _draw(self, level: PreviewLevel) -> tuple[Wanted, bool]:
        """Draws at a level, as `Refiner.step` asks."""
        # finer voxels replace the stand-in of a large volume
        while level == FULL and self.document.has_finer:
            self.document = self.document.refined()
            self.refiner.renew(self.document.counts, prod(self.pose.camera.size))
        started = time.perf_counter()
        try:
            self.image = self._render(level, 2 if level == FULL and self.document is self.too_fine else level.stride)
        except InputError as error:
            if level != FULL or all(layer.volume.count <= MOST_KEPT for layer in self.document.drawn_layers):
                raise
            # another error comes again
            self.image = self._render(level, 2)
            self.too_fine = self.document
            print_lines([f"every second voxel is drawn, not all: {error}"])
        self.level, self.drawn, self.seconds = level, self._wanted(), time.perf_counter() - started
        return self.drawn, level == FULL

    def _render(self, level: PreviewLevel, stride: int) -> Image:
        """The picture of a level, of voxels at a stride."""
        camera = self.pose.camera.resized(level.size(self.pose.camera.size))
        settings = level.settings(self.document.scene.settings.replace(classification="auto"))
        subject, settings = self.document.subject_at(stride, settings, None if level == FULL else camera.eye)
        with shared_renderer() as renderer:
            return renderer.render(subject, camera, settings, verify_bound=False)

    def _place(self, event: Mapping[str, Any]) -> Place:
        return float(event.get("x", 0.0)) * self.ratio, float(event.get("y", 0.0)) * self.ratio

    def _resize(self, event: Mapping[str, Any]) -> None:
        """Takes the size of an element that is new, as after a reload of the page, or was resized."""
        self.refiner.drawn = ()
        self.ratio = float(event.get("pixel_ratio") or event.get("ratio") or 1.0)
        size = tuple(max(1, round(float(event[side]) * self.ratio)) for side in ("width", "height"))
        if size != self.pose.camera.size:
            self.pose = self.pose.resized((size[0], size[1]))
            self.refiner.renew(self.document.counts, prod(size))


# options that a view can change
CHANGEABLE = ("preset", *TRANSFER, *names_of(Settings))
# choice of the transfer function that the scene was opened with
AS_OPENED = "as opened"
# the browser's part: jupyter_rfb's, whose view shows `still` until a frame arrives, and hides the same picture of pages
# without widgets; the border would take two rows and columns of pixels
SCRIPT = (
    RemoteFrameBuffer._esm.replace("export default", "const frames =")
    + """
export default () => {
  const { initialize, render } = frames()
  return { initialize, render (context) {
    const end = render(context), view = context.el.querySelector('img'), still = context.model.get('still')
    view.style.border = '0'
    if (still && view.src.startsWith('data:')) view.src = still
    for (const picture of document.querySelectorAll('img.splatgl-still'))
      if (picture.src === still) picture.style.display = 'none'
    return end
  } }
}
"""
)


class NotebookView(RemoteFrameBuffer):  # type: ignore[misc]
    """Left drag rotates, shift or middle drag pans, the wheel and right drag zoom, a double click resets.

    While it moves, frames are reduced; once it is still, the full picture is drawn. A saved notebook and pages made of
    it keep the first picture. `image` is that of now; `camera` and `settings` can be set; `controls` are widgets for
    the colours, their window, the blend and the light, which follow what code sets.
    """

    _esm = SCRIPT
    # address of the first picture, a JPEG on black; "" before the view is displayed
    still = Unicode().tag(sync=True)

    def __init__(self, session: Session) -> None:
        self.session = session
        # widgets of `controls` by name, and whether they are being set to what the view shows
        self.shown: list[dict[str, Any]] = []
        self.following = False
        width, height = session.pose.camera.size
        # jupyter_rfb displays the place of its errors at once; here it is displayed with the view
        with capture_output():
            super().__init__(css_width=f"{width}px", css_height=f"{height}px")

    @property
    def image(self) -> Image:
        """The picture with all pixels, of the camera and the settings as they are, also where no browser draws it."""
        return self.session.picture()

    @property
    def camera(self) -> Camera:
        """The camera; the view turns on from one that is set."""
        return self.session.pose.camera

    @camera.setter
    def camera(self, camera: Camera) -> None:
        if not isinstance(camera, Camera):
            raise expected("camera", "a Camera", type(camera).__name__)
        self.session.look(camera)
        self.request_draw()

    @property
    def settings(self) -> Settings:
        """The settings of the picture."""
        return self.session.scene.settings

    @settings.setter
    def settings(self, settings: Settings) -> None:
        if not isinstance(settings, Settings):
            raise expected("settings", "Settings", type(settings).__name__)
        self.change(**{name: getattr(settings, name) for name in names_of(Settings)})

    def change(self, **options: Any) -> None:
        """Draws with other options of the transfer function or the settings: `view.change(preset="mri", blend="mip")`.

        Raises InputError for options of other kinds, and for bad values.
        """
        reject_unknown("options", options, CHANGEABLE)
        scene = self.session.scene
        # a preset replaces the whole transfer function
        scene = replace(scene, transfer={}) if "preset" in options else scene
        self._take(scene.with_options(**options))

    def _take(self, scene: SceneFile) -> None:
        """Draws by the options of a scene; the widgets follow."""
        self.session.change(scene)
        self.request_draw()
        self.following = True
        try:
            for widgets in self.shown:
                self._set(widgets)
        finally:
            self.following = False

    @property
    def controls(self) -> Any:
        """Widgets that change the view, and follow it: an ipywidgets.VBox."""
        import ipywidgets

        values = statistics(self.session.document.volume).values
        low, high = float(values[0]), float(values[-1])
        # two numbers of more digits are cut off
        digits = ".0f" if high - low > 100 else ".3g"
        widgets = {
            "preset": ipywidgets.Dropdown(options=[AS_OPENED, *PRESETS]),
            "blend": ipywidgets.Dropdown(options=[*BLENDS]),
            "light": ipywidgets.Dropdown(options=declared(Settings)["light"].choices),
            "window": ipywidgets.FloatRangeSlider(
                min=low, max=high, step=(high - low) / 200 or 1.0, readout_format=digits
            ),
        }
        self._set(widgets)
        opened = self.session.scene
        for name, widget in widgets.items():
            widget.description, widget.continuous_update = name, False
            widget.observe(partial(self._choose, name, opened), "value")
        self.shown.append(widgets)
        return ipywidgets.VBox(list(widgets.values()))

    def _set(self, widgets: Mapping[str, Any]) -> None:
        """Sets widgets to what the view shows."""
        transfer = self.session.document.layers[0].transfer
        low, high = transfer.color_range
        slider, preset = widgets["window"], self.session.scene.transfer.get("preset")
        slider.min, slider.max = min(slider.min, low), max(slider.max, high)
        slider.value = low, high
        widgets["preset"].value = preset if preset in PRESETS else AS_OPENED
        widgets["blend"].value, widgets["light"].value = self.settings.blend, self.settings.light

    def _choose(self, name: str, opened: SceneFile, change: Mapping[str, Any]) -> None:
        """Applies a choice of the controls. opened: the scene whose transfer function is that as opened."""
        if self.following:
            return
        value = change["new"]
        if name == "preset" and value == AS_OPENED:
            self._take(replace(self.session.scene, transfer=opened.transfer))
        else:
            self.change(**{name: value})

    def handle_event(self, event: dict[str, Any]) -> None:
        """Applies an event of the browser."""
        if self.session.handle(event):
            self.request_draw()

    def get_frame(self) -> np.ndarray | None:
        """The due frame; schedules the next one."""
        frame = self.session.frame()
        wait = self.session.seconds_until_due()
        if wait is not None:
            # without an event loop, the caller asks again
            with suppress(RuntimeError):
                asyncio.get_running_loop().call_later(wait, self.request_draw)
        return frame

    def _ipython_display_(self) -> None:
        """Displays a picture for pages without widgets, as nbconvert makes them, and the widget, which hides it."""
        image = self.image
        jpeg, png = (
            b64encode(data).decode() for data in (image.encoded(Path("still.jpg"), 8, BLACK), image._repr_png_())
        )
        self.still = f"data:image/jpeg;base64,{jpeg}"
        name = escape(self.session.document.volume.name or "volume")
        html = f'<img class="splatgl-still" alt="picture of {name}" src="{self.still}">'
        display({"text/html": html, "image/png": png, "text/plain": ""}, raw=True)
        for widget in (self._output_context._repr_mimebundle_(), super()._repr_mimebundle_()[0]):
            display(widget | {"text/plain": ""}, raw=True)

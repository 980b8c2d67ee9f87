"""Panel in napari's window: draws the visible layers beside it, follows its camera, and saves the image."""

from __future__ import annotations

import atexit
import math
import threading
import time
from typing import Any

import numpy as np
from qtpy.QtCore import Qt, QTimer
from qtpy.QtCore import Signal as QtSignal  # type: ignore[attr-defined, unused-ignore]
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.integrations.napari.draw import summary
from splatgl.integrations.napari.snapshot import Look, view_of
from splatgl.integrations.napari.worker import Answer, Worker
from splatgl.options import Kind
from splatgl.splat.presets import PRESETS
from splatgl.splat.settings import BLENDS, choices

# minimum width of the image in the panel, pixels
LEAST_WIDTH = 320
# item of the blend and transfer functions that napari uses
AS_SHOWN = "as shown"
# sizes of pictures: multiples of the canvas, and pixels that can be edited
CANVAS = {"canvas": 1, "canvas ×2": 2, "canvas ×3": 3}
SIZES = (*CANVAS, "1920×1080", "1024×1024")
ANNOTATIONS = {"scale": "scale", "axes": "axes", "colorbar": "colours", "box": "box"}
# milliseconds after the last change before a picture that follows the camera, and between steps of the progress bar
SETTLE, STEP = 60, 100
# steps of the progress bar; expected time of a picture in times of its preview, before one is known
STEPS, OF_PREVIEW = 1000, 8.0
# events of the camera, sliders and layers that change a picture
CAMERA_EVENTS = ("center", "zoom", "angles", "perspective", "orientation")
DIMS_EVENTS = ("point", "ndisplay", "order")


class Panel(QWidget):  # type: ignore[misc, unused-ignore]
    """Draws the viewer's layers; `image` is the last image, `state` what its worker said last."""

    answered, failed = QtSignal(object), QtSignal(str)

    def __init__(self, napari_viewer: Any) -> None:
        super().__init__()
        self.viewer = napari_viewer
        self.image: Image | None = None
        # its samples, uint8 [H, W, 3], sRGB
        self.rgb = np.zeros((1, 1, 3), np.uint8)
        self.state, self.started, self.share, self.expected = "", 0.0, 0.0, 0.0
        self.worker = Worker(self.answered.emit)
        self.answered.connect(self._take)
        self.failed.connect(lambda text: self.summary.setText(text))
        atexit.register(self.worker.close)
        self.destroyed.connect(self.worker.close)
        self.timer, self.ticks = QTimer(self), QTimer(self)
        self.timer.setSingleShot(True)
        self.timer.timeout.connect(self.draw)
        self.ticks.timeout.connect(self._tick)
        self._add_options()
        self._add_buttons()
        self._follow_events()
        # the process is ready when it is needed
        self.worker.cancel()

    def _add_options(self) -> None:
        """Adds the options of a picture."""
        column, grid = QVBoxLayout(self), QGridLayout()
        self.blends, self.presets, self.lights, self.sizes = (QComboBox() for _ in range(4))
        rows: tuple[tuple[str, Any, Any], ...] = (
            ("blend", self.blends, (AS_SHOWN, *BLENDS)),
            ("colours", self.presets, (AS_SHOWN, *PRESETS)),
            ("light", self.lights, choices()["light"]),
            ("size", self.sizes, SIZES),
        )
        for number, (name, box, items) in enumerate(rows):
            box.addItems(items)
            box.currentTextChanged.connect(self._changed)
            grid.addWidget(QLabel(name), number // 2, number % 2 * 2)
            grid.addWidget(box, number // 2, number % 2 * 2 + 1)
        self.sizes.setEditable(True)
        self.annotations = {name: QCheckBox(label) for name, label in ANNOTATIONS.items()}
        self.follow = QCheckBox("follow the camera")
        boxes = QHBoxLayout()
        for box in (*self.annotations.values(), self.follow):
            box.toggled.connect(self._changed)
            boxes.addWidget(box)
        column.addLayout(grid)
        column.addLayout(boxes)

    def _add_buttons(self) -> None:
        """Adds the buttons, the image and its summary."""
        buttons = [QPushButton(name) for name in ("Render", "Cancel", "Save…", "Copy", "As layer")]
        self.render_button, self.cancel_button, self.save_button, self.copy_button, self.layer_button = buttons
        row = QHBoxLayout()
        for button, action in zip(buttons, (self.draw, self.cancel, self.save, self.copy, self.add_layer), strict=True):
            button.clicked.connect(action)
            row.addWidget(button)
        self.bar = QProgressBar()
        self.bar.setRange(0, STEPS)
        self.bar.setTextVisible(False)
        self.shown, self.summary = QLabel(), QLabel()
        self.shown.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.shown.setMinimumSize(LEAST_WIDTH, LEAST_WIDTH)
        # a picture leaves room for its summary
        self.shown.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self.summary.setWordWrap(True)
        column: Any = self.layout()
        column.addLayout(row)
        column.addWidget(self.bar)
        column.addWidget(self.shown, stretch=1)
        column.addWidget(self.summary)
        self._enable()

    def _enable(self) -> None:
        """Enables the buttons that have something to do."""
        self.cancel_button.setEnabled(self.worker.busy)
        for button in (self.save_button, self.copy_button, self.layer_button):
            button.setEnabled(self.image is not None)

    def _follow_events(self) -> None:
        """Draws again once the camera, sliders or layers change, if asked."""
        scene = getattr(self.viewer, "scene", None)
        camera = scene.camera if scene is not None else self.viewer.camera
        for holder, names in ((camera, CAMERA_EVENTS), (self.viewer.dims, DIMS_EVENTS)):
            for name in names:
                getattr(holder.events, name).connect(self._changed)
        for name in ("inserted", "removed", "reordered"):
            getattr(self.viewer.layers.events, name).connect(self._changed)

    def _changed(self, *event: Any) -> None:
        if self.follow.isChecked():
            self.timer.start(SETTLE)

    def look(self) -> Look:
        """The chosen options. Raises InputError for a size that is none."""
        blend, preset = self.blends.currentText(), self.presets.currentText()
        light: Any = self.lights.currentText()
        text = self.sizes.currentText().strip()
        high, wide = view_of(self.viewer)[0].size
        if text in CANVAS:
            size = round(wide) * CANVAS[text], round(high) * CANVAS[text]
        else:
            try:
                size = Kind.picture_size().check(text)
            except ValueError:
                raise InputError(f"size: expected {Kind.picture_size().this}, got {text!r}") from None
        names = tuple(name for name, box in self.annotations.items() if box.isChecked())
        common: Any = None if blend == AS_SHOWN else blend
        return Look(common, size, light, "" if preset == AS_SHOWN else preset, names)

    def draw(self) -> None:
        """Begins to draw the visible layers; previews and the image appear when they are drawn."""
        try:
            look = self.look()
        except InputError as error:
            self._fail(str(error))
            return
        # an older image must not be saved in place of this one
        self.image = None
        self.started, self.share = time.monotonic(), 0.0
        self.worker.draw(self.viewer, look)
        self.state = "drawing"
        self.summary.setText("drawing …")
        self.ticks.start(STEP)
        self._enable()

    def cancel(self) -> None:
        """Ends the drawing; a preview stays."""
        self.worker.cancel()
        self.state = "cancelled"
        self.summary.setText("cancelled")
        self._end()

    def save(self) -> None:
        """Asks for a file name and writes the image, in a thread: encoding may take long."""
        name, _ = QFileDialog.getSaveFileName(self, "Save the picture", "picture.png")
        if name and self.image is not None:
            threading.Thread(target=self._write, args=(self.image, name)).start()

    def _write(self, image: Image, name: str) -> None:
        try:
            image.save(name)
        except InputError as error:
            self.failed.emit(str(error))

    def copy(self) -> None:
        """Copies the image to the clipboard."""
        if self.image is not None:
            clipboard: Any = QApplication.clipboard()
            clipboard.setImage(_picture(self.rgb))

    def add_layer(self) -> None:
        """Adds the image to the viewer as a layer of its own."""
        if self.image is not None:
            self.viewer.add_image(self.rgb, name="splatgl", rgb=True)

    def closeEvent(self, event: Any) -> None:  # noqa: N802, D102
        self.worker.close()
        super().closeEvent(event)

    def resizeEvent(self, event: Any) -> None:  # noqa: N802, D102
        super().resizeEvent(event)
        self._show()

    def _take(self, answer: Answer) -> None:
        """Shows what the worker has drawn."""
        if answer.job != self.worker.number:
            return
        self.state = answer.state
        if answer.state == "error":
            self._fail(answer.text)
        elif answer.image is not None and answer.rgb is not None:
            self.rgb, self.pixels = answer.rgb, QPixmap.fromImage(_picture(answer.rgb))
            self._show()
            self.share = answer.share
            if answer.state == "preview":
                self.expected = self.expected or OF_PREVIEW * answer.seconds
                self.summary.setText(f"preview after {answer.seconds:.2f} s, drawing …")
                return
            self.image, self.expected = answer.image, answer.seconds
            self.summary.setText(summary(answer.image))
            self._end()

    def _fail(self, text: str) -> None:
        self.image = None
        self.shown.clear()
        self.pixels = QPixmap()
        self.summary.setText(text)
        self._end()

    def _end(self) -> None:
        self.ticks.stop()
        self.bar.setValue(0 if self.image is None else STEPS)
        self._enable()

    def _tick(self) -> None:
        """Moves the bar by the time of earlier pictures; it does not reach the end before the image does."""
        rest = 1 - math.exp(-(time.monotonic() - self.started) / (self.expected or 1.0))
        self.bar.setValue(round(STEPS * max(self.share, 0.95 * rest)))

    def _show(self) -> None:
        pixels = getattr(self, "pixels", None)
        if pixels is not None and not pixels.isNull():
            ways = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
            self.shown.setPixmap(pixels.scaled(self.shown.size(), *ways))


def _picture(rgb: np.ndarray) -> QImage:
    """A QImage of RGB samples, uint8 [H, W, 3], with memory of its own."""
    height, width, _ = rgb.shape
    return QImage(rgb.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888).copy()

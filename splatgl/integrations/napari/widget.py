"""The panel's widget in napari's window: a button that draws, the picture, and what it leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import (
    QApplication,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from splatgl.data.image import Image
from splatgl.errors import USER_ERRORS, error_text
from splatgl.integrations.napari.panel import picture
from splatgl.splat.settings import choices

# minimum width of the image in the panel, pixels
LEAST_WIDTH = 320
# the item that blends as the layers are rendered
AS_SHOWN = "as shown"


class NapariPanel(QWidget):
    """Draws the visible image and label layers of a viewer as a scene. image: the latest picture, or None."""

    def __init__(self, napari_viewer: Any) -> None:
        super().__init__()
        self.viewer = napari_viewer
        self.image: Image | None = None
        # its samples, uint8 [H, W, 3], sRGB
        self.rgb = np.zeros((1, 1, 3), np.uint8)
        self.blends, self.shown, self.summary = QComboBox(), QLabel(), QLabel()
        self.blends.addItems((AS_SHOWN, *choices()["blend"]))
        self.buttons = [QPushButton(name) for name in ("Render", "Save…", "Copy", "As layer")]
        row, column = QHBoxLayout(), QVBoxLayout(self)
        row.addWidget(self.blends)
        for button, action in zip(self.buttons, (self.draw, self.save, self.copy, self.add_layer), strict=True):
            button.clicked.connect(action)
            row.addWidget(button)
        self.shown.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.shown.setMinimumSize(LEAST_WIDTH, LEAST_WIDTH)
        # a picture leaves room for its summary
        self.shown.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self.summary.setWordWrap(True)
        column.addLayout(row)
        column.addWidget(self.shown, stretch=1)
        column.addWidget(self.summary)
        self._show(None, "")

    def draw(self) -> None:
        """Draws the visible layers; the window waits."""
        blend: Any = self.blends.currentText()
        QApplication.setOverrideCursor(Qt.CursorShape.WaitCursor)
        try:
            image = picture(self.viewer, None if blend == AS_SHOWN else blend)
        except USER_ERRORS as error:
            self._show(None, error_text(error))
        else:
            self._show(image, summary(image))
        finally:
            QApplication.restoreOverrideCursor()

    def save(self) -> None:
        """Asks for a file name and writes the image."""
        name, _ = QFileDialog.getSaveFileName(self, "Save the picture", "picture.png")
        if name and self.image is not None:
            try:
                self.image.save(name)
            except USER_ERRORS as error:
                self.summary.setText(error_text(error))

    def copy(self) -> None:
        """Copies the image to the clipboard."""
        clipboard: Any = QApplication.clipboard()
        clipboard.setImage(_qimage(self.rgb))

    def add_layer(self) -> None:
        """Adds the image to the viewer as a layer of its own."""
        self.viewer.add_image(self.rgb, name="splatgl", rgb=True)

    def resizeEvent(self, event: Any) -> None:  # noqa: N802, D102
        super().resizeEvent(event)
        self._fit()

    def _show(self, image: Image | None, text: str) -> None:
        self.image = image
        self.summary.setText(text)
        self.shown.clear()
        if image is not None:
            self.rgb = np.ascontiguousarray(image.samples8((0.0, 0.0, 0.0))[..., :3])
            self._fit()
        for button in self.buttons[1:]:
            button.setEnabled(image is not None)

    def _fit(self) -> None:
        if self.image is not None:
            ways = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
            self.shown.setPixmap(QPixmap.fromImage(_qimage(self.rgb)).scaled(self.shown.size(), *ways))


def summary(image: Image) -> str:
    """Summary line of an image, and a line for each of its notes."""
    info, (height, width, _) = image.info, image.pixels.shape
    by = str(info["renderer"]).partition(" (")[0]
    line = f"{width}×{height} pixels, {info['blend']} of {info['splats']:,} splats, {info['seconds']:.2f} s by {by}"
    return "\n".join([line, *image.notes])


def _qimage(rgb: np.ndarray) -> QImage:
    """A QImage of RGB samples, uint8 [H, W, 3], with memory of its own."""
    height, width, _ = rgb.shape
    return QImage(rgb.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888).copy()

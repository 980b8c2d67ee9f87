"""Panel in napari's window: draws the visible layers, shows the image with its summary, and saves it."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.integrations.napari.draw import picture, summary
from splatgl.splat.settings import BLENDS

# minimum width of the image in the panel, pixels
LEAST_WIDTH = 320
# item of the blend that napari uses
AS_SHOWN = "as shown"


class Panel(QWidget):  # type: ignore[misc, unused-ignore]
    """Draws the viewer's layers; `image` is the last image."""

    def __init__(self, napari_viewer: Any) -> None:
        super().__init__()
        self.viewer = napari_viewer
        self.image: Image | None = None
        self.blends = QComboBox()
        self.blends.addItems([AS_SHOWN, *BLENDS])
        draw, self.save_button = QPushButton("Render"), QPushButton("Save…")
        draw.clicked.connect(self.draw)
        self.save_button.clicked.connect(self.save)
        self.save_button.setEnabled(False)
        self.shown, self.summary = QLabel(), QLabel()
        self.shown.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.shown.setMinimumSize(LEAST_WIDTH, LEAST_WIDTH)
        self.summary.setWordWrap(True)
        row, column = QHBoxLayout(), QVBoxLayout(self)
        for widget in (self.blends, draw, self.save_button):
            row.addWidget(widget)
        column.addLayout(row)
        column.addWidget(self.shown, stretch=1)
        column.addWidget(self.summary)

    def draw(self) -> None:
        """Draws the visible layers; shows errors and notes below the image."""
        # an older image must not be saved in place of this one
        self.image = None
        self.shown.clear()
        self.save_button.setEnabled(False)
        try:
            blend: Any = self.blends.currentText()
            self.image = picture(self.viewer, None if blend == AS_SHOWN else blend)
        except InputError as error:
            self.summary.setText(str(error))
            return
        self.summary.setText(summary(self.image))
        self.save_button.setEnabled(True)
        self._show()

    def save(self) -> None:
        """Asks for a file name and writes the image."""
        name, _ = QFileDialog.getSaveFileName(self, "Save the picture", "picture.png")
        if name and self.image is not None:
            try:
                self.image.save(name)
            except InputError as error:
                self.summary.setText(str(error))

    def resizeEvent(self, event: Any) -> None:  # noqa: N802, D102
        super().resizeEvent(event)
        self._show()

    def _show(self) -> None:
        if self.image is None:
            return
        rgb = self.image.to_pil().convert("RGB")
        width, height, samples = rgb.width, rgb.height, rgb.tobytes()
        whole = QPixmap.fromImage(QImage(samples, width, height, 3 * width, QImage.Format.Format_RGB888))
        ways = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
        self.shown.setPixmap(whole.scaled(self.shown.size(), *ways))

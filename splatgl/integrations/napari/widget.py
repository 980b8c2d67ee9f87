"""The panel in napari's window: draws the visible layers, shows the picture and what was drawn, and saves it."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import Qt
from qtpy.QtGui import QImage, QPixmap
from qtpy.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.integrations.napari.draw import picture, told
from splatgl.splat.settings import BLENDS

# least width of the picture in the panel, pixels
LEAST_WIDTH = 320
# the blend that napari draws the layers by
AS_SHOWN = "as shown"


class Panel(QWidget):  # type: ignore[misc, unused-ignore]
    """Draws what the viewer shows; `image` is the last picture."""

    def __init__(self, napari_viewer: Any) -> None:
        super().__init__()
        self.viewer = napari_viewer
        self.image: Image | None = None
        self.blends = QComboBox()
        self.blends.addItems([AS_SHOWN, *BLENDS])
        draw, self.keep = QPushButton("Render"), QPushButton("Save…")
        draw.clicked.connect(self.draw)
        self.keep.clicked.connect(self.save)
        self.keep.setEnabled(False)
        self.shown, self.summary = QLabel(), QLabel()
        self.shown.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.shown.setMinimumSize(LEAST_WIDTH, LEAST_WIDTH)
        self.summary.setWordWrap(True)
        row, column = QHBoxLayout(), QVBoxLayout(self)
        for each in (self.blends, draw, self.keep):
            row.addWidget(each)
        column.addLayout(row)
        column.addWidget(self.shown, stretch=1)
        column.addWidget(self.summary)

    def draw(self) -> None:
        """Draws the visible layers; what cannot be drawn, and what is left out, is told below."""
        # no older picture is left that could be saved as this one
        self.image = None
        self.shown.clear()
        self.keep.setEnabled(False)
        try:
            blend = self.blends.currentText()
            self.image = picture(self.viewer, None if blend == AS_SHOWN else blend)
        except InputError as error:
            self.summary.setText(str(error))
            return
        self.summary.setText(told(self.image))
        self.keep.setEnabled(True)
        self._show()

    def save(self) -> None:
        """Asks for a file's name and writes the picture."""
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

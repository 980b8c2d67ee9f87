"""Pictures of slices: one, or several side by side at one scale, with their positions and directions."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.annotate import text_of
from splatgl.annotations.canvas import AnnotatedSubject, AnnotationView, Canvas, ColorScale
from splatgl.annotations.world_lines import draw_measures, letters, measure_text
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.options import names_of, no_effect, non_default
from splatgl.scene.view import ViewOptions

if TYPE_CHECKING:
    from splatgl.geometry.camera import Camera
    from splatgl.geometry.slices import SlicePainter, SlicePlane
    from splatgl.scene.open_scene import OpenScene
    from splatgl.scene.scene_file import SceneFile

# pixels between slices, and font heights of a slice that has room for letters of directions
GAP, LETTERS = 2, 7
# annotations of a sheet, and the margins that they take at the right, the top and the bottom, font heights
ANNOTATIONS = {"scale": (0, 0, 3.5), "colorbar": (11.5, 0, 0), "title": (0, 2.5, 0), "measures": (0, 0, 0)}
# height of a line with its halo, font heights; font heights of a slice that has room for a title above it
LINE, TITLED = 1.4, 4
# options of the view that slices have
OF_SLICES = ("size", "zoom", "up", "dpi", "width")
# voxels of a measure's points from its slice
ON_SLICE = 0.5 + 1e-6
# samples along a side of a pixel: at least of labels, whose borders are sharp, and at most
LABELS, MOST = 3, 8


@dataclass(frozen=True)
class SlicePage:
    """Cells in columns and rows. size: of their part of the picture, pixels, `top` below its upper edge. pitch: side
    of a pixel, world units. room: pixels of a cell with its gap and margins. margins: at the left and right of a slice,
    above and below it, pixels.
    """

    size: tuple[int, int]
    top: int
    columns: int
    rows: int
    pitch: float
    room: tuple[int, int]
    margins: tuple[int, int, int]

    @classmethod
    def fitted(cls, size: tuple[int, int], top: int, sides: np.ndarray, zoom: float, em: int) -> SlicePage:
        """The sheet as of `of`, with the margins that titles and letters of slices of that size have. em: font height,
        pixels; 0: without letters.
        """
        line = round(LINE * em)
        for margins, least in (((line, line, line), LETTERS), ((0, line, 0), TITLED)):
            with suppress(InputError):
                sheet = cls.of(size, top, sides, zoom, margins)
                if min(sheet.inner) >= least * em:
                    return sheet
        return cls.of(size, top, sides, zoom, (0, 0, 0))

    @classmethod
    def of(
        cls, size: tuple[int, int], top: int, sides: np.ndarray, zoom: float, margins: tuple[int, int, int]
    ) -> SlicePage:
        """The sheet on which slices of `sides` [N, 2], world units, are largest. zoom: a factor of their size."""
        sheets, widest, around = [], sides.max(axis=0), np.array([2 * margins[0], sum(margins[1:])]) + GAP
        for columns in range(1, len(sides) + 1):
            rows = -(-len(sides) // columns)
            most = np.array(size) // (columns, rows)
            if (most > around).all():
                pitch = float((widest / (most - around)).max()) / zoom
                wide, high = np.minimum(np.ceil(widest / pitch - 1e-6).astype(int) + around, most).tolist()
                sheets.append(cls(size, top, columns, rows, pitch, (wide, high), margins))
        if not sheets:
            raise expected("slice", f"fewer slices than pixels in {size[0]}×{size[1]}", len(sides), "a larger --size")
        return min(sheets, key=lambda sheet: sheet.pitch)

    @property
    def inner(self) -> np.ndarray:
        """Pixels [2] of a cell that a slice may take."""
        side, above, below = self.margins
        return np.array(self.room) - (2 * side, above + below) - GAP

    def cell(self, number: int) -> np.ndarray:
        """Left and top [2] of the room of a slice within its margins, pixels; all cells are in the middle."""
        place = np.array(divmod(number, self.columns))[::-1]
        margin = (np.array(self.size) - np.array([self.columns, self.rows]) * self.room) // 2
        return margin + place * self.room + np.array([0, self.top]) + self.margins[:2] + GAP // 2


def draw_slices(scene: OpenScene) -> tuple[Image, AnnotationView | None]:
    """The picture of a scene's slices, and the view of its annotations, if there are any; needs no OpenGL. Raises
    InputError for planes beside the volume, and for annotations of a view in space.
    """
    from splatgl.geometry.slices import parse_slices

    started, file, volume = time.perf_counter(), scene.file, scene.volume
    names = [text.partition("=")[0] for text in file.annotate]
    for name in names:
        if name not in ANNOTATIONS:
            raise expected("annotate", f"{', '.join(ANNOTATIONS)} beside slices", name)
    planes = parse_slices(file.slices, volume, np.asarray(file.view.slice_up(volume.hints)))
    size, background = file.view.size, file.settings.ground
    pixels: np.ndarray = np.zeros((size[1], size[0], 4), np.float32)
    canvas = Canvas.over(pixels, background)
    em = canvas.em
    right, top, bottom = (max((ANNOTATIONS[name][n] for name in names), default=0) * em for n in range(3))
    part = round(size[0] - right), round(size[1] - top - bottom)
    sides = np.array([plane.box[1] - plane.box[0] for plane in planes])
    sheet = SlicePage.fitted(part, round(top), sides, file.view.zoom or 1.0, em)
    painter, cells = replace(scene.scene.painter("slice"), fill=file.label_fill), []
    for number, plane in enumerate(planes):
        cell = PageCell.of(plane, sheet, number)
        left, top_row, right_end, bottom_row = cell.box
        pixels[top_row:bottom_row, left:right_end] = cell.light(painter, canvas.edge)
        cells.append(cell)
    if background is not None:
        pixels += (1 - pixels[..., 3:]) * np.append(np.asarray(background, np.float32), np.float32(1))
    canvas = Canvas.over(pixels, background)
    for cell in cells:
        _write(canvas, cell.plane, cell.box, sheet.margins, volume)
    notes = _write_measures(canvas, cells, scene) if "measures" in names else []
    pixels = canvas.pixels + (1 - canvas.pixels[..., 3:]) * pixels
    info = {
        "blend": "slices",
        "size": list(size),
        "pitch": sheet.pitch,
        "unit": volume.unit,
        "slices": [cell.provenance for cell in cells],
        "background": None if background is None else list(background),
        "seconds": round(time.perf_counter() - started, 6),
    }
    image = Image(pixels, info).with_notes([*notes, *_unused_notes(file)])
    return image, _annotation_view(scene, cells) if names else None


def _unused_notes(file: SceneFile) -> list[str]:
    """A note on settings and options of a view in space, which slices do not have; presets state a blend, too."""
    of_preset = {"blend"} if "preset" in file.transfer else set()
    given = [name for name in file.settings.given if name not in ("background", "clip", *of_preset)]
    viewing = [name for name in names_of(ViewOptions) if name in non_default(file.view) and name not in OF_SLICES]
    return no_effect([*given, *viewing], "slices have no view in space")


@dataclass(frozen=True, eq=False)
class PageCell:
    """A slice in a sheet. box: left, top, right, bottom, pixels. start [2]: their left upper edge along the plane's
    right and down; pitch: side of a pixel, world units.
    """

    plane: SlicePlane
    box: tuple[int, int, int, int]
    start: np.ndarray
    pitch: float

    @classmethod
    def of(cls, plane: SlicePlane, sheet: SlicePage, number: int) -> PageCell:
        """The cell of a slice: whole pixels that contain it, as many as there is room for."""
        low, high = plane.box
        wide = np.minimum(np.ceil((high - low) / sheet.pitch - 1e-6), sheet.inner).astype(int)
        x, y = (sheet.cell(number) + (sheet.inner - wide) // 2).tolist()
        box = (x, y, x + int(wide[0]), y + int(wide[1]))
        return cls(plane, box, (low + high - wide * sheet.pitch) / 2, sheet.pitch)

    def light(self, painter: SlicePainter, width: int) -> np.ndarray:
        """The light of the pixels, float32 [h, w, 4]. width: of outlines, pixels."""
        left, top, right, bottom = self.box
        fine = _samples(painter, self.plane, self.pitch)
        size = ((right - left) * fine, (bottom - top) * fine)
        light = painter.pixels(self.plane, self.start, (self.pitch / fine,) * 2, size, width=width * fine)
        return light.reshape(bottom - top, fine, right - left, fine, 4).mean(axis=(1, 3)).astype(np.float32)

    @property
    def camera(self) -> Camera:
        """The view of the pixels of the box."""
        from splatgl.geometry.camera import Camera

        left, top, right, bottom = self.box
        size, plane = (right - left, bottom - top), self.plane
        center = plane.point + (self.start + self.pitch * np.array(size) / 2) @ np.array([plane.right, plane.down])
        high = self.pitch * size[1]
        return Camera.orthographic(center - 2 * high * plane.normal, center, -plane.down, high, size)

    @property
    def provenance(self) -> dict[str, object]:
        """The plane, and where its pixels are: the centre of the one in column i and row j of the picture lies at
        corner + (i − left + ½) · steps[0] + (j − top + ½) · steps[1], world units.
        """
        plane = self.plane
        vectors = {name: getattr(plane, name).tolist() for name in ("point", "normal", "right", "down")}
        corner = plane.point + self.start @ np.array([plane.right, plane.down])
        steps = [(self.pitch * plane.right).tolist(), (self.pitch * plane.down).tolist()]
        return {"title": plane.title, **vectors, "pixels": list(self.box), "corner": corner.tolist(), "steps": steps}


def _samples(painter: SlicePainter, plane: SlicePlane, pitch: float) -> int:
    """Samples along a side of a pixel: as dense as voxels."""
    least = LABELS if any(layer.nearest for layer in painter.layers) else 1
    return int(np.clip(np.ceil(pitch * painter.density(plane).max() - 1e-6), least, MOST))


def _write(
    canvas: Canvas, plane: SlicePlane, box: Sequence[int], margins: tuple[int, int, int], volume: Volume
) -> None:
    """Writes the place of a slice above it, and the directions around it, where there is room."""
    left, top, right, bottom = box
    side, above, below = margins
    canvas.text(plane.title, left - side, top - above)
    wide = canvas.text_size(plane.title)[0] + canvas.em // 2 - side
    if volume.frame is None or min(right - left, bottom - top) < LETTERS * canvas.em:
        return
    for vector, axis in ((plane.right, 0), (plane.down, 1)):
        for sign in (-1, 1):
            text = letters(volume.frame, sign * vector)
            size = canvas.text_size(text)
            at = [(left + right - size[0]) // 2, (top + bottom - size[1]) // 2]
            ends = ((left - side, right + side - size[0]), (top - above, bottom + below - size[1]))[axis]
            at[axis] = ends[sign > 0]
            if axis == 1 and sign < 0:
                at[0] = max(at[0], left + wide)
            if at[0] + size[0] <= right + side:
                canvas.text(text, at[0], at[1])


def _write_measures(canvas: Canvas, cells: Sequence[PageCell], scene: OpenScene) -> list[str]:
    """Draws each measure on the slices within half a voxel of all its points; a note on those that lie on no slice."""
    subject, into = scene.annotated_subject, np.linalg.inv(scene.volume.world_from_index)
    nearest, notes = [np.inf] * len(subject.measures), list[str]()
    for cell in cells:
        plane, (left, top, right, bottom), on_it = cell.plane, cell.box, []
        for number, measure in enumerate(subject.measures):
            distance = float(np.abs((np.array(measure.points) - plane.point) @ plane.normal).max())
            is_on = distance * np.abs(into @ plane.normal).max() <= ON_SLICE
            nearest[number] = 0.0 if is_on else min(nearest[number], distance)
            on_it += [measure] if is_on else []
        layer = Canvas(np.zeros((bottom - top, right - left, 4), np.float32), canvas.ink, font=canvas.em)
        draw_measures(layer, AnnotationView(replace(subject, measures=tuple(on_it)), scene.transfer, cell.camera))
        canvas.add(layer, (left, top))
        notes += layer.notes
    for measure, distance in zip(subject.measures, nearest, strict=True):
        away = f"{distance:.4g} {scene.volume.unit or 'units'} away"
        notes += [f"measure {measure_text(measure, subject)}: on no slice, the nearest is {away}"] if distance else []
    return notes


def _annotation_view(scene: OpenScene, cells: Sequence[PageCell]) -> AnnotationView:
    """The view of slices side by side that annotations show."""
    from splatgl.geometry.camera import Camera

    size, plane = scene.file.view.size, cells[0].plane
    center, high = scene.volume.center, cells[0].pitch * size[1]
    camera = Camera.orthographic(center - 2 * high * plane.normal, center, -plane.down, high, size)
    subject, transfer = AnnotatedSubject.of(scene.volume), scene.scene.painter("slice").layers[0].transfer
    if not (transfer.labels or subject.colored):
        low, high = transfer.color_range
        scale = ColorScale(transfer.colormap, float(low), float(high), subject.value_name)
        subject = replace(subject, scales=(scale,) if low < high else (), empty=low < high)
    has_scale = text_of(scene.file.annotate, "scale") is not None
    if has_scale and len({subject.lengths(cell.plane.right) for cell in cells}) > 1:
        raise expected("annotate", "no scale for slices along axes of several units", "scale")
    return AnnotationView(subject, transfer, camera)

"""Thumbnails of a few methods' images, and of their differences, magnified on a common scale."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.comparison.html_report import data_uri, heat, largest, shown
from splatgl.data.image import Image
from splatgl.errors import InputError
from splatgl.reference.renderer import Renderer
from splatgl.splat.settings import Settings
from splatgl.truth.report.methods import EXACT, PAPER, methods
from splatgl.truth.report.results import Scene
from splatgl.truth.report.subject import Subject
from splatgl.truth.report.truths import Truths

# methods shown, if drawn
PREVIEW = "preview 1/2"
SPLATS = (PAPER, "grid", "ray", EXACT, "no antialiasing", "2×2", "4×4", PREVIEW)
SHOWN = (*SPLATS, "sheets 3", "post b-spline", "post b-spline 2×2")
# percentile of the worst method's differences shown as the brightest
BRIGHTEST = 99.5
COMPARED = ("reference", "sampled", "field")
# images up to this many pixels a side are enlarged on the page
SQUARES = 128


@dataclass(frozen=True)
class Thumbnail:
    """One method's picture and its differences, as data URIs, by truth."""

    name: str
    picture: str
    differences: dict[str, str]


@dataclass(frozen=True)
class Strip:
    """A scene's thumbnails, the truth first. scales: the brightest difference, by truth.

    small: whether pixels are shown as squares.
    """

    thumbnails: tuple[Thumbnail, ...]
    scales: dict[str, float]
    small: bool


def strip(renderer: Renderer, subject: Subject, scene: Scene, truths: Truths) -> Strip:
    """Redraws the methods: the images are bitwise identical."""
    rows = {name: row for name in SHOWN if (row := scene.row(name)) is not None and not row.omitted}
    drawn: dict[str, Image] = {}
    found: dict[tuple[str, str], np.ndarray] = {}
    for name, row in rows.items():
        splats, settings = subject.drawn(methods()[name])
        drawn[name] = renderer.render(splats, subject.camera, settings)
        for truth in COMPARED:
            if truth in row.errors:
                found[name, truth] = largest(drawn[name], truths.get(truth, settings))
    scales = {t: _scale([d for (name, of), d in found.items() if of == t and name != PREVIEW]) for t in COMPARED}
    peak = max((float(image.pixels.max()) for image in drawn.values()), default=1.0) or 1.0
    peak = peak if subject.settings.blend == "xray" else 1.0
    cells = [Thumbnail(name, data_uri(shown(right, peak)), {}) for name, right in _truth(truths, subject.settings)]
    for name in rows:
        heats = {t: _heat(found[name, t], scales[t]) for t in COMPARED if (name, t) in found}
        cells.append(Thumbnail(name, data_uri(shown(drawn[name], peak)), heats))
    return Strip(tuple(cells), scales, max(subject.camera.size) <= SQUARES)


def _truth(truths: Truths, settings: Settings) -> Iterator[tuple[str, Image]]:
    """The sampled truth and the field by their names, if any."""
    for truth, name in (("sampled", "sampled truth"), ("field", "the field")):
        try:
            yield name, truths.get(truth, settings)
        except InputError:
            continue


def _scale(differences: list[np.ndarray]) -> float:
    return max((float(np.percentile(d, BRIGHTEST)) for d in differences), default=0.0) or 1.0


def _heat(difference: np.ndarray, scale: float) -> str:
    """Heat map from 0 to `scale`, which is set by an extra pixel that is cropped afterwards."""
    clipped = np.minimum(difference, np.float32(scale))
    with_scale = np.pad(clipped, ((0, 1), (0, 0)))
    with_scale[-1, 0] = scale
    return data_uri(heat(with_scale)[:-1])

"""Thumbnails of what a few methods draw, and of how it differs, magnified on one scale for all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from splatgl.data.errors import InputError
from splatgl.data.image import Image
from splatgl.splat.plan.settings import Settings
from splatgl.truth.compare_pictures import data_uri, heat, largest, shown
from splatgl.truth.drawing import Renderer
from splatgl.truth.report.methods import DEFAULT, PAPER, methods
from splatgl.truth.report.results import Scene
from splatgl.truth.report.subject import Subject
from splatgl.truth.report.truths import Truths

# whose pictures are shown, as far as they were drawn
PREVIEW = "preview 1/2"
SHOWN = (PAPER, "grid", "ray", DEFAULT, "no antialiasing", "2×2", "4×4", PREVIEW)
# differences are shown up to what this share of the worst method's pixels exceeds
BRIGHTEST = 99.5
COMPARED = ("reference", "sampled")
# up to so many pixels a side, pictures are enlarged on the page
SQUARES = 128


@dataclass(frozen=True)
class Thumbnail:
    """One method's picture and its differences, as data URIs, by truth."""

    name: str
    picture: str
    differences: dict[str, str]


@dataclass(frozen=True)
class Strip:
    """A scene's thumbnails, the truth first. scales: the difference that is drawn brightest, by truth.

    small: whether pixels are shown as squares.
    """

    thumbnails: tuple[Thumbnail, ...]
    scales: dict[str, float]
    small: bool


def strip(renderer: Renderer, subject: Subject, scene: Scene, truths: Truths) -> Strip:
    """Draws the methods again: the same pictures, bit for bit."""
    names = [name for name in SHOWN if (row := scene.row(name)) is not None and not row.omitted]
    drawn: dict[str, Image] = {}
    found: dict[tuple[str, str], np.ndarray] = {}
    for name in names:
        splats, settings = subject.drawn(methods()[name])
        drawn[name] = renderer.render(splats, subject.camera, settings)
        for truth in COMPARED:
            try:
                found[name, truth] = largest(drawn[name], truths.get(truth, settings))
            except InputError:
                # that method has no such truth; the page says so where it tells what was left out
                continue
    scales = {t: _scale([d for (name, of), d in found.items() if of == t and name != PREVIEW]) for t in COMPARED}
    peak = max((float(image.pixels.max()) for image in drawn.values()), default=1.0) or 1.0
    peak = peak if subject.settings.blend == "xray" else 1.0
    cells = [Thumbnail(name, data_uri(shown(right, peak)), {}) for name, right in _truth(truths, subject.settings)]
    for name in names:
        heats = {t: _heat(found[name, t], scales[t]) for t in COMPARED if (name, t) in found}
        cells.append(Thumbnail(name, data_uri(shown(drawn[name], peak)), heats))
    return Strip(tuple(cells), scales, max(subject.camera.size) <= SQUARES)


def _truth(truths: Truths, settings: Settings) -> Iterator[tuple[str, Image]]:
    """The sampled truth by its name, where there is one."""
    try:
        yield "sampled truth", truths.get("sampled", settings)
    except InputError:
        return


def _scale(differences: list[np.ndarray]) -> float:
    return max((float(np.percentile(d, BRIGHTEST)) for d in differences), default=0.0) or 1.0


def _heat(difference: np.ndarray, scale: float) -> str:
    """Heat from 0 to `scale`: a pixel beyond the picture, which is cut off, holds the scale."""
    clipped = np.minimum(difference, np.float32(scale))
    with_scale = np.pad(clipped, ((0, 1), (0, 0)))
    with_scale[-1, 0] = scale
    return data_uri(heat(with_scale)[:-1])

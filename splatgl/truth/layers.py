"""Several layers in float64: the twin of `shaders/layers_over.comp`.

Along a ray each layer is a sequence of pieces of even matter. Between any two ends extinctions and emissions of all
layers add up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window, ahead
from splatgl.splat.resolve import Resolved, suited
from splatgl.splat.scene import Scene, check_layer, common_samples
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats
from splatgl.truth.boxes import BoxScene
from splatgl.truth.sheet_field import behind
from splatgl.truth.sheets import Pieces, SheetScene


@dataclass(frozen=True, eq=False)
class LayerScene:
    """Data shared by all windows of a picture of layers, each in sheets or boxes."""

    layers: Sequence[SheetScene | BoxScene]

    def band_height(self) -> int:
        """Rows of pixels drawn together."""
        return max(min(layer.band_height() for layer in self.layers) // (2 * len(self.layers)), 1)

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        light = merged([layer.pieces(window) for layer in self.layers])
        return light.reshape(window.height, window.width, 4)

    def between(self, window: Window, near: np.ndarray, far: np.ndarray) -> np.ndarray:
        """Light [P, 4] of what a window's pixels see between distances [P], world units."""
        return merged([layer.pieces(window, near, far) for layer in self.layers])

    def parts(self, windows: Sequence[Window]) -> list[np.ndarray]:
        """Windows of the picture."""
        return [self.part(window) for window in windows]


def layers_of(scene: Scene, camera: Camera, settings: Settings) -> list[tuple[Splats, Settings]]:
    """The splats of layers that have any, or of the first, with settings by which all have as many samples a pixel."""
    drawn = common_samples(scene.drawn(settings), camera, settings)
    return [(ahead(suited(each, own, moving=False), camera), own) for each, own in drawn]


def resolved_layer(splats: Splats, camera: Camera, settings: Settings) -> Resolved:
    """The settings resolved for one layer of several. Raises InputError for one that composites splat by splat."""
    found = Resolved.of(splats, camera, settings)
    check_layer(found, splats.name)
    return found


def merged(layers: Sequence[Pieces]) -> np.ndarray:
    """Light [P, 4] of layers' pieces along P rays."""
    edges = np.sort(np.concatenate([each.ends.reshape(len(each.ends), -1) for each in layers], axis=1), axis=1)
    light = np.zeros((len(edges), 4))
    rows = np.arange(len(edges))
    at = [np.zeros(len(edges), np.intp) for _ in layers]
    for first, last in zip(edges.T[:-1], edges.T[1:], strict=True):
        middle, matter = (first + last) / 2, np.zeros_like(light)
        for n, each in enumerate(layers):
            while (late := each.ends[rows, at[n], 1] <= middle).any():
                late &= at[n] < each.ends.shape[1] - 1
                if not late.any():
                    break
                at[n] += late
            begin, end = each.ends[rows, at[n]].T
            inside = (begin < middle) & (middle < end) & (last > first)
            share = np.where(inside, (last - first) / np.where(inside, end - begin, 1.0), 0.0)
            matter += each.matter[rows, at[n]] * share[:, None]
        light = behind(light, matter)
    return light

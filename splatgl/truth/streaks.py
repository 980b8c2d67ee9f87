"""Moving splats in float64, each as a streak: single-pass motion blur without GPU rounding.

Compared with `temporal.Moments`, the reference, it measures the error of streaks: straight lines for curved
paths, one width for a changing depth, and optical depth that is smeared before it occludes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from splatgl.data.image import Image
from splatgl.errors import expected
from splatgl.splat.camera import Camera
from splatgl.splat.culling import Window
from splatgl.splat.footprint import run_along
from splatgl.splat.kernels import tabulated
from splatgl.splat.lighting import shone
from splatgl.splat.motion import Motion, Streaks, streaks
from splatgl.splat.motion_blur import MOTIONS, dwelt_depth, energy_gain, isolation
from splatgl.splat.ordering import back_to_front, order_for
from splatgl.splat.resolve import AVERAGED, Resolved
from splatgl.splat.settings import BLENDS, BlendMode, Settings
from splatgl.splat.splats import Splats
from splatgl.splat.view import View
from splatgl.truth.blend import ADD, Band, Part, pixels
from splatgl.truth.extent import Boxes, pixel_ends
from splatgl.truth.pairs import values
from splatgl.truth.reference import attenuated_depth
from splatgl.truth.streak_row import StreakRow, passing

# samples per band
BAND = 1 << 16


def render(
    splats: Splats,
    camera: Camera,
    settings: Settings,
    motion: Motion,
    shutter: float = 180.0,
    shape: str = "exact",
) -> Image:
    """Image of moving splats, float64 [H, W, 4], linear premultiplied; shape: exact, energy or paper.

    Blur attenuates the same quantity as antialiasing, opacity or optical depth, as `attenuation` says. Raises
    InputError for another shape, and for maximum blending and supersampling, which are not supported.
    """
    if shape not in MOTIONS:
        raise expected("shape", " or ".join(MOTIONS), repr(shape))
    if settings.antialias in AVERAGED or BLENDS[settings.blend].join == "max":
        raise expected("settings", "antialias paper or off, blend composite or xray", "others")
    drawn = _Drawn.of(splats, settings, streaks(splats, camera, motion, shutter), shape)
    # the same bands as in the reference
    width, height = camera.size
    rows = max(1, BAND // width)
    picture = np.concatenate(
        [drawn.part(Window(0, top, width, min(rows, height - top))) for top in range(0, height, rows)]
    )
    if settings.background is not None and not BLENDS[settings.blend].unbounded:
        picture = picture + (1 - picture[..., 3:]) * np.array([*settings.background, 1.0])
    info = {"scene": splats.name, "blend": settings.blend, "motion": shape, "shutter": shutter}
    return Image(picture, {**info, "renderer": "float64 streaks"})


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Data shared by all bands: the streaks' row and boxes, and order, colour, depth, coverage (the remaining fraction
    of opacity) and isolated (see motion_opacity.py) of all splats.
    """

    row: StreakRow
    boxes: Boxes
    camera: Camera
    blend: BlendMode
    order: np.ndarray
    color: np.ndarray
    depth: np.ndarray
    coverage: np.ndarray
    isolated: np.ndarray

    @classmethod
    def of(cls, splats: Splats, settings: Settings, paths: Streaks, shape: str) -> _Drawn:
        resolved = Resolved.of(splats, paths.camera, settings, moving=True)
        blend, attenuation = resolved.look.blend, resolved.look.attenuation
        view = replace(resolved.view, kernel=tabulated(resolved.kernel.name))
        row = StreakRow(view, "row1", paths.middle, None, paths.step, shape)
        order = np.arange(len(splats))
        if blend.ordered:
            order = back_to_front(splats, order_for(splats, paths.camera))[::-1]
        color = splats.colors.astype(np.float64)
        color = shone(color, splats, paths.camera, paths.middle, resolved)
        depth = splats.records["optical_depth"].astype(np.float64)
        coverage, isolated = np.ones(len(splats)), np.zeros(len(splats))
        if attenuation != "optical-depth":
            coverage = view.coverage(paths.middle[2])
            lengths = length_of(view, paths)
            if attenuation == "fill":
                through = run_along(view.index_from_eye[:, :2] @ paths.step, splats.runs)
                depth = attenuated_depth(splats, view, paths.middle, coverage) if resolved.view.antialias else depth
                coverage, isolated = np.ones(len(splats)), isolation(lengths, through)
            else:
                coverage = coverage * energy_gain(view.kernel, lengths)
        return cls(row, _boxes(view, paths), paths.camera, blend, order, color, depth, coverage, isolated)

    def part(self, window: Window) -> np.ndarray:
        """A window of the picture, float64 [h, w, 4]."""
        gathered = Band.empty(window.height * window.width)
        for found in values(self.row, self.boxes, self.order, window, self.camera):
            s = found.splat
            if len(s):
                depth = self.depth[s] * found.integral.value
                if self.isolated.any():
                    depth = dwelt_depth(depth, self.depth[s] * found.integral.peak, self.isolated[s])
                ADD[self.blend.join](gathered, Part(found.pixel, depth, self.color[s], self.coverage[s]))
        return pixels(gathered, self.blend).reshape(window.height, window.width, 4)


def length_of(view: View, paths: Streaks) -> np.ndarray:
    """[N]: path lengths in units of their own, possibly widened, kernels."""
    own = paths.middle[:2]
    if view.perspective:
        own = own / np.where(np.abs(paths.middle[2]) > view.reach, paths.middle[2], view.reach)
    return passing(view, paths.middle, own, paths.step).length


def _boxes(view: View, paths: Streaks) -> Boxes:
    """Pixels that a streak can reach: the box of both ends; the whole image if one end is not visible."""
    width, height = paths.camera.size
    ends = []
    for side in (-0.5, 0.5):
        voxel = paths.middle.copy()
        voxel[:2] += side * paths.step
        ends.append(pixel_ends(view, "row1", voxel, paths.camera))
    unseen = [right < left for left, right, _, _ in ends]
    some, all_ = unseen[0] | unseen[1], (unseen[0] & unseen[1]) | (paths.middle[2] < 0) & unseen[0]
    left, top = (np.where(some, 0, np.minimum(ends[0][n], ends[1][n])) for n in (0, 2))
    right, bottom = (np.where(some, full, np.maximum(ends[0][n], ends[1][n])) for n, full in ((1, width), (3, height)))
    return Boxes(left, np.where(all_ | (right <= left) | (bottom <= top), left, right), top, bottom)

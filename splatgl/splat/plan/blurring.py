"""`Blurred`: how one picture of a moving scene is made: by streaks, by the mean of pictures, or both."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.blur import MOTIONS
from splatgl.splat.motion.moments import moments
from splatgl.splat.motion.motion import Exposure, Motion
from splatgl.splat.plan.settings import Settings
from splatgl.splat.plan.suited import blur, suited
from splatgl.splat.view.camera import Camera


@dataclass(frozen=True)
class Blurred:
    """exposure: of streaks, None without. moments: pictures that this one is the mean of, 0 without.

    settings: adapted to streaks, whose align is exact. camera: in the middle of the exposure, of a still the given one.
    """

    settings: Settings
    camera: Camera
    exposure: Exposure | None = None
    moments: int = 0

    @classmethod
    def of(cls, splats: Splats, camera: Camera, settings: Settings, motion: Motion | None, notes: list[str]) -> Blurred:
        """The blur that the settings ask for; adds notes."""
        form, found = blur(splats, settings), Exposure.of(camera, settings.shutter, motion)
        if form == "off" and motion is not None and not motion.still:
            notes.append("motion blur left out: the setting motion is off; the picture would be another")
        elif found is None and form != "off":
            notes.append("motion blur left out: nothing moves; the picture is the same")
        if form == "off" or found is None or motion is None:
            return cls(settings, camera)
        if form == "moments":
            splats = suited(splats, settings, moving=True)
            count = settings.moments or moments(splats, camera, motion, settings.shutter)
            if settings.motion in MOTIONS:
                notes.append(f"motion {settings.motion} left out: {settings.blend} of a streak is none of its moments")
            notes.append(f"motion blur: the mean of pictures at {count} times, shutter {settings.shutter:g}°")
            return cls(settings, found.middle, None, count)
        if settings.align not in ("auto", "exact"):
            notes.append(f"align {settings.align} left out: streaks are exact")
        drawn = f"motion blur {form}, shutter {settings.shutter:g}°, on quads"
        notes.append(f"{drawn}; its error bound is to straight streaks")
        notes.append(f"streaks are straight: where paths bend most they are off by {found.bend(splats):.2g} pixels")
        count = settings.moments or 1
        if count > 1:
            notes.append(f"the mean of {count} pictures, each streaked over its part of the paths")
        adapted = settings.but(align="exact", motion=form)
        return cls(adapted, found.middle, found, count if count > 1 else 0)

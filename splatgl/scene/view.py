"""`ViewOptions`: cameras from angles and sizes; flat stacks of microscopes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Hints, Triple, Volume
from splatgl.errors import expected
from splatgl.options import Group, Kind, check_options, option
from splatgl.splat.presets import is_microscopy

if TYPE_CHECKING:
    from splatgl.splat.camera import Bounded, Camera
    from splatgl.splat.splats import Splats


# units of length of microscopes
UNITS = ("um", "µm", "nm", "Å")
# a flat stack is less deep than this share of its width and height
FLAT = 0.5
NOTE = "a flat stack is seen along z, x to the right and y down: --elevation 45 tilts it"


def orient_flat_stack(volume: Volume, has_note: bool = True) -> Volume:
    """The volume; a flat stack of a microscope is seen along z and turns about y. has_note: whether a note says so."""
    if not is_flat_stack(volume):
        return volume
    hints = replace(volume.hints, azimuth=0.0, elevation=0.0, up=(0.0, -1.0, 0.0))
    return replace(volume, hints=hints, notes=(*volume.notes, *[NOTE] * has_note))


def is_flat_stack(volume: Volume) -> bool:
    """Whether a volume is much thinner along z than along x and y, and from a microscope by file, unit or values."""
    hints = volume.hints
    placed = any(x is not None for x in (hints.azimuth, hints.elevation, hints.eye, hints.up, hints.points))
    depth, height, width = ((n - 1) * step for n, step in zip(volume.shape, reversed(volume.spacing), strict=True))
    if placed or volume.frame is not None or volume.color is not None or depth >= FLAT * min(height, width):
        return False
    known = hints.stack or depth == 0 or volume.unit in UNITS
    return np.allclose(volume.direction, np.eye(3)) and (known or is_microscopy(volume))


# degrees
AZIMUTH, ELEVATION, ELEVATION_FLAT, FOV = 30.0, 20.0, 60.0, 40.0


_option = partial(option, group=Group.VIEW)


@dataclass(frozen=True)
class ViewOptions:
    """Camera parameters; None: from the hints, anatomy or shape of the volume.

    part: the view is fitted to it, instead of the visible part of the volume. fixed: camera that replaces all
    parameters but the size.
    """

    size: tuple[int, int] = _option((512, 512), Kind.picture_size(), "pixels, such as 800x600 or 512", level="basic")
    azimuth: float | None = _option(
        None,
        Kind.number(metavar="A"),
        "degrees around the up axis (default 30). Counter-clockwise from above; 0 is the front",
        level="basic",
    )
    elevation: float | None = _option(
        None, Kind.number(metavar="A"), "degrees above the horizon (default 20)", level="basic"
    )
    fov: float | None = _option(None, Kind.number(metavar="A"), "full vertical angle of view in degrees (default 40)")
    zoom: float | None = _option(None, Kind.number(metavar="F"), "magnification, above 1 is nearer", level="basic")
    eye: Triple | None = _option(None, Kind.numbers(3, "X,Y,Z"), "position of the eye, world units")
    look_at: Triple | None = _option(None, Kind.numbers(3, "X,Y,Z"), "point that --eye looks at (default: the centre)")
    up: Triple | None = _option(None, Kind.numbers(3, "X,Y,Z"), "direction drawn upwards (default 0,0,1)")
    orthographic: bool = _option(False, Kind.flag(), "parallel rays", bare=True)
    height: float | None = _option(None, Kind.number(metavar="L"), "height of an orthographic picture, world units")
    part: Bounded | None = None
    fixed: Camera | None = None

    def __post_init__(self) -> None:
        check_options(self)

    def fitted(self, part: Bounded) -> ViewOptions:
        """The view fitted to a part of the volume; a view with a camera or a part stays."""
        return replace(self, part=part) if self.part is None and self.fixed is None else self

    def orbit(self, volume: Volume | Splats) -> tuple[float, float] | None:
        """Azimuth and elevation around the centre of the visible part; None for a view from an eye."""
        hints = volume.hints if isinstance(volume, Volume) else Hints()
        orbits = any(x is not None for x in (self.azimuth, self.elevation, self.zoom))
        if self.eye is not None or (hints.eye is not None and not orbits):
            return None
        azimuth, elevation = _default_orbit(volume)
        return _first(self.azimuth, hints.azimuth, azimuth), _first(self.elevation, hints.elevation, elevation)

    def is_fixed(self, volume: Volume) -> bool:
        """Whether the camera does not depend on the visible part of the volume."""
        if self.part is not None or self.fixed is not None:
            return True
        return self.orbit(volume) is None and (self.height is not None or not self.orthographic)

    def camera(self, volume: Volume | Splats, subject: Bounded) -> Camera:
        """The camera; an orbit is fitted to the visible part of `subject`. volume: has hints, or is splats without."""
        if self.fixed is not None:
            return self.fixed.resized(self.size)
        from splatgl.splat.camera import Camera
        from splatgl.splat.opaque_bounds import Opaque
        from splatgl.splat.splats import Splats

        if self.part is not None:
            subject = self.part
        elif isinstance(subject, Splats) and subject.post is not None:
            known = volume if isinstance(volume, Volume) else subject.source and subject.source.volume
            subject = Opaque(known, subject.post.transfer) if known else subject
        hints = volume.hints if isinstance(volume, Volume) else Hints()
        fov = _first(self.fov, hints.fov, FOV)
        orbit = self.orbit(volume)
        if orbit is None:
            target = _first(self.look_at, hints.target if self.eye is None else None, tuple(_center(volume)))
            up = _first(self.up, hints.up, (0.0, 0.0, 1.0))
            camera = Camera.look_at(_first(self.eye, hints.eye), target, up, fov, self.size)
        else:
            if self.look_at is not None:
                raise expected("look_at", "an eye that looks there", "none", "give --eye too")
            camera = Camera.orbit(
                subject,
                *orbit,
                fov,
                self.size,
                _first(self.zoom, 1.0),
                _first(self.up, hints.up, (0.0, 0.0, 1.0)),
            )
        parallel = self.orthographic or self.height is not None
        return camera.parallel(subject, self.height) if parallel else camera


def _center(volume: Volume | Splats) -> np.ndarray:
    """Centre of the box of samples, or of splats, world units."""
    return volume.center if isinstance(volume, Volume) else np.asarray(volume.corners.mean(axis=0))


def _default_orbit(volume: Volume | Splats) -> tuple[float, float]:
    """Default azimuth and elevation: from the front, volumes thinner than FLAT of their width from above."""
    extent = volume.corners.max(axis=0) - volume.corners.min(axis=0)
    elevation = ELEVATION_FLAT if extent[2] < FLAT * min(extent[0], extent[1]) else ELEVATION
    return AZIMUTH, elevation


def _first(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)

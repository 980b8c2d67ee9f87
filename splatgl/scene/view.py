"""`View`: the camera from angles and sizes; flat stacks of microscopes."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Hints, Triple, Volume
from splatgl.errors import expected
from splatgl.splat.presets import is_microscopy

if TYPE_CHECKING:
    from splatgl.splat.camera import Bounded, Camera
    from splatgl.splat.splats import Splats


# units of length of microscopes
UNITS = ("um", "µm", "nm", "Å")
# a stack is flat whose depth is less than this share of its width and height
FLAT = 0.5
TOLD = "a flat stack is seen along z, x to the right and y down: --elevation 45 tilts it"


def seen_along_z(volume: Volume, told: bool = True) -> Volume:
    """The volume, a flat stack of a microscope with the view of it: along z, and turning about y. told: with a note."""
    if not is_flat_stack(volume):
        return volume
    hints = replace(volume.hints, azimuth=0.0, elevation=0.0, up=(0.0, -1.0, 0.0))
    return replace(volume, hints=hints, notes=(*volume.notes, *[TOLD] * told))


def is_flat_stack(volume: Volume) -> bool:
    """Whether it is a plane, or much thinner along z than along x and y, and a microscope's by its file, its unit or
    its values.
    """
    hints = volume.hints
    placed = any(x is not None for x in (hints.azimuth, hints.elevation, hints.eye, hints.up, hints.points))
    depth, height, width = ((n - 1) * step for n, step in zip(volume.shape, reversed(volume.spacing), strict=True))
    if placed or volume.frame is not None or volume.color is not None or depth >= FLAT * min(height, width):
        return False
    known = hints.stack or depth == 0 or volume.unit in UNITS
    return np.allclose(volume.direction, np.eye(3)) and (known or is_microscopy(volume))


# cameras are imported once there is a volume: bad input is told at once

# number of components of camera keys; the others have one, and `orthographic` is true or false
VIEW_COUNTS = {"size": 2, "eye": 3, "look_at": 3, "up": 3}
AZIMUTH, ELEVATION, ELEVATION_FLAT, FOV = 30.0, 20.0, 60.0, 40.0


@dataclass(frozen=True)
class ViewOptions:
    """Camera parameters; those that are None come from the volume's hints, anatomy or shape."""

    size: tuple[int, int] = (512, 512)
    azimuth: float | None = None
    elevation: float | None = None
    fov: float | None = None
    zoom: float | None = None
    eye: Triple | None = None
    look_at: Triple | None = None
    up: Triple | None = None
    orthographic: bool = False
    height: float | None = None

    def orbit(self, volume: Volume | Splats) -> tuple[float, float] | None:
        """Azimuth and elevation about the middle of what is visible; None if the view is that from an eye."""
        hints = volume.hints if isinstance(volume, Volume) else Hints()
        orbits = any(x is not None for x in (self.azimuth, self.elevation, self.zoom))
        if self.eye is not None or (hints.eye is not None and not orbits):
            return None
        azimuth, elevation = _default_orbit(volume)
        return _first(self.azimuth, hints.azimuth, azimuth), _first(self.elevation, hints.elevation, elevation)

    def is_fixed(self, volume: Volume) -> bool:
        """Whether the camera is the same whatever of the volume is visible."""
        return self.orbit(volume) is None and (self.height is not None or not self.orthographic)

    def camera(self, volume: Volume | Splats, subject: Bounded) -> Camera:
        """The camera; an orbit is fitted to what is visible of `subject`. volume: has hints, or is splats without."""
        from splatgl.splat.camera import Camera
        from splatgl.splat.opaque_bounds import Opaque
        from splatgl.splat.splats import Splats

        if isinstance(subject, Splats) and subject.post is not None:
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


@dataclass(frozen=True)
class Fitted(ViewOptions):
    """A view that is fitted to a part of the volume."""

    part: Bounded | None = None

    @classmethod
    def of(cls, view: ViewOptions, part: Bounded) -> ViewOptions:
        """A view of the part instead of the whole; one by a camera as it is."""
        return (
            cls(**{f.name: getattr(view, f.name) for f in fields(ViewOptions)}, part=part)
            if type(view) is ViewOptions
            else view
        )

    def is_fixed(self, volume: Volume) -> bool:
        """True: the part is given."""
        return True

    def camera(self, volume: Volume | Splats, subject: Bounded) -> Camera:
        """The camera, fitted to the part."""
        assert self.part is not None
        return super().camera(volume, self.part)


def _center(volume: Volume | Splats) -> np.ndarray:
    """Centre of the box of samples, or of splats, world units."""
    return volume.center if isinstance(volume, Volume) else np.asarray(volume.corners.mean(axis=0))


def _default_orbit(volume: Volume | Splats) -> tuple[float, float]:
    """Default azimuth and elevation: from the front, volumes thinner than FLAT of their width from above."""
    extent = volume.corners.max(axis=0) - volume.corners.min(axis=0)
    elevation = ELEVATION_FLAT if extent[2] < FLAT * min(extent[0], extent[1]) else ELEVATION
    return AZIMUTH, elevation


def typed(name: str, value: Any) -> Any:
    """Type-checked value of a camera key; lists become tuples."""
    if name == "orthographic":
        fine, this = isinstance(value, bool), "true or false"
    else:
        count = VIEW_COUNTS.get(name)
        numbers: list[Any] = value if count and isinstance(value, list) else [value] * (not count)
        kind: Any = int if name == "size" else (int, float)
        fine = len(numbers) == (count or 1)
        fine = fine and all(isinstance(n, kind) and not isinstance(n, bool) and abs(n) < inf for n in numbers)
        this = f"{count or 'one'} {'whole' if name == 'size' else 'finite'} number{'s' if count else ''}"
    if not fine:
        raise expected(name, this, repr(value)[:80])
    return tuple(value) if isinstance(value, list) else value


def _first(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)

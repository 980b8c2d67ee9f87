"""`ViewOptions`: cameras from angles and sizes; standard views; flat stacks of microscopes."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Hints, Triple, Volume
from splatgl.errors import expected
from splatgl.options import HelpGroup, ValueKind, check_options, option
from splatgl.transfer.presets import is_microscopy

if TYPE_CHECKING:
    from splatgl.geometry.camera import Bounded, Camera
    from splatgl.splat.splats import Splats


# units of length of microscopes
UNITS = ("um", "nm", "Å")
# a flat stack is less deep than this share of its width and height
FLAT = 0.5
NOTE = "a flat stack is seen along z, x to the right and y down: --elevation 45 tilts it"
# up in microscopes' stacks: their first plane is on top, and its rows go down; flat ones turn about their columns
PLANES_UP: Triple = (0.0, 0.0, -1.0)
ROWS_UP: Triple = (0.0, -1.0, 0.0)


def orient_stack(volume: Volume, has_note: bool = True) -> Volume:
    """The volume; a microscope's stack is seen by parallel rays, its first plane is on top, x to the right and y down,
    as in Fiji and napari. A flat one is seen along z, and turns about y. has_note: whether a note says so.
    """
    if is_flat_stack(volume):
        hints = replace(volume.hints, azimuth=0.0, elevation=0.0, up=ROWS_UP, orthographic=True, stack=True)
        return replace(volume, hints=hints, notes=(*volume.notes, *[NOTE] * has_note))
    if _is_oriented(volume) or not (volume.hints.stack or volume.unit in UNITS[:3]):
        return volume
    return replace(volume, hints=replace(volume.hints, up=PLANES_UP, orthographic=True, stack=True))


def _is_oriented(volume: Volume) -> bool:
    """Whether a view or directions are stated, or colours of voxels that are no microscope's."""
    hints = volume.hints
    placed = any(x is not None for x in (hints.azimuth, hints.elevation, hints.eye, hints.up, hints.points))
    is_model = volume.color is not None and not hints.stack
    return placed or volume.frame is not None or is_model or not np.allclose(volume.direction, np.eye(3))


def is_flat_stack(volume: Volume) -> bool:
    """Whether a volume is much thinner along z than along x and y, and from a microscope by file, unit or values."""
    depth, height, width = ((n - 1) * step for n, step in zip(volume.shape, reversed(volume.spacing), strict=True))
    if _is_oriented(volume) or depth >= FLAT * min(height, width):
        return False
    return volume.hints.stack or depth == 0 or volume.unit in UNITS or is_microscopy(volume)


# what a view is fitted to: the boxes of volumes, what is visible of them, and that as up to version 0.3
FIT_ALL, FIT_VISIBLE, FIT_OF_0_3 = FITS = ("all", "visible", "0.3")
# degrees
AZIMUTH, ELEVATION, ELEVATION_FLAT, FOV = 30.0, 20.0, 60.0, 40.0
# azimuth and elevation of the standard views in degrees: the front is a scene's azimuth 0. A patient's right is that of
# 3D Slicer, at the viewer's left from the front.
VIEWS = {
    "isometric": (45.0, 35.264),
    "front": (0.0, 0.0),
    "back": (180.0, 0.0),
    "right": (90.0, 0.0),
    "left": (-90.0, 0.0),
    "top": (0.0, 90.0),
    "bottom": (0.0, -90.0),
}
# the views that need a patient's frame, and what they are without one
OF_PATIENTS = {"anterior": "front", "posterior": "back", "left": "left", "right": "right"}
OF_PATIENTS |= {"superior": "top", "inferior": "bottom"}
# views across the planes of two axes
PLANES = {"xy": "top", "xz": "front", "yz": "right"}
# axes that views look along, as ParaView names them
ALONG = {"front": "+y", "back": "-y", "right": "-x", "left": "+x", "top": "-z", "bottom": "+z"}
OF_AXES = (*PLANES, *sorted(ALONG.values()))
NAMED = (*OF_PATIENTS, *(name for name in VIEWS if name not in OF_PATIENTS), *OF_AXES)
# millimetres of the units of a width on paper, and of an inch; dots per inch of a picture of such a width
INCH = 25.4
PAPER = {"mm": 1.0, "cm": 10.0, "in": INCH, "pt": INCH / 72}
PRINT_DPI = 300.0


def angles(view: str, subject: Volume | Splats) -> tuple[float, float]:
    """Azimuth and elevation of a standard view of a volume, whose frame is LPS, RAS or None."""
    if view in ALONG.values():
        view = next(name for name in ALONG if along(name, subject) == view)
    azimuth, elevation = VIEWS[{**OF_PATIENTS, **PLANES}.get(view, view)]
    # a patient's right is at the viewer's left
    return (-azimuth if getattr(subject, "frame", None) and view in ("left", "right") else azimuth), elevation


def along(view: str, subject: Volume | Splats) -> str:
    """The axis of the world that a standard view looks along, such as +y."""
    frame, up = getattr(subject, "frame", None), getattr(getattr(subject, "hints", None), "up", None)
    sign, axis = ALONG[view][0], ALONG[view][1]
    # the front of a patient is -y in LPS and +y in RAS; the first plane of a microscope's stack is its top
    is_stack = up in (PLANES_UP, ROWS_UP)
    is_turned = {"x": frame == "LPS", "y": frame == "RAS" or is_stack, "z": is_stack}[axis]
    return f"{'+' if (sign == '-') == is_turned else '-'}{axis}"


def read_paper_width(text: str) -> float:
    """Millimetres of a length on paper, such as 85mm. Raises ValueError for other text."""
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+) *(mm|cm|in|pt)", text)
    if match is None or not float(match[1]) > 0:
        raise ValueError
    return float(match[1]) * PAPER[match[2]]


def _paper_width(text: Any) -> str:
    if str(text).isdecimal():
        raise expected("width", "a width on paper such as 85mm", text, f"did you mean size {text}, in pixels?")
    read_paper_width(text)
    return str(text)


_option = partial(option, group=HelpGroup.VIEW)


@dataclass(frozen=True)
class ViewOptions:
    """Camera parameters; None: from the hints, anatomy or shape of the volume.

    A width on paper sets the dots per inch, if they are not given, and the pixels, of which the size is then the shape.
    part: the view is fitted to it, instead of the subject. fixed: camera that replaces all
    parameters but the size.
    """

    size: tuple[int, int] = _option(
        (512, 512), ValueKind.picture_size(), "pixels, such as 800x600 or 512", level="basic"
    )
    view: str | None = _option(
        None,
        replace(ValueKind.choice(NAMED), metavar=""),
        "a standard view: left, front, isometric, xy, +x, …. Instead of azimuth and elevation; left is the patient's, "
        "+x looks along x",
        level="basic",
        metavar="NAME",
    )
    azimuth: float | None = _option(
        None,
        ValueKind.number(metavar="A"),
        "degrees around the up axis (default 30). Counter-clockwise from above; 0 is the front, the patient's",
        level="basic",
    )
    elevation: float | None = _option(
        None, ValueKind.number(metavar="A"), "degrees above the horizon (default 20)", level="basic"
    )
    fov: float | None = _option(
        None, ValueKind.number(metavar="A"), "full vertical angle of view in degrees (default 40)"
    )
    zoom: float | None = _option(None, ValueKind.number(metavar="F"), "magnification, above 1 is nearer", level="basic")
    eye: Triple | None = _option(None, ValueKind.numbers(3, "X,Y,Z"), "position of the eye, world units")
    look_at: Triple | None = _option(
        None, ValueKind.numbers(3, "X,Y,Z"), "point that --eye looks at (default: the centre)"
    )
    up: Triple | None = _option(None, ValueKind.numbers(3, "X,Y,Z"), "up direction of the picture (default 0,0,1)")
    orthographic: bool | None = _option(
        None, ValueKind.flag(), "parallel rays. Stacks of microscopes have them unless --fov is given", bare=True
    )
    height: float | None = _option(
        None, ValueKind.number(metavar="L"), "height of an orthographic picture, world units"
    )
    dpi: float | None = _option(
        None,
        ValueKind.number("dots per inch from 1 to 10000", 1, 10_000),
        f"dots per inch, which the file states (default of --width: {PRINT_DPI:g}). Letters are then 8 points high",
    )
    width: str | None = _option(
        None,
        ValueKind("a length such as 85mm, 8.5cm, 3.3in or 240pt", _paper_width, _paper_width, "LENGTH", hint="str"),
        "width on paper, such as 85mm, that with --dpi gives the pixels. --size gives the shape",
    )
    fit: str = _option(
        FIT_ALL,
        ValueKind.choice(FITS),
        "what the picture shows in full. all: the boxes of volumes, and meshes; visible: what the transfer function "
        "shows, but for lone voxels; 0.3: all that it shows, off the centre, as version 0.3 did",
    )
    part: Bounded | None = field(default=None, compare=False)
    fixed: Camera | None = None

    def __post_init__(self) -> None:
        check_options(self)
        beside = [name for name in ("azimuth", "elevation", "eye") if getattr(self, name) is not None]
        if self.view is not None and beside:
            raise expected("view", "a standard view or angles", f"{self.view} and {' and '.join(beside)}")
        if self.up is not None and self.view in OF_AXES:
            raise expected("up", "no other direction for a view across or along axes", f"{self.view} and an up")
        if self.width is not None:
            dpi = self.dpi or PRINT_DPI
            pixels = max(round(read_paper_width(self.width) / INCH * dpi), 1)
            object.__setattr__(self, "dpi", dpi)
            object.__setattr__(self, "size", (pixels, max(round(pixels * self.size[1] / self.size[0]), 1)))

    def changed(self, **options: Any) -> ViewOptions:
        """The view with other options: a standard view replaces angles and an eye, and these a standard view."""
        angles = ("azimuth", "elevation", "eye", "look_at")
        if options.get("view") is not None:
            options = {**dict.fromkeys(angles), **options}
        elif any(options.get(name) is not None for name in angles):
            options = {"view": None, **options}
        return replace(self, **options)

    @property
    def paper(self) -> dict[str, object]:
        """Dots per inch, for the provenance of a picture; none unless they are stated."""
        return {} if self.dpi is None else {"dpi": self.dpi}

    def notes(self, volume: Volume) -> tuple[str, ...]:
        """A note on a view that needs a patient's frame, of data without one."""
        if volume.frame is not None or self.view is None or self.view not in OF_PATIENTS:
            return ()
        azimuth, elevation = angles(self.view, volume)
        where = f"azimuth {azimuth:g}°, elevation {elevation:g}°"
        return (
            f"the file does not state anatomy: {self.view} is {where}, which may differ from the patient's directions",
        )

    def fitted(self, part: Bounded) -> ViewOptions:
        """The view fitted to a part of the volume; a view with a camera or a part stays."""
        return replace(self, part=part) if self.part is None and self.fixed is None else self

    def orbit(self, volume: Volume | Splats) -> tuple[float, float] | None:
        """Azimuth and elevation around the centre of the subject; None for a view from an eye."""
        hints = volume.hints if isinstance(volume, Volume) else Hints()
        orbits = any(x is not None for x in (self.view, self.azimuth, self.elevation, self.zoom))
        if self.eye is not None or (hints.eye is not None and not orbits):
            return None
        if self.view is not None:
            return angles(self.view, volume)
        azimuth, elevation = _default_orbit(volume)
        return _first(self.azimuth, hints.azimuth, azimuth), _first(self.elevation, hints.elevation, elevation)

    def is_fixed(self, volume: Volume) -> bool:
        """Whether the camera of one volume does not depend on what is visible of it."""
        if self.part is not None or self.fixed is not None or self.fit == FIT_ALL:
            return True
        return self.orbit(volume) is None and (self.height is not None or not self.is_parallel(volume))

    def is_parallel(self, volume: Volume | Splats) -> bool:
        """Whether rays are parallel."""
        hinted = isinstance(volume, Volume) and volume.hints.orthographic and self.fov is None
        return self.height is not None or bool(_first(self.orthographic, hinted))

    def upward(self, hints: Hints) -> Triple:
        """Up in the picture: a direction in the world. Standard views of flat stacks are those of deep ones."""
        hinted = PLANES_UP if self.view is not None and hints.up == ROWS_UP and hints.stack else hints.up
        return _first(self.up, hinted, (0.0, 0.0, 1.0))

    def slice_up(self, hints: Hints) -> Triple:
        """Up in slices across x and z; rows of a microscope's planes go down."""
        return ROWS_UP if hints.stack and self.up is None and hints.up == PLANES_UP else self.upward(hints)

    def orbit_camera(
        self, subject: Bounded, orbit: tuple[float, float], hints: Hints, fov: float, is_parallel: bool
    ) -> Camera:
        """The camera at an azimuth and an elevation around the subject, at which azimuth 0 has x to the right.

        is_parallel: whether rays will be parallel, which see both sides of the centre alike.
        """
        from splatgl.geometry.camera import Camera

        up = self.upward(hints)
        turn = 180.0 if up == PLANES_UP and hints.stack and self.up is None else 0.0
        looks = ((orbit[0] + turn, orbit[1]), fov, self.size, _first(self.zoom, 1.0), up)
        return Camera.around(subject, *looks, centred=self.fit != FIT_OF_0_3 and not is_parallel)

    def camera(self, volume: Volume | Splats, subject: Bounded) -> Camera:
        """The camera; an orbit is fitted to `subject` as `fit` says. volume: has hints, or is splats without."""
        if self.fixed is not None:
            return self.fixed.resized(self.size)
        from splatgl.geometry.camera import Camera

        subject = self.framed(volume, subject)
        hints = volume.hints if isinstance(volume, Volume) else Hints()
        fov = _first(self.fov, hints.fov, FOV)
        orbit = self.orbit(volume)
        if orbit is None:
            center = volume.center if isinstance(volume, Volume) else volume.corners.mean(axis=0)
            target = _first(self.look_at, hints.target if self.eye is None else None, tuple(center))
            camera = Camera.look_at(_first(self.eye, hints.eye), target, self.upward(hints), fov, self.size)
        else:
            if self.look_at is not None:
                raise expected("look_at", "an eye that looks there", "none", "give --eye too")
            camera = self.orbit_camera(subject, orbit, hints, fov, self.is_parallel(volume))
        return camera.parallel(subject, self.height) if self.is_parallel(volume) else camera

    def framed(self, volume: Volume | Splats, subject: Bounded) -> Bounded:
        """The part of a subject that the view is fitted to."""
        from splatgl.planning.culling import OpaqueBounds
        from splatgl.splat.splats import Splats

        if self.part is not None:
            return self.part
        if self.fit == FIT_ALL:
            return getattr(subject, "full_extent", subject)
        if isinstance(subject, Splats) and subject.post is not None:
            known = volume if isinstance(volume, Volume) else subject.source and subject.source.volume
            subject = OpaqueBounds(known, subject.post.transfer) if known else subject
        return getattr(subject, "robust", subject) if self.fit == FIT_VISIBLE else subject


def _default_orbit(volume: Volume | Splats) -> tuple[float, float]:
    """Default azimuth and elevation: from the front, volumes thinner than FLAT of their width from above."""
    extent = volume.corners.max(axis=0) - volume.corners.min(axis=0)
    elevation = ELEVATION_FLAT if extent[2] < FLAT * min(extent[0], extent[1]) else ELEVATION
    return AZIMUTH, elevation


def _first(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)

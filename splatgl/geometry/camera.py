"""`Camera`: perspective and orthographic, float64. Eye axes are right, down, forward.

Matrices are named destination first: `eye_from_world @ (x − eye)`. Pixel (i, j) is column i, row j,
row 0 on top, its centre at (i + ½, j + ½).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
import pyrr

from splatgl.coercion import public
from splatgl.errors import expected
from splatgl.geometry.grid import corners_of
from splatgl.options import SIZE, checked

# |sin| of the smallest angle between `up` and the view that defines a horizon
UP_TOLERANCE = 1e-9
# size of the default picture over the object's bounding sphere
FIT_MARGIN = 1.05
# rounds in which the outermost points of a view are found
ROUNDS = 16
# degrees: larger angles lose all digits to whole turns; a narrower field needs an eye further than FAR
MOST_TURN, LEAST_FOV = 1e12, 1e-9
# limits of zoom: beyond them the eye is at the subject's centre, or further away than FAR
ZOOMS = (1e-15, 1e15)
# largest side of a picture, for any renderer
MOST_PIXELS = 2**24
# world units: fourth powers of lengths within these fit float64
LEAST_LENGTH, MOST_LENGTH = 1e-60, 1e60
# spacings: squares of lengths up to this, and of their inverses, fit float32
FAR = 1e15


Vector: TypeAlias = Sequence[float] | np.ndarray
# also 800x600 as text, and one number of a square
Size: TypeAlias = int | str | Sequence[int]


class Bounded(Protocol):
    """Anything with an extent: volumes and splats.

    It may have a `frame`, "LPS" or "RAS", which says where the patient's front is, and a `full_extent`, which default
    views are fitted to instead: the box of the volume of which it is the visible part.
    """

    @property
    def corners(self) -> np.ndarray:
        """Corners of the box [8, 3], world units."""
        ...

    @property
    def outline(self) -> np.ndarray:
        """Points [N, 3] whose convex hull contains the object, world units."""
        ...


@dataclass(frozen=True, eq=False)
class FittedPoints:
    """Points [N, 3] to which a view is fitted, world units, and their anatomical frame."""

    outline: np.ndarray
    frame: str | None = None

    @property
    def corners(self) -> np.ndarray:
        """Corners [8, 3] of the box around them."""
        return corners_of(self.outline.min(axis=0), self.outline.max(axis=0))


@public
@dataclass(frozen=True, eq=False)
class Camera:
    """A view; made by `look_at`, `orbit` or `orthographic`.

    eye: [3] world; eye_from_world: [3, 3], rows right, down, forward; size: (width, height) in pixels.
    extent: height of the image at depth 1 (perspective, 2·tan(fov/2)) or in world units (orthographic).

    ```python
    volume = sg.scenes.ball(12)
    camera = sg.Camera.orbit(volume, azimuth=60, elevation=10, size=(64, 48))
    image = sg.render(volume, camera=camera)
    ```
    """

    eye: np.ndarray
    eye_from_world: np.ndarray
    size: tuple[int, int]
    extent: float
    perspective: bool = True

    @classmethod
    def look_at(cls, eye: Vector, target: Vector, up: Vector, fov: float = 60.0, size: Size = (512, 512)) -> Camera:
        """Perspective view from `eye` to `target`; fov: full vertical angle in degrees.

        Raises InputError if eye = target, `up` is along the view, or fov is not within [1e−9, 180).
        """
        return cls(*_eye_and_axes(eye, target, up), _size(size), 2.0 * _half_width(fov))

    @classmethod
    def orthographic(
        cls, eye: Vector, target: Vector, up: Vector, height: float = 300.0, size: Size = (512, 512)
    ) -> Camera:
        """Parallel view along target − eye; height: of the image, world units.

        Everything behind the plane through `eye` is clipped. Raises InputError as `look_at`, and for height ≤ 0.
        """
        return cls(*_eye_and_axes(eye, target, up), _size(size), _height(height), perspective=False)

    @classmethod
    def orbit(
        cls,
        subject: Bounded | Any,
        azimuth: float = 0.0,
        elevation: float = 0.0,
        fov: float = 40.0,
        size: Size = (512, 512),
        zoom: float = 1.0,
        up: Vector = (0.0, 0.0, 1.0),
    ) -> Camera:
        """Perspective view that shows the whole `subject`, with equal margins: of a volume and its splats the volume's
        box, of a scene all boxes and meshes, whatever is visible of them.

        At (0, 0) it looks along +y with +z up, and at a patient in LPS or RAS from the front. azimuth turns the eye
        counter-clockwise seen from +z, elevation lifts it (degrees). Another `up` applies the shortest rotation from
        +z. Raises InputError as `look_at`, for a zoom outside [1e−15, 1e15], and for angles beyond 1e12 degrees.
        """
        subject = getattr(subject, "full_extent", subject)
        return cls.around(subject, (azimuth, elevation), fov, size, zoom, up)

    @classmethod
    def default(cls, x: Any, **options: Any) -> Camera:
        """The camera of `sg.render(x, **options)`. Raises InputError as `sg.render`."""
        from splatgl.scene.api import camera_of

        return camera_of(x, **options)

    @classmethod
    def around(
        cls,
        subject: Bounded,
        orbit: tuple[float, float],
        fov: float,
        size: Size,
        zoom: float,
        up: Vector,
        centred: bool = True,
    ) -> Camera:
        """As `orbit`, at azimuth and elevation, fitted to the outline of `subject` itself. centred: whether opposite
        margins are equal; else the centre of its box is in the middle.
        """
        half, (azimuth, elevation) = _half_width(fov), orbit
        if not ZOOMS[0] <= zoom <= ZOOMS[1]:
            raise expected("zoom", f"a positive number from {ZOOMS[0]:g} to {ZOOMS[1]:g}", zoom)
        for what, angle in (("azimuth", azimuth), ("elevation", elevation)):
            if not abs(angle) <= MOST_TURN:
                raise expected(what, f"an angle of at most {MOST_TURN:g} degrees", angle)
        # the front of a patient is −y in LPS and +y in RAS
        front = 180.0 if getattr(subject, "frame", None) == "RAS" else 0.0
        back, top = _orbit_axes(azimuth + front, elevation, up)
        corners = subject.corners
        center = (corners.min(axis=0) + corners.max(axis=0)) / 2
        axes = np.stack([np.cross(top, back), -top, -back])
        distance, offset = _fit((subject.outline - center) @ axes.T, half, _size(size), centred)
        center = center + offset @ axes
        return cls.look_at(center + back * distance / zoom, center, top, fov, size)

    @classmethod
    def of(cls, x: Any, size: Size | None = None) -> Camera:
        """View of a VTK or PyVista camera, a PyVista plotter, or a VTK window or renderer.

        size: pixels; None: the plotter's or window's, or 512 × 512. Raises InputError for other objects.
        """
        camera, pixels = _of_vtk(x, size)
        if not (hasattr(camera, "GetFocalPoint") and hasattr(camera, "GetParallelScale")):
            raise expected("camera", "a camera of VTK or PyVista, or a plotter", f"a {type(x).__name__}")
        width, height = _size(pixels or (512, 512))
        placed = (camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp())
        if camera.GetParallelProjection():
            # VTK's parallel scale is half of the height
            return cls.orthographic(*placed, 2.0 * camera.GetParallelScale(), (width, height))
        angle = float(camera.GetViewAngle())
        if camera.GetUseHorizontalViewAngle():
            angle = float(np.degrees(2 * np.arctan(np.tan(np.radians(angle) / 2) * height / width)))
        return cls.look_at(*placed, angle, (width, height))

    def parallel(self, subject: Bounded | Any, height: float | None = None) -> Camera:
        """Orthographic view from the same eye. height: world units; None: of the perspective picture at the centre of
        `subject`. Raises InputError for height ≤ 0, and for None if that centre is not in front of the eye.
        """
        middle = float(self.eye_from_points(subject.corners)[:, 2].mean())
        if height is None and not middle > 0:
            raise expected("height", "a camera in front of the volume's centre", "one behind it", "give a height")
        extent = _height(self.extent * middle if height is None else height)
        return Camera(self.eye, self.eye_from_world, self.size, extent, perspective=False)

    def __eq__(self, other: object) -> bool:
        """Whether both see the same, number by number."""
        return self._key == other._key if isinstance(other, Camera) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[object, ...]:
        numbers = (*self.eye.tolist(), *self.eye_from_world.ravel().tolist())
        return numbers, tuple(self.size), self.extent, self.perspective

    def __repr__(self) -> str:
        """Size, position, direction and field of view in one line."""
        eye, forward = (", ".join(f"{x:g}" for x in np.round(v, 3)) for v in (self.eye, self.forward))
        angle = f"fov {np.degrees(2 * np.arctan(self.extent / 2)):.4g}°"
        field = angle if self.perspective else f"height {self.extent:.4g}, orthographic"
        return f"<Camera {self.size[0]}×{self.size[1]}: eye ({eye}), forward ({forward}), {field}>"

    @property
    def right(self) -> np.ndarray:
        """Unit vector [3] along the picture's rows, world axes."""
        return np.asarray(self.eye_from_world[0])

    @property
    def forward(self) -> np.ndarray:
        """Unit vector [3] of the view direction, world axes."""
        return np.asarray(self.eye_from_world[2])

    def pixel_pitch(self, depth: float | np.ndarray) -> float | np.ndarray:
        """World length of a pixel's side at `depth`; constant in orthographic views."""
        pitch = self.extent / self.size[1]
        return np.asarray(depth) * pitch if self.perspective else np.full(np.shape(depth), pitch)[()]

    def z_k(self, spacing: float) -> float:
        """Depth at which a voxel of that spacing is one pixel wide [M98 Eq. 3].

        Orthographic: 0 if voxels are smaller than pixels everywhere, else infinity.
        """
        pitch = self.extent / self.size[1]
        if self.perspective:
            return spacing / pitch
        return np.inf if spacing >= pitch else 0.0

    def eye_from_points(self, points: np.ndarray) -> np.ndarray:
        """World points [..., 3] in eye axes, camera-relative, float64."""
        places = np.asarray(points, dtype=np.float64)
        if places.shape[-1:] != (3,):
            raise expected("points", "[..., 3], x, y and z", f"shape {places.shape}")
        return np.asarray((places - self.eye) @ self.eye_from_world.T)

    def slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Pixel centres along each image axis, [W] and [H]: slopes x/z (perspective), or eye x, y in world units."""
        width, height = self.size
        pitch = self.extent / height
        return (np.arange(width) + 0.5 - width / 2) * pitch, (np.arange(height) + 0.5 - height / 2) * pitch

    def resized(self, size: Size) -> Camera:
        """The same view with another number of pixels and the same vertical field of view."""
        return Camera(self.eye, self.eye_from_world, _size(size), self.extent, self.perspective)


def _of_vtk(x: Any, size: Any) -> tuple[Any, Any]:
    """Camera of a plotter, window or renderer, or `x` itself; and the pixels of its viewport, if known."""
    if not any(hasattr(getattr(x, "renderer", x), name) for name in ("GetRenderers", "GetActiveCamera")):
        return x, size
    from splatgl.integrations.vtk.scene import renderer_of

    renderer = renderer_of(x)
    window = getattr(x, "window_size", None) or (renderer.GetRenderWindow() and renderer.GetRenderWindow().GetSize())
    left, bottom, right, top = renderer.GetViewport()
    size = size or (window and (round(window[0] * (right - left)), round(window[1] * (top - bottom))))
    return getattr(x, "camera", None) or renderer.GetActiveCamera(), size


def check_reach(corners: np.ndarray, camera: Camera, spacing: float) -> None:
    """Raises InputError for splat distances or picture heights beyond float32's range.

    corners [8, 3]: of the splats, world units.
    """
    far = float(np.abs(camera.eye_from_points(corners)).max()) / spacing
    if not far <= FAR:
        raise expected("eye", f"within {FAR:g} spacings of the splats", f"{far:g}", "move it nearer")
    if not camera.perspective and not 1 / FAR <= camera.extent / spacing <= FAR:
        height = f"{camera.extent:g}"
        raise expected("height", f"{spacing / FAR:g} to {spacing * FAR:g}, for splats {spacing:g} apart", height)


def _half_width(fov: float) -> float:
    """tan(fov/2)."""
    if not LEAST_FOV <= fov < 180.0:
        raise expected("fov", f"an angle between 0 and 180 degrees, from {LEAST_FOV:g} on", fov)
    return float(np.tan(np.radians(fov) / 2))


def _height(height: float) -> float:
    if not LEAST_LENGTH <= height <= MOST_LENGTH:
        raise expected("height", f"a positive length from {LEAST_LENGTH:g} to {MOST_LENGTH:g}", height)
    return float(height)


def _point(what: str, value: Vector) -> np.ndarray:
    point = np.array(value, dtype=np.float64)
    if point.shape != (3,) or not (np.abs(point) <= MOST_LENGTH).all():
        raise expected(what, f"three finite numbers (x, y, z) up to {MOST_LENGTH:g}", value)
    return point


def _size(size: Size) -> tuple[int, int]:
    width, height = checked(SIZE, "size", size)
    if max(width, height) > MOST_PIXELS:
        raise expected("size", f"a width and a height of at least 1 pixel, up to {MOST_PIXELS}", f"{width}×{height}")
    return width, height


def _eye_and_axes(eye: Vector, target: Vector, up: Vector) -> tuple[np.ndarray, np.ndarray]:
    place = _point("eye", eye)
    view = _point("target", target) - place
    length = float(np.linalg.norm(view))
    if not length > 0.0:
        raise expected("target", "a point other than the eye", [float(x) for x in target], "move one of them")
    vertical = _point("up", up)
    vertical = vertical / (np.abs(vertical).max() or 1.0)
    view = view / length
    side = np.linalg.norm(np.cross(view, vertical))
    if side <= UP_TOLERANCE * np.linalg.norm(vertical) or not side > 0.0:
        raise expected("up", "a direction that is not along the view", up, "choose another --up")
    # GL's axes are right, up, backward; pyrr gives them as columns
    axes = pyrr.matrix33.create_from_matrix44(pyrr.matrix44.create_look_at(np.zeros(3), view, vertical)).T
    return place, np.asarray(axes * np.array([[1.0], [-1.0], [-1.0]]))


def _orbit_axes(azimuth: float, elevation: float, up: Vector) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors from the subject to the eye, and up in the picture."""
    pole = _point("up", up)
    if not np.abs(pole).max() > 0:
        raise expected("up", "a direction", up)
    pole = pyrr.vector.normalise(pole / np.abs(pole).max())
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)])
    top = np.array([-np.sin(a) * np.sin(e), np.cos(a) * np.sin(e), np.cos(e)])
    # the shortest turn from +z to the pole; half a turn about y where they are opposite
    if pole[2] <= UP_TOLERANCE - 1:
        turn = np.diag([-1.0, 1.0, -1.0])
    else:
        v = pyrr.vector3.cross(np.array([0.0, 0.0, 1.0]), pole)
        skew = cross_matrix(v)
        turn = np.eye(3) + skew + skew @ skew / (1 + pole[2])
    return turn @ back, turn @ top


def quaternion_of(axes: np.ndarray) -> np.ndarray:
    """The unit quaternion (x, y, z, w) of a rotation [3, 3].  [Bar-Itzhack 2000]"""
    k = np.zeros((4, 4))
    k[:3, :3] = axes + axes.T - np.trace(axes) * np.eye(3)
    k[3, :3] = k[:3, 3] = axes[2, 1] - axes[1, 2], axes[0, 2] - axes[2, 0], axes[1, 0] - axes[0, 1]
    k[3, 3] = np.trace(axes)
    return np.asarray(np.linalg.eigh(k)[1][:, -1])


def cross_matrix(v: Sequence[float] | np.ndarray) -> np.ndarray:
    """[3, 3]: the matrix whose product with a vector is the cross product v × vector."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _fit(points: np.ndarray, half: float, size: tuple[int, int], centred: bool) -> tuple[float, np.ndarray]:
    """Distance from the eye to the centre, and the place [3] across the view that both move to, at which all points
    [N, 3] are visible, if centred with equal margins at opposite sides. points: eye axes (right, down, forward) from
    the centre.
    """
    widest = half * np.array([size[0] / size[1], 1.0])
    across, depth = points[:, :2], points[:, 2:]
    if not centred:
        return float(((np.abs(across) / widest).max(axis=1) - depth[:, 0]).max()) * FIT_MARGIN, np.zeros(3)
    reach = np.stack([(across - widest * depth).max(axis=0), (-across - widest * depth).max(axis=0)])
    distance = float((reach.sum(axis=0) / (2 * widest)).max()) * FIT_MARGIN
    offset = np.zeros(2)
    if not distance > 0:
        return distance, np.zeros(3)
    away = np.maximum(distance + depth[:, 0], np.finfo(float).tiny)
    for axis in range(2):
        # the slopes of both outermost points are opposite; others may be outermost then
        for _ in range(ROUNDS):
            slopes = (across[:, axis] - offset[axis]) / away
            ends = np.array([slopes.argmin(), slopes.argmax()])
            weights = 1 / away[ends]
            offset[axis] = (across[ends, axis] @ weights) / weights.sum()
    return distance, np.append(offset, 0.0)

"""A ray marcher of the field that kernels reconstruct, in float64, which shares no code with the product's references.

It reads what extraction kept (places, coefficients, gradients) and a camera's axes, and does the rest itself: kernels,
rays, box, classification, light. Its difference to a picture is that of sheets, footprints and float32, not of the
kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import splatgl as sg

# points of a ray per voxel at which the field is taken, and parts of what is linear between two
FINE, PARTS = 24, 4
# points at a time
MOST = 1 << 15


def b_spline(r: np.ndarray) -> np.ndarray:
    near, far = 2 / 3 - r**2 + r**3 / 2, np.maximum(2 - r, 0.0) ** 3 / 6
    return np.where(r < 1, near, far)


def crawfis_max(r: np.ndarray) -> np.ndarray:
    near = 0.557526 - 1.157743 * r**2 + 0.671033 * r**3
    s = np.maximum(1.556228 - r, 0.0)
    return np.where(r <= 0.889392, near, 0.067599 * s**2 + 0.282474 * s**3)


def gaussian(r: np.ndarray) -> np.ndarray:
    return np.where(r < 2, np.exp(-2 * r**2), 0.0)


Kernel = Callable[[np.ndarray], np.ndarray]
KERNELS: dict[str, Kernel] = {"b-spline": b_spline, "crawfis-max": crawfis_max, "gaussian": gaussian}


@dataclass(frozen=True, eq=False)
class Rays:
    """start, step [3, P]: grid positions, and grid steps of a unit of length; near, far [P]: lengths, world units, at
    which a ray is within the box of all cells and ahead of the eye. toward [P, 3]: unit vectors, world axes.
    """

    start: np.ndarray
    step: np.ndarray
    near: np.ndarray
    far: np.ndarray
    toward: np.ndarray

    @classmethod
    def of(cls, splats: sg.Splats, camera: sg.Camera) -> Rays:
        """A ray through the centre of each pixel, row by row."""
        assert splats.post is not None
        width, height = camera.size
        side = camera.extent / height
        x = ((np.arange(width) + 0.5) - width / 2) * side
        y = ((np.arange(height) + 0.5) - height / 2) * side
        x, y = (each.ravel() for each in np.meshgrid(x, y))
        right, down, forward = camera.eye_from_world
        across = x[:, None] * right + y[:, None] * down
        toward = across + forward if camera.perspective else np.repeat(forward[None], len(x), axis=0)
        toward = toward / np.linalg.norm(toward, axis=1)[:, None]
        eye = camera.eye + (0 if camera.perspective else across)
        inverse = np.linalg.inv(splats.grid.world_from_index)
        start = inverse @ (np.broadcast_to(eye, toward.shape) - splats.grid.origin).T
        step = inverse @ toward.T
        size = np.array(splats.post.shape)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(np.stack([(-0.5 - start) / step, (size - 0.5 - start) / step]), axis=0)
        # of a ray along a face, which is in the box, a place in its plane is 0/0
        along = (step == 0) & (start >= -0.5) & (start <= size - 0.5)
        near = np.maximum(np.where(along, -np.inf, ends[0]).max(axis=0), 0.0)
        far = np.where(along, np.inf, ends[1]).min(axis=0)
        return cls(start, step, near, np.maximum(far, near), toward)


class Field:
    """Σ k c / Σ k of the kept voxels, and of their gradients."""

    def __init__(self, splats: sg.Splats) -> None:
        assert splats.post is not None
        self.post, records = splats.post, splats.records
        self.kernel = KERNELS[splats.post.kernel]
        x, y, z = np.rint(records["position"]).astype(int).T + 3
        # those kept, coefficients and gradients; nothing around the box
        self.terms = np.zeros((*(n + 6 for n in splats.post.shape[::-1]), 5))
        self.terms[z, y, x, 0] = 1
        self.terms[z, y, x, 1] = records["value"]
        self.terms[z, y, x, 2:] = records["gradient"]

    def at(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values [P] and gradients [P, 3] at grid positions [3, P]; NaN where no voxel reaches."""
        found = [self._at(places[:, first : first + MOST]) for first in range(0, places.shape[1], MOST)]
        sums = np.concatenate(found) if found else np.zeros((0, 5))
        with np.errstate(divide="ignore", invalid="ignore"):
            means = sums[:, 1:] / sums[:, :1]
        return self.post.low + means[:, 0] * self.post.span, means[:, 1:]

    def _at(self, places: np.ndarray) -> np.ndarray:
        depth, height, width, _ = self.terms.shape
        # nothing is beyond the padding
        cell = np.clip(np.floor(places).astype(int), -2, np.array([width, height, depth])[:, None] - 6)
        squares = (places - cell - np.arange(-1, 3)[:, None, None]) ** 2
        first = ((cell[2] + 2) * height + cell[1] + 2) * width + cell[0] + 2
        terms, sums = self.terms.reshape(-1, 5), np.zeros((places.shape[1], 5))
        for x, y, z in np.ndindex(4, 4, 4):
            weight = self.kernel(np.sqrt(squares[x, 0] + squares[y, 1] + squares[z, 2]))
            sums += weight[:, None] * terms[first + (z * height + y) * width + x]
        return sums


def extinctions(transfer: sg.Transfer, unit: float, values: np.ndarray) -> np.ndarray:
    """Per world length, of values; a repeated point is a step, whose upper side a value on it takes."""
    x, y = np.array(transfer.points, float).T
    upper = np.interp(values, x, y)
    for n in np.flatnonzero(np.diff(x) == 0):
        upper = np.where(values == x[n], y[x == x[n]][-1], upper)
    return -np.log1p(-np.minimum(upper, 1 - 2.0**-24)) / unit


def march(
    splats: sg.Splats, camera: sg.Camera, blend: str = "composite", fine: int = FINE, strength: float = 0.05
) -> np.ndarray:
    """The picture [H, W, 4] of a ray through each pixel's centre, linear premultiplied, lit as the transfer function
    says; without antialiasing, light of other kinds, planes and masks. strength: of attenuated-mip.
    """
    assert splats.post is not None
    rays, field, transfer = Rays.of(splats, camera), Field(splats), splats.post.transfer
    unit = transfer.unit or float(np.abs(np.linalg.det(splats.grid.world_from_index))) ** (1 / 3)
    pictures = np.zeros((len(rays.near), 4))
    length = (rays.far - rays.near) * np.linalg.norm(rays.step, axis=0)
    steps = np.ceil(np.where(np.isfinite(length), length, 0.0) * fine).astype(int)
    for ray in np.flatnonzero(steps):
        t = np.linspace(rays.near[ray], rays.far[ray], steps[ray] + 1)
        value, gradient = field.at(rays.start[:, ray, None] + rays.step[:, ray, None] * t)
        if blend in ("mip", "minip"):
            some = value[np.isfinite(value)]
            if some.size:
                pictures[ray] = _class(transfer, some.max() if blend == "mip" else some.min())
            continue
        if blend == "attenuated-mip":
            pictures[ray] = _attenuated(transfer, value, strength * (t[1] - t[0]) / unit)
            continue
        share = (np.arange(PARTS) + 0.5) / PARTS
        value = (value[:-1, None] * (1 - share) + value[1:, None] * share).ravel()
        middle = (gradient[:-1, None] * (1 - share[:, None]) + gradient[1:, None] * share[:, None]).reshape(-1, 3)
        step, known = (t[1] - t[0]) / PARTS, np.isfinite(value)
        if blend == "mean":
            if known.any():
                pictures[ray] = _class(transfer, value[known].mean())
            continue
        value = np.where(known, value, 0.0)
        depth = np.where(known, extinctions(transfer, unit, value) * step, 0.0)
        color = transfer.color(value)
        if transfer.shading and blend == "composite":
            size = np.linalg.norm(middle, axis=1)
            slant = np.abs(middle @ rays.toward[ray]) / np.where(size > 0, size, 1.0)
            color = color * np.where(size > 0, 0.3 + 0.7 * slant, 1.0)[:, None]
        passed = depth if blend == "xray" else np.exp(depth - np.cumsum(depth)) * -np.expm1(-depth)
        pictures[ray] = *(passed @ color), passed.sum()
    return pictures.reshape(camera.size[1], camera.size[0], 4)


def _attenuated(transfer: sg.Transfer, value: np.ndarray, depth: float) -> np.ndarray:
    """Class of the largest product of a value's share of the window and of what is left before it, by trapezia.

    depth: of a step at the window's high end.
    """
    low, high = transfer.window or (transfer.points[0][0], transfer.points[-1][0])
    share = np.clip((np.where(np.isfinite(value), value, low) - low) / (high - low), 0, 1)
    before = np.concatenate([[0.0], np.cumsum(share[1:] + share[:-1]) * depth / 2])
    return _class(transfer, low + (high - low) * float((share * np.exp(-before)).max()))


def _class(transfer: sg.Transfer, value: float) -> np.ndarray:
    opacity = -np.expm1(-extinctions(transfer, 1.0, np.array([value]))[0])
    return np.array([*(transfer.color(np.array([value]))[0] * opacity), opacity])


def calm(picture: np.ndarray, most: float = 0.1) -> np.ndarray:
    """bool [H, W]: pixels whose alpha differs from that of each of the eight around it by `most` at most."""
    alpha = np.pad(picture[..., 3], 1, mode="edge")
    height, width = picture.shape[:2]
    around = [alpha[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray(np.ptp(np.stack(around), axis=0) <= 2 * most) & (
        np.abs(np.stack(around) - picture[..., 3]).max(axis=0) <= most
    )

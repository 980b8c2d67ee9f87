"""Constant fog: the exact opacity of every ray is 1 − exp(−σL), for any eye and voxel size."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from splatgl.data.volume import Volume
from splatgl.splat.camera import Camera
from splatgl.splat.kernels import kernel
from splatgl.splat.splats import Splats
from splatgl.truth.stress.bench import Bench, voxels
from splatgl.truth.stress.case import Case, Check, check
from splatgl.truth.stress.scenes import alpha, transfer

VIEWS = 50
SEED = 50
FOG_BOUND = 0.011
SHAPE = (30, 28, 32)
SIZE = (96, 6)
# minimum distance of a ray from the box's edges in voxels, times max(1, m): a kernel reaches 1.56 m
CLEAR = 2.0
# minimum path length, voxels
SHORTEST = 4.0


@dataclass(frozen=True)
class View:
    """A box of fog and an eye. opacity: per mean spacing."""

    spacing: np.ndarray
    camera: Camera
    opacity: float
    inside: bool

    def splats(self) -> Splats:
        """Splats of the box, all voxels with this opacity."""
        volume = Volume(np.ones(SHAPE[::-1], np.uint8), tuple(self.spacing))
        return voxels(volume, transfer(((0.0, 0.0), (1.0, self.opacity))))


def views(seed: int = SEED) -> list[View]:
    """Random directions, distances and spacings; every fifth eye is inside, at least two voxels from a face."""
    rng = np.random.default_rng(seed)
    found: list[View] = []
    while len(found) < VIEWS:
        view = _view(rng, len(found) % 5 == 0)
        # at least one ray must satisfy the conditions
        if paths(view)[1].any():
            found.append(view)
    return found


def _view(rng: np.random.Generator, inside: bool) -> View:
    # aspect ratios up to 1:3, at any scale
    spacing = np.exp(rng.uniform(-0.55, 0.55, 3)) * 10.0 ** rng.uniform(-3, 3)
    box = spacing * SHAPE
    middle = spacing * (np.array(SHAPE) - 1) / 2
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    target = middle + rng.uniform(-0.2, 0.2, 3) * box
    # a strip of an image of 200 to 800 rows: the depth at which a voxel is a pixel wide
    z_k = rng.uniform(150.0, 600.0)
    fov = float(np.degrees(2 * np.arctan(SIZE[1] / 2 / z_k)))
    if inside:
        eye = spacing * rng.uniform(2.0, np.array(SHAPE) - 3.0)
    else:
        # up to several voxels a pixel
        far = z_k * spacing.max() * rng.uniform(0.3, 2.0)
        eye = middle - direction * (np.linalg.norm(box) / 2 + far)
    up = rng.normal(size=3)
    camera = Camera.look_at(eye, eye + direction if inside else target, up, fov, SIZE)
    return View(spacing, camera, float(rng.uniform(0.02, 0.08)), inside)


def paths(view: View, reach: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """(σL [H, W], clear [H, W]): each ray's optical depth, and whether it stays clear of the edges. reach: of the box
    larger by so many voxels, times max(1, m).
    """
    camera, spacing = view.camera, view.spacing
    across, down = np.meshgrid(*camera.slopes())
    rays = np.stack([across, down, np.ones_like(across)], axis=-1) @ camera.eye_from_world / spacing
    eye = camera.eye / spacing
    pitch = camera.extent / camera.size[1] / spacing.min()
    farthest = camera.eye_from_points(spacing * np.array(list(product(*((0, size) for size in SHAPE)))))[:, 2].max()
    grown = reach * max(1.0, pitch * farthest)
    low, high = np.full(3, -0.5) - grown, np.array(SHAPE) - 0.5 + grown
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - eye) / rays, (high - eye) / rays])
    near, far = ends.min(axis=0).max(axis=-1), ends.max(axis=0).min(axis=-1)
    near = np.maximum(near, 0.0)
    hit = far > near
    near, far = np.where(hit, near, 0.0), np.where(hit, far, 0.0)
    length = (far - near) * np.linalg.norm(rays * spacing, axis=-1)
    voxels = (far - near) * np.linalg.norm(rays, axis=-1)
    mean = float(np.prod(spacing) ** (1 / 3))
    depth = -np.log1p(-view.opacity) / mean * length
    clear = hit & (voxels >= SHORTEST)
    for start, along in _edges(low, high):
        away, at = _apart(eye, rays, start, along)
        clear &= away >= CLEAR * np.maximum(1.0, pitch * at)
    return depth, clear


def _edges(low: np.ndarray, high: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The box's twelve edges: start and vector to the end."""
    for axis in range(3):
        for corner in product((False, True), repeat=2):
            start = low.copy()
            start[[n for n in range(3) if n != axis]] = np.where(corner, np.delete(high, axis), np.delete(low, axis))
            yield start, np.eye(3)[axis] * (high - low)


def _apart(eye: np.ndarray, rays: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(distance in voxels [H, W], depth [H, W]) from rays [H, W, 3], which start at the eye, to an edge."""
    unit = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    # across the ray, the edge is start − eye + s · along
    first, step = (part - (unit @ part)[..., None] * unit for part in (start - eye, along))
    square = (step * step).sum(axis=-1)
    share = np.clip(-(first * step).sum(axis=-1) / np.maximum(square, 1e-12), 0.0, 1.0)
    nearest = start - eye + share[..., None] * along
    ahead = np.maximum((nearest * unit).sum(axis=-1), 0.0)
    away = np.linalg.norm(nearest - ahead[..., None] * unit, axis=-1)
    return away, ahead / np.linalg.norm(rays, axis=-1)


def fog(bench: Bench) -> list[Check]:
    """Checks 1 − exp(−σL) on rays clear of the box's edges; on others that it lies between that of boxes smaller and
    larger by what a kernel reaches.
    """
    found: dict[bool, list[np.ndarray]] = {True: [], False: []}
    right: dict[bool, list[np.ndarray]] = {True: [], False: []}
    paper: dict[bool, list[np.ndarray]] = {True: [], False: []}
    edge_found, edge_right, edge_paper = [], [], []
    radius = kernel("crawfis-max").radius
    for view in views():
        depth, clear = paths(view)
        splats = view.splats()
        drawn, old = (alpha(draw(splats, view.camera)) for draw in (bench.draw, bench.paper))
        answer = -np.expm1(-depth)
        for kept, picture in ((found, drawn), (right, answer), (paper, old)):
            kept[view.inside].append(picture[clear])
        edge_found.append(drawn[~clear])
        ends = (-np.expm1(-paths(view, reach)[0]) for reach in (-radius, radius))
        edge_right.append(np.clip(drawn, *ends)[~clear])
        edge_paper.append(old[~clear])
    checks = []
    for inside in (False, True):
        own, known, eight = (np.concatenate(kept[inside]) for kept in (found, right, paper))
        name = f"{len(own)} rays from {'inside' if inside else 'outside'}"
        checks.append(check(name, own, known, FOG_BOUND, eight, relative=True))
    own, known, eight = (np.concatenate(kept) for kept in (edge_found, edge_right, edge_paper))
    return [*checks, check(f"{len(own)} rays nearer edges", own, known, FOG_BOUND, eight)]


CASES = (
    Case(
        "constant-fog",
        "fog seen from 50 random directions, distances and spacings, a fifth of them from inside",
        "30×28×32 voxels of 1e−3 to 1e3 units, up to 1:3, pictures of 200 to 800 rows; rays that keep 2 max(1, m) "
        "voxels from the box's edges, eye at least 2 voxels from a face, path at least 4 voxels; nearer the "
        "edges it lies between that of boxes smaller and larger by a kernel's reach",
        "closed form: 1 − exp(−σL)",
        fog,
    ),
)

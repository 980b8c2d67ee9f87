"""`Mesh`: triangles in a volume's world, from files or arrays; points as spheres, lines as tubes; caps of cuts.

A point of the plane lies inside if a ray within the plane crosses the mesh an odd number of times: what lies inside an
inner surface is outside. The plane is divided into strips between the corners of the outline where it cuts the mesh,
and the inner parts of the strips into triangles that share their corners, without gaps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from splatgl.coercion import public
from splatgl.data.affine import World, unit_name
from splatgl.data.color import linear_from_srgb, srgb_from_linear, srgb_of_name
from splatgl.errors import expected

# a corner takes its vertex' mean normal if that is within this angle of the triangle's normal, else the latter
SMOOTH = np.cos(np.radians(45.0))
# sides of tubes
SIDES = 8
# a bone's colour, sRGB
COLOR = "#e8dcc8"
# colour map of values
COLORMAP = "viridis"
# colours of caps
PLAIN, OF_VOLUME = CAPS = ("plain", "volume")


@dataclass(frozen=True, eq=False)
class Texture:
    """Colours of a mesh by position, which are not lit. light: of world points [P, 3], float64 [P, 4]: linear RGB and
    1, or 0 where there is a hole.

    texels: the same at texels, float32: linear RGB and 1 or 0 [H, W, 4], or places in the mesh's colour map [H, W],
    below KNOWN where there is a hole. texel_from_world [2, 4]: column and row at a point (x, y, z, 1). smooth: whether
    cubics lie between the texels, else the nearest counts.
    """

    light: Callable[[np.ndarray], np.ndarray]
    texels: np.ndarray
    texel_from_world: np.ndarray
    smooth: bool = True

    @property
    def mapped(self) -> bool:
        """Whether texels are positions in a colour map."""
        return self.texels.ndim == 2

    def scaled(self, factors: np.ndarray) -> Texture:
        """The texture of a mesh whose vertices (x, y, z) are multiplied by factors [3]."""
        matrix = self.texel_from_world / np.append(factors, 1.0)
        return replace(self, light=lambda points: self.light(points / factors), texel_from_world=matrix)


@public
@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles, lit from both sides. vertices float64 [N, 3]: world units; faces int64 [M, 3]: numbers of vertices.

    color: "#rrggbb", a CSS name such as teal, or linear RGB. colors uint8 [N, 3]: sRGB of each vertex instead, or None.
    opacity: from 0 to 1, of each triangle. frame, unit: as of volumes.
    values float64 [N]: numbers of vertices, drawn in the colours of `colormap` over `window` (None: from the least to
    the largest) unless there are colours; NaN is drawn in `color`. quantity: their name.
    clipped: whether clipping planes of scenes and settings cut it, too. corner_normals [M, 3, 3]: normals of the
    corners of triangles, instead of the surface's. texture: gives the colours by place. caps: a mesh that scenes clip
    is closed by planes in "plain" colour, or in those of the "volume" there; "": it stays open. Raises InputError for
    other shapes and numbers.
    """

    vertices: np.ndarray
    faces: np.ndarray
    color: str | Sequence[float] = COLOR
    opacity: float = 1.0
    colors: np.ndarray | None = None
    name: str = ""
    frame: str | None = None
    values: np.ndarray | None = None
    colormap: str = COLORMAP
    window: tuple[float, float] | None = None
    quantity: str = ""
    clipped: bool = False
    corner_normals: np.ndarray | None = None
    texture: Texture | None = None
    caps: str = ""
    unit: str = ""

    def __post_init__(self) -> None:
        vertices = _array("vertices", self.vertices, np.float64)
        if len(vertices) and not np.isfinite(vertices).all():
            raise expected("vertices", "finite numbers", "NaN or infinity")
        faces = _array("faces", self.faces, np.int64)
        if len(faces) and not (faces.min() >= 0 and faces.max() < len(vertices)):
            raise expected("faces", f"numbers of {len(vertices)} vertices", f"{faces.min()} to {faces.max()}")
        colors = self.colors
        if colors is not None:
            colors = _array("colors", colors, np.uint8)
            if len(colors) != len(vertices):
                raise expected("colors", f"one for each of {len(vertices)} vertices", len(colors))
        if not 0 <= self.opacity <= 1:
            raise expected("opacity", "a number from 0 to 1", self.opacity)
        object.__setattr__(self, "color", _color(self.color))
        object.__setattr__(self, "unit", unit_name(str(self.unit or "")))
        values = None if self.values is None else _values(self.values, len(vertices))
        for name, value in (("vertices", vertices), ("faces", faces), ("colors", colors), ("values", values)):
            object.__setattr__(self, name, value)
        if self.window is not None:
            object.__setattr__(self, "window", _window(self.window))
        if self.corner_normals is not None and np.shape(self.corner_normals) != (len(faces), 3, 3):
            raise expected("corner_normals", f"an array {(len(faces), 3, 3)}", np.shape(self.corner_normals))
        if self.caps:
            if self.caps not in CAPS:
                raise expected("caps", " or ".join(CAPS), repr(self.caps)[:80])
            object.__setattr__(self, "clipped", True)

    def __len__(self) -> int:
        """The number of triangles."""
        return len(self.faces)

    def __repr__(self) -> str:
        """One line: name, triangles, opacity."""
        return f"<Mesh {self.name!r}: {len(self):,} triangles, opacity {self.opacity:g}>"

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals float64 [M, 3, 3] of the corners of triangles; 0 for triangles without area."""
        if self.corner_normals is not None:
            return np.asarray(self.corner_normals, np.float64)
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        mean = np.zeros_like(self.vertices)
        for n, corner in enumerate(self.faces.T):
            # weighted by the angle there, so that how a side is cut into triangles does not matter
            here = _normalize(np.roll(corners, -n, axis=1)[:, 1:] - corners[:, n, None])
            angle = np.arccos(np.clip((here[:, 0] * here[:, 1]).sum(axis=1), -1.0, 1.0))
            for axis in range(3):
                mean[:, axis] += np.bincount(corner, _normalize(across)[:, axis] * angle, len(mean))
        flat, smooth = _normalize(across)[:, None], _normalize(mean)[self.faces]
        return np.where((flat * smooth).sum(axis=2, keepdims=True) > SMOOTH, smooth, flat)

    @property
    def shades(self) -> np.ndarray:
        """Linear RGB float64 [M, 3, 3] of the corners of triangles."""
        if self.colors is None:
            return np.broadcast_to(np.asarray(self.color, np.float64), (len(self.faces), 3, 3))
        return np.asarray(linear_from_srgb(self.colors / 255.0))[self.faces]

    @property
    def world(self) -> World:
        """Frame and unit of the vertices."""
        return World(self.frame, self.unit)

    def placed(self, frame: str | None = None, unit: str = "") -> Mesh:
        """The mesh in another frame and unit of length; one that is unknown on either side stays."""
        change = self.world.change(frame, unit)
        if change is None:
            return self
        frame, unit = change.world
        normals = None if self.corner_normals is None else self.corner_normals * change.turn
        texture = self.texture and self.texture.scaled(change.factors)
        vertices = self.vertices * change.factors
        return replace(self, vertices=vertices, frame=frame, unit=unit, corner_normals=normals, texture=texture)

    def unlit(self) -> Mesh:
        """The mesh in its plain colours, whatever the light: with normals of length 0."""
        return replace(self, corner_normals=np.zeros((len(self.faces), 3, 3)))

    @property
    def ranged(self) -> tuple[float, float]:
        """The values at the ends of the colour map; 0 and 1 without finite values, and a range around one value."""
        if self.window is not None:
            return self.window
        known = np.zeros(0) if self.values is None else self.values[np.isfinite(self.values)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        return (low, high) if low < high else (low - 0.5, low + 0.5)

    @property
    def mapped(self) -> bool:
        """Whether the values give the colours."""
        return self.values is not None and self.colors is None

    @property
    def has_map(self) -> bool:
        """Whether values or texels are drawn in the colours of a map."""
        return self.mapped or (self.texture is not None and self.texture.mapped)

    @property
    def area(self) -> float:
        """The area of all triangles, square world units."""
        corners = self.vertices[self.faces]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return float(np.linalg.norm(across, axis=1).sum()) / 2

    def cut(self, planes: Sequence[Sequence[float]]) -> Mesh:
        """The part where n · x ≥ d for all planes (n_x, n_y, n_z, d), open there; triangles of any size are cut."""
        rows = np.asarray(planes, np.float64).reshape(-1, 4)
        if not len(self) or (self.vertices @ rows[:, :3].T >= rows[:, 3]).all():
            return self
        # per corner: position, normal, linear colour, value
        parts = [self.vertices[self.faces], self.normals]
        if self.colors is not None:
            parts.append(linear_from_srgb(self.colors / 255.0)[self.faces])
        if self.values is not None:
            parts.append(self.values[self.faces][..., None])
        corners = np.concatenate(parts, axis=2)
        for *normal, place in rows:
            corners = _clip_triangles(corners, corners[..., :3] @ np.array(normal) - place)
        flat = corners.reshape(-1, corners.shape[2])
        colors = None
        if self.colors is not None:
            colors = np.rint(srgb_from_linear(np.clip(flat[:, 6:9], 0, 1)) * 255).astype(np.uint8)
        return replace(
            self,
            vertices=flat[:, :3],
            faces=np.arange(len(flat)).reshape(-1, 3),
            colors=colors,
            values=None if self.values is None else flat[:, -1],
            window=self.ranged if self.mapped else self.window,
            corner_normals=_normalize(corners[..., 3:6]),
            caps="",
        )

    def to_pyvista(self) -> Any:
        """A pyvista.PolyData of the triangles, and of the colours of vertices. InputError without PyVista."""
        from splatgl.integrations.vtk.image_data import poly_data

        return poly_data(self)

    @classmethod
    def of_points(cls, points: Any, radius: float, **look: Any) -> Mesh:
        """Spheres around points [N, 3], world units. look: color, opacity, name."""
        centers, (ball, faces) = _array("points", points, np.float64), _icosphere()
        vertices = centers[:, None] + ball * _radius(radius)
        offsets = np.arange(len(centers))[:, None, None] * len(ball)
        return cls(vertices.reshape(-1, 3), (faces + offsets).reshape(-1, 3), **look)

    @classmethod
    def of_lines(cls, lines: Sequence[Any], radius: float, **look: Any) -> Mesh:
        """Tubes around lines of points [N, 3], world units; none for a single point. look: color, opacity, name."""
        tubes = [_tube(_array("lines", line, np.float64), _radius(radius)) for line in lines]
        tubes = [tube for tube in tubes if len(tube)]
        rings = [np.arange(len(tube) // SIDES) for tube in tubes]
        first = np.cumsum([0, *map(len, tubes)])
        quads = [_ring_triangles(ring[:-1]) + start for ring, start in zip(rings, first[:-1], strict=True)]
        vertices = np.concatenate([np.zeros((0, 3)), *tubes])
        return cls(vertices, np.concatenate([np.zeros((0, 3), np.int64), *quads]), **look)


def _array(what: str, values: Any, kind: Any) -> np.ndarray:
    try:
        array: np.ndarray = np.ascontiguousarray(values, kind)
    except (TypeError, ValueError) as error:
        raise expected(what, "an array [N, 3] of numbers", type(values).__name__) from error
    if array.size == 0:
        return np.zeros((0, 3), kind)
    if array.ndim != 2 or array.shape[1] != 3:
        raise expected(what, "an array [N, 3]", str(array.shape))
    return array


def _values(stated: Any, count: int) -> np.ndarray:
    """float64 [N], NaN where they are not finite."""
    try:
        values: np.ndarray = np.array(stated, np.float64)
    except (TypeError, ValueError) as error:
        raise expected("values", "numbers", type(stated).__name__) from error
    if values.shape != (count,):
        raise expected("values", f"one for each of {count} vertices", f"shape {values.shape}")
    values[~np.isfinite(values)] = np.nan
    return values


def _window(ends: Any) -> tuple[float, float]:
    try:
        low, high = (float(number) for number in ends)
    except (TypeError, ValueError):
        low = high = np.nan
    if not -np.inf < low < high < np.inf:
        raise expected("window", "two finite numbers, the first below the second", repr(ends)[:80])
    return low, high


def _color(color: str | Sequence[float]) -> tuple[float, float, float]:
    """Linear RGB."""
    try:
        color = linear_from_srgb(np.array(srgb_of_name(color)) / 255).tolist() if isinstance(color, str) else color
        r, g, b = np.asarray(color, np.float64).tolist()
    except (TypeError, ValueError):
        r = g = b = np.nan
    if not all(0 <= part <= 1 for part in (r, g, b)):
        raise expected("color", "#rrggbb, a CSS name or three linear numbers from 0 to 1", repr(color)[:80])
    return r, g, b


def _radius(radius: float) -> float:
    if not 0 < radius < np.inf:
        raise expected("radius", "a positive length", radius)
    return float(radius)


def _normalize(vectors: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.where(size > 0, size, 1.0))


def _icosphere() -> tuple[np.ndarray, np.ndarray]:
    """Vertices [162, 3] and faces [320, 3] of an icosahedron, divided twice, on the unit sphere."""
    golden = (1 + 5**0.5) / 2
    sides = [(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    vertices = _normalize(np.array([np.roll(side, n) for n in range(3) for side in sides], np.float64))
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 1.1
    faces = np.array([three for three in combinations(range(12), 3) if near[np.ix_(three, three)].sum() == 9])
    # the same winding for all
    inward = np.linalg.det(vertices[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    for _ in range(2):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        ends, number = np.unique(edges, axis=0, return_inverse=True)
        middle = number.reshape(-1, 3) + len(vertices)
        vertices = np.concatenate([vertices, _normalize(vertices[ends].sum(axis=1))])
        a, b, c = faces.T
        ab, bc, ca = middle.T
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        faces = np.concatenate([np.stack(part, axis=1) for part in parts])
    return vertices, faces


def ring_points(line: np.ndarray) -> np.ndarray:
    """Indices of a line's points [N, 3] that get a ring of SIDES vertices; none if fewer than two points differ."""
    moves = np.flatnonzero(np.append(True, (np.diff(line, axis=0) != 0).any(axis=1))) if len(line) else np.zeros(0, int)
    return moves if len(moves) > 1 else moves[:0]


def _tube(line: np.ndarray, radius: float) -> np.ndarray:
    """Rings [n · SIDES, 3] around a line's points; none if fewer than two points differ."""
    line = line[ring_points(line)]
    if len(line) < 2:
        return np.zeros((0, 3))
    along = _normalize(np.gradient(line, axis=0))
    turn = 2 * np.pi * np.arange(SIDES) / SIDES
    side = np.eye(3)[np.abs(along[0]).argmin()]
    rings = []
    for point, forward in zip(line, along, strict=True):
        # turn as little as possible from ring to ring
        side = _normalize(side - (side @ forward) * forward)
        other = np.cross(forward, side)
        rings.append(point + radius * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other))
    return np.concatenate(rings)


def _ring_triangles(rings: np.ndarray) -> np.ndarray:
    """Triangles [2 · SIDES · R, 3] between each of R rings and the next."""
    a = (rings[:, None] * SIDES + np.arange(SIDES)).ravel()
    b = (rings[:, None] * SIDES + (np.arange(SIDES) + 1) % SIDES).ravel()
    return np.concatenate([np.stack([a, b, b + SIDES], axis=1), np.stack([a, b + SIDES, a + SIDES], axis=1)])


def _clip_triangles(corners: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """The parts of triangles [M, 3, K] where `beyond` [M, 3], linear between corners, is at least 0, as triangles."""
    inside = beyond >= 0
    count = inside.sum(axis=1)
    inner = corners[count == 3]
    # one corner inside gives one triangle, one outside two; rotated so that this corner is the first
    tips, stumps = (_rotate_corners(corners, beyond, count == n, inside if n == 1 else ~inside) for n in (1, 2))
    (a, *_), (ab, ac) = tips
    (_, e, f), (de, df) = stumps
    parts = [inner, np.stack([a, ab, ac], axis=1), np.stack([de, e, f], axis=1), np.stack([de, f, df], axis=1)]
    return np.concatenate(parts)


def _rotate_corners(
    corners: np.ndarray, beyond: np.ndarray, some: np.ndarray, first: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Corners [m, K] of selected triangles from the `first` on, and where the plane crosses its two sides."""
    numbers = np.flatnonzero(some)
    start = first[numbers].argmax(axis=1)
    order = (start[:, None] + np.arange(3)) % 3
    three = [corners[numbers, order[:, n]] for n in range(3)]
    at = [beyond[numbers, order[:, n]] for n in range(3)]
    crossed = []
    for n in (1, 2):
        share = (at[0] / (at[0] - at[n]))[:, None]
        crossed.append(three[0] + (three[n] - three[0]) * share)
    return three, crossed


# n_x, n_y, n_z, d: keeps n · x ≥ d, world units; n is a unit vector
Plane = tuple[float, float, float, float]
# lengths within an outline, as shares of its size, that are only rounding
ROUNDING = 1e-9


def cap_meshes(mesh: Mesh, planes: Sequence[Plane]) -> list[tuple[Plane, Mesh]]:
    """The caps that close a clipped mesh, each with its plane. Raises InputError as `cap_mesh`."""
    distinct = list(dict.fromkeys(planes))
    caps = [(plane, cap_mesh(mesh, plane).cut([other for other in distinct if other != plane])) for plane in distinct]
    return [(plane, cap) for plane, cap in caps if len(cap)]


def cap_mesh(mesh: Mesh, plane: Plane) -> Mesh:
    """The part of a plane inside a mesh, in the mesh's plain colour.

    Raises InputError for a mesh that is open where the plane cuts it.
    """
    normal, place = np.array(plane[:3], np.float64), float(plane[3])
    right = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    axes = np.array([right, np.cross(normal, right)]) / np.linalg.norm(right)
    corners, faces = fill_outline(_outline(mesh, normal, place) @ axes.T)
    return Mesh(
        corners @ axes + place * normal,
        faces,
        mesh.color,
        mesh.opacity,
        name=f"cap of {mesh.name}",
        frame=mesh.frame,
        corner_normals=np.broadcast_to(normal, (len(faces), 3, 3)),
    )


def _outline(mesh: Mesh, normal: np.ndarray, place: float) -> np.ndarray:
    """Lines [S, 2, 3] in which the plane cuts the triangles of a mesh."""
    # sums of the same three products are the same wherever they stand in an array
    inside = ((mesh.vertices * normal).sum(axis=1) >= place)[mesh.faces]
    cut = mesh.faces[inside.any(axis=1) & ~inside.all(axis=1)]
    # files without shared vertices repeat their places
    places, number = np.unique(mesh.vertices[cut].reshape(-1, 3), axis=0, return_inverse=True)
    beyond = (places * normal).sum(axis=1) - place
    sides = np.sort(number.reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    sides = sides[(beyond[sides] >= 0).sum(axis=1) == 1]
    _, count = np.unique(sides, axis=0, return_counts=True)
    if (count % 2).any():
        this = "meshes that are closed where planes cut them"
        raise expected("caps", this, f"{mesh.name or 'a mesh'}, which is open", "close its holes, or leave caps out")
    ends, along = places[sides], beyond[sides]
    share = along[:, 0] / (along[:, 0] - along[:, 1])
    return np.asarray(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share[:, None]).reshape(-1, 2, 3)


# parts of lines between neighbouring rows, by strip and from left to right: numbers [N] of strips, x [N] on their lower
# rows, and on their upper ones
Strips = tuple[np.ndarray, np.ndarray, np.ndarray]


def fill_outline(lines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners [N, 2] and faces [M, 3] of the area inside closed lines [S, 2, 2]: (x, y) of both ends."""
    downwards = lines[:, 0, 1] > lines[:, 1, 1]
    lines = np.where(downwards[:, None, None], lines[:, ::-1], lines)
    lines = lines[lines[:, 0, 1] < lines[:, 1, 1]]
    slack = ROUNDING * float(np.ptp(lines, axis=(0, 1)).max(initial=0.0)) if len(lines) else 0.0
    rows = np.unique(lines[..., 1])
    strips = _strips(lines, rows)
    while len(crossed := _crossings(strips, rows, slack)):
        rows = np.union1d(rows, crossed)
        strips = _strips(lines, rows)
    # ends of the inner parts, by left and right, lower and upper
    strip, low, high = strips
    left, right = (np.stack([low[n::2], high[n::2]]) for n in (0, 1))
    row = strip[::2] + np.array([[0], [1]])
    points, number = np.unique(
        np.stack([np.stack([row, row]), np.stack([left, right])], axis=-1).reshape(-1, 2), axis=0, return_inverse=True
    )
    (low_left, high_left), (low_right, high_right) = number.reshape(2, 2, -1)
    # sides between neighbouring points of a row: what they belong to, and their first points
    below, start = unroll_ranges(low_left, np.maximum(low_left, low_right))
    above, end = unroll_ranges(high_left, np.maximum(high_left, high_right))
    faces = [np.stack([start, start + 1, high_left[below]], axis=1), np.stack([end + 1, end, low_right[above]], axis=1)]
    return np.stack([points[:, 1], rows[points[:, 0].astype(int)]], axis=1), np.concatenate(faces)


def _strips(lines: np.ndarray, rows: np.ndarray) -> Strips:
    """The parts of upward lines [S, 2, 2] between rows [R], among which are those of all ends."""
    first, last = (np.searchsorted(rows, lines[:, end, 1]) for end in (0, 1))
    line, strip = unroll_ranges(first, last)
    (x, y), (end_x, end_y) = (lines[line, end].T for end in (0, 1))
    low, high = (
        np.where(at == y, x, np.where(at == end_y, end_x, x + (end_x - x) * ((at - y) / (end_y - y))))
        for at in (rows[strip], rows[strip + 1])
    )
    order = np.lexsort((low + high, strip))
    return strip[order], low[order], high[order]


def _crossings(strips: Strips, rows: np.ndarray, slack: float) -> np.ndarray:
    """Further rows, where neighbouring lines of a strip cross by more than `slack`."""
    apart, below, above = map(np.diff, strips)
    some = np.flatnonzero((apart == 0) & (np.minimum(below, above) < -slack))
    strip, share = strips[0][some], below[some] / (below[some] - above[some])
    at = rows[strip] + (rows[strip + 1] - rows[strip]) * share
    return np.asarray(at[(at > rows[strip]) & (at < rows[strip + 1])])


def unroll_ranges(first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The whole numbers from `first` to below `last` [N], after the index of the range of each."""
    count = last - first
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count - first, count)

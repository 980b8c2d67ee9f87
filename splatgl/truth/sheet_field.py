"""Reconstructed values along rays in float64: what lies around a sheet is cut, classified in parts, and lit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.ambient_occlusion import Cues
from splatgl.splat.clipping import FACE
from splatgl.splat.lighting import Light, surface_light
from splatgl.splat.mask_field import MaskField, face_share, kept_part
from splatgl.splat.preintegration import PostClassified
from splatgl.splat.resolve import Resolved
from splatgl.splat.settings import BlendMode
from splatgl.splat.sheets import AMID, CENTERED, EDGE, LEAST_MASS, Sheets, index_direction, layer_wave
from splatgl.splat.splats import Splats
from splatgl.splat.view import View
from splatgl.truth.blend import classified, joined, joined_value
from splatgl.truth.rays import Rays

# opacity behind which light is less than rounding
OPAQUE = 1 - 1e-15


@dataclass(frozen=True, eq=False)
class SheetField:
    """Classification of reconstructed values."""

    blend: BlendMode
    post: PostClassified
    view: View
    shading: bool
    weighted: bool
    spacing: float
    unit: float
    light: Light
    shines: np.ndarray | None
    cues: Cues | None
    mask: MaskField | None = None
    near: int = 0

    @classmethod
    def of(cls, splats: Splats, resolved: Resolved, view: View, near: int = 0) -> SheetField:
        """Of splats that are classified after. near: sheets from the eye on that are planes."""
        assert splats.post is not None
        look = resolved.look
        shines = look.light.within(resolved.camera)
        seen, size, cues = (look.shading, look.weighted), splats.grid.mean_spacing, resolved.cues
        found = cls(look.blend, splats.post, view, *seen, size, splats.unit, look.light, shines, cues, resolved.mask)
        return replace(found, near=near)

    def composited(self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets) -> np.ndarray:
        """[P, 4]: sums [P, sheets, 5] of mass, value and gradient, from sheet `first` on."""
        light = np.zeros((len(sums), 4))

        def seen() -> np.ndarray:
            # what is behind matter that hides everything is not seen
            return (light[:, 3] < OPAQUE) | self.blend.one_value | self.blend.unbounded

        for part in self.parts(sums, rays, first, sheets, seen):
            at = part.pixel
            if self.blend.one_value:
                length = part.ends[1] - part.ends[0]
                # Simpson's rule for the mean, and nearly the extremes
                for value, share in ((part.begin[:, 0], 1 / 6), (part.value, 2 / 3), (part.end[:, 0], 1 / 6)):
                    light[at] = joined(light[at], value, length * share, self.blend.join)
            elif self.blend.unbounded:
                light[at] += self.matter(part, rays)
            else:
                light[at] = behind(light[at], self.matter(part, rays))
        if not self.blend.one_value:
            return light
        return classified(self.post.transfer, self.post.value(joined_value(light, self.blend.join)))

    def parts(
        self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets, seen: Callable[[], np.ndarray]
    ) -> Iterator[Part]:
        """What lies around each sheet within the volume's box, in `steps` parts, nearest first. seen: tells in which
        pixels anything more can be seen.
        """
        near, far = self.places(rays, rays.near, sheets), self.places(rays, rays.far, sheets)
        entry = near if rays.entry is None else self.places(rays, rays.entry, sheets)
        stretch = rays.stretch * sheets.thickness
        padded = np.pad(self.centered(sums, rays, first, sheets), ((0, 0), (2, 2), (0, 0)))
        along = rays.toward * stretch[:, None]
        for n in range(1, padded.shape[1] - 1):
            some = np.flatnonzero((padded[:, n - 1 : n + 2, 0] > 0).any(axis=1) & seen())
            before, own, behind_ = (padded[some, n + k] for k in (-1, 0, 1))
            around = unbent(np.stack([(before + own) / 2, own, (own + behind_) / 2]), along[some])
            # half-way from the sheet before
            begin = first + n - 2 - 0.5
            # the part within the box
            low, high = (np.clip(end[some] - begin, 0.0, 1.0) for end in (near, far))
            face = entry[some] - begin + FACE / sheets.thickness
            for i in range(sheets.steps):
                ends = self._kept(
                    [np.clip((i + end) / sheets.steps, low, high) for end in (0, 1)], begin, some, rays, sheets
                )
                middle = (ends[0] + ends[1]) / 2
                has = between_sheets(around, middle)[:, 0] >= LEAST_MASS
                ends[1] = np.where(has, ends[1], ends[0])
                length = ends[1] - ends[0]
                faced = np.clip(face - ends[0], 0.0, length) / np.where(length > 0, length, 1.0)
                first_, mean, last = (means_of(between_sheets(around, at)) for at in (ends[0], middle, ends[1]))
                distance = (begin + middle) * sheets.thickness
                between = (ends[0], ends[1])
                yield Part(some, begin, between, first_, mean, last, stretch[some], faced, distance)

    def centered(self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets) -> np.ndarray:
        """[P, sheets, 6]: sums [P, sheets, 5] as if even matter had the same mass everywhere, whose values are moved,
        by their gradients, from its mean place to the sheets' own; and how much further than others, in sheets², they
        spread it. Of one value unchanged, whose extremes are then those of means.
        """
        if self.blend.one_value:
            return np.concatenate([sums, np.zeros_like(sums[..., :1])], axis=-1)
        number = first + np.arange(sums.shape[1])
        offset = np.broadcast_to(ray_offset(self.view, rays), len(rays.near))
        along = number * sheets.thickness - offset[:, None]
        places = rays.start[..., None] + rays.direction[..., None] * along
        # near the first and last layer gradients are of faces
        last = np.array(self.post.shape)[:, None, None] - 1
        amid = np.minimum(places, last - places).min(axis=0) - AMID
        layers, half = sheets.layer_terms(rays.direction)[..., None]
        sine, cosine = layer_wave(places), layer_wave(places + 0.25)
        lag = (layers[0] * sine + 2 * half[0] * sine * cosine).sum(axis=0)
        further = (layers[1] * cosine + half[1] * (1 - 2 * sine**2)).sum(axis=0) - 2 * lag**2
        if self.view.perspective:
            lag += bulge(number, sheets) * (number >= self.near)
        low, high = CENTERED
        mass = sums[..., 0] / sheets.mass
        share = np.clip(amid, 0.0, 1.0) * np.clip((mass - low) / (high - low), 0.0, 1.0)
        even = 1 + share * (1 / np.maximum(mass, low) - 1)
        slope = (sums[..., 2:] * rays.toward[:, None]).sum(axis=-1) * (rays.stretch * sheets.thickness)[:, None]
        moved = sums.copy()
        moved[..., 1] += share * lag * even * slope
        # gradients of the sheets beside it count, too
        further *= share * np.clip(amid - 1, 0.0, 1.0)
        return np.concatenate([moved * even[..., None], further[..., None]], axis=-1)

    def _kept(
        self, ends: list[np.ndarray], sheet: float, some: np.ndarray, rays: Rays, sheets: Sheets
    ) -> list[np.ndarray]:
        """What the mask keeps between ends, in sheets from a place in them, of some pixels."""
        if self.mask is None:
            return ends
        at = [self.mask.at(self._points((sheet + end) * sheets.thickness, some, rays)) for end in ends]
        return list(kept_part((at[0], at[1]), (ends[0], ends[1])))

    def _points(self, distance: np.ndarray, some: np.ndarray, rays: Rays) -> np.ndarray:
        """Grid positions [3, P] at distances, index units as sheets are counted, of some rays."""
        offset = np.broadcast_to(ray_offset(self.view, rays), len(rays.near))[some]
        return np.asarray(rays.start[:, some] + rays.direction[:, some] * (distance - offset))

    def places(self, rays: Rays, distance: np.ndarray, sheets: Sheets) -> np.ndarray:
        """Distances [P] along rays, index units, in sheets from the eye, or from the plane through it."""
        return np.asarray((distance + ray_offset(self.view, rays)) / sheets.thickness)

    def matter(self, part: Part, rays: Rays) -> np.ndarray:
        """[P, 4]: emission and optical depth of a part."""
        matter = self.weighed(part)
        if self.shading or self.cues is not None:
            factor, highlight = self.light_of(part, rays)
            matter[:, :3] = matter[:, :3] * factor[:, None] + matter[:, 3:] * highlight[:, None]
        return matter

    def light_of(self, part: Part, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [P] and highlights [P] of a part by its gradients; of the face of a cut by the plane."""
        found = self._surface(part, part.gradient if self.shading else np.zeros((len(part.pixel), 3)), rays)
        if not self.shading:
            return found
        if self.mask is not None:
            face = self.mask.normals(self._points(part.middle, part.pixel, rays))
            found = _mixed(found, self._surface(part, face, rays), face_share(part.gradient, face))
        if rays.face is not None:
            face = rays.face[part.pixel]
            found = _mixed(found, self._surface(part, face, rays), part.faced * face.any(axis=1))
        return found

    def _surface(self, part: Part, normal: np.ndarray, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        toward, reached = rays.toward[part.pixel], None
        if self.cues is not None:
            reached = self.cues.reached(self._points(part.middle, part.pixel, rays).T, normal, toward)
        return surface_light(normal, toward, self.light, self.shines, reached)

    def weighed(self, part: Part) -> np.ndarray:
        """[P, 4]: colour times optical depth, and optical depth of a part."""
        first, last, length = part.begin, part.end, (part.ends[1] - part.ends[0]) * part.stretch
        matter = self.post.integral.mean(self.post.value(first[:, 0]), self.post.value(last[:, 0]))
        if self.weighted:
            size = np.linalg.norm(part.gradient, axis=1)
            weight = self.post.transfer.weight(size * self.post.span / self.spacing)
            extinction = matter[:, 3]
            matter *= (weighted(extinction, weight) / np.where(extinction > 0, extinction, 1.0))[:, None]
        return np.asarray(matter * (length * self.spacing / self.unit)[:, None])


@dataclass(frozen=True, eq=False)
class Part:
    """A part of what lies around a sheet, of pixels [P]. ends: where it begins and ends, in sheets from `sheet`.

    begin, mean, end [P, 4]: values and gradients there and in its middle. stretch [P]: mean spacings per sheet. faced
    [P]: its share within the face of a cut. middle [P]: distance of its middle, index units, as sheets are counted.
    """

    pixel: np.ndarray
    sheet: float
    ends: tuple[np.ndarray, np.ndarray]
    begin: np.ndarray
    mean: np.ndarray
    end: np.ndarray
    stretch: np.ndarray
    faced: np.ndarray
    middle: np.ndarray

    @property
    def gradient(self) -> np.ndarray:
        """[P, 3]: in its middle."""
        return self.mean[:, 1:]

    @property
    def value(self) -> np.ndarray:
        """[P]: in its middle."""
        return self.mean[:, 0]


def between_sheets(around: np.ndarray, u: np.ndarray) -> np.ndarray:
    """[P, 5]: sums at places u [P] from 0, half-way before a sheet, to 1, half-way behind. around [3, P, 5]: the sums
    half-way before, of the sheet, and half-way behind.
    """
    shares = np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2]) + EDGE
    return np.asarray((shares[..., None] * around).sum(axis=0))


def unbent(around: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Sums `around` a sheet [3, P, 5], of which [3, P, 6] hold further spread, too: values are less by what that adds
    where gradients change along rays. along [P, 3]: unit directions times mean spacings per sheet.
    """
    further = around[..., 5]
    before, behind_ = np.diff((around[..., 2:5] * along).sum(axis=-1), axis=0)
    ends = before * further[0], behind_ * further[2]
    middle = (further[0] + 2 * further[1] + further[2]) / 4 * (before + behind_) - sum(ends) / 2
    found = around[..., :5].copy()
    found[..., 1] -= np.stack([ends[0], middle, ends[1]])
    return found


def means_of(sums: np.ndarray) -> np.ndarray:
    """Values and gradients [P, 4] of sums [P, 5]; 0 without mass."""
    return np.asarray(sums[:, 1:] / np.where(sums[:, :1] > 0, sums[:, :1], 1.0))


def bulge(number: np.ndarray, sheets: Sheets) -> np.ndarray:
    """How far, in sheets, a ray passes even matter of a sphere before the sphere's own place."""
    return np.asarray(sheets.variance / sheets.thickness**2 / np.maximum(number, 1))


Lit = tuple[np.ndarray, np.ndarray]


def _mixed(found: Lit, other: Lit, share: np.ndarray) -> Lit:
    """Factors and highlights, a share of which is of others."""
    factor, highlight = (mine * (1 - share) + own * share for mine, own in zip(found, other, strict=True))
    return factor, highlight


def ray_offset(view: View, rays: Rays) -> np.ndarray | float:
    """What distances along rays are shorter than those by which sheets are counted: in parallel views these are from
    the plane through the eye across the rays, in index space.
    """
    if view.perspective:
        return 0.0
    return np.asarray(index_direction(view) @ (rays.start - view.eye_index[:, None]))


def behind(light: np.ndarray, matter: np.ndarray) -> np.ndarray:
    """Light [P, 4] that reaches the eye from behind `light`, through matter [P, 4]: emission and optical depth."""
    depth = matter[:, 3]
    share = np.where(depth > 0, -np.expm1(-depth) / np.where(depth > 0, depth, 1.0), 1.0)
    return np.asarray(light + ((1 - light[:, 3]) * share)[:, None] * matter)


def weighted(extinction: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Extinction of that share of an extinction's opacity, both per reference length."""
    share = np.minimum(-np.expm1(-extinction) * weight, 1.0)
    with np.errstate(divide="ignore"):
        return np.where(weight < 1, -np.log1p(-share), extinction)

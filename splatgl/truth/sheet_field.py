"""Reconstructed values along rays in float64: what lies between two sheets is cut, classified in parts, and lit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from splatgl.splat.classification.post import PostClassified
from splatgl.splat.classification.shading import Light, surface_light
from splatgl.splat.cues.cues import Cues
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.plan.blend_mode import BlendMode
from splatgl.splat.plan.resolve import Resolved
from splatgl.splat.sheets.sheets import LEAST_MASS, Sheets, index_direction
from splatgl.splat.view.clip import FACE
from splatgl.splat.view.mask import MaskField, face_share, kept_part
from splatgl.splat.view.view import View
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
        """Of splats that are classified after. near: sheets from the eye on that hold the field itself."""
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
                length = (part.ends[1] - part.ends[0]) / 2
                values = part.begin[:, 0], part.end[:, 0]
                if part.sheet + 1 >= self.near:
                    values = ((values[0] + values[1]) / 2,) * 2
                for value in values:
                    light[at] = joined(light[at], value, length, self.blend.join)
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
        """What lies between two sheets within the volume's box, in `steps` parts, nearest first. seen: tells in which
        pixels anything more can be seen.
        """
        pixels = len(sums)
        before = np.zeros((pixels, 4))
        known = np.zeros(pixels, bool)
        near, far = self.places(rays, rays.near, sheets), self.places(rays, rays.far, sheets)
        entry = near if rays.entry is None else self.places(rays, rays.entry, sheets)
        stretch = rays.stretch * sheets.thickness
        padded = np.concatenate([sums, np.zeros((pixels, 1, 5))], axis=1)
        for n in range(padded.shape[1]):
            mass = padded[:, n, 0]
            valid = mass >= LEAST_MASS
            mean = padded[:, n, 1:] / np.where(valid, mass, 1.0)[:, None]
            mean = np.where(valid[:, None], mean, before)
            start = np.where(known[:, None], before, mean)
            some = np.flatnonzero((valid | known) & seen())
            # the part within the box
            low, high = (np.clip(end[some] - (first + n - 1), 0.0, 1.0) for end in (near, far))
            face = entry[some] - (first + n - 1) + FACE / sheets.thickness
            for i in range(sheets.steps):
                ends = self._kept(
                    [np.clip((i + end) / sheets.steps, low, high) for end in (0, 1)], first + n - 1, some, rays, sheets
                )
                begin, end = (start[some] * (1 - at[:, None]) + mean[some] * at[:, None] for at in ends)
                length = ends[1] - ends[0]
                middle = ((first + n - 1) + (ends[0] + ends[1]) / 2) * sheets.thickness
                faced = np.clip(face - ends[0], 0.0, length) / np.where(length > 0, length, 1.0)
                yield Part(some, first + n - 1, (ends[0], ends[1]), begin, end, stretch[some], faced, middle)
            before, known = np.where(valid[:, None], mean, 0.0), valid

    def _kept(
        self, ends: list[np.ndarray], sheet: int, some: np.ndarray, rays: Rays, sheets: Sheets
    ) -> list[np.ndarray]:
        """What the mask keeps between ends, in sheets from one, of some pixels."""
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
    """A part of what lies behind a sheet, of pixels [P]. ends: where it begins and ends, in sheets from that one.

    begin, end [P, 4]: values and gradients there. stretch [P]: mean spacings per sheet. faced [P]: its share within the
    face of a cut. middle [P]: distance of its middle, index units, as sheets are counted.
    """

    pixel: np.ndarray
    sheet: int
    ends: tuple[np.ndarray, np.ndarray]
    begin: np.ndarray
    end: np.ndarray
    stretch: np.ndarray
    faced: np.ndarray
    middle: np.ndarray

    @property
    def gradient(self) -> np.ndarray:
        """[P, 3]: in its middle."""
        return np.asarray((self.begin[:, 1:] + self.end[:, 1:]) / 2)


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

"""Sheets in float64: the twin of the shaders `sheet_*.glsl`.

Classified before: extinction and extinction · colour add up within a sheet. Classified after: masses, and values and
gradients weighted by mass, add up within a sheet; a quadratic B-spline interpolates the sums of sheets, whose means are
classified in parts, or joined to one value that is classified.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from splatgl.geometry.clipping import FACE, FLUSH
from splatgl.geometry.mask_field import MaskField, clip_to_mask
from splatgl.geometry.view import GridView
from splatgl.planning.ambient_occlusion import LightVolume
from splatgl.planning.resolve import Appearance, Resolved
from splatgl.reference.blend import classify_values, join_attenuated, join_values, joined_value
from splatgl.reference.rays import (
    Bounds,
    FootprintRow,
    PixelBoxes,
    Pixels,
    Rays,
    pair_values,
    pixel_boxes,
    pixel_slopes,
)
from splatgl.splat.kernels import Kernel, tabulate
from splatgl.splat.lighting import apply_light, surface_light
from splatgl.splat.line_integral import Integral
from splatgl.splat.sheets import (
    ABSENT,
    AMID,
    CENTERED,
    EDGE,
    LEAST_MASS,
    NearField,
    Sheets,
    index_direction,
    layer_wave,
)
from splatgl.splat.splats import Splats
from splatgl.transfer.preintegration import ClassIntegral, ValueClassifier
from splatgl.transfer.regions import THIN, mean_matter, spline_crossings
from splatgl.transfer.transfer import Transfer

# opacity behind which the remaining light is less than rounding
OPAQUE = 1 - 1e-15
# parts of rays that are classified together: many enough that numpy's calls cost little, their temporaries a few MB
PAIRS = 1 << 13


@dataclass(frozen=True, eq=False)
class SheetField:
    """Classification of reconstructed values."""

    appearance: Appearance
    post: ValueClassifier
    view: GridView
    spacing: float
    unit: float
    shines: np.ndarray | None
    cues: LightVolume | None
    mask: MaskField | None = None
    near: int = 0
    # of an attenuated maximum, per reference length
    mip_attenuation: float = 0.0

    @classmethod
    def of(cls, splats: Splats, resolved: Resolved, view: GridView, near: int = 0) -> SheetField:
        """Classification of splats of values. near: number of sheets from the eye on that are planes."""
        assert splats.post is not None
        appearance, size = resolved.appearance, (splats.grid.mean_spacing, splats.unit)
        lit = appearance.light.within(resolved.camera), resolved.cues
        return cls(appearance, splats.post, view, *size, *lit, resolved.mask, near, resolved.mip_attenuation)

    def composite(self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets) -> np.ndarray:
        """[P, 4]: sums [P, sheets, 5] of mass, value and gradient, from sheet `first` on."""
        light = np.zeros((len(sums), 4))

        def seen() -> np.ndarray:
            # opaque matter hides everything behind it
            return (light[:, 3] < OPAQUE) | self.appearance.shows_value | self.appearance.is_sum

        for part in self.parts(sums, rays, first, sheets, seen):
            if self.appearance.shows_value:
                self._join(light, part)
                continue
            place = part.number - part.number[0]
            matter = np.zeros((len(light), int(place[-1]) + 1, 2, 4))
            matter[part.pixel, place, 0] = self.matter(part, rays)
            if part.behind is not None:
                matter[part.pixel, place, 1] = self.surface_matter(part, rays)
            if self.appearance.is_sum:
                light += matter.sum(axis=(1, 2))
            else:
                light += (1 - light[:, 3:]) * composite_sums(matter.reshape(len(light), -1, 4))
        if not self.appearance.shows_value:
            return light
        return self.shown(light)

    def shown(self, light: np.ndarray) -> np.ndarray:
        """[P, 4]: the classes of joined values, of rays [P, 4]."""
        value = joined_value(light, self.appearance.join)
        if self.appearance.join == "attenuated":
            scale, offset = self.post.window_share
            value = (value - offset) / scale
        return classify_values(self.post.transfer, self.post.value(value))

    def _join(self, light: np.ndarray, part: RaySegments) -> None:
        """Joins the values of parts to those of pixels, in place."""
        length = part.ends[1] - part.ends[0]
        for one in np.split(np.arange(len(part.pixel)), np.flatnonzero(np.diff(part.number)) + 1):
            at, values = part.pixel[one], np.stack([part.begin[one, 0], part.value[one], part.end[one, 0]])
            if self.appearance.join == "attenuated":
                scale, offset = self.post.window_share
                depth = length[one] * part.stretch[one] * (self.spacing / self.unit * self.mip_attenuation)
                light[at] = join_attenuated(light[at], np.clip(scale * values + offset, 0, 1), length[one], depth)
                continue
            # Simpson's rule for the mean, and nearly the extremes
            for value, share in zip(values, (1 / 6, 2 / 3, 1 / 6), strict=True):
                light[at] = join_values(light[at], value, length[one] * share, self.appearance.join)

    def parts(
        self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets, is_visible: Callable[[], np.ndarray]
    ) -> Iterator[RaySegments]:
        """Yields the ray segments around all sheets within the volume's box, in `segments` parts each, nearest first,
        about PAIRS parts of rays at a time. is_visible: returns in which pixels further matter is visible.
        """
        near, far = self.places(rays, rays.near, sheets), self.places(rays, rays.far, sheets)
        entry = self.places(rays, rays.entry, sheets)
        stretch = rays.stretch * sheets.thickness
        padded = np.pad(self.center(sums, rays, first, sheets), ((0, 0), (2, 2), (0, 0)))
        along, steps, mass = rays.toward * stretch[:, None], self.segments(sheets), padded[..., 0] > 0
        has_mass = mass[:, :-2] | mass[:, 1:-1] | mass[:, 2:]
        together = max(PAIRS // (max(len(sums), 1) * steps), 1)
        for start in range(0, has_mass.shape[1], together):
            seen = has_mass[:, start : start + together] & is_visible()[:, None]
            number, some = np.nonzero(np.repeat(seen.T, steps, axis=0))
            if not len(some):
                continue
            sheet, step = np.divmod(number, steps)
            sheet += start
            before, at_sheet, behind_ = (padded[some, sheet + n] for n in range(3))
            around = remove_bend(np.stack([(before + at_sheet) / 2, at_sheet, (at_sheet + behind_) / 2]), along[some])
            # half-way from the previous sheet
            begin = first - 1.5 + sheet
            # the part within the box
            low, high = (np.clip(end[some] - begin, 0.0, 1.0) for end in (near, far))
            face = entry[some] - begin + FACE / sheets.thickness
            ends, surface = self._segment(around, step, (low, high), sheets)
            last_end = ends[1]
            ends = self._clip_to_mask(ends, begin, some, rays, sheets)
            if surface is not None and self.mask is not None:
                at = self.mask.at(self._points((begin + last_end) * sheets.thickness, some, rays))
                surface[at < -FLUSH] = -1
            middle = (ends[0] + ends[1]) / 2
            has = between_sheets(around, middle)[:, 0] >= LEAST_MASS
            ends[1] = np.where(has, ends[1], ends[0])
            length = ends[1] - ends[0]
            faced = np.clip(face - ends[0], 0.0, length) / np.where(length > 0, length, 1.0)
            first_, mean, last = (means_of(between_sheets(around, at)) for at in (ends[0], middle, ends[1]))
            distance = (begin + middle) * sheets.thickness
            place, between = number + start * steps, (ends[0], ends[1])
            part = RaySegments(some, place, begin, between, first_, mean, last, stretch[some], faced, distance)
            if surface is None:
                yield part
                continue
            sums = between_sheets(around, last_end)
            surface[sums[:, 0] < LEAST_MASS] = -1
            yield replace(
                part, behind=SurfaceHits(surface, means_of(sums)[:, 1:], (begin + last_end) * sheets.thickness)
            )

    def segments(self, sheets: Sheets) -> int:
        """Number of ray segments around a sheet: they end at surfaces, too."""
        return sheets.steps + 2 * len(self.post.transfer.iso)

    def _segment(
        self, around: np.ndarray, step: np.ndarray, limits: tuple[np.ndarray, np.ndarray], sheets: Sheets
    ) -> tuple[list[np.ndarray], np.ndarray | None]:
        """Ends [P], twice, of segments number `step` [P] of sheets, and the surfaces [P] at their ends, or −1; None
        without iso-surfaces. limits: of the ray around the sheets.
        """
        (low, high), steps = limits, sheets.steps
        if not self.post.transfer.iso:
            return [np.clip((step + end) / steps, low, high) for end in (0, 1)], None
        levels = self.post.surfaces[0]
        crossed = np.concatenate([spline_crossings(around[..., 1] - level * around[..., 0]) for level in levels])
        # a sheet has its end as far as the ray goes on
        crossed[(crossed < low) | (crossed >= np.where(high >= 1, 2.0, high))] = np.inf
        borders = np.clip((np.arange(steps)[:, None] + 1) / steps, low, high)
        ends = np.concatenate([crossed, borders])
        order = np.argsort(ends, axis=0, kind="stable")
        # zero-length segments behind the last border, in place of crossings that there are not
        ends = np.minimum(np.concatenate([low[None], np.take_along_axis(ends, order, axis=0)]), high)
        number, all_rows = order[step, np.arange(len(step))], np.arange(len(step))
        is_crossed = (number < len(crossed)) & np.isfinite(np.concatenate([crossed, borders])[number, all_rows])
        return [ends[step + n, all_rows] for n in (0, 1)], np.where(is_crossed, number // 2, -1)

    def center(self, sums: np.ndarray, rays: Rays, first: int, sheets: Sheets) -> np.ndarray:
        """[P, sheets, 6]: sums [P, sheets, 5] normalised to the mass of constant matter, with values moved along their
        gradients from the matter's mean place to the sheet's place; and the additional spread, sheets². Unchanged for
        blends of one value.
        """
        if self.appearance.shows_value:
            return np.concatenate([sums, np.zeros_like(sums[..., :1])], axis=-1)
        number = first + np.arange(sums.shape[1])
        offset = np.broadcast_to(ray_offset(self.view, rays), len(rays.near))
        along = number * sheets.thickness - offset[:, None]
        places = rays.start[..., None] + rays.direction[..., None] * along
        # near the first and last layer, gradients belong to faces
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
        # the additional spread also uses gradients of the sheets beside
        further *= share * np.clip(amid - 1, 0.0, 1.0)
        return np.concatenate([moved * even[..., None], further[..., None]], axis=-1)

    def _clip_to_mask(
        self, ends: list[np.ndarray], sheet: np.ndarray, some: np.ndarray, rays: Rays, sheets: Sheets
    ) -> list[np.ndarray]:
        """Clips parts of rays to the mask. ends: in sheets, counted from `sheet` [P]; some: pixels [P]."""
        if self.mask is None:
            return ends
        at = [self.mask.at(self._points((sheet + end) * sheets.thickness, some, rays)) for end in ends]
        return list(clip_to_mask((at[0], at[1]), (ends[0], ends[1])))

    def _points(self, distance: np.ndarray, some: np.ndarray, rays: Rays) -> np.ndarray:
        """Grid positions [3, P] of some rays at distances, index units, measured as for sheets."""
        offset = np.broadcast_to(ray_offset(self.view, rays), len(rays.near))[some]
        return np.asarray(rays.start[:, some] + rays.direction[:, some] * (distance - offset))

    def places(self, rays: Rays, distance: np.ndarray, sheets: Sheets) -> np.ndarray:
        """Converts distances [P] along rays, index units, to sheets."""
        return np.asarray((distance + ray_offset(self.view, rays)) / sheets.thickness)

    def matter(self, part: RaySegments, rays: Rays) -> np.ndarray:
        """[P, 4]: emission and optical depth of a part."""
        matter = self.classify(part)
        if self.appearance.shading or self.cues is not None:
            factor, highlight = self.shade_part(part, rays)
            matter[:, :3] = matter[:, :3] * factor[:, None] + matter[:, 3:] * highlight[:, None]
        return matter

    def surface_matter(self, part: RaySegments, rays: Rays) -> np.ndarray:
        """[P, 4]: emission and optical depth of the iso-surfaces at the ends of a part; 0 without one."""
        crossed = part.behind
        assert crossed is not None
        matter = self.post.surfaces[1][crossed.surface] * (crossed.surface >= 0)[:, None]
        at_end = replace(part, middle=crossed.distance)
        factor, highlight = self._surface(at_end, crossed.gradient * (self.appearance.iso == "lit"), rays)
        matter[:, :3] = matter[:, :3] * factor[:, None] + matter[:, 3:] * highlight[:, None]
        return matter

    def shade_part(self, part: RaySegments, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Factors of colours [P] and highlights [P] of a part, by its gradients, the mask's face, and the clip plane's
        face.
        """
        light = self._surface(part, part.gradient if self.appearance.shading else np.zeros((len(part.pixel), 3)), rays)
        if not self.appearance.shading:
            return light
        if self.mask is not None:
            face = self.mask.normals(self._points(part.middle, part.pixel, rays))
            share = self.mask.face_share(part.gradient, face, self.post.span)
            light = mix_light(light, self._surface(part, face, rays), share)
        if rays.face is not None:
            face = rays.face[part.pixel]
            light = mix_light(light, self._surface(part, face, rays), part.faced * face.any(axis=1))
        return light

    def _surface(self, part: RaySegments, normal: np.ndarray, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        toward, reached = rays.toward[part.pixel], None
        if self.cues is not None:
            reached = self.cues.light_shares(self._points(part.middle, part.pixel, rays).T, normal, toward)
        return surface_light(normal, toward, self.appearance.light, self.shines, reached)

    def classify(self, part: RaySegments) -> np.ndarray:
        """[P, 4]: colour times optical depth, and optical depth of a part."""
        length, scale = (part.ends[1] - part.ends[0]) * part.stretch, self.post.span / self.spacing
        size = np.linalg.norm(part.gradient, axis=1) * scale
        states = [
            np.stack([self.post.value(at[:, 0]), np.linalg.norm(at[:, 1:], axis=1) * scale])
            for at in (part.begin, part.end)
        ]
        matter = mean_classes(self.post.integral, self.post.transfer, states, size)
        return np.asarray(matter * (length * self.spacing / self.unit)[:, None])


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """Iso-surfaces at the ends of parts of rays. surface [P]: numbers, −1: none. gradient [P, 3]: there. distance [P]:
    theirs, index units, measured as for sheets.
    """

    surface: np.ndarray
    gradient: np.ndarray
    distance: np.ndarray


@dataclass(frozen=True, eq=False)
class RaySegments:
    """Parts of the matter around sheets, of pixels [P], of several sheets in their order. number [P]: of the part among
    all of its ray, from 0. ends: its start and end, in sheets, counted from `sheet` [P].

    begin, mean, end [P, 4]: values and gradients at its start, middle and end. stretch [P]: mean spacings per sheet.
    faced [P]: share within the face of a clip plane. middle [P]: distance of its middle, index units, measured as for
    sheets. behind: surfaces at its end; None without iso-surfaces.
    """

    pixel: np.ndarray
    number: np.ndarray
    sheet: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    begin: np.ndarray
    mean: np.ndarray
    end: np.ndarray
    stretch: np.ndarray
    faced: np.ndarray
    middle: np.ndarray
    behind: SurfaceHits | None = None

    @property
    def gradient(self) -> np.ndarray:
        """[P, 3]: gradient in the middle."""
        return self.mean[:, 1:]

    @property
    def value(self) -> np.ndarray:
        """[P]: value in the middle."""
        return self.mean[:, 0]


def between_sheets(around: np.ndarray, u: np.ndarray) -> np.ndarray:
    """[P, 5]: sums at places u [P], from 0 (half-way before a sheet) to 1 (half-way behind). around [3, P, 5]: sums
    half-way before, at the sheet, and half-way behind.
    """
    shares = np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2]) + EDGE
    return np.asarray((shares[..., None] * around).sum(axis=0))


def remove_bend(around: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Sums [3, P, 5] of sums `around` a sheet [3, P, 6], without the error of values that the additional spread causes
    where gradients change along rays. along [P, 3]: unit directions times mean spacings per sheet.
    """
    further = around[..., 5]
    before, behind_ = np.diff((around[..., 2:5] * along).sum(axis=-1), axis=0)
    ends = before * further[0], behind_ * further[2]
    middle = (further[0] + 2 * further[1] + further[2]) / 4 * (before + behind_) - sum(ends) / 2
    straight = around[..., :5].copy()
    straight[..., 1] -= np.stack([ends[0], middle, ends[1]])
    return straight


def means_of(sums: np.ndarray) -> np.ndarray:
    """Values and gradients [P, 4] of sums [P, 5]; 0 without mass."""
    return np.asarray(sums[:, 1:] / np.where(sums[:, :1] > 0, sums[:, :1], 1.0))


def bulge(number: np.ndarray, sheets: Sheets) -> np.ndarray:
    """Distance, in sheets, by which a ray passes constant matter of a spherical sheet before the sheet's place."""
    return np.asarray(sheets.variance / sheets.thickness**2 / np.maximum(number, 1))


Lit = tuple[np.ndarray, np.ndarray]


def mix_light(first: Lit, other: Lit, share: np.ndarray) -> Lit:
    """Mixes factors and highlights: `share` of the second."""
    factor, highlight = (a * (1 - share) + b * share for a, b in zip(first, other, strict=True))
    return factor, highlight


def ray_offset(view: GridView, rays: Rays) -> np.ndarray | float:
    """Offset from distances along rays to distances by which sheets are counted: in parallel views, these start at the
    plane through the eye across the rays, in index space.
    """
    if view.perspective:
        return 0.0
    return np.asarray(index_direction(view) @ (rays.start - view.eye_index[:, None]))


def weight_extinction(extinction: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Extinction whose opacity is `weight` times that of `extinction`, per reference length."""
    share = np.minimum(-np.expm1(-extinction) * weight, 1.0)
    with np.errstate(divide="ignore"):
        return np.where(weight < 1, -np.log1p(-share), extinction)


def mean_classes(
    integral: ClassIntegral, transfer: Transfer, states: Sequence[np.ndarray], size: np.ndarray | None = None
) -> np.ndarray:
    """Mean emission, if the integral has it, and extinction [P, n] per reference length of rays between states [1 or 2,
    P]: values, and magnitudes of gradients where opacity depends on them. size [P]: magnitude that weighs opacity, by
    default the mean of the ends'.
    """
    pieces = list(pairwise(states))
    matter = np.sum([integral.mean(first[0], last[0]) for first, last in pieces], axis=0) / len(pieces)
    if transfer.gradient:
        extinction, size = matter[:, -1], (states[0][1] + states[-1][1]) / 2 if size is None else size
        weighted = weight_extinction(extinction, transfer.weight(size))
        matter = matter * (weighted / np.where(extinction > 0, extinction, 1.0))[:, None]
        matter[:, -1] = weighted
    if transfer.regions:
        regions = np.sum([mean_matter(transfer.regions, *piece) for piece in pieces], axis=0) / len(pieces)
        matter = matter + regions[:, -matter.shape[1] :]
    return np.asarray(matter)


# segments of constant density along rays, nearest first: the world distances of their ends [P, N, 2] from the eye, or
# from its plane; and emission and optical depth [P, N, 4]
ConstantPieces = tuple[np.ndarray, np.ndarray]
# maximum number of floats in the sums of a band of pixels
MOST_SUMS = 2**24


class SheetScene:
    """Data shared by all pixels: positions, sheets, and the splats' terms in their sums."""

    def __init__(self, splats: Splats, resolved: Resolved) -> None:
        assert resolved.sheets is not None
        self.resolved, self.sheets, self.camera = resolved, resolved.sheets, resolved.camera
        view = self.view = replace(resolved.view, kernel=tabulate(resolved.kernel.name))
        voxel = view.voxels(splats.positions)
        self.spacing = splats.grid.mean_spacing
        self.row = FootprintRow.of(view, "row1", voxel, splats.grid)
        self.boxes: PixelBoxes = pixel_boxes(view, self.row.name, voxel, self.camera)
        place = self.sheets.places(view, splats.positions)
        self.base = self.sheets.base(place)
        self.weights = self.sheets.weights(place, self.base)
        self.first = int(self.base.min()) if len(splats) else 0
        self.many = int(self.base.max()) + self.sheets.count - self.first if len(splats) else 1
        self.field, self.near = None, NearField.of(splats, view, self.sheets)
        if self.near is not None:
            last = max(self.first + self.many, self.near.count)
            self.first = min(self.first, -1)
            self.many = last - self.first
        if splats.post is None:
            color = apply_light(splats.colors.astype(np.float64), splats, self.camera, voxel, resolved)
            depth = self.row.attenuate_depth(splats, resolved.appearance.attenuation)
            self.terms = depth[:, None] * np.concatenate([color, np.ones((len(splats), 1))], axis=1)
        else:
            self.field = SheetField.of(splats, resolved, view, self.near.count if self.near else 0)
            value = splats.records["value"].astype(np.float64)
            self.terms = np.column_stack([np.ones(len(splats)), value, splats.records["gradient"].astype(np.float64)])

    def band_height(self) -> int:
        """Rows of pixels whose sums fit into MOST_SUMS."""
        return max(MOST_SUMS // (max(self.many, 1) * self.terms.shape[1] * self.camera.size[0]), 1)

    def part(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> np.ndarray:
        """Wanted pixels of the picture, float64 [P, 4], or their light between distances [P], world units."""
        sums, rays = self._sums(wanted), self._rays(wanted, near, far)
        if self.field is None:
            return composite_sums(sums if near is None else sums * self._within(rays)[..., None])
        return self.field.composite(sums, rays, self.first, self.sheets)

    def _sums(self, wanted: Pixels) -> np.ndarray:
        """Sums [P, sheets, terms] of wanted pixels."""
        sums = np.zeros((self.terms.shape[1], len(wanted) * self.many))
        for pairs in pair_values(self.row, self.boxes, np.arange(len(self.base)), wanted, self.camera):
            self._add(sums, *pairs)
        by_sheet = sums.T.reshape(-1, self.many, len(sums))
        if self.near is not None:
            rays = self._rays(wanted, None, None)
            by_sheet[:, : -1 - self.first] = 0
            for sheet in range(-1, self.near.count):
                by_sheet[:, sheet - self.first] = near_sums(self.near, self.view.kernel, rays, sheet, self.sheets)
        return by_sheet

    def pieces(self, wanted: Pixels, near: np.ndarray | None = None, far: np.ndarray | None = None) -> ConstantPieces:
        """Ray segments of constant density along the rays of wanted pixels, or along their parts between distances
        [P].
        """
        sums, rays = self._sums(wanted), self._rays(wanted, near, far)
        if self.field is None:
            # a sheet's matter extends by half a sheet to both sides
            middle = self.first + np.arange(self.many)[None, :, None] + np.zeros((len(sums), 1, 1))
            sums = sums if near is None else sums * self._within(rays)[..., None]
            return self._depths(rays, middle + np.array([-0.5, 0.5])), sums
        all_pixels = np.ones(len(sums), bool)
        steps, both = self.field.segments(self.sheets), 1 + bool(self.field.post.transfer.iso)
        number = (self.many + 2) * steps
        # one piece for each part, empty where there is no value, and for the surface behind it
        ends = np.full((len(sums), number * both, 2), self.first - 1.5)
        matter = np.zeros((len(sums), number * both, 4))
        for part in self.field.parts(sums, rays, self.first, self.sheets, lambda: all_pixels):
            ends[part.pixel, part.number * both] = part.sheet[:, None] + np.stack(part.ends, axis=1)
            matter[part.pixel, part.number * both] = self.field.matter(part, rays)
            if part.behind is not None:
                at = part.behind.distance[:, None] / self.sheets.thickness + np.array([0.0, THIN])
                ends[part.pixel, part.number * both + 1] = at
                matter[part.pixel, part.number * both + 1] = self.field.surface_matter(part, rays)
        for n in range(1, number * both):
            # begins where the one before ends: a surface stays whole where the part behind it is thinner
            thickness = (ends[:, n, 1] - ends[:, n, 0]) * (n % both)
            ends[:, n, 0] = np.maximum(ends[:, n, 0], ends[:, n - 1, 1])
            ends[:, n, 1] = np.maximum(ends[:, n, 1], ends[:, n, 0] + thickness)
        return self._depths(rays, ends), matter

    def _rays(self, wanted: Pixels, near: np.ndarray | None, far: np.ndarray | None) -> Rays:
        """Rays of wanted pixels, clipped to distances if given; endless for splats classified before."""
        field = self.field
        bounds = Bounds() if field is None else Bounds.of_voxels(field.post.shape, self.resolved.clip)
        rays = Rays.of(self.view, self.camera, bounds, pixel_slopes(wanted.index, self.camera, self.view.pitch))
        return rays if near is None or far is None else rays.between(near / self.spacing, far / self.spacing)

    def _within(self, rays: Rays) -> np.ndarray:
        """Shares [P, sheets] of the matter around sheets that are within the limits of rays."""
        middle = self.first + np.arange(self.many)
        offset = ray_offset(self.view, rays)
        ends = [((end + offset) / self.sheets.thickness)[:, None] - middle for end in (rays.near, rays.far)]
        return np.asarray(np.clip(ends[1], -0.5, 0.5) - np.clip(ends[0], -0.5, 0.5))

    def _depths(self, rays: Rays, places: np.ndarray) -> np.ndarray:
        """Distances along rays, world units, of places [P, …], in sheets."""
        around = (slice(None), *[None] * (places.ndim - 1))
        offset = np.broadcast_to(ray_offset(self.view, rays), len(places))[around]
        return np.asarray((places * self.sheets.thickness - offset) * (rays.stretch * self.spacing)[around])

    def _add(self, sums: np.ndarray, splat: np.ndarray, pixel: np.ndarray, integral: Integral) -> None:
        value = integral.value if self.field is None else integral.value / integral.peak
        entry = pixel * self.many + self.base[splat] - self.first
        shares = [weight[splat] * value for weight in self.weights]
        for total, term in zip(sums, self.terms.T, strict=True):
            values = term[splat]
            for j, share in enumerate(shares):
                total += np.bincount(entry + j, share * values, len(total))


def near_sums(near: NearField, kernel: Kernel, rays: Rays, sheet: int, sheets: Sheets) -> np.ndarray:
    """[P, 5]: mass, and value and gradient weighted by mass, of a plane sheet near the eye."""
    places = rays.start + rays.direction * (sheet * sheets.thickness)
    sums = np.zeros((places.shape[1], 5))
    first = np.floor(places).astype(np.int64)
    around = near.around
    size = np.array(near.cells.shape[2::-1])[:, None]
    for step in np.ndindex(*(2 * around,) * 3):
        cell = first + np.array(step)[:, None] - around + 1
        x, y, z = np.clip(cell - near.low[:, None], 0, size - 1)
        cells = near.cells[z, y, x].astype(np.float64)
        apart = cell - places
        along = (apart * rays.direction).sum(axis=0)
        across = np.sqrt(np.maximum((apart**2).sum(axis=0) - along**2, 0.0))
        weight = kernel.footprint(across) * sheets.shares(along / sheets.thickness) * (cells[:, 3] < ABSENT)
        sums += weight[:, None] * np.column_stack([np.ones(len(cells)), cells[:, 3], cells[:, :3]])
    return np.asarray(sums / kernel.footprint(np.zeros(())))


def composite_sums(sums: np.ndarray) -> np.ndarray:
    """[P, 4]: sums [P, sheets, 4] of emission and optical depth, nearest first, mixed within each sheet."""
    depth = sums[..., 3]
    before = np.cumsum(depth, axis=1) - depth
    share = np.where(depth > 0, -np.expm1(-depth) / np.where(depth > 0, depth, 1.0), 1.0)
    color = (sums[..., :3] * (share * np.exp(-before))[..., None]).sum(axis=1)
    return np.concatenate([color, -np.expm1(-depth.sum(axis=1))[:, None]], axis=1)

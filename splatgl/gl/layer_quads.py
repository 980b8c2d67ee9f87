"""Draws overlapping layers without compute shaders: stores ray segments of each layer in slots of a texture, slab by
slab, and composites all layers of a slab.

A slab is a range of sheets of the first layer. Each layer goes on until its pieces fill the slab on every ray of a band
of the picture. Pieces of sheets, and boxes of voxels, have consecutive numbers along a ray; slots are reused in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple, Protocol

import moderngl
import numpy as np

from splatgl.geometry.grid import corners_of
from splatgl.gl.buffers import InstanceBuffer, free, texel_texture, uneven
from splatgl.gl.device import Device
from splatgl.gl.features import base_of, feature_uniforms
from splatgl.gl.layers import Drawn, LayerBatch, layer_uniforms, union
from splatgl.gl.program import cover, set_uniforms, use_blend
from splatgl.gl.quads import CORNERS, SheetGroup, SheetQuads, sort_by_number
from splatgl.gl.target import Portions, RenderTarget, settle
from splatgl.gl.tiles import bands_of
from splatgl.planning.culling import PixelWindow
from splatgl.planning.plan import Plan
from splatgl.splat.sheets import NearField, index_direction
from splatgl.splat.splats import Splats

# sheets of the first layer in a slab
SLAB = 8
# bytes of all slots together, and of a piece
POOL, PIECE = 2**28, 16
# texture unit of the slots
SLOTS_UNIT = 4
# components of directions that count as positive: UPRIGHT in layer_slots.glsl, and twice as much, where either may be
UPRIGHT, UNSURE = -1e-6, 2e-6
# by how many voxels a ray's voxel numbers may differ from those of its place: rounding of three coordinates
ROUNDING = 2.0
# a number beyond all others
END = 2**30
# at least as large as any number of a piece is negative
LEAST_NUMBER = 2**20


class Numbering(NamedTuple):
    """Numbers of a layer's pieces along the rays of a band [P], at places of the first layer: at + rate · place.

    margin: by how much the numbers of the pieces at a place may be less or more.
    """

    at: np.ndarray
    rate: np.ndarray
    margin: float

    def range(self, begin: float, end: float) -> tuple[int, int]:
        """Returns the first and last number of the pieces of all rays between two places."""
        first, last = self.at + self.rate * begin, self.at + self.rate * end
        return int(np.floor(first.min() - self.margin)), int(np.floor(last.max() + self.margin))


class Slots(NamedTuple):
    """The slots of a band. firsts, counts: of each layer. size: of a slot, texels. across: slots side by side."""

    firsts: list[int]
    counts: list[int]
    size: tuple[int, int]
    across: int

    def corner(self, layer: int, number: int) -> tuple[int, int]:
        """Returns the first texel of the slot of a layer's piece."""
        slot = self.firsts[layer] + number % self.counts[layer]
        return slot % self.across * self.size[0], slot // self.across * self.size[1]


class RayBand(NamedTuple):
    """Some rays [P] of a band of the picture's rows, by places in sheets of the first layer. places: of each layer, at
    + rate · place. voxels: of each layer offsets [P, 3] from the eye, index axes, at place 0, and steps to place 1.
    grid: rows and columns of the rays; is_whole: whether they are all rays, or all directions.
    """

    window: PixelWindow
    places: list[tuple[np.ndarray, np.ndarray]]
    voxels: list[tuple[np.ndarray, np.ndarray]]
    grid: tuple[int, int]
    is_whole: bool


class LayerPieces(Protocol):
    """Pieces of the matter of one layer. steps: of a sheet; 0: boxes. shift: as in layers_join.frag. uneven: whether
    the pieces of a sheet differ in length.
    """

    splats: Splats
    plan: Plan
    steps: int
    shift: float
    uneven: bool

    def extent(self) -> tuple[float, float]:
        """Returns the first and last place of the layer's matter, in its sheets."""

    def begin(self, band: RayBand, layer: int, portions: Portions) -> list[Numbering]:
        """Starts a band at the nearest piece; returns the numbering of each group of rays."""

    def advance(self, into: moderngl.Framebuffer, slots: Slots, begin: float, end: float) -> bool:
        """Keeps all pieces up to a place of the first layer; returns whether there are any. begin: of the slab."""


class SheetPieces:
    """Pieces of a layer in sheets. bind: binds the uniforms and tables of the layer."""

    def __init__(self, quads: SheetQuads, splats: Splats, plan: Plan, layers: LayerBatch) -> None:
        assert plan.resolved.sheets is not None
        self.quads, self.splats, self.plan, self.bind = quads, splats, plan, layers.bind
        self.steps, self.uneven = max(plan.program.appearance.steps, 1), bool(plan.program.appearance.iso)
        if splats.post is not None and self.uneven:
            # segments that end at surfaces, too, and a surface behind each
            self.steps = 2 * (self.steps + 2 * len(splats.post.transfer.iso))
        self.shift = 1.5 if plan.program.appearance.steps else 0.5
        near = NearField.of(splats, plan.view, plan.resolved.sheets)
        self.picture = quads.begin(splats, plan, near, layers.limits)
        self.groups = quads.fill(self.picture, splats)

    def extent(self) -> tuple[float, float]:
        """Returns the first and last place of the layer's matter, in its sheets."""
        sheets = [*self.groups, *self.picture.near]
        return min(sheets) - self.shift, max(sheets) + self.plan.program.appearance.sheets + 2.0

    def begin(self, band: RayBand, layer: int, portions: Portions) -> list[Numbering]:
        """Starts a band at the nearest sheet; returns the numbering of its parts."""
        self.window, self.layer = band.window, layer
        self.sheets = self.quads.sweep(self.picture, band.window, [self.groups], portions)
        # the next sheet, whose splats are added already; None before the first
        self.sheet: int | None = None
        self.part = band.window
        at, rate = band.places[layer]
        margin = self.steps if self.uneven else 0.5
        self.numbers = Numbering((at + self.shift) * self.steps, rate * self.steps, margin)
        return [self.numbers]

    def advance(self, into: moderngl.Framebuffer, slots: Slots, begin: float, end: float) -> bool:
        """Keeps the parts of all sheets up to a place of the first layer; returns whether there are any."""
        last = self.numbers.range(begin, end)[1] // self.steps
        if self.sheet is not None and self.sheet > last:
            return False
        self.bind(self.splats, self.plan)
        self.quads.bind(self.picture, self.window, (0, 0), piece=True)
        if self.sheet is None:
            self._next()
        first = self.sheet
        while self.sheet is not None and self.sheet <= last:
            for part in range(self.steps):
                x, y = slots.corner(self.layer, self.sheet * self.steps + part)
                set_uniforms(self.quads.closing, corner=(x, y), part_=part)
                into.viewport = x, y, self.window.width, self.window.height
                left, top, width, height = self.part.box
                into.scissor = x + left, y + top - self.window.y, width, height
                self.quads.close(into, self.sheet, None)
            self._next()
        return self.sheet != first

    def _next(self) -> None:
        """Goes on to the next complete sheet."""
        self.sheet, self.part = next(self.sheets, (END, self.window))


class BoxPieces:
    """Pieces of a layer of boxes: the numbers of a box's voxel, with the signs of a ray's direction, add up to its own.
    bind: binds the uniforms and tables of the layer.
    """

    steps, shift, uneven = 0, 0.0, False

    def __init__(self, device: Device, splats: Splats, plan: Plan, layers: LayerBatch) -> None:
        self.ctx, self.programs, self.splats, self.plan = device.ctx, device.programs, splats, plan
        self.bind, self.limits = layers.bind, layers.limits
        # by signs of directions: splats in the order of their numbers
        self.octants: dict[tuple[int, ...], tuple[InstanceBuffer, dict[int, SheetGroup]]] = {}

    def release(self) -> None:
        """Frees the buffers."""
        free(*(instances for instances, _ in self.octants.values()))

    def extent(self) -> tuple[float, float]:
        """Returns the first and last distance of the boxes, in voxels."""
        view, bounds = self.plan.view, self.splats.index_bounds + np.array([[-0.5], [0.5]])
        corners = corners_of(*bounds) - view.eye_index
        if not view.perspective:
            places = corners @ index_direction(view)
            return float(places.min()), float(places.max())
        nearest = np.linalg.norm(view.eye_index - np.clip(view.eye_index, *bounds))
        return float(nearest), float(np.linalg.norm(corners, axis=1).max())

    def begin(self, band: RayBand, layer: int, portions: Portions) -> list[Numbering]:
        """Starts a band at the nearest boxes; returns the numbering of each octant of directions."""
        self.window, self.layer, self.portions = band.window, layer, portions
        view = self.plan.view
        eye = view.eye_index - base_of(self.splats, view.eye_index)
        start, step = band.voxels[layer]
        start = start + eye
        units = step / np.linalg.norm(step, axis=1, keepdims=True)
        # an octant may begin between two rays: least numbers are those of rays around it, as numbers are quasi-concave
        rows = units.reshape(*band.grid, 3)
        apart = sum(float(np.abs(np.diff(rows, axis=axis)).max(initial=0.0)) for axis in (0, 1))
        around = UNSURE if band.is_whole else UNSURE + apart
        self.numbers = {}
        for signs in product((1, -1), repeat=3):
            rays = (units * np.array(signs) + np.array(signs) * -UPRIGHT > -around).all(axis=1)
            if rays.any():
                self.numbers[signs] = Numbering(start[rays] @ signs, step[rays] @ signs, ROUNDING)
        self.done = dict.fromkeys(self.numbers, -END)
        return list(self.numbers.values())

    def advance(self, into: moderngl.Framebuffer, slots: Slots, begin: float, end: float) -> bool:
        """Keeps all boxes up to a place of the first layer; returns whether there are any."""
        drawn, bound = False, None
        for signs, numbers in self.numbers.items():
            first, last = numbers.range(begin, end)
            instances, groups = self._sorted(signs)
            for number in range(max(first, self.done[signs] + 1), last + 1):
                if number not in groups:
                    continue
                bound = bound or self._bind()
                set_uniforms(bound, octant=signs)
                self._draw(into, bound, instances, groups[number], slots.corner(self.layer, number))
                drawn = True
            self.done[signs] = last
        return drawn

    def _draw(
        self,
        into: moderngl.Framebuffer,
        program: moderngl.Program,
        instances: InstanceBuffer,
        group: SheetGroup,
        slot: tuple[int, int],
    ) -> None:
        corner = slot[0], slot[1] - self.window.y
        into.viewport = *corner, *self.plan.view.size
        into.scissor = *slot, self.window.width, self.window.height
        into.use()
        self.ctx.enable_only(moderngl.NOTHING)
        set_uniforms(program, corner=corner)
        for begin, end in self.portions.over(group.begin, group.end):
            vertices = instances.vertices(program, begin)
            vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def _bind(self) -> moderngl.Program:
        self.bind(self.splats, self.plan)
        program = self.programs.for_splats(self.plan.program, {"SLOTTED": True, "LIMITED": self.limits is not None})
        set_uniforms(program, **feature_uniforms(self.splats, self.plan))
        if self.limits is not None:
            self.limits.use_in(program, self.splats.grid.mean_spacing)
        return program

    def _sorted(self, signs: tuple[int, ...]) -> tuple[InstanceBuffer, dict[int, SheetGroup]]:
        """Returns the splats in the order of their numbers for directions of these signs, and the groups by number."""
        if signs not in self.octants:
            view, positions = self.plan.view, self.splats.positions
            numbers = np.rint(positions - base_of(self.splats, view.eye_index)).astype(np.int64) @ signs
            indices, order = sort_by_number(numbers, positions)
            instances = InstanceBuffer(self.ctx)
            instances.fill(self.splats.records[indices])
            self.octants[signs] = instances, order.groups(view)
        return self.octants[signs]


class LayerQuads:
    """Draws several layers by quads; reuses its textures and buffers between pictures."""

    def __init__(self, device: Device) -> None:
        self.device, self.ctx, self.programs = device, device.ctx, device.programs
        # of each layer
        self.quads: list[SheetQuads] = []
        self.slots: moderngl.Framebuffer | None = None
        self.texture: moderngl.Texture | None = None

    def release(self) -> None:
        """Frees all textures and buffers; they are recreated on demand."""
        free(*self.quads)
        self.quads = []
        free(self.slots, self.texture)
        self.slots, self.texture = None, None

    def composite(self, target: RenderTarget, layers: LayerBatch) -> None:
        """Composites the layers into `target`, in bands whose slots fit into the pool."""
        layers = replace(layers, layers=[layer for layer in layers.layers if len(layer[0])])
        pieces = self._pieces(layers)
        try:
            window = union([plan.window for _, plan in layers.layers])
            width = target.size[0]
            rows = PixelWindow(0, window.y, width, window.height)
            slots = self._layout(pieces, self._begin(layers, pieces, rows), rows)
            height = POOL // (PIECE * width * (sum(slots.counts)))
            for band in bands_of(rows, width * max(height, 1)):
                self._band(target, layers, pieces, band)
        finally:
            target.framebuffer.scissor = None  # type: ignore[assignment]
            for layer in pieces:
                if isinstance(layer, BoxPieces):
                    layer.release()

    def _pieces(self, layers: LayerBatch) -> list[LayerPieces]:
        self.quads += [SheetQuads(self.device) for _ in layers.layers[len(self.quads) :]]
        return [
            BoxPieces(self.device, splats, plan, layers)
            if plan.resolved.boxes
            else SheetPieces(quads, splats, plan, layers)
            for quads, (splats, plan) in zip(self.quads, layers.layers, strict=False)
        ]

    def _begin(self, layers: LayerBatch, pieces: Sequence[LayerPieces], window: PixelWindow) -> Slabs:
        """Starts a band of the picture in all layers."""
        band = band_of(layers.layers, window)
        numberings = [layer.begin(band, n, layers.portions) for n, layer in enumerate(pieces)]
        ends = [layer.extent() for layer in pieces]
        places = [(np.array(end)[:, None] - at) / rate for end, (at, rate) in zip(ends, band.places, strict=True)]
        first, last = min(float(place.min()) for place in places), max(float(place.max()) for place in places)
        return Slabs(np.arange(first, last + SLAB, SLAB), numberings)

    def _layout(self, pieces: Sequence[LayerPieces], slabs: Slabs, band: PixelWindow) -> Slots:
        """Returns the slots of a band."""
        counts = []
        for layer, numberings in zip(pieces, slabs.numberings, strict=True):
            ranges = [n.range(*slab) for n in numberings for slab in zip(slabs.ends[:-1], slabs.ends[1:], strict=True)]
            count = max(last - first for first, last in ranges) + 1
            counts.append(-(-count // max(layer.steps, 1)) * max(layer.steps, 1) + layer.steps)
        size = band.width, band.height
        across = max(min(int(self.ctx.info["GL_MAX_TEXTURE_SIZE"]) // size[0], sum(counts)), 1)
        return Slots(np.cumsum([0, *counts[:-1]]).tolist(), counts, size, across)

    def _band(
        self, target: RenderTarget, layers: LayerBatch, pieces: Sequence[LayerPieces], window: PixelWindow
    ) -> None:
        """Composites all layers in a band of the picture."""
        slabs = self._begin(layers, pieces, window)
        slots = self._layout(pieces, slabs, window)
        into = self._emptied(slots)
        kept = False
        for begin, end in zip(slabs.ends[:-1].tolist(), slabs.ends[1:].tolist(), strict=True):
            layers.portions.ask()
            before, kept = kept, False
            for layer in pieces:
                kept |= layer.advance(into, slots, begin, end)
            # pieces of the slab before may reach into this one
            if kept or before:
                layers.bind(*layers.layers[0])
                self._join(target, layers.layers, pieces, slots, window, (begin, end))

    def _join(
        self,
        target: RenderTarget,
        layers: Sequence[Drawn],
        pieces: Sequence[LayerPieces],
        slots: Slots,
        window: PixelWindow,
        slab: tuple[float, float],
    ) -> None:
        """Composites the pieces of a slab behind the light of nearer slabs."""
        assert self.texture is not None
        program = self.programs.for_screen("layers_join.frag", layers[0][1].program, {"LAYERS": len(layers)})
        eyes = [plan.view.eye_index - base_of(splats, plan.view.eye_index) for splats, plan in layers]
        biases = [-(-LEAST_NUMBER // count) * count for count in slots.counts]
        steps = [layer.steps for layer in pieces]
        set_uniforms(
            program,
            pieces=SLOTS_UNIT,
            slot_size=(*slots.size, slots.across),
            band_top=window.y,
            slab=slab,
            box_eye=[*map(tuple, eyes)],
            slots=[*zip(slots.firsts, slots.counts, steps, biases, strict=True)],
            shift=[layer.shift for layer in pieces],
            uneven=[layer.uneven for layer in pieces],
            **layer_uniforms(layers),
        )
        self.texture.use(SLOTS_UNIT)
        target.framebuffer.use()
        target.framebuffer.scissor = window.box
        use_blend(self.ctx)
        cover(program)

    def _emptied(self, slots: Slots) -> moderngl.Framebuffer:
        """Returns the slots' texture, empty."""
        total = sum(slots.counts)
        size = slots.across * slots.size[0], -(-total // slots.across) * slots.size[1]
        if self.slots is None or self.slots.size[0] < size[0] or self.slots.size[1] < size[1]:
            old = self.slots, self.texture
            self.texture = texel_texture(self.ctx, (uneven(size[0]), uneven(size[1])), 4, "u4")
            self.slots = self.ctx.framebuffer([self.texture])
            free(*old)
        self.slots.scissor = None  # type: ignore[assignment]
        self.slots.viewport = 0, 0, *self.slots.size
        self.slots.use()
        self.ctx.enable_only(moderngl.NOTHING)
        cover(self.programs.for_screen("slots_clear.frag"))
        settle(self.ctx)
        return self.slots


class Slabs(NamedTuple):
    """ends: of the slabs of a band, in sheets of the first layer. numberings: of each layer's pieces."""

    ends: np.ndarray
    numberings: list[list[Numbering]]


# pixels between two rays whose numbers are computed, and the most between them per depth: by more, numbers bend
APART, MOST_APART = 8, 0.0125


def band_of(layers: Sequence[Drawn], window: PixelWindow) -> RayBand:
    """Returns the places of layers along some rays of a window, among them those at its corners."""
    view = layers[0][1].view
    x, y, width, height = window.box
    apart = int(np.clip(MOST_APART / view.pitch, 1, APART)) if view.perspective else APART
    columns = np.unique(np.append(np.arange(0, width, apart), width - 1)) + x + 0.5 - view.size[0] / 2
    rows = np.unique(np.append(np.arange(0, height, apart), height - 1)) + y + 0.5 - view.size[1] / 2
    right, down = (side.ravel() for side in np.meshgrid(columns * view.pitch, rows * view.pitch))
    flat, ahead = np.stack([right, down, 0 * right]), np.stack([0 * right, 0 * right, 0 * right + 1])
    places, voxels = [], []
    for splats, plan in layers:
        # from lengths in mean spacings of the first layer
        scaled = plan.view.index_from_eye * (layers[0][0].grid.mean_spacing / splats.grid.mean_spacing)
        start = (scaled @ (0 * flat if view.perspective else flat)).T
        step = (scaled @ (flat + ahead if view.perspective else ahead)).T
        sheets, direction = plan.resolved.sheets, index_direction(plan.view)
        thickness = sheets.thickness if sheets else 1.0
        first = float(sheets.range(splats, plan.view)[0]) if sheets else 0.0
        rate = np.linalg.norm(step, axis=1) if view.perspective else step @ direction
        places.append((start @ direction / thickness - first, rate / thickness))
        voxels.append((start, step))
    # from depths to places of the first layer
    at, rate = places[0]
    return RayBand(
        window,
        [(own - own_rate * at / rate, own_rate / rate) for own, own_rate in places],
        [(start - step * (at / rate)[:, None], step / rate[:, None]) for start, step in voxels],
        (len(rows), len(columns)),
        apart == 1 or not view.perspective,
    )

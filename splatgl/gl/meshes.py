"""Depth peeling of meshes in pictures of volumes: the nearest surface first, each with the volume in front of it.

Opaque surfaces end every ray. Of the transparent surfaces the nearest is drawn, then the nearest behind it, and so on;
matter between two surfaces is drawn separately and composited with them, so that the order is right wherever surfaces
and volumes lie.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import moderngl
import numpy as np

from splatgl.data.mesh import Mesh, Texture
from splatgl.errors import InputError
from splatgl.geometry.camera import Camera
from splatgl.gl.buffers import free, texel_texture
from splatgl.gl.device import Device
from splatgl.gl.program import cover, set_uniforms, use_blend
from splatgl.gl.target import RenderTarget, check_size, settle
from splatgl.transfer.colormaps import map_places, map_tables

# texture units of the nearest and farthest depths; volumes use the lower units
NEAREST_UNIT, FARTHEST_UNIT = 16, 17
LIMIT_UNITS = {"nearest_depth": NEAREST_UNIT, "farthest_depth": FARTHEST_UNIT}
# texture units of surface_over.frag
MATTER_UNIT, SURFACE_UNIT = 0, 1
# a depth behind everything, in mean spacings
NOWHERE = 1e9
# limit of overlapping transparent surfaces
MOST_PEELS = 64
# nearest depth that is rasterised, as a fraction of the farthest
NEAREST = 1e-5
# texture units of the colour maps of values, and of the texels of a texture
MAPS_UNIT, TEXELS_UNIT = 21, 22
# vertex format of a corner: place, normal, colour, value
CORNER = "3f 3f 4f 2f"


@dataclass(frozen=True, eq=False)
class DepthLimits:
    """Depths of each sample between which the volume is drawn: float textures, world units divided by `unit`."""

    nearest: moderngl.Texture
    farthest: moderngl.Texture
    unit: float

    def use(self) -> None:
        """Binds both textures."""
        self.nearest.use(NEAREST_UNIT)
        self.farthest.use(FARTHEST_UNIT)

    def use_in(self, program: moderngl.Program, spacing: float) -> None:
        """Binds both textures, and sets a program's uniforms. spacing: its unit of length."""
        set_uniforms(program, **LIMIT_UNITS, depth_unit=self.unit / spacing)
        self.use()


@dataclass(frozen=True, eq=False)
class PeelTarget:
    """Render target of surfaces: light and depths."""

    light: moderngl.Texture
    depth: moderngl.Texture
    framebuffer: moderngl.Framebuffer
    buffer: moderngl.Renderbuffer

    def release(self) -> None:
        """Frees the target."""
        free(self.framebuffer, self.light, self.depth, self.buffer)


@dataclass(frozen=True, eq=False)
class TriangleGroup:
    """Triangles of one draw call: all meshes without a texture, or one with it. row: of its colour map."""

    corners: moderngl.Buffer
    texture: Texture | None
    row: int


class Surfaces:
    """Peels surfaces; reuses its targets between pictures."""

    def __init__(self, device: Device) -> None:
        self.ctx, self.programs = device.ctx, device.programs
        self.targets: list[PeelTarget] = []
        self.size = (0, 0)
        # of the latest picture
        self.textures: dict[Texture, moderngl.Texture] = {}

    def release(self) -> None:
        """Frees the targets; they are recreated on demand."""
        free(*self.targets)
        self.targets = []
        self._keep_textures(())

    def peeled(
        self, meshes: Sequence[Mesh], camera: Camera, unit: float, lit: bool, plain: bool = True
    ) -> Iterator[tuple[DepthLimits, moderngl.Texture]]:
        """Yields depth intervals between surfaces, and the light of the surface behind each, nearest first.

        unit: world units per unit of the frame's lengths. lit: surfaces are shaded. Raises InputError for more than
        MOST_PEELS surfaces behind each other.
        """
        opaque = [mesh for mesh in meshes if mesh.opacity == 1]
        clear = [mesh for mesh in meshes if 0 < mesh.opacity < 1]
        maps = sum(mesh.has_map for mesh in opaque)
        corners = [corners_of(opaque, 0, camera, unit), corners_of(clear, maps, camera, unit)]
        depths = depth_range(np.concatenate([group["place"][:, 2] for group in corners]), camera.perspective)
        tables = map_tables([*opaque, *clear])
        mapped = texel_texture(self.ctx, tables.shape[1::-1], 3, "f4", tables.tobytes())
        groups = [self._groups(opaque, corners[0], 0), self._groups(clear, corners[1], maps)]
        end, before, now, ends = self._sized(camera.size)
        # a new size has freed them
        self._keep_textures([mesh.texture for mesh in (*opaque, *clear) if mesh.texture is not None])
        mapped.use(MAPS_UNIT)
        try:
            for target, depth in ((ends, NOWHERE), (before, -NOWHERE)):
                target.framebuffer.use()
                target.framebuffer.clear(red=depth)
                settle(self.ctx)
            self._draw(groups[0], end, before, ends, (camera.perspective, not plain), (depths, lit))
            for _ in range(MOST_PEELS):
                if not self._draw(groups[1], now, before, end, (camera.perspective, not plain), (depths, lit)):
                    break
                yield DepthLimits(before.depth, now.depth, unit), now.light
                before, now = now, before
            else:
                raise InputError(f"meshes: expected at most {MOST_PEELS} overlapping transparent surfaces, got more")
            yield DepthLimits(before.depth, end.depth, unit), end.light
        finally:
            free(mapped, *(group.corners for group in (*groups[0], *groups[1])))

    def composite(self, target: RenderTarget, matter: RenderTarget, surface: moderngl.Texture) -> None:
        """Blends a depth interval, and the surface behind it, behind the contents of the target."""
        program = self.programs.for_screen("surface_over.frag")
        set_uniforms(program, matter=MATTER_UNIT, surface=SURFACE_UNIT)
        matter.texture.use(MATTER_UNIT)
        surface.use(SURFACE_UNIT)
        target.framebuffer.use()
        use_blend(self.ctx)
        cover(program)
        settle(self.ctx)

    def _draw(
        self,
        groups: Sequence[TriangleGroup],
        into: PeelTarget,
        before: PeelTarget,
        end: PeelTarget,
        program: tuple[bool, bool],
        style: tuple[tuple[float, float], bool],
    ) -> bool:
        """Draws the nearest surfaces between the depths of `before` and `end`; returns whether there are any."""
        DepthLimits(before.depth, end.depth, 1.0).use()
        clear = self.programs.for_screen("surface_clear.frag")
        set_uniforms(clear, **LIMIT_UNITS)
        into.framebuffer.use()
        into.framebuffer.clear(depth=1.0)
        self.ctx.enable_only(moderngl.NOTHING)
        cover(clear)
        if not groups:
            settle(self.ctx)
            return False
        self.ctx.enable_only(moderngl.DEPTH_TEST)
        self.ctx.depth_func = "<"
        query = self.ctx.query(samples=True)
        with query:
            for group in groups:
                drawing = self.programs.for_meshes(*program, group.texture is not None)
                lit = style[1] and group.texture is None
                set_uniforms(drawing, **LIMIT_UNITS, depths=style[0], lit=lit, maps=MAPS_UNIT)
                if group.texture is not None:
                    self.textures[group.texture].use(TEXELS_UNIT)
                    mapped, smooth = group.texture.mapped, group.texture.smooth
                    set_uniforms(drawing, texels=TEXELS_UNIT, mapped=mapped, smooth_texels=smooth, map_row=group.row)
                inputs = [(group.corners, CORNER, "in_place", "in_normal", "in_color", "in_value")]
                vertices = self.ctx.vertex_array(drawing, inputs)
                vertices.render(moderngl.TRIANGLES)
                vertices.release()
        self.ctx.enable_only(moderngl.NOTHING)
        return bool(query.samples)

    def _groups(self, meshes: Sequence[Mesh], corners: np.ndarray, maps: int) -> list[TriangleGroup]:
        """Buffers of the corners of meshes, which are in their order. maps: number of the first colour map."""
        plain, textured, first = [corners[:0]], list[TriangleGroup](), 0
        for mesh in meshes:
            part = corners[first : first + 3 * len(mesh)]
            if mesh.texture is None:
                plain.append(part)
            elif len(part):
                textured.append(TriangleGroup(self.ctx.buffer(part.tobytes()), mesh.texture, maps))
            maps += mesh.has_map
            first += 3 * len(mesh)
        others = np.concatenate(plain)
        return [*([TriangleGroup(self.ctx.buffer(others.tobytes()), None, 0)] if len(others) else []), *textured]

    def _keep_textures(self, textures: Sequence[Texture]) -> None:
        """Uploads textures, and frees all others."""
        for texture in [other for other in self.textures if other not in textures]:
            self.textures.pop(texture).release()
        for texture in textures:
            if texture not in self.textures:
                (height, width), channels = texture.texels.shape[:2], 1 if texture.mapped else 4
                check_size(self.ctx, (width, height))
                texels = texture.texels.tobytes()
                self.textures[texture] = texel_texture(self.ctx, (width, height), channels, "f4", texels)

    def _sized(self, size: tuple[int, int]) -> list[PeelTarget]:
        """Returns four targets of `size`, recreated when the size changes."""
        if self.size != size or not self.targets:
            check_size(self.ctx, size)
            self.release()
            self.targets, self.size = [self._peel(size) for _ in range(4)], size
        return self.targets

    def _peel(self, size: tuple[int, int]) -> PeelTarget:
        light, depth = (texel_texture(self.ctx, size, components, "f4") for components in (4, 1))
        buffer = self.ctx.depth_renderbuffer(size)
        return PeelTarget(light, depth, self.ctx.framebuffer([light, depth], buffer), buffer)


def corners_of(meshes: Sequence[Mesh], maps: int, camera: Camera, unit: float) -> np.ndarray:
    """Returns the corners of all triangles [3 M]: places in eye space divided by `unit`, normals in eye axes, colours
    and opacities, places of values in colour maps and the numbers of the maps, counted from `maps`; −1 for no map. Of
    a mesh with a texture, columns and rows of texels instead.
    """
    count = sum(3 * len(mesh) for mesh in meshes)
    corners = np.zeros(count, [("place", "<f4", 3), ("normal", "<f4", 3), ("color", "<f4", 4), ("value", "<f4", 2)])
    first = 0
    for mesh in meshes:
        part = corners[first : first + 3 * len(mesh)]
        places = camera.eye_from_points(mesh.vertices) / unit
        part["place"] = places[mesh.faces].reshape(-1, 3)
        part["normal"] = mesh.normals.reshape(-1, 3) @ camera.eye_from_world.T
        part["color"][:, :3], part["color"][:, 3] = mesh.shades.reshape(-1, 3), mesh.opacity
        part["value"][:, 1] = maps if mesh.mapped else -1.0
        if mesh.mapped:
            part["value"][:, 0] = map_places(mesh)[mesh.faces].ravel()
        elif mesh.texture is not None:
            turn = mesh.texture.texel_from_world
            part["value"] = (mesh.vertices @ turn[:, :3].T + turn[:, 3])[mesh.faces].reshape(-1, 2)
        maps += mesh.has_map
        first += 3 * len(mesh)
    return corners


def depth_range(depth: np.ndarray, perspective: bool) -> tuple[float, float]:
    """Returns the range of the depth buffer, slightly beyond the depths of all corners [N] in front of the eye."""
    far = float(depth.max(initial=0.0))
    if far <= 0:
        return NEAREST, 1.0
    near = max(float(depth.min()), NEAREST * far if perspective else 0.0)
    return near * 0.999, far * 1.001 + 1e-30

"""OpenGL objects of a context, shared by all techniques."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl

from splatgl.gl.buffers import SplatBuffers, free
from splatgl.gl.card_lists import CardLists
from splatgl.gl.features import FRAME, STYLE, FieldTextures
from splatgl.gl.program import Programs
from splatgl.gl.shader import ComputeShape
from splatgl.gl.target import Targets
from splatgl.gl.textures import NearSheets, TableTextures

# OpenGL version with compute shaders
COMPUTE = 430


def has_compute(ctx: moderngl.Context) -> bool:
    """Whether a context has compute shaders."""
    return ctx.version_code >= COMPUTE


class Device:
    """Programs, targets, tables, fields, splats and near sheets of a context, and its uniform blocks `frame` and
    `style`; shape: of shaders of tiles. compute: whether there are compute shaders. card: lists tiles by these on a
    graphics card; None: of processors.
    """

    def __init__(self, ctx: moderngl.Context, owned: ExitStack, shape: ComputeShape) -> None:
        self.ctx, self.compute = ctx, has_compute(ctx)
        self.programs = Programs(ctx, owned, shape)
        self.targets = Targets(ctx, owned)
        self.tables = TableTextures(ctx, owned)
        self.fields = FieldTextures(ctx, owned)
        self.splats = SplatBuffers(ctx, owned)
        self.near = NearSheets(ctx, self.programs, self.tables, owned)
        self.card = CardLists(ctx) if shape.name == "card" and self.compute else None
        self.frame, self.style = ctx.buffer(reserve=FRAME.itemsize), ctx.buffer(reserve=STYLE.itemsize)
        for block in (self.frame, self.style):
            owned.callback(block.release)

    def release(self) -> None:
        """Frees the targets, the buffers of splats, and the textures of fields; they are recreated on demand."""
        free(self.targets, self.splats, self.fields, self.near, self.card)

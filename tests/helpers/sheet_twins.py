"""Uniforms of sheets, for their twins."""

from __future__ import annotations

import splatgl as sg
from splatgl.gl.sheet_tiles import sheet_uniforms
from splatgl.planning.plan import Plan

RAMP = sg.Transfer([(0, 0), (1, 0.9)], colormap="hot", shading=True)


def uniforms(splats: sg.Splats, plan: Plan) -> dict[str, object]:
    return sheet_uniforms(splats, plan)

"""The paper's technique: every splat is an instance of a textured quad, blended in drawing order.  [M98 §5]"""

from __future__ import annotations

import moderngl

from splatgl.gl.boxes import box_uniforms
from splatgl.gl.buffers import Sorted, SplatBuffers
from splatgl.gl.draw_order import DrawOrder, Range, chunks
from splatgl.gl.portions import Portions
from splatgl.gl.program import BLEND_STATES, Programs
from splatgl.gl.tables import BLUR_UNIT, HALF_LINE_UNIT
from splatgl.gl.target import Target
from splatgl.gl.tiles import set_uniforms
from splatgl.splat.plan import Plan
from splatgl.splat.splats import Splats

CORNERS = 4


class Quads:
    """The instanced-quad technique: needs only OpenGL 3.3 and supports every plan."""

    def __init__(self, ctx: moderngl.Context, programs: Programs, splats: SplatBuffers) -> None:
        self.ctx, self.programs, self.splats = ctx, programs, splats

    def draw(self, target: Target, splats: Splats, plan: Plan, order: DrawOrder, portions: Portions) -> None:
        """Blends the splats into `target` in drawing order, chunk by chunk; raises Interrupted if cancelled."""
        program = self.programs.for_splats(plan.program)
        for name, unit in (("half_table", HALF_LINE_UNIT), ("blur_table", BLUR_UNIT)):
            if name in program:
                program[name] = unit
        if plan.resolved.boxes:
            set_uniforms(program, **box_uniforms(splats, plan))
        blend = BLEND_STATES[plan.program.look.blend.join, order.nearest_first]
        self.ctx.blend_equation = blend.equation  # type: ignore[assignment]
        self.ctx.blend_func = blend.source, blend.destination
        target.framebuffer.use()
        self.ctx.enable_only(moderngl.BLEND)
        for chunk in chunks((0, len(splats))):
            quads = self._instances(splats, plan, order, chunk)
            for begin, end in portions.over(*chunk):
                vertices = quads.vertices(program, begin - chunk[0])
                vertices.render(moderngl.TRIANGLE_STRIP, vertices=CORNERS, instances=end - begin)

    def release(self) -> None:
        """No effect: it owns no GL objects."""

    def _instances(self, splats: Splats, plan: Plan, order: DrawOrder, which: Range) -> Sorted:
        """Splats `which` of the drawing order."""
        return self.splats.of(splats).quads(plan.program.runs, order, which)

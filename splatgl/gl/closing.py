"""Pixels that next to nothing passes any more: closed by depth, and told to the splats that lie behind them."""

from __future__ import annotations

from collections.abc import Callable

import moderngl

from splatgl.gl.program import Programs
from splatgl.gl.target import Target, Targets
from splatgl.splat.occlusion import TILE
from splatgl.splat.plan import Plan

# texture units: of what is looked at while pixels are closed, and of the map of hidden tiles
LOOKING_UNIT, HIDDEN_UNIT = 2, 4


class Closing:
    """Closes pixels of a target, and keeps a map of them: a texel for TILE² pixels, 1 where those and all around,
    as far as a sprite reaches, are closed.

    whole: draws one triangle over the framebuffer in use.
    """

    def __init__(
        self, ctx: moderngl.Context, programs: Programs, targets: Targets, whole: Callable[[moderngl.Program], None]
    ) -> None:
        self.ctx, self.programs, self.targets, self.whole = ctx, programs, targets, whole

    def begin(self, target: Target) -> None:
        """Nothing is closed yet."""
        hidden = self._map("hidden", target)
        hidden.framebuffer.clear()
        hidden.texture.use(location=HIDDEN_UNIT)
        self.ctx.finish()

    def close(self, target: Target, plan: Plan) -> None:
        """Writes the nearest depth where less than `plan.passing` of the light passes, and draws the map anew."""
        program = self.programs.for_screen("opaque.frag")
        program["drawn"], program["opaque"] = LOOKING_UNIT, 1.0 - plan.passing
        target.texture.use(location=LOOKING_UNIT)
        with target.depth_alone(plan.window):
            self.ctx.enable_only(moderngl.DEPTH_TEST)
            self.ctx.depth_func = "1"
            self.whole(program)
            self.ctx.depth_func = "<="
        if plan.program.hiding:
            self._hide(target, plan)

    def _hide(self, target: Target, plan: Plan) -> None:
        """Tiles of which every pixel is closed, then those with such tiles all around."""
        self.ctx.enable_only(moderngl.NOTHING)
        closed, hidden = self._map("closed", target), self._map("hidden", target)
        program = self.programs.for_screen("tile.frag")
        program["drawn"], program["opaque"], program["tile"] = LOOKING_UNIT, 1.0 - plan.passing, TILE
        self._draw(program, hidden)
        program = self.programs.for_screen("around.frag")
        program["tiles"], program["reach"] = LOOKING_UNIT, plan.around
        for source, result, axis in ((hidden, closed, (1, 0)), (closed, hidden, (0, 1))):
            source.texture.use(location=LOOKING_UNIT)
            program["axis"] = axis
            self._draw(program, result)
        # llvmpipe's vertex shaders read a texture at once, be it drawn yet or not
        self.ctx.finish()

    def _draw(self, program: moderngl.Program, result: Target) -> None:
        result.framebuffer.use()
        self.whole(program)

    def _map(self, role: str, target: Target) -> Target:
        width, height = target.texture.size
        return self.targets.get(role, (-(-width // TILE), -(-height // TILE)), "rgba8")

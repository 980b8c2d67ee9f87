"""What light reaches matter, as textures and a uniform block: see `shaders/cues.glsl`."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl
import numpy as np

from splatgl.splat.ambient_occlusion import Cues, Fields
from splatgl.splat.view import View

CUES_BINDING = 2
# names of samplers, and their texture units
SAMPLERS = {"sky_field": 18, "shade_field": 19}
CUES = np.dtype(
    {
        "names": ["cell_from_index", "cell_from_normal", "cell_of_eye", "strength"],
        "formats": [("<f4", (3, 4)), ("<f4", (3, 4)), "<4f4", "<4f4"],
        "offsets": [0, 48, 96, 112],
        "itemsize": 128,
    }
)


class CueFields:
    """Textures of the latest fields; made on the first use, written anew for others."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.block: moderngl.Buffer | None = None
        self.textures: dict[str, moderngl.Texture3D] = {}
        self.fields: Fields | None = None
        owned.callback(self.release)

    def use(self, cues: Cues, view: View) -> None:
        """Binds what a picture's shaders read."""
        fields = cues.fields
        if self.fields is not fields:
            self._release_textures()
            for name, field in (("sky_field", fields.sky), ("shade_field", fields.shade)):
                if field is not None:
                    depth, height, width, *channels = field.shape
                    size, count = (width, height, depth), channels[0] if channels else 1
                    texture = self.ctx.texture3d(size, count, field.tobytes(), alignment=4, dtype="f4")
                    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
                    self.textures[name] = texture
            self.fields = fields
        for name, texture in self.textures.items():
            texture.use(SAMPLERS[name])
        if self.block is None:
            self.block = self.ctx.buffer(reserve=CUES.itemsize)
        self.block.write(cues_block(cues, view).tobytes())
        self.block.bind_to_uniform_block(CUES_BINDING)

    def release(self) -> None:
        """Frees the textures and the block; they are made again on demand."""
        self._release_textures()
        if self.block is not None:
            self.block.release()
        self.block = None

    def _release_textures(self) -> None:
        for texture in self.textures.values():
            texture.release()
        self.textures, self.fields = {}, None


def cues_block(cues: Cues, view: View) -> np.ndarray:
    """CUES, shape ()."""
    block = np.zeros((), CUES)
    turn, moved = cues.cell_from_index
    block["cell_from_index"][:, :3] = turn.T
    block["cell_from_normal"][:, :3] = cues.cell_from_normal.T
    block["cell_of_eye"][:3] = turn @ view.eye_index + moved
    block["strength"][:2] = cues.occlusion, cues.shadows
    return block

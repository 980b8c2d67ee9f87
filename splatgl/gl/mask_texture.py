"""The mask of the latest splats, or the normals of their labels, as a texture that shaders read along rays."""

from __future__ import annotations

from contextlib import ExitStack

import moderngl

from splatgl.errors import expected
from splatgl.splat.label_normals import LabelNormals
from splatgl.splat.mask_field import MaskField

# name of the sampler, and its texture unit
MASK_SAMPLER, MASK_UNIT = "mask_field", 20


class MaskTexture:
    """Made on the first use, and anew for another mask, or with its faces."""

    def __init__(self, ctx: moderngl.Context, owned: ExitStack) -> None:
        self.ctx = ctx
        self.texture: moderngl.Texture3D | None = None
        self.holds: tuple[MaskField | LabelNormals, bool] | None = None
        owned.callback(self.release)

    def use(self, mask: MaskField | LabelNormals, faced: bool) -> None:
        """Binds it. faced: whether shaders read its gradients, too, as of labels. Raises InputError beyond OpenGL's
        size.
        """
        if self.holds is None or self.holds[0] is not mask or (faced and not self.holds[1]):
            self.release()
            data = mask.faced if faced or isinstance(mask, LabelNormals) else mask.kept
            depth, height, width = data.shape[:3]
            most = self.ctx.info["GL_MAX_3D_TEXTURE_SIZE"]
            if max(depth, height, width) > most:
                raise expected("mask", f"a box of at most {most} voxels a side around it", max(depth, height, width))
            self.texture = self.ctx.texture3d(
                (width, height, depth), 4 if data.ndim == 4 else 1, data.tobytes(), alignment=1
            )
            self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            self.holds = mask, faced
        assert self.texture is not None
        self.texture.use(MASK_UNIT)

    def release(self) -> None:
        """Frees the texture; it is made again on demand."""
        if self.texture is not None:
            self.texture.release()
        self.texture, self.holds = None, None

"""What the frames of an animation have in common, wherever they are drawn, and drawing one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from splatgl.annotations.annotate import annotated, on_ground
from splatgl.annotations.canvas import Subject
from splatgl.app.frames import Frames
from splatgl.data.image import Image
from splatgl.scene.draw import at_time, is_layered, layered, origin, unbacked
from splatgl.scene.scene_file import Scene
from splatgl.splat.bricks import Bricks, required_bricks
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Motion, flow_of
from splatgl.splat.scene import Scene as Layers
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.gl.renderer import Renderer

# room above the brightest of some X-rays
HEADROOM = 1.05

# splats, a volume in bricks, or layers, and velocities under flow
Matter = tuple[Splats | Bricks | Layers, np.ndarray | None]


@dataclass(frozen=True, eq=False)
class FrameView:
    """A frame's number, that of its volume, its camera, and the motion since the frame before."""

    frame: int
    volume: int
    camera: Camera
    motion: Motion


@dataclass(frozen=True, eq=False)
class Over:
    """What is laid over each frame: annotations, what they need to know, and seconds between two time points."""

    names: tuple[str, ...]
    subject: Subject
    step: float | None


@dataclass(frozen=True, eq=False)
class Work:
    """scenes: one per volume. settings: with the moments of all frames. flow: displacement along the volume's vectors
    per frame. top: common scale of X-ray frames. bands: of rows, in which a volume is drawn in bricks; 0: whole. It
    holds no splats: they are extracted where they are drawn. over: annotations.
    """

    scenes: list[Scene]
    transfer: Transfer
    settings: Settings
    frames: Frames
    flow: float | None
    bits: int
    top: float | None = None
    bands: int = 0
    over: Over | None = None

    def matter(self, number: int) -> Matter:
        """The splats of one volume, and their velocities."""
        scene = self.scenes[number]
        volume = scene.open()
        if self.bands:
            return required_bricks(volume, self.transfer, self.settings), None
        if is_layered(scene, volume):
            return layered(scene, volume, self.transfer), None
        splats = scene.splats(volume, self.transfer, moving=scene.settings.shutter > 0)
        return splats, None if self.flow is None else flow_of(splats, volume, self.flow)

    def frame(self, renderer: Renderer, matter: Matter, view: FrameView) -> bytes:
        """A frame's file, with motion blur as the settings say."""
        subject, flow = matter
        settings = unbacked(self.settings, self.over.names if self.over else ())
        if isinstance(subject, Bricks):
            from splatgl.gl.large_volumes import moving_bricks

            image = moving_bricks(renderer, subject, view.camera, settings, view.motion, self.bands)
        else:
            motion = view.motion if flow is None else replace(view.motion, flow=flow)
            image = renderer.render(subject, view.camera, _settings(subject, settings), motion)
        if self.top is not None and self.frames.path(view.frame).suffix.lower() == ".png":
            image = scaled(image, self.top)
        scene = self.scenes[view.volume]
        image = Image(image.pixels, {**image.info, **origin(scene, self.transfer)})
        if self.over is not None:
            names = at_time(self.over.names, scene, view.volume, self.over.step)
            backdrop = self.settings.background
            image = annotated(image, self.over.subject, self.transfer, view.camera, names, backdrop, steady=True)
            image = on_ground(image, backdrop)
        ground = self.settings.background if BLENDS[self.settings.blend].unbounded else None
        return self.frames.encoded(view.frame, image, self.bits, ground)

    def brightest(
        self, renderer: Renderer, probes: Sequence[tuple[int, Camera]], read: Callable[[int], Matter]
    ) -> float:
        """Common scale of all X-ray frames, from still pictures of those volumes, which `read` gives, and cameras."""
        top, still, latest = 0.0, self.scenes[0].settings, -1
        for number, camera in probes:
            if number != latest:
                (subject, _), latest = read(number), number
            if isinstance(subject, Bricks):
                image = renderer.render_bricks(subject, camera, still, bands=self.bands)
            else:
                image = renderer.render(subject, camera, _settings(subject, still))
            top = max(top, float(image.pixels.max()))
        return top * HEADROOM or 1.0


def _settings(subject: Splats | Layers, settings: Settings) -> Settings:
    """The settings of a picture: layers have their planes themselves."""
    return settings.but(clip=()) if isinstance(subject, Layers) else settings


def scaled(image: Image, top: float) -> Image:
    """An X-ray scaled for display, so that saving does not normalize it by its own maximum."""
    info = {**image.info, "blend": "xray over scale", "scale": 1 / top}
    if isinstance(error := info.get("error_bound"), float):
        info["error_bound"] = error / top
    return Image(image.pixels / np.float32(top), info)

"""What draws the pictures that are measured: truth is given it, and imports no OpenGL.

`gl.renderer.Renderer` fits both protocols of a renderer.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Protocol

from splatgl.data.image import Image
from splatgl.splat.extraction.splats import Splats
from splatgl.splat.motion.motion import Motion
from splatgl.splat.plan.settings import Settings
from splatgl.splat.view.camera import Camera


class Renderer(Protocol):
    """Draws pictures, [H, W, 4], linear premultiplied, row 0 on top."""

    def render(
        self,
        splats: Splats,
        camera: Camera,
        settings: Settings | None = None,
        motion: Motion | None = None,
        verify_bound: bool = True,
    ) -> Image:
        """One picture; `info` tells what was drawn and how, `error_bound` included.

        verify_bound: whether a picture whose bound exceeds the tolerance is measured against a finer one.
        Raises InputError for what can't be drawn.
        """


class Program(Protocol):
    """What a plan compiles."""

    @property
    def technique(self) -> str:
        """Either quads or tiles."""


class Plan(Protocol):
    """What a renderer decided for a picture."""

    @property
    def program(self) -> Program:
        """What it compiles."""

    @property
    def key(self) -> Hashable:
        """Plans of the same splats and camera draw the same picture if their keys are equal."""


class Planner(Renderer, Protocol):
    """A renderer that tells ahead what it will do."""

    def plan(self, splats: Splats, camera: Camera, settings: Settings | None = None) -> Plan:
        """What `render` would do with the same arguments. Raises InputError as `render`."""

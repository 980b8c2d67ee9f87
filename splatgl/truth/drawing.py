"""Renderer protocols for the truth package, which imports no OpenGL.

`gl.renderer.Renderer` implements both renderer protocols.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Protocol

from splatgl.data.image import Image
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Motion
from splatgl.splat.settings import Settings
from splatgl.splat.splats import Splats


class Renderer(Protocol):
    """Renders images, [H, W, 4], linear premultiplied, row 0 at the top."""

    def render(
        self,
        splats: Splats,
        camera: Camera,
        settings: Settings | None = None,
        motion: Motion | None = None,
        verify_bound: bool = True,
    ) -> Image:
        """Renders an image; `info` describes the rendering, including `error_bound`.

        verify_bound: whether to measure the error against a finer image if the bound exceeds the tolerance.
        Raises InputError for input that cannot be rendered.
        """


class Program(Protocol):
    """The shader program of a plan."""

    @property
    def technique(self) -> str:
        """Either quads or tiles."""


class Plan(Protocol):
    """A renderer's decisions for an image."""

    @property
    def program(self) -> Program:
        """The program it compiles."""

    @property
    def key(self) -> Hashable:
        """Plans with equal keys give the same image for the same splats and camera."""


class Planner(Renderer, Protocol):
    """A renderer that exposes its plan."""

    def plan(self, splats: Splats, camera: Camera, settings: Settings | None = None) -> Plan:
        """The plan of `render` for the same arguments. Raises InputError as `render`."""

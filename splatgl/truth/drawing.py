"""What draws the pictures that are measured: truth is given it, and imports no OpenGL.

`gl.renderer.Renderer` fits both protocols of a renderer.
"""

from __future__ import annotations

from dataclasses import Field
from typing import Any, ClassVar, Protocol

from splatgl.data.image import Image
from splatgl.splat.camera import Camera
from splatgl.splat.motion import Motion
from splatgl.splat.rows import Splats
from splatgl.splat.settings import Settings


class Renderer(Protocol):
    """Draws pictures, [H, W, 4], linear premultiplied, row 0 on top."""

    def render(
        self,
        splats: Splats,
        camera: Camera,
        settings: Settings | None = None,
        motion: Motion | None = None,
        held: bool = True,
    ) -> Image:
        """One picture; `info` tells what was drawn and how, `error_bound` included.

        held: whether a picture that promises less than the tolerance is measured against a finer one.
        Raises InputError for what can't be drawn.
        """


class Program(Protocol):
    """What a plan compiles."""

    @property
    def primitive(self) -> str:
        """quad, sprite or tile."""

    @property
    def antialias(self) -> bool:
        """Whether any splat is widened."""


class Plan(Protocol):
    """What a renderer decided for a picture: a frozen dataclass; equal plans draw equal pictures."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def program(self) -> Program:
        """What it compiles."""

    @property
    def parts(self) -> int:
        """In how many parts the picture is drawn."""


class Planner(Renderer, Protocol):
    """A renderer that tells ahead what it will do."""

    def plan(self, splats: Splats, camera: Camera, settings: Settings | None = None) -> Plan:
        """What `render` would do with the same arguments. Raises InputError as `render`."""

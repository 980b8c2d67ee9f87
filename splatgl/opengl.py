"""The choice of OpenGL, which commands, renderers and workers pass on."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.errors import expected
from splatgl.platforms import BACKENDS


@dataclass(frozen=True)
class OpenGL:
    """Backend and device of an OpenGL context.

    backend: egl, osmesa or window, on Windows wgl or window, on macOS cgl or window; auto takes the first of these that
    opens. device: the EGL device, counted from 0, which restricts the backend to egl; None takes the first graphics
    card, else the first device that opens. gpu: whether software renderers are refused; None: as the environment
    variable SPLATGL_REQUIRE_GPU says. Raises InputError for others.
    """

    backend: str = "auto"
    device: int | None = None
    gpu: bool | None = None

    def __post_init__(self) -> None:
        if self.backend != "auto" and self.backend not in BACKENDS:
            raise expected("backend", " | ".join(("auto", *BACKENDS)), self.backend)
        if self.device is not None and self.device < 0:
            raise expected("device", "an EGL device number from 0", self.device)
        if self.device is not None and not self.may_be_egl:
            fix = "leave it out or use the backend egl" if "egl" in BACKENDS else "leave it out"
            raise expected("device", "none, since only egl chooses one", self.device, fix)

    @property
    def may_be_egl(self) -> bool:
        """Whether the backend is egl, or auto where egl comes first."""
        return self.backend in ("auto", "egl") and "egl" in BACKENDS

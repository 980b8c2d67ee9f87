"""`View`: the widget of a notebook around a `Session`. Needs the extra `notebook`."""

from __future__ import annotations

import asyncio
from base64 import b64encode
from contextlib import suppress
from typing import Any

import numpy as np
from jupyter_rfb import RemoteFrameBuffer

from splatgl.app.notebook import Session


class View(RemoteFrameBuffer):  # type: ignore[misc]
    """Left drag rotates, shift or middle drag pans, the wheel and right drag zoom, a double click resets.

    While it moves, frames are reduced; once it is still, the full picture is drawn. A saved notebook keeps the first
    picture. `image` is the last one.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        width, height = session.pose.camera.size
        super().__init__(css_width=f"{width}px", css_height=f"{height}px")

    @property
    def image(self) -> Any:
        """The picture on show, an Image."""
        return self.session.image

    def handle_event(self, event: dict[str, Any]) -> None:
        """Turns an event into a view."""
        if self.session.handle(event):
            self.request_draw()

    def get_frame(self) -> np.ndarray | None:
        """The frame that is due, and a later call for the one that follows."""
        found = self.session.frame()
        wait = self.session.patience()
        if wait is not None:
            # without a loop, as in a script, whoever asks for frames asks again
            with suppress(RuntimeError):
                asyncio.get_running_loop().call_later(wait, self.request_draw)
        return found

    def _repr_mimebundle_(self, **options: Any) -> Any:
        """The widget, and a picture for where no widget is shown."""
        if not self.session.image.info:
            self.session.frame()
            # the widget asks for its own
            self.session.refiner.drawn = ()
        bundle = super()._repr_mimebundle_(**options)
        data = bundle[0] if isinstance(bundle, tuple) else bundle
        if isinstance(data, dict):
            data["image/png"] = b64encode(self.session.image._repr_png_()).decode()
        return bundle

"""`LiveView`: draws previews and full frames of what the window shows."""

from __future__ import annotations

from functools import partial

import numpy as np

from splatgl.errors import USER_ERRORS, error_text
from splatgl.gl.screen import Marks
from splatgl.gl.target import Interrupted
from splatgl.viewer.adaptive_quality import LADDER, REST, Moment
from splatgl.viewer.display import COUNT, EXTRACTING, PICTURE, Display
from splatgl.viewer.hud import progress_text
from splatgl.viewer.reference_view import ReferenceInputs

# maximum panel frames between two portions of a picture
MOST_SHOWN = 2
# seconds of a preview that the panel waits for
WAITED = 0.05


class LiveView(Display):
    """Draws previews and full frames of the document, and displays them with the panel."""

    def _follow_state(self, blurs: bool) -> None:
        """Shows the document in the styles of the state once its coarsest splats are extracted; finer ones follow at
        rest. Until then, the previous document is shown.
        """
        state, extractor = self.state, self.extractor
        if self.coming is not None:
            if self.coming.extracted:
                self._take(self.coming)
            elif not extractor.has_failed(self.coming):
                extractor.request(self.coming, False)
                return
        base = self.coming or self.document
        placed = base.with_planes(state.slice_planes)
        document = placed.with_styles(state.styles, state.mesh_files, state.moving, blurs)
        if document is self.coming:
            # it failed, until the state changes
            if not state.message:
                self.say(extractor.why, EXTRACTING)
            return
        if document is not self.document and not document.extracted:
            self.coming = document
            extractor.request(document, False)
            return
        if document is not self.document or self.coming is not None:
            self._take(document)
        moving = document.for_settings(state.moving, True)
        incomplete = [each for each in (document, moving) if not each.is_complete]
        if incomplete:
            extractor.request(incomplete[0], self.now() - self.touched >= REST)
        self._warn_if_too_large()

    def _warn_if_too_large(self) -> None:
        """Shows a message while a layer has too many splats to draw them all."""
        document = self.document
        if document.exceeds_budget and document.extracted[0] == 2 and not self.state.message:
            count = sum(8 * len(layer.at(2)) for layer in document.drawn_layers if layer.exceeds_budget)
            self.say(f"some {count:,} splats: too many to draw all; make more of it transparent", COUNT)
        elif not document.exceeds_budget:
            self.clear_message(COUNT)

    def _moment(self) -> Moment:
        # quads near the eye may be slow even in portions: deferred until the mouse button is released
        frame = self.painter.frame
        held = self.input.is_dragging and (frame is None or frame.plan.program.technique == "quads")
        return Moment(self.now() - self.touched, self.state.gliding, held, self.document.extracted)

    def _draw(self) -> int | None:
        """Renders a preview after changes, or the full-quality frame at rest. Returns its level, if any."""
        gliding = self.state.gliding or (self.input.is_dragging and self._moment().moving)
        blurs = gliding and self.state.blur != "off"
        self._follow_state(blurs)
        wanted, moment, inputs = self.wanted(), self._moment(), self.inputs
        level = self.refiner.level(wanted, moment)
        if level is None:
            if wanted == self.refiner.refused:
                self._say_rejected()
            return None
        if wanted != self.refiner.drawn:
            self.reference.forget()
        try:
            # quick previews need no portions
            is_slow = level == 0 or self.refiner.pace.expected(level) > WAITED
            interrupted = partial(self._is_interrupted, inputs, level == 0) if is_slow else None
            frame = self.painter.draw(self.state, self.document, LADDER[level], blurs, interrupted)
        except Interrupted:
            return None
        except USER_ERRORS as error:
            self.refiner.refuse(wanted)
            self.reject_reason = error_text(error)
            # also for a view that turns, which is rejected again each time
            self._say_rejected()
            return None
        self.clear_message(PICTURE)
        self.refiner.done(wanted, level, frame.full)
        self.dirty = max(self.dirty, 1 + frame.full)
        return level

    def _say_rejected(self) -> None:
        """Shows why the picture is another one, which no key hides."""
        # the previous document need not support the settings of the coming one
        if self.coming is None and not self.state.message:
            self.say(self.reject_reason, PICTURE)

    def _is_interrupted(self, inputs: int, is_full: bool = True) -> bool:
        """Polls events during a frame and shows the panel that they change; True after new input, which cancels the
        frame if `is_full`. A preview goes on, and shows the panel only while the cursor is over it.
        """
        self.window.wait(0.0)
        # a change is shown after the frame that makes it
        for _ in range(MOST_SHOWN):
            if self.dirty and self.panel is not None and (self.inputs == inputs if is_full else self.panel.touched):
                self._redisplay()
        return self.window.closing or (is_full and self.inputs != inputs)

    def _compare(self) -> None:
        """Requests the reference of a full-quality frame once its view is at rest."""
        frame, reference = self.painter.frame, self.reference
        if self.state.compare == "off" or not frame or not frame.full or self.refiner.drawn != self.wanted():
            if reference.wanted is not None:
                reference.forget()
        elif reference.wanted is None:
            settings = self.state.settings.but(classification="auto")
            reference.request(ReferenceInputs.of(self.document, self.state.pose.camera, settings))

    def _show(self) -> None:
        """Displays the image, its overlay and the panel if any of them changed."""
        running = self.recorder.running
        note = self.painter.compared(self.state, self.reference)
        note = f"recording {running.target.name}: {running.text}" if running else note
        doing = self.busy or self.pending_reason
        if self.painter.write(self.state, self.document, self.window.scale, doing, note):
            self.refresh()
        if self.dirty:
            self._redisplay()
            self.window.title(f"{self.document.volume.name} - splatgl - {doing or progress_text(self.painter.frame)}")

    def _redisplay(self) -> None:
        """Displays the latest image with the panel as it is now."""
        self.dirty -= 1
        self._compose()
        self.window.show()

    def shot(self) -> np.ndarray:
        """The window's current image, uint8 [H, W, 3], sRGB."""
        self._compose()
        return self.screen.read(self.window.size)

    def _compose(self) -> None:
        """Draws the window's content into its back buffer."""
        if self.state.panel and self.panel is None:
            self._open_panel()
        self.screen.draw(self._drawn_size, self.painter.look(self.state, self.reference))
        self.screen.mark(self.window.size, self._marks())
        if self.panel is not None and not self.state.help:
            before, panel = self.state, self.panel.panel
            panel.recent, panel.widgets.recording = self.recent.paths, self.recorder.running
            self.state = self.panel.frame(self.state, self.document, self.painter.frame)
            effects, panel.widgets.effects = panel.widgets.effects, []
            self.effects += effects
            if self.state is not before or effects:
                self.touch()
            if self.panel.waiting or self.panel.owed:
                self.refresh()

    @property
    def _drawn_size(self) -> tuple[int, int]:
        """Pixels of the picture, and of the one beside it."""
        width, height = self.size
        return width * (1 + (self.state.beside is not None)), height

    def _marks(self) -> Marks:
        slices = self.slices.marks(self.state, self.document, self.view)
        # nothing lies over the help
        if self.document.is_loading or self.painter.frame is None or self.state.help:
            return slices
        covered = self.panel is not None and self.panel.touched
        cursor = None if covered or self.input.is_dragging else self.input.cursor
        lies_over = self.panel is not None and self.state.panel and self.view.size[0] == self.window.size[0]
        edge = self.panel.left_edge if lies_over else self.size[0]
        return self.overlays.marks(self.state, self.document, self.view, cursor, slices, edge)

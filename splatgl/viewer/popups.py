"""`Palette`, which finds commands by their words, and `Questions`, which wait for an answer. Extra `gui`."""

from __future__ import annotations

from collections.abc import Iterable

from imgui_bundle import imgui

from splatgl.annotations.text import plain
from splatgl.viewer.commands import Command, CopyText
from splatgl.viewer.document import Document
from splatgl.viewer.panel_sections import CommandWidgets
from splatgl.viewer.questions import Question
from splatgl.viewer.state import State

# width of the palette in screen units at a content scale of 1, its distance from the top as a share of the height, and
# the most commands that it lists
WIDTH, TOP, MOST = 440.0, 0.1, 14
PALETTE, QUESTION = "###palette", "###question"


class Palette:
    """List of the commands whose titles hold the typed words. row: the one that Enter runs."""

    def __init__(self) -> None:
        self.opening = self.is_open = False
        self.typed, self.row = "", 0

    def open(self) -> None:
        """Shows all commands from the next frame on."""
        self.opening, self.typed, self.row = True, "", 0

    def draw(self, state: State, document: Document, widgets: CommandWidgets, room: tuple[int, int]) -> State:
        """Draws the list, if it is open; returns the state after the chosen command. room: width and height of the
        window, screen units.
        """
        if self.opening:
            imgui.open_popup(PALETTE)
            self.opening = False
        wide = min(WIDTH * imgui.get_style().font_scale_main, room[0] - 16.0)
        imgui.set_next_window_pos((room[0] / 2, room[1] * TOP), imgui.Cond_.always, (0.5, 0.0))
        imgui.set_next_window_size((wide, 0.0))
        self.is_open = imgui.begin_popup(PALETTE)
        if not self.is_open:
            return state
        if imgui.is_window_appearing():
            imgui.set_keyboard_focus_here()
        imgui.set_next_item_width(-1.0)
        before, flags = self.typed, imgui.InputTextFlags_.enter_returns_true
        entered, self.typed = imgui.input_text_with_hint("##typed", "what to do", self.typed, flags)
        found = find_commands(self.typed, widgets.commands.values())[:MOST]
        moves = imgui.is_key_pressed(imgui.Key.down_arrow) - imgui.is_key_pressed(imgui.Key.up_arrow)
        self.row = 0 if self.typed != before else min(max(self.row + moves, 0), max(len(found) - 1, 0))
        chosen = found[self.row] if entered and found else None
        for number, command in enumerate(found):
            if imgui.selectable(f"{command.title}##{command.id}", number == self.row)[0]:
                chosen = command
            keys = ", ".join(command.keys)
            imgui.same_line(max(wide - imgui.calc_text_size(keys).x - 2 * imgui.get_style().window_padding.x, 0.0))
            imgui.text_disabled(keys)
        if chosen is not None:
            imgui.close_current_popup()
            state = widgets.run(chosen.id, state, document)
        imgui.end_popup()
        return state


def find_commands(text: str, commands: Iterable[Command]) -> list[Command]:
    """The commands whose titles hold all words of a text, those that begin with it first."""
    words = text.lower().split()
    found = [each for each in commands if all(word in each.title.lower() for word in words)]
    return sorted(found, key=lambda command: not command.title.lower().startswith(text.lower()))


class Questions:
    """Shows questions one after another, each until it is answered, by Enter with the first answer, or closed by
    Escape.
    """

    def __init__(self) -> None:
        self.waiting: list[Question] = []
        self.is_open = False

    def ask(self, question: Question) -> None:
        """Shows a question from the next frame on, unless it waits already."""
        self.waiting += [question] * (question not in self.waiting)

    def draw(self, widgets: CommandWidgets, room: tuple[int, int]) -> None:
        """Draws the question, if one is asked; the answer becomes an effect. room: as of `Palette.draw`."""
        if self.is_open and not imgui.is_popup_open(QUESTION):
            # Escape closed it
            self.waiting, self.is_open = self.waiting[1:], False
        if not self.waiting:
            return
        question = self.waiting[0]
        if not self.is_open:
            imgui.open_popup(QUESTION)
            self.is_open = True
        wide = min(WIDTH * imgui.get_style().font_scale_main, room[0] - 16.0)
        imgui.set_next_window_pos((room[0] / 2, room[1] / 2), imgui.Cond_.always, (0.5, 0.5))
        imgui.set_next_window_size((wide, 0.0))
        flags = imgui.WindowFlags_.no_saved_settings | imgui.WindowFlags_.no_resize | imgui.WindowFlags_.no_move
        if not imgui.begin_popup_modal(f"{question.title}{QUESTION}", None, flags)[0]:
            return
        imgui.text_wrapped(plain(question.text))
        is_entered = imgui.is_key_pressed(imgui.Key.enter, repeat=False) and not imgui.is_window_appearing()
        # else it presses the button that has the keys
        is_entered &= not imgui.get_io().nav_visible
        for number, (text, effect) in enumerate(question.answers):
            if imgui.button(text) or (is_entered and number == 0):
                # a text is copied before it is closed
                if not isinstance(effect, CopyText):
                    imgui.close_current_popup()
                    self.waiting, self.is_open = self.waiting[1:], False
                widgets.effects += [effect] if effect else []
            imgui.same_line()
        imgui.new_line()
        imgui.end_popup()

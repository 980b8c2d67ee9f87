"""Argument parser: help in two lengths, errors in one line, messages with flags, and options of dataclasses."""

from __future__ import annotations

import argparse
import re
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from splatgl.options import Option

# names in messages that stand for other options; --target is checked by argparse
OTHER_NAMES = {"target": "look_at"}
EXPECTED = ": expected "
BAD_INPUT = 2
# a value that begins with a minus: -30, -160,240, -.5:0,1:1, -inf
NEGATIVE = re.compile(r"-([0-9.]|inf\b|nan\b)")
COMMON = "basic options of the picture (the first of several values is the default)"
# options of a command that `--help` lists in whole, at most
MANY = 40


class Parser(argparse.ArgumentParser):
    """Argument parser that reports a usage error in one line, as for any bad input, and takes negative values.

    `--help` of many options shows those in groups of the command's own, and of the groups that commands share those
    with a `summary`; `--help-all` shows all.
    """

    def __init__(self, *args: Any, **named: Any) -> None:
        # an abbreviation would make each new option a breaking change
        super().__init__(*args, **{"formatter_class": Formatter, "allow_abbrev": False, **named})
        # argparse takes what fits for a value, not an option: its own pattern knows single numbers, no -1,2,3
        self._negative_number_matcher = NEGATIVE
        self._positionals.title = "arguments"

    def error(self, message: str) -> NoReturn:
        """Exits with BAD_INPUT and one line on stderr."""
        self.exit(BAD_INPUT, f"{one_line(f'{self.prog}: {message}; see {self.prog} --help')}\n")

    @property
    def flags(self) -> dict[str, str]:
        """Long flags by destination; operands have none."""
        return {action.dest: max(action.option_strings, key=len) for action in self._actions if action.option_strings}

    def with_flags(self, message: str, args: argparse.Namespace | None) -> str:
        """The message with flags instead of the names of options in Python.

        Replaced are: the name at the beginning; the name of a given reader option after a path; `name=` of a reader
        option in what is expected or advised; the names of options that a format does not take. Keys of a scene.toml
        stay, unless the option is given.
        """
        head, separator, rest = message.partition(EXPECTED)
        if not separator:
            return message
        flags, before, colon, name = self.flags, *head.rpartition(": ")
        from splatgl.options import HelpGroup

        reading = [a.dest for g in self._action_groups if g.title == HelpGroup.READING for a in g._group_actions]
        plain = name.removeprefix("transfer ")
        of_file = bool(colon) or plain != name or str(getattr(args, "source", "")).endswith(".toml")
        plain = plain if colon else OTHER_NAMES.get(plain, plain)
        is_given = getattr(args, plain, None) is not None
        # layers and meshes may come from a scene file, too
        flag = "" if plain in ("layers", "meshes") else flags.get(plain, "")
        if flag and (is_given or not of_file) and (not colon or plain in reading):
            head = before + colon + flag
        if reading:
            names = "|".join(reading)
            rest = re.sub(rf"(?<![\w.'-])({names})=(?=\S)", lambda match: f"{flags[match[1]]} ", rest)
            if colon and name == "options":
                rest = re.sub(rf"(?<![\w.'-])({names})(?=[, ]|$)", lambda match: flags[match[1]], rest)
        return head + separator + rest

    @property
    def is_long(self) -> bool:
        """Whether `--help` leaves options out."""
        return len(self._actions) > MANY

    def format_help(self, everything: bool = False) -> str:
        """Help on all options in groups, or on the basic options."""
        # the program itself imports no more than its commands' names
        if self._subparsers is not None:
            return super().format_help()
        from splatgl.options import HelpGroup

        # groups that commands share
        alone = (HelpGroup.ANIMATION, HelpGroup.EXPORT)
        places = {str(group): place for place, group in enumerate(HelpGroup) if group not in alone}
        self._action_groups.sort(key=lambda group: places.get(group.title or "", -1))
        if everything or not self.is_long:
            return super().format_help()
        form = Formatter(self.prog)
        form.is_short = True
        form.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        form.add_text(self.description)
        shared = [action for group in self._action_groups if group.title in places for action in group._group_actions]
        basic = [action for action in shared if getattr(action, "summary", "")]
        own = [group for group in self._action_groups if group.title not in places]
        for title, actions in [(group.title, group._group_actions) for group in own] + [(COMMON, basic)]:
            form.start_section(title)
            form.add_arguments(actions)
            form.end_section()
        form.add_text(f"More options: {self.prog} --help-all")
        return form.format_help()


class Formatter(argparse.RawDescriptionHelpFormatter):
    """Formats `-o, --output FILE`, and keeps the lines of a description. is_short: each option is in a line, with a
    short name of its value, and its summary.
    """

    is_short = False

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        value = self._format_args(action, self._get_default_metavar_for_optional(action))
        return f"{', '.join(action.option_strings)} {value}"

    def _format_args(self, action: argparse.Action, default_metavar: str) -> str:
        value = super()._format_args(action, default_metavar)
        return value.partition("[:")[0] if self.is_short else value

    def _expand_help(self, action: argparse.Action) -> str:
        summary: str = getattr(action, "summary", "") if self.is_short else ""
        return summary or super()._expand_help(action)


class HelpAll(argparse.Action):
    """Prints help on all options, and exits."""

    def __call__(self, parser: Any, *_: Any) -> None:
        """Prints help on all options, and exits."""
        print(parser.format_help(everything=True), end="")
        parser.exit()


class JoinList(argparse.Action):
    """A list with commas: an option that is repeated adds to it."""

    def __call__(self, _parser: Any, namespace: argparse.Namespace, values: Any, _option: str | None = None) -> None:
        """Stores the list with the values."""
        before = getattr(namespace, self.dest, None)
        joined = f"{before},{values}" if isinstance(values, str) else (before or ()) + values
        setattr(namespace, self.dest, joined if before else values)


def add_options(parser: argparse.ArgumentParser, record: Any, *names: str) -> None:
    """Adds the options that a dataclass declares, or some of them, in groups by their titles."""
    from splatgl.options import declared, names_of

    options, defaults = declared(record), {item.name: item.default for item in fields(record)}
    for name in names or names_of(record):
        add_option(parser, name, options[name], defaults[name])


def add_option(parser: argparse.ArgumentParser, name: str, option: Option, default: Any = None) -> None:
    """Adds an option. A "basic" one gets the attribute `summary`: its line of `--help`."""
    kind, rest = option.kind, option.help.removeprefix(option.summary)
    choices = ", ".join(option.choices) if option.choices and kind.metavar else ""
    summary = f"{option.summary}: {choices}" if choices else option.summary
    if isinstance(default, int | float) and default and "default" not in option.help:
        summary += f" (default {default:g})"
    arguments: dict[str, Any] = {"dest": name, "help": (summary + rest).replace("%", "%%")}
    if option.is_bare:
        arguments |= {"action": "store_const", "const": option.bare}
    else:
        arguments |= {"type": kind.parse, "metavar": option.metavar or kind.metavar}
        arguments |= {"choices": option.choices, "type": str} if option.choices and kind.read is str else {}
        arguments |= {"nargs": "?", "const": option.bare} if option.bare is not None else {}
        arguments |= {"action": "append"} if option.repeat else {"action": JoinList} if default == () else {}
    flag = option.flag or f"--{name.replace('_', '-')}"
    action: Any = group_of(parser, option.group).add_argument(flag, **arguments)
    # a single word says no more than the flag
    line = choices if choices and " " not in option.summary else summary
    action.summary = line if option.level == "basic" else ""


def group_of(parser: argparse.ArgumentParser, title: str) -> argparse._ArgumentGroup:
    """The group of that title, which is added if there is none."""
    groups = {group.title: group for group in parser._action_groups}
    return groups.get(title) or parser.add_argument_group(title)


def one_line(text: str) -> str:
    """The text without characters that a terminal does not print, such as line ends in names of files."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)

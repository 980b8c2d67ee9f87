"""Options: fields of dataclasses that declare once what command line, keywords, TOML and panel need to know."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from inspect import isfunction
from math import inf, isfinite
from numbers import Real
from typing import Any, get_args

from splatgl.errors import InputError, expected

# options of `--help`; further options of `--help-all`; its last options
BASIC, MORE, EXPERT = "basic", "more", "expert"
# groups of `--help-all` that options of several files share
ACCURACY, SPEED, PAPER = "accuracy", "performance", "the paper's method, and experts"


@dataclass(frozen=True)
class Kind:
    """Kind of value. this: its description in messages; written: of its text, unless that is metavar and `this`. check:
    returns the value that is stored, of a keyword or of TOML; read: the value of a command line's text. Both raise
    TypeError or ValueError for others. choices: its values, the default first. span: lowest and highest number.
    """

    this: str
    check: Callable[[Any], Any]
    read: Callable[[str], Any] = str
    metavar: str = "NAME"
    choices: Callable[[], tuple[str, ...]] | None = None
    span: tuple[float, float] = (-inf, inf)
    written: str = ""

    @property
    def expected(self) -> str:
        """Description of the value in messages."""
        return " or ".join(self.choices()) if self.choices else self.this


@dataclass(frozen=True)
class Option:
    """An option. help: its meaning; `--help` shows the first sentence. group: title of its group in `--help-all`.
    label: its name in the panel. flag: its name on the command line, unless the field's. bare: the value of the flag
    alone; without a metavar the flag takes no other. repeat: whether the flag may come repeatedly.
    """

    kind: Kind
    help: str
    group: str = "options"
    level: str = MORE
    label: str = ""
    flag: str = ""
    metavar: str = ""
    bare: Any = None
    repeat: bool = False

    @property
    def choices(self) -> tuple[str, ...]:
        """Values to choose from, the default first; () if there are others."""
        return self.kind.choices() if self.kind.choices else ()

    @property
    def summary(self) -> str:
        """First sentence of the help."""
        return self.help.partition(". ")[0]


def option(default: Any, kind: Kind, help: str, **more: Any) -> Any:
    """A field of a dataclass that declares an option; more: further fields of Option."""
    return field(default=default, metadata={"option": Option(kind, help, **more)})


def declared(record: Any) -> dict[str, Option]:
    """Options of a dataclass by the names of their fields."""
    return {f.name: f.metadata["option"] for f in fields(record) if "option" in f.metadata}


def check_options(record: Any, prefix: str = "") -> None:
    """Checks each option of a frozen dataclass and stores its plain value. Raises InputError naming the option."""
    for each in fields(record):
        value = getattr(record, each.name)
        if "option" in each.metadata and value is not each.default:
            object.__setattr__(record, each.name, checked(each.metadata["option"].kind, prefix + each.name, value))


def checked(kind: Kind, name: str, value: Any) -> Any:
    """The value that is stored for a value of that kind. Raises InputError naming the option."""
    try:
        return kind.check(value)
    except InputError:
        raise
    except (TypeError, ValueError) as error:
        raise expected(name, kind.expected, repr(value)[:80]) from error


def non_default(record: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults."""
    return {f.name: value for f in fields(record) if (value := getattr(record, f.name)) != f.default}


def refuse_unknown(what: str, names: Iterable[str], known: Iterable[str], this: str = "") -> None:
    """InputError for names that are not known. this: a description of the known names."""
    known = list(known)
    unknown = [name for name in names if name not in known]
    if unknown:
        fix = nearest(unknown[0], known)
        raise expected(what, this or f"keys {', '.join(known)}", ", ".join(unknown), fix)


def nearest(word: str, known: Iterable[str]) -> str:
    """`did you mean …?`, or "" if no known word is similar."""
    similar = get_close_matches(word, list(known), n=1)
    return f"did you mean {similar[0]}?" if similar else ""


# --- kinds -----------------------------------------------------------------------------------------------------------


def is_number(value: object) -> bool:
    """Whether a value is a real number, and not a bool."""
    return isinstance(value, Real) and not isinstance(value, bool)


def choice(names: Any) -> Kind:
    """One of some names: a Literal or iterable of them, or a function that lists those known at the time."""
    fixed = get_args(names) or (() if isfunction(names) else tuple(names))

    def known() -> tuple[str, ...]:
        return fixed or tuple(names())

    def check(value: Any) -> Any:
        if value not in known():
            raise ValueError
        return value

    return Kind("", check, choices=known)


def number(
    this: str = "a number", low: float = -inf, high: float = inf, above: bool = False, metavar: str = "N"
) -> Kind:
    """A finite number from `low`, or above it, to `high`."""

    def check(value: Any) -> Any:
        if not (is_number(value) and isfinite(value) and low <= value <= high) or (above and value == low):
            raise ValueError
        return value

    return Kind(this, check, float, metavar, span=(low, high))


def whole(low: int, high: float = inf, this: str = "") -> Kind:
    """A whole number from `low` to `high`."""

    def check(value: Any) -> int:
        if not (is_number(value) and low <= value <= high and value == int(value)):
            raise ValueError
        return int(value)

    return Kind(this or f"a whole number from {low} to {high}", check, int, "N", span=(low, high))


def one_of(*values: int) -> Kind:
    """One of some whole numbers."""
    names = tuple(map(str, values))

    def check(value: Any) -> int:
        if isinstance(value, bool) or value not in values:
            raise ValueError
        return int(value)

    return Kind(f"{', '.join(names[:-1])} or {names[-1]}", check, int, "|".join(names))


def flag() -> Kind:
    """True or false; the flag of the command line takes no value."""

    def check(value: Any) -> bool:
        if not isinstance(value, bool):
            raise ValueError
        return value

    return Kind("true or false", check, metavar="")


def text(this: str = "a text", metavar: str = "NAME", *types: type) -> Kind:
    """A text, or a value of other types."""

    def check(value: Any) -> Any:
        if not isinstance(value, (str, *types)) or (isinstance(value, bool) and bool not in types):
            raise ValueError
        return value

    return Kind(this, check, str, metavar)


def numbers(count: int, metavar: str, this: str = "", integers: bool = False) -> Kind:
    """A tuple of so many finite numbers: a sequence of them, or text in which commas or × separate them."""
    kind: Any = int if integers else float

    def check(value: Any) -> tuple[Any, ...]:
        plain = tuple(value.tolist() if hasattr(value, "tolist") else value)
        if len(plain) != count or not all(is_number(n) and isfinite(n) and n == kind(n) for n in plain):
            raise ValueError
        return plain

    def read(given: str) -> tuple[Any, ...]:
        parts = given.replace("×", ",").replace("x", "," if integers else "x").split(",")
        if len(parts) != count:
            raise ValueError
        return tuple(kind(part) for part in parts)

    this = this or f"{count} {'whole' if integers else 'finite'} numbers"
    return Kind(this, check, read, metavar)


def read_size(given: str) -> tuple[int, int]:
    """Width and height of WIDTHxHEIGHT, or of one number for a square. Raises ValueError for other text."""
    sides = [int(part) for part in given.lower().replace("×", "x").split("x")]
    width, height = sides * 2 if len(sides) == 1 else sides
    return width, height


def read_pairs(given: str) -> tuple[tuple[float, float], ...]:
    """Pairs of numbers A:B, separated by commas. Raises ValueError for other text."""
    return tuple((float(a), float(b)) for a, b in (part.split(":") for part in given.split(",")))


def as_is(value: Any) -> Any:
    """The value, which is checked elsewhere."""
    return value

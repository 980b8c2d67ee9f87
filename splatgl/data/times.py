"""`Times`: the times of a file's time points, as numbers with a unit or as dates, and their texts."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from splatgl.errors import expected, list_names

# letters by their numbers, as ImageJ writes those beyond Latin
_ESCAPED = re.compile(r"\\u([0-9a-fA-F]{4})")


def plain_unit(text: str) -> str:
    """A unit's name in small letters, in which signs that look alike are one, such as those of micro and mu."""
    letters = _ESCAPED.sub(lambda match: chr(int(match[1], 16)), text.strip())
    return unicodedata.normalize("NFKC", letters).lower()


# units of time, as files spell them
_SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}


def seconds_in(unit: object) -> float | None:
    """Seconds in a unit of time of any spelling; None for other units."""
    return _SECONDS.get(plain_unit(str(unit)))


_SIGNS = {1.0: "s", 1e-3: "ms", 1e-6: "µs", 1e-9: "ns", 60.0: "min", 3600.0: "h", 86400.0: "d"}
# calendars in which dates are those of Python
_CALENDARS = ("", "standard", "gregorian", "proleptic_gregorian")
_SINCE = re.compile(r"(\w+) since (\d{1,4})-(\d{1,2})-(\d{1,2})(?:[T ](\d{1,2}):(\d{2})(?::(\d{2}))?)?")
_DATE = re.compile(r"\d{4}-\d{2}-\d{2}(?:[T ]\d{2}:\d{2}(?::\d{2})?)?")
_VALUE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) *([a-zA-Zµμ]*)")
# seconds from a start after which times are written as dates, and share of the least step that is rounding
_LONG, _ROUNDING = 1e6, 0.01


@dataclass(frozen=True)
class Times:
    """values: of the time points, in a unit, "" if it is not known. start: of dates, None for times without."""

    values: tuple[float, ...]
    unit: str = ""
    start: datetime | None = None

    @classmethod
    def of(cls, values: Iterable[float], units: str = "", calendar: str = "") -> Times | None:
        """Times in units such as "s" or CF's "hours since 1900-01-01"; None of values that are not finite."""
        known = tuple(float(value) for value in values)
        if not np.isfinite(known).all():
            return None
        word = units.strip().partition(" ")[0]
        seconds = seconds_in(word)
        unit = word if seconds is None else _SIGNS[seconds]
        since = _SINCE.match(units.strip())
        is_long = seconds is not None and max(map(abs, known), default=0.0) * seconds >= _LONG
        if since is None or not is_long or calendar.lower() not in _CALENDARS:
            return cls(known, unit)
        try:
            dated = cls(known, unit, datetime(*(int(part or 0) for part in since.groups()[1:])))  # type: ignore[arg-type]
            return dated if all(dated._date(n) for n in range(len(known))) else None
        except (ValueError, OverflowError):
            return cls(known, unit)

    def _date(self, number: int) -> datetime:
        assert self.start is not None
        return self.start + timedelta(seconds=round(self.values[number] * (seconds_in(self.unit) or 1.0), 3))

    def text(self, number: int) -> str:
        """The time of a time point, such as "1.5 s" or "2019-03-21 06:00"."""
        if self.start is None:
            return f"{self.values[number]:.10g} {self.unit}".rstrip()
        date = self._date(number)
        return f"{date:%Y-%m-%d %H:%M}" + (f":{date:%S}" if date.second else "")

    def number(self, text: str) -> int:
        """The time point of a value, with or without its unit, or of a date. Raises InputError if there is none."""
        texts = [self.text(n) for n in range(len(self.values))]
        date = text.strip().replace("T", " ")
        starting = [n for n, known in enumerate(texts) if _DATE.fullmatch(date) and known.startswith(date)]
        match = _VALUE.fullmatch(text.strip())
        if match is not None and not starting:
            value, unit = float(match[1]), match[2]
            factor = (
                1.0 if unit in ("", self.unit) else (seconds_in(unit) or np.nan) / (seconds_in(self.unit) or np.nan)
            )
            away, ordered = np.abs(np.array(self.values) - value * factor), np.unique(self.values)
            least = float(np.diff(ordered).min()) if len(ordered) > 1 else abs(value) or 1.0
            starting = [int(away.argmin())] if away.min(initial=np.inf) <= _ROUNDING * least else []
        if not starting:
            this = f"a number from 0 to {len(texts) - 1}, or one of {list_names(texts)}"
            raise expected("time", this, repr(text))
        return starting[0]


def is_time(text: str) -> bool:
    """Whether a text is a time, with a point, a unit or as a date, and no number of a time point."""
    match = _VALUE.fullmatch(text.strip())
    is_value = match is not None and bool(match[2] or not re.fullmatch(r"[+-]?\d+", match[1]))
    return is_value or bool(_DATE.fullmatch(text.strip()))

"""Extension of mkdocstrings: docstrings of the API's pages have their parameters as lists."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

import griffe


def list_parameters(text: str, names: Collection[str]) -> str:
    """A docstring as Markdown, each "name: …" or "name, name: …" of these names an item of a list. An item ends at the
    next one, at an empty line, and before "Raises" and "Further keywords".
    """
    known = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    if not known:
        return text
    start = re.compile(rf"(?:^|(?<=[.;:)]) |(?<=\n)) *((?:{known})(?:, (?:{known}))*)(?=(?: \[[^]]*\])?: )")
    blocks = re.split(r"(```.*?```)", text, flags=re.DOTALL)
    return "".join(block if block.startswith("```") else "\n\n".join(_paragraphs(block, start)) for block in blocks)


def _paragraphs(text: str, start: re.Pattern[str]) -> Iterator[str]:
    """The paragraphs of a text, items of lists after each other."""
    for paragraph in re.split(r"\n\s*\n", text):
        first, *rest = start.split(paragraph)
        if not rest:
            yield paragraph
            continue
        items, after = [], ""
        for names, about in zip(rest[::2], rest[1::2], strict=True):
            about, *tail = re.split(r"(?<=[.;])\s+(?=Raises |Further keywords )", about, maxsplit=1)
            written = ", ".join(f"`{name}`" for name in names.split(", "))
            items.append(re.sub(r"\s+", " ", f"- {written}{about}").rstrip("; "))
            after = " ".join([after, *tail]).strip()
        yield "\n\n".join(part for part in (first.strip(), "\n".join(items), after) if part)


class Lists(griffe.Extension):
    """Lists the parameters of functions, and the fields of classes."""

    def on_function(self, *, func: Any, **_: Any) -> None:
        """Called for each function."""
        self._list(func, [parameter.name for parameter in func.parameters])

    def on_class(self, *, cls: Any, **_: Any) -> None:
        """Called for each class, after its members."""
        init = cls.members.get("__init__")
        fields = [name for name, member in cls.members.items() if member.is_attribute]
        self._list(cls, [*fields, *(parameter.name for parameter in getattr(init, "parameters", ()))])

    def _list(self, owner: Any, names: Collection[str]) -> None:
        if owner.docstring is not None:
            owner.docstring.value = list_parameters(owner.docstring.value, names)

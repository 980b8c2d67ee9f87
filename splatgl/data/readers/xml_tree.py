"""XML without document types (whose entities can grow without bound) and without deep nesting."""

from __future__ import annotations

from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from splatgl.data.readers.files import library
from splatgl.errors import expected

MAX_DEPTH = 64
"""Deepest nesting of elements; image files need six."""


def parse_xml(text: str | bytes, title: str) -> Element:
    """The root element of `text`. Raises InputError for damaged XML, for a DOCTYPE, and beyond MAX_DEPTH."""
    builder, depth = TreeBuilder(), 0
    parser = expat.ParserCreate(namespace_separator="}")

    def refuse(*_declaration: object) -> None:
        raise expected("XML", "no document type", "a DOCTYPE", "remove it")

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise expected("XML", f"at most {MAX_DEPTH} levels of elements", "more", "the file is damaged")
        builder.start(_braced(tag), {_braced(name): value for name, value in attributes.items()})

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(_braced(tag))

    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.buffer_text = builder.data, True
    with library(title):
        parser.Parse(text, True)
        return builder.close()


def _braced(name: str) -> str:
    """'uri}tag' as ElementTree writes it: '{uri}tag'."""
    return f"{{{name}" if "}" in name else name

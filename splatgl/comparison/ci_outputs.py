"""Outputs for a CI: a summary in Markdown, and JUnit with attached pictures."""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from xml.etree import ElementTree

from splatgl.comparison.html_report import STATES, Case
from splatgl.fileio import write_file

# rows of a summary in Markdown: GitHub takes 1 MiB a step
MOST_ROWS = 200
# images of a case's HTML: kind and content
IMAGES = re.compile(r'<figcaption>(actual|expected|difference)[^<]*<.*?src="data:image/png;base64,([^"]+)"')
# characters that XML has no place for
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def markdown_summary(cases: Sequence[Case], title: str, page: str = "") -> str:
    """A summary in Markdown: the counts, and a row for each case that is not the same. page: the report's place."""
    numbers = {state: sum(c.state == state for c in cases) for state in STATES}
    counts = ", ".join(f"{count} {state}" for state, count in numbers.items() if count) or "none compared"
    wrong = sorted((c for c in cases if c.state != "same"), key=lambda c: STATES.index(c.state))
    lines = [f"### {'❌' if wrong else '✅'} {title}: {counts}", ""]
    if wrong:
        lines += ["| picture | verdict | what changed |", "|---|---|---|"]
        lines += [f"| {_cell(c.name)} | {c.state} | {_cell(c.line)} |" for c in wrong[:MOST_ROWS]]
        if len(wrong) > MOST_ROWS:
            lines += [f"| … | | {len(wrong) - MOST_ROWS} more |"]
        commands = [c.accept for c in wrong if c.accept]
        if commands:
            text = "\n".join(commands[:MOST_ROWS])
            lines += ["", "<details><summary>accept all of them</summary>", "", "```sh", text, "```", "", "</details>"]
        if page:
            lines += ["", f"Pictures: `{page}` in the artefacts of this run."]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return escape(text, quote=False).replace("|", "\\|").replace("\n", " ")


def append_text(path: Path, text: str) -> None:
    """Appends to a file, as steps of a GitHub workflow do to their common summary."""
    before = path.read_bytes() if path.is_file() else b""
    write_file(path, before + text.encode())


def write_attachments(case: Case, folder: Path) -> list[Path]:
    """Writes the first actual, expected and difference images of a case as PNG files; returns their paths."""
    paths: dict[str, Path] = {}
    for kind, content in IMAGES.findall(case.html):
        if kind not in paths:
            paths[kind] = folder / f"{case.anchor.removeprefix('case-')}.{kind}.png"
            write_file(paths[kind], base64.b64decode(content))
    return list(paths.values())


def attachment_lines(paths: Sequence[Path]) -> str:
    """Lines by which Jenkins and GitLab attach files to a test of a JUnit report."""
    return "".join(f"[[ATTACHMENT|{path.resolve()}]]\n" for path in paths)


def junit_xml(cases: Sequence[Case], title: str, folder: Path | None) -> bytes:
    """A JUnit report: a test for each case. folder: for the pictures that it attaches; None attaches none."""
    wrong = sum(c.state in ("different", "missing") for c in cases)
    errors = sum(c.state == "unusable" for c in cases)
    numbers = {"tests": len(cases), "failures": wrong, "errors": errors}
    suite = ElementTree.Element("testsuite", {"name": title, **{key: str(n) for key, n in numbers.items()}})
    for case in cases:
        test = ElementTree.SubElement(suite, "testcase", {"classname": title, "name": NOT_XML.sub("?", case.name)})
        if case.state == "same":
            continue
        line = NOT_XML.sub("?", case.line)
        kind = "error" if case.state == "unusable" else "failure"
        ElementTree.SubElement(test, kind, {"message": line}).text = "\n".join(filter(None, (line, case.accept)))
        paths = write_attachments(case, folder) if folder else []
        if paths:
            ElementTree.SubElement(test, "system-out").text = attachment_lines(paths)
    suites = ElementTree.Element("testsuites")
    suites.append(suite)
    return bytes(ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True))

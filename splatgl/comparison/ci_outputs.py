"""Outputs for a CI: a summary in Markdown, JUnit with attached pictures, and the history of a baseline in git."""

from __future__ import annotations

import base64
import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from html import escape
from io import BytesIO
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from PIL import Image as Pillow

from splatgl.comparison.html_report import STATES, Case, data_uri
from splatgl.fileio import write_file

# rows of a summary in Markdown: GitHub takes 1 MiB a step
MOST_ROWS = 200
# commits in a history, and pixels along the longer side of their pictures
MOST_COMMITS, THUMBNAIL = 6, 150
# seconds that git may take
GIT_SECONDS = 20
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


def with_history(case: Case) -> Case:
    """The case with the expected image at the last commits that changed it; as it is where git has none."""
    if case.state == "same" or not case.file.endswith(".png"):
        return case
    figures = "".join(
        f'<figure><img alt="expected picture of {escape(f"{date} {commit}")}" src="{data_uri(samples)}">'
        f"<figcaption>{escape(f'{date} {commit} {subject}')}</figcaption></figure>"
        for commit, date, subject, samples in _commits(Path(case.file))
    )
    if not figures:
        return case
    details = f'<details class="history"><summary>the expected picture in git</summary>{figures}</details>'
    return replace(case, html=case.html + details)


def _commits(file: Path) -> Iterator[tuple[str, str, str, np.ndarray]]:
    """(commit, date, subject, thumbnail) of each of the last commits that changed a file, the newest first."""
    name = f"./{file.name}"
    log = _git(file.parent, "log", f"-{MOST_COMMITS}", "--format=%h\t%as\t%s", "--", name).decode("utf-8", "replace")
    for line in log.splitlines():
        commit, date, subject = line.split("\t", 2)
        try:
            picture = Pillow.open(BytesIO(_git(file.parent, "show", f"{commit}:{name}"))).convert("RGBA")
        except (OSError, ValueError):
            # deleted by this commit, or kept outside of git
            continue
        picture.thumbnail((THUMBNAIL, THUMBNAIL))
        yield commit, date, subject, np.asarray(picture)


def _git(folder: Path, *arguments: str) -> bytes:
    """Output of a git command in a folder; empty if git fails or is missing."""
    try:
        command = ["git", "-C", str(folder), *arguments]
        return subprocess.run(command, capture_output=True, check=True, timeout=GIT_SECONDS).stdout
    except (OSError, subprocess.SubprocessError):
        return b""

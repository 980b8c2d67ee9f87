"""Hooks of MkDocs: tables that come from the code, the page of all commands, and pages from .github."""

from __future__ import annotations

import argparse
import re
import shutil
import textwrap
from html import escape
from pathlib import Path
from typing import Any

import gallery
from paper.tables import Table

from splatgl.annotations.annotate import ANNOTATIONS
from splatgl.cli.main import COMMANDS, _parser
from splatgl.options import declared
from splatgl.planning.technique import TECHNIQUES, table_of_unsupported
from splatgl.readers import FORMATS, LoadOptions
from splatgl.report.page import REGISTRY, registry
from splatgl.splat.settings import Settings
from splatgl.viewer import commands

ROOT = Path(__file__).resolve().parents[1]
# pages of the site that are kept elsewhere, because code hosts look for them there
ELSEWHERE = {"contributing.md": ".github/CONTRIBUTING.md", "security.md": ".github/SECURITY.md"}
HEAD = ("option", "values", "meaning")
STYLE = """
.md-grid { max-width: 72rem; }
.md-typeset table:not([class]) { font-size: .62rem; }
.md-typeset table:not([class]) th { min-width: 3rem; }
.md-typeset table:not([class]) td:first-child code { white-space: nowrap; }
.md-typeset table:not([class]) td code { word-break: normal; overflow-wrap: normal; }
.md-typeset table:not([class]) td:last-child { min-width: 8rem; }
.md-typeset pre > code { font-size: .74em; }
.md-typeset details { font-size: inherit; }
.md-typeset :is(h1, h2) { color: var(--md-default-fg-color); font-weight: 400; }
.md-typeset table:not([class]) :is(td, th) { padding: .7em .6em; }
.md-typeset :is(.language-sh, .language-python) pre > code { white-space: pre-wrap; overflow-wrap: anywhere; }
.md-typeset .language-sh pre > code { padding-right: 3em; }
.md-tabs__link { opacity: 1; }
.md-tabs__item--active .md-tabs__link { font-weight: 700; }
@media (max-width: 44.9em) {
  .md-typeset pre > code { white-space: pre-wrap; overflow-wrap: anywhere; }
  .md-typeset .language-sh pre > code { white-space: pre-line; }
}
"""
# a page that turns, in the site's folder live
STYLE_OF_FRAME = "width: 100%; height: 40rem; border: 0"
FRAME = f'<iframe title="{{0}}" src="live/{{0}}" loading="lazy" style="{STYLE_OF_FRAME}" allowfullscreen></iframe>'
# browsers start no workers for pages of a folder: there the search runs in a frame
WORKER = """
if (location.protocol === "file:") window.Worker = class extends EventTarget {
  constructor(url) {
    super();
    const frame = document.createElement("iframe"), script = document.createElement("script");
    frame.hidden = true;
    document.body.append(frame);
    this.inside = frame.contentWindow;
    this.inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}));
    script.src = url;
    this.loaded = new Promise(resolve => { script.onload = resolve; });
    this.inside.document.body.append(script);
  }
  postMessage(data) { this.loaded.then(() => this.inside.dispatchEvent(new MessageEvent("message", {data}))); }
};
"""


def keys() -> str:
    """Table of the default keys of the window."""
    rows = (
        (" or ".join(f"`{key}`" for key in row.keys), row.title, f"`{row.id}`") for row in commands.COMMANDS if row.keys
    )
    return Table(("keys", "action", "name"), tuple(rows)).markdown()


def annotations() -> str:
    """Table of all annotations."""
    names = {row.name: f"`{row.name}{'=TEXT' if row.example else ''}`" for row in ANNOTATIONS.values()}
    rows = ((names[row.name], row.about, f"`{row.key}`" if row.key else "") for row in ANNOTATIONS.values())
    return Table(("name", "draws", "key in the window"), tuple(rows)).markdown()


def settings() -> str:
    """Tables of all settings, one for each group of the command line."""
    groups: dict[str, list[tuple[str, str, str]]] = {}
    for name, option in declared(Settings).items():
        values = ", ".join(option.choices) or (option.metavar or option.kind.metavar).replace("|", ", ")
        row = (f"`--{(option.flag or name).replace('_', '-')}`", values, _escaped(option.help))
        groups.setdefault(option.group, []).append(row)
    tables = (f"**{name.capitalize()}**\n\n{Table(HEAD, tuple(rows)).markdown()}" for name, rows in groups.items())
    return "\n\n".join(tables)


def methods() -> str:
    """Table of the methods of reports."""
    title = f"all {sum(name.count('·') + 1 for _, _, name in registry())} methods, by what is varied"
    return Table(REGISTRY, tuple(registry()), title).markdown()


def reader_options() -> str:
    """Table of the options of reading that have a help text, with the formats that take each."""
    rows = []
    for name, option in declared(LoadOptions).items():
        # without "compressed" and the like
        formats = dict.fromkeys(form.title.partition(",")[0] for form in FORMATS if name in form.options)
        rows += [(f"`{name}`", ", ".join(formats) or "all", _escaped(option.help))] * bool(option.help)
    return Table(("option", "formats", "meaning"), tuple(rows)).markdown()


TABLES = {
    "reader_options": reader_options,
    "settings": settings,
    "annotations": annotations,
    "keys": keys,
    "methods": methods,
    "techniques": lambda: Table(("setting", *TECHNIQUES), tuple(table_of_unsupported())).markdown(),
}
"""Tables by the name that a page gives in `<!-- table: NAME -->`."""


def command_parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each command, with all of its options."""
    parsers = {}
    for name in COMMANDS:
        parser = _parser([name])
        (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
        parsers[name] = commands.choices[name]
    return parsers


def command_reference() -> str:
    """The page of all commands: usage, and a table of options for each group of each command."""
    parts = [
        "# Commands",
        "**Task: look up an option.** `splatgl COMMAND --help` prints the usual ones, `--help-all` all.",
    ]
    for name, parser in command_parsers().items():
        about, _, examples = (parser.description or "").partition("\n\nexamples:\n")
        usage = parser.format_usage().removeprefix("usage: ").strip()
        parts += [f"## splatgl {name}", about, f"```text\n{usage}\n{textwrap.dedent(examples)}".rstrip() + "\n```"]
        for group in parser._action_groups:
            rows = [_row(parser, action) for action in group._group_actions if action.help != argparse.SUPPRESS]
            if rows:
                parts.append(f"**{(group.title or 'options').capitalize()}**")
                parts.append(Table(("option", "meaning"), tuple(rows)).markdown())
    return "\n\n".join(parts) + "\n"


def _row(parser: argparse.ArgumentParser, action: argparse.Action) -> tuple[str, str]:
    """Cells of an option: how it is written, and its help."""
    formatter = parser._get_formatter()
    written = escape(formatter._format_action_invocation(action))
    text = formatter._expand_help(action) if action.help else ""
    # a bar would end the cell even inside of backticks, brackets would be a link
    for character in "|[]":
        written = written.replace(character, f"&#{ord(character)};")
    return f"<code>{written}</code>", _escaped(text)


def _escaped(text: str) -> str:
    """Help text as Markdown: signs that would be markup stay as they are."""
    return re.sub(r"([*_<\[])", r"\\\1", text)


# a line of the guide's page that links to a program of the repository
EXAMPLE = re.compile(r"(?m)^- \[(.+)\]\(\.\./\.\./(scripts/examples/\w+\.py)\)$")


def example(match: re.Match[str]) -> str:
    """Section of a linked program, with its text."""
    return f"## {match[1]}\n\n```python\n{(ROOT / match[2]).read_text(encoding='utf-8')}```\n"


def site_page(text: str) -> str:
    """Markdown of a page for the site: generated tables and linked programs in place, tables in <details> rendered."""
    text = EXAMPLE.sub(example, re.sub(r"<!-- table: (\w+) -->", lambda match: TABLES[match[1]](), text))
    text = text.replace("<!-- pages -->", "\n\n".join(FRAME.format(name) for name in gallery.LIVE))
    return text.replace("<details>", '<details markdown="1">')


def on_files(files: Any, config: Any) -> Any:
    """Adds the generated pages, the style sheet and the script."""
    from mkdocs.structure.files import File

    for name, source in ELSEWHERE.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        files.append(File.generated(config, name, content=text.replace("../splatgl/docs/", "")))
    files.append(File.generated(config, "commands.md", content=command_reference()))
    files.append(File.generated(config, "site.css", content=STYLE))
    files.append(File.generated(config, "iframe-worker.js", content=WORKER))
    return files


def on_post_build(config: Any) -> None:
    """Adds the pages that turn, and removes what no browser loads: maps of sources, and the search of other
    languages.
    """
    gallery.export_pages(Path(config["site_dir"]) / "live")
    scripts = Path(config["site_dir"]) / "assets" / "javascripts"
    shutil.rmtree(scripts / "lunr")
    for path in Path(config["site_dir"]).rglob("*.map"):
        path.unlink()


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Called by MkDocs for each page."""
    return site_page(markdown)

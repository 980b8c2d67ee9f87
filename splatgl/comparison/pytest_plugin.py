"""pytest plugin: the fixture `splatgl_image`, and an HTML report of every image that differs.

Baselines are written only if an option requests it, never automatically. The controller process assembles the
report from data attached to each test report, so that it is complete under pytest-xdist.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from splatgl.comparison.image_regression import ImageRegression
    from splatgl.comparison.reports import Case
    from splatgl.comparison.verdict import CompareOptions


# options that write baselines, and those of outputs, which projects state too
MODES = {
    "--splatgl-update": "write missing baselines, and rewrite baselines that differ",
    "--splatgl-update-class": "write baselines for this class of renderers only (llvmpipe, …)",
    "--splatgl-update-add": "add pictures that differ as further baselines for this class of renderers",
}
REPORT, SUMMARY = "--splatgl-report", "--splatgl-summary"
# the name of the settings in pytest.ini and of pytest's tables in other files
INI = "splatgl"
# attribute of a test report with the compared cases
CASES_ATTRIBUTE = "splatgl_cases"
CASES: pytest.StashKey[list[Case]] = pytest.StashKey()
OPTIONS: pytest.StashKey[CompareOptions] = pytest.StashKey()
FAULTY: pytest.StashKey[bool] = pytest.StashKey()
SEE = "the settings of splatgl are wrong, as the first test with pictures says"
# the folder in the report's for pictures that a JUnit report attaches
ATTACHMENTS = "attachments"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the plugin's options to pytest."""
    group = parser.getgroup("splatgl", "image regression (splatgl)")
    for mode, about in MODES.items():
        group.addoption(mode, action="store_true", help=about)
    about = "write all comparisons to DIR/index.html, with pictures of the differences"
    group.addoption(REPORT, metavar="DIR", help=about)
    about = "append a summary in Markdown to FILE, such as $GITHUB_STEP_SUMMARY"
    group.addoption(SUMMARY, metavar="FILE", help=about)
    parser.addini(INI, "settings of comparisons in TOML, as in [tool.splatgl.compare] of pyproject.toml", default="")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Checks the options, creates the report folder, and registers the collector."""
    modes = [mode for mode in MODES if _option(config, mode)]
    if len(modes) > 1:
        raise pytest.UsageError(f"{' and '.join(modes)}: expected one of them")
    folder = _option(config, REPORT)
    if folder:
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            got = f"{folder}: {error.strerror}"
            raise pytest.UsageError(f"{REPORT}: expected a folder to write to, got {got}") from error
    config.pluginmanager.register(Collector(), "splatgl-collector")


def _option(config: pytest.Config, name: str) -> Any:
    return config.getoption(name.lstrip("-").replace("-", "_"), None)


def options_of(config: pytest.Config) -> CompareOptions:
    """The project's options: of pyproject.toml and of pytest's configuration. Bad ones fail the tests, of
    which the first says what is wrong.
    """
    from splatgl.comparison.verdict import CompareOptions
    from splatgl.errors import InputError
    from splatgl.fileio import parse_table

    fault = ""
    if OPTIONS not in config.stash:
        try:
            table = parse_table(config.getini(INI), f"{INI}: expected settings in TOML")
            project = CompareOptions.of_project(config.rootpath, config.rootpath)
            config.stash[OPTIONS] = project.changed(table, INI)
        except InputError as error:
            fault = SEE if config.stash.get(FAULTY, False) else str(error)
            config.stash[FAULTY] = True
    if fault:
        # not within the handler: pytest prints an exception with those that it was raised in
        pytest.fail(fault, pytrace=False)
    return config.stash[OPTIONS]


def output_of(config: pytest.Config, name: str) -> Path | None:
    """The folder of the report, or the file of the summary: of pytest's option, else of the project."""
    path = _option(config, name)
    return Path(path) if path else getattr(options_of(config), name.rpartition("-")[2])


@pytest.fixture
def splatgl_image(request: pytest.FixtureRequest) -> ImageRegression:
    """Call it with an image: `splatgl_image(image)`, `splatgl_image(image, name="front", tolerance=0.02)`."""
    from splatgl.comparison.image_regression import FOLDER, ImageRegression

    # path relative to the invocation folder, which may differ from the root of test ids, and be on another drive
    file = str(request.node.path)
    with suppress(ValueError):
        file = os.path.relpath(file, request.config.invocation_params.dir)
    parts = [node.name for node in request.node.listchain() if isinstance(node, (pytest.Class, pytest.Item))]
    path, options = Path(request.node.path), options_of(request.config)
    folder, root = options.baselines, request.config.rootpath
    if folder is None:
        folder = path.parent / FOLDER
    elif path.is_relative_to(root):
        folder = folder / path.parent.relative_to(root)
    return ImageRegression(
        test="::".join([Path(file).as_posix(), *parts]),
        file=path,
        folder=folder / path.stem,
        options=options,
        default_name="-".join(parts),
        mode=next((mode.rpartition("-")[2] for mode in MODES if _option(request.config, mode)), ""),
        cases=request.node.stash.setdefault(CASES, []),
        report=output_of(request.config, REPORT) is not None,
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    """Attaches a test's comparisons to its report, which pytest-xdist transfers between processes."""
    report = yield
    # report a case once: fixtures may also compare, before or after the test
    if cases := item.stash.get(CASES, []):
        setattr(report, CASES_ATTRIBUTE, [asdict(case) for case in cases])
        if item.config.getoption("xmlpath", None):
            _attach(item, cases)
        cases.clear()
    return report


def _attach(item: pytest.Item, cases: list[Case]) -> None:
    """Writes the pictures of failures into the report's folder, and names them in the JUnit report of the test.

    The property `attachment` is in every report; lines that Jenkins and GitLab read are with `junit_logging`.
    """
    from splatgl.comparison.reports import attachment_lines, write_attachments

    folder = output_of(item.config, REPORT)
    if folder is None:
        return
    for case in cases:
        paths = write_attachments(case, folder.absolute() / ATTACHMENTS)
        item.user_properties.extend(("attachment", str(path)) for path in paths)
        if paths:
            item.add_report_section("call", "stdout", attachment_lines(paths))


class Collector:
    """Comparisons of all tests, in the controller process. incomplete: files with tests that did not compare."""

    def __init__(self) -> None:
        self.cases: list[Case] = []
        self.incomplete: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collects the cases attached to a test's report."""
        from splatgl.comparison.reports import Case

        cases = getattr(report, CASES_ATTRIBUTE, [])
        self.cases += [Case(**values) for values in cases]
        if report.skipped or (report.failed and not cases):
            self.incomplete.add(report.location[0])

    def pytest_terminal_summary(self, terminalreporter: Any, config: pytest.Config) -> None:
        """Writes the HTML report if --splatgl-report is given, and lists the files written."""
        if not self.cases:
            return
        folder, summary = output_of(config, REPORT), output_of(config, SUMMARY)
        lines = [f"wrote {path}" for path in sorted({case.written for case in self.cases if case.written})]
        unused = self._unused(config)
        lines += [f"unused baseline: {path}" for path in unused]
        if folder:
            lines.append(self._report(folder, unused))
        if summary:
            self._summary(summary, folder)
        if lines:
            terminalreporter.section("splatgl")
            for line in lines:
                terminalreporter.write_line(line)

    def _unused(self, config: pytest.Config) -> list[str]:
        """Baselines that no test of a whole run compares; none are known if only some tests of a file ran."""
        from splatgl.comparison.image_regression import list_unused

        chosen = ("keyword", "markexpr", "deselect", "lf", "last_failed", "stepwise", "maxfail")
        if any(config.getoption(name, None) for name in chosen) or any("::" in name for name in config.args):
            return []
        return list_unused(self.cases, {config.rootpath / name for name in self.incomplete})

    def _report(self, folder: Path, unused: list[str]) -> str:
        from splatgl.comparison.reports import build_page, list_files
        from splatgl.fileio import write_file

        wrong = sum(case.state != "same" for case in self.cases)
        extra = list_files("baselines that no test compares", unused)
        write_file(folder / "index.html", build_page(self.cases, "Image regression", extra).encode())
        return f"{wrong} of {len(self.cases)} pictures differ, are missing or unusable: {folder / 'index.html'}"

    def _summary(self, path: Path, folder: Path | None) -> None:
        from splatgl.comparison.reports import append_text, markdown_summary

        page = str(folder / "index.html") if folder else ""
        append_text(path, markdown_summary(self.cases, "Image regression", page))

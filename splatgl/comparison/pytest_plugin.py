"""pytest plugin: the fixture `splatgl_image`, and an HTML report of every image that differs.

Baselines are written only if an option requests it, never automatically. The controller process assembles the
report from data attached to each test report, so that it is complete under pytest-xdist.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from splatgl.comparison.image_regression import ImageRegression


UPDATE, REPORT = "--splatgl-update", "--splatgl-report"
UPDATE_CLASS, ADD = "--splatgl-update-class", "--splatgl-update-add"
# attribute of a test report with the compared cases
CASES_ATTRIBUTE = "splatgl_cases"
# the fixture's former name, which pytest-regressions uses for another fixture
FORMER_NAME = "image_regression"
CASES: pytest.StashKey[list[dict[str, str]]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the plugin's options to pytest."""
    group = parser.getgroup("splatgl", "image regression (splatgl)")
    add = group.addoption
    add(UPDATE, action="store_true", help="write missing baselines, and rewrite baselines that differ")
    add(UPDATE_CLASS, action="store_true", help="write baselines for this class of renderers only (llvmpipe, …)")
    add(ADD, action="store_true", help="add pictures that differ as further baselines for this class of renderers")
    add(REPORT, metavar="DIR", help="write all comparisons to DIR/index.html, with pictures of the differences")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Checks the options, creates the report folder, registers the collector and the fixture's former name if free."""
    modes = [option for option in (UPDATE, UPDATE_CLASS, ADD) if _option(config, option)]
    if len(modes) > 1:
        raise pytest.UsageError(f"{' and '.join(modes)}: expected one of them")
    folder = _option(config, REPORT)
    if folder:
        try:
            Path(folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            got = f"{folder}: {error.strerror}"
            raise pytest.UsageError(f"{REPORT}: expected a folder to write to, got {got}") from error
    manager = config.pluginmanager
    manager.register(Collector(), "splatgl-collector")
    if not any(hasattr(plugin, FORMER_NAME) for plugin in manager.get_plugins()):
        manager.register(Former(), "splatgl-former")


def _option(config: pytest.Config, name: str) -> Any:
    return config.getoption(name.lstrip("-").replace("-", "_"), None)


@pytest.fixture
def splatgl_image(request: pytest.FixtureRequest) -> ImageRegression:
    """Call it with an image: `splatgl_image(image)`, `splatgl_image(image, name="front", tolerance=0.02)`."""
    from splatgl.comparison.image_regression import ImageRegression

    modes = {UPDATE: "update", UPDATE_CLASS: "update-class", ADD: "add"}
    mode: Any = next((mode for option, mode in modes.items() if _option(request.config, option)), "")
    # path relative to the invocation folder, which may differ from the root of test ids, and be on another drive
    file = str(request.node.path)
    with suppress(ValueError):
        file = os.path.relpath(file, request.config.invocation_params.dir)
    parts = [node.name for node in request.node.listchain() if isinstance(node, (pytest.Class, pytest.Item))]
    return ImageRegression(
        test="::".join([Path(file).as_posix(), *parts]),
        file=Path(request.node.path),
        default_name="-".join(parts),
        mode=mode,
        cases=request.node.stash.setdefault(CASES, []),
        report=bool(_option(request.config, REPORT)),
    )


class Former:
    """Provides the fixture by its former name."""

    @pytest.fixture
    def image_regression(self, splatgl_image: ImageRegression) -> ImageRegression:
        """`splatgl_image` by its former name."""
        return splatgl_image


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    """Attaches a test's comparisons to its report, which pytest-xdist transfers between processes."""
    report = yield
    # report a case once: fixtures may also compare, before or after the test
    if cases := item.stash.get(CASES, []):
        setattr(report, CASES_ATTRIBUTE, list(cases))
        cases.clear()
    return report


class Collector:
    """Comparisons of all tests, collected in the controller process."""

    def __init__(self) -> None:
        self.cases: list[dict[str, str]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collects the cases attached to a test's report."""
        self.cases += getattr(report, CASES_ATTRIBUTE, [])

    def pytest_terminal_summary(self, terminalreporter: Any, config: pytest.Config) -> None:
        """Writes the HTML report if --splatgl-report is given, and lists the files written."""
        folder = _option(config, REPORT)
        written = [case["written"] for case in self.cases if case.get("written")]
        lines = [f"wrote {path}" for path in sorted(set(written))]
        if folder:
            lines.append(self._report(Path(folder)))
        if lines:
            terminalreporter.section("splatgl")
            for line in lines:
                terminalreporter.write_line(line)

    def _report(self, folder: Path) -> str:
        """Writes the report and returns a message with its path."""
        from splatgl.comparison.html_report import Case, build_page
        from splatgl.fileio import write_file

        cases = [Case(*(case[key] for key in ("name", "state", "line", "html"))) for case in self.cases]
        wrong = sum(case.state != "same" for case in cases)
        write_file(folder / "index.html", build_page(cases, "Image regression").encode())
        return f"{wrong} of {len(cases)} pictures differ, are missing or unusable: {folder / 'index.html'}"

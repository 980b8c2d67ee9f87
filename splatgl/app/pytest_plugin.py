"""The pytest plugin: the fixture `image_regression`, and a page with every picture that differs.

Baselines are written only where an option asks for it; nothing is ever updated by itself. The report is put together
by the process that pytest runs in, from what each test report carries, so that it is complete under pytest-xdist.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from splatgl.app.regression import ImageRegression

UPDATE, UPDATE_CLASS, ADD, REPORT = (
    "--splatgl-update",
    "--splatgl-update-class",
    "--splatgl-update-add",
    "--splatgl-report",
)
# the attribute of a test report that carries what was compared
CARRIED = "splatgl_cases"
CASES: pytest.StashKey[list[dict[str, str]]] = pytest.StashKey()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("splatgl", "image regression (splatgl)")
    ways = group.addoption
    ways(UPDATE, action="store_true", help="write the baselines that are missing or differ; the portable ones first")
    ways(UPDATE_CLASS, action="store_true", help="write them for this class of renderers only (llvmpipe, nvidia, …)")
    ways(ADD, action="store_true", help="add what differs as one more that is right for this class of renderers")
    ways(REPORT, metavar="DIR", help="collect what was compared in DIR/index.html, with pictures of what differs")


def pytest_configure(config: pytest.Config) -> None:
    asked = [option for option in (UPDATE, UPDATE_CLASS, ADD) if _option(config, option)]
    if len(asked) > 1:
        raise pytest.UsageError(f"{' and '.join(asked)}: expected one of them")
    folder = _option(config, REPORT)
    if folder and Path(folder).exists() and not Path(folder).is_dir():
        raise pytest.UsageError(f"{REPORT}: expected a folder, got the file {folder}")
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Collector(), "splatgl-collector")


def _option(config: pytest.Config, name: str) -> Any:
    return config.getoption(name.lstrip("-").replace("-", "_"), None)


@pytest.fixture
def image_regression(request: pytest.FixtureRequest) -> ImageRegression:
    """Call it with a picture: `image_regression(image)`, `image_regression(image, name="front", tolerance=0.02)`."""
    from splatgl.app.regression import ImageRegression, Mode

    modes = {UPDATE: Mode.UPDATE, UPDATE_CLASS: Mode.UPDATE_CLASS, ADD: Mode.ADD}
    mode = next((mode for option, mode in modes.items() if _option(request.config, option)), Mode.COMPARE)
    cases = request.node.stash.setdefault(CASES, [])
    return ImageRegression(
        test=request.node.nodeid,
        file=Path(request.node.path),
        default_name=request.node.name,
        mode=mode,
        cases=cases,
        report=bool(_option(request.config, REPORT)),
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[Any]:
    report = yield
    cases = item.stash.get(CASES, [])
    if call.when == "call" and cases:
        setattr(report, CARRIED, list(cases))
    return report


class Collector:
    """What all tests compared, in the process that tells the outcome."""

    def __init__(self) -> None:
        self.cases: list[dict[str, str]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.cases += getattr(report, CARRIED, [])

    def pytest_terminal_summary(self, terminalreporter: Any, config: pytest.Config) -> None:
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
        """Writes the page; says where it is."""
        from splatgl.data.image import write_whole
        from splatgl.truth.compare_report import Case, page

        cases = [Case(*(case[key] for key in ("name", "state", "line", "html"))) for case in self.cases]
        wrong = sum(case.state != "same" for case in cases)
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / "index.html", page(cases, "Image regression").encode())
        return f"{wrong} of {len(cases)} pictures differ, are missing or unusable: {folder / 'index.html'}"

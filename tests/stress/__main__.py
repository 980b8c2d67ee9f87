"""`splatgl stress`: extreme scenes with known exact results, compared with the rendered images."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.cli.options import add_options, record_of
from splatgl.errors import expected
from splatgl.fileio import check_folder, check_output, write_file
from splatgl.platforms import CHOICES
from splatgl.scene.draw import WorkerOptions
from tests.stress import CASES, run_case
from tests.stress.case import Bench, Case, Check, Result
from tests.stress.report import PAGES, about, as_csv, as_json, as_markdown, heading, line, lines, verdict

if TYPE_CHECKING:
    from splatgl.distributed.worker import Drawing
    from splatgl.gl.renderer import Renderer


# suffix of each file of results, and its text of (results, name of the renderer)
FILES: dict[str, tuple[str, Callable[[list[Result], str], str]]] = {
    "markdown": (".md", as_markdown),
    "csv": (".csv", lambda results, drawn_by: as_csv(results)),
    "json": (".json", as_json),
}
# exit code if a bound is violated
BROKEN = 1
# up to this many cases, all checks are printed
FEW = 3


def add_parser(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `splatgl stress`."""
    parser.add_argument("--case", nargs="+", action="extend", metavar="NAME", help="only these cases, with all checks")
    parser.add_argument("--list", action="store_true", help="list the cases, and draw nothing")
    parser.add_argument("--explain", metavar="NAME", help=f"explain one case; in depth: {', '.join(PAGES)}")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for stress.md, stress.csv and stress.json")
    parser.add_argument("--markdown", metavar="FILE", help="write the table as Markdown")
    parser.add_argument("--csv", metavar="FILE", help="write each check as a line of CSV")
    parser.add_argument("--json", metavar="FILE", help="write everything as JSON")
    parser.add_argument("--backend", default="auto", metavar="NAME", help=f"{CHOICES} (default auto)")
    parser.add_argument("--device", type=int, metavar="N", help="number of the EGL device, from 0")
    parser.set_defaults(gpu=False)
    add_options(parser, WorkerOptions)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Runs the cases, prints and writes the results; returns 1 if a bound is violated, else 0."""
    if args.list:
        print("\n".join(f"{case.name:20}{case.stresses}" for case in CASES.values()))
        return 0
    files = _files(args)
    chosen = [_case(name) for name in args.case] if args.case else list(CASES.values())
    explained = _case(args.explain) if args.explain else None
    format_line = lines if args.case and len(chosen) <= FEW else line
    if (by := record_of(args, WorkerOptions)).are_used and not explained:
        results, drawn_by = _on_workers(by, chosen, format_line)
    else:
        from splatgl.gl.renderer import Renderer

        with Renderer(args.backend, args.device) as renderer:
            if explained:
                return _explain(explained, renderer)
            drawn_by = _renderer_name(renderer)
            print(f"{drawn_by}\n{heading()}")
            results = []
            for case in chosen:
                results.append(run_case(case, renderer))
                print(format_line(results[-1]), flush=True)
    print(verdict(results))
    for kind, path in files.items():
        write_file(path, FILES[kind][1](results, drawn_by).encode())
    return 0 if all(result.ok for result in results) else BROKEN


def _renderer_name(renderer: Renderer) -> str:
    return f"{renderer.info.renderer}, OpenGL {renderer.info.version} ({renderer.info.backend})"


def _on_workers(
    by: WorkerOptions, chosen: list[Case], format_line: Callable[[Result], str]
) -> tuple[list[Result], str]:
    """(results in the order of the cases, name of the renderer); prints each result when it is ready."""
    from splatgl.distributed.cluster import spread

    results, drawn_by = dict[str, Result](), ""
    with by.connected() as client:
        items = ((case.name, (case.name, by.drawing)) for case in chosen)
        for name, (name_there, checks, pictures, bad, seconds) in spread(client, _case_on_worker, items):
            if name_there != drawn_by:
                drawn_by = name_there
                print(f"{drawn_by}\n{heading()}")
            results[name] = Result(CASES[name], checks, pictures, bad, seconds)
            print(format_line(results[name]), flush=True)
    return [results[case.name] for case in chosen], drawn_by


def _case_on_worker(name: str, drawing: Drawing) -> tuple[str, tuple[Check, ...], int, int, float]:
    """On a worker: name of the renderer, and the fields of a Result without its case."""
    from splatgl.distributed.worker import renderer

    result = run_case(CASES[name], renderer(drawing))
    return _renderer_name(renderer(drawing)), result.checks, result.pictures, result.bad_pixels, result.seconds


def _explain(case: Case, renderer: Renderer) -> int:
    """Prints a page on a case: description, analysis if available, and checks."""
    print(about(case))
    if case.name in PAGES:
        print(f"\n{PAGES[case.name](Bench(renderer))}")
    result = run_case(case, renderer)
    print(f"\n{heading()}\n{lines(result)}")
    return 0 if result.ok else BROKEN


def _files(args: argparse.Namespace) -> dict[str, Path]:
    """Output files by kind, checked before any work."""
    files = {kind: Path(path) for kind in FILES if (path := getattr(args, kind))}
    if args.output:
        folder = Path(args.output)
        if folder.exists() and not folder.is_dir():
            raise expected(folder, "a folder", "a file", "give another name to --output")
        check_folder(folder, folder)
        files = {**{kind: folder / f"stress{suffix}" for kind, (suffix, _) in FILES.items()}, **files}
    for kind, path in files.items():
        check_output(path, (FILES[kind][0],))
    return files


def _case(name: str) -> Case:
    if name not in CASES:
        raise expected("stress case", "one of " + ", ".join(CASES), repr(name), "splatgl stress --list shows all")
    return CASES[name]

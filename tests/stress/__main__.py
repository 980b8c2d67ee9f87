"""`scripts/stress`: extreme scenes with known exact results, compared with the rendered images.

Prints a line for each case: its error, its bound, and the error of the paper's settings. Exits with 1 if a bound is
violated.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from splatgl.cli.parser import Parser
from splatgl.gl.renderer import Renderer
from splatgl.platforms import CHOICES
from tests.stress import CASES, run_case
from tests.stress.case import Bench, Result
from tests.stress.report import PAGES, about, as_markdown, heading, line, lines, verdict

GUIDE = Path(__file__).parents[2] / "splatgl" / "docs" / "accuracy.md"
# a heading, a line below it, and the rows
TABLE = re.compile(r"(?m)^\| case \| error \|.*\n(?:\|.*\n)+")
# up to this many cases, all checks are printed
FEW = 3
# exit code if a bound is violated
BROKEN = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the cases and prints the results; returns BROKEN if a bound is violated, else 0."""
    parser = Parser(prog="scripts/stress", description="Draw extreme scenes, and check the bound of each.")
    chosen = parser.add_mutually_exclusive_group()
    names = {"metavar": "NAME", "choices": CASES}
    chosen.add_argument("--case", nargs="+", action="extend", help="only these cases, with all checks", **names)
    chosen.add_argument("--list", action="store_true", help="list the cases, and draw nothing")
    chosen.add_argument("--explain", help=f"explain one case; in depth: {', '.join(PAGES)}", **names)
    chosen.add_argument("--guide", action="store_true", help=f"write the table into {GUIDE.name}")
    parser.add_argument("--backend", default="auto", metavar="NAME", help=f"{CHOICES} (default auto)")
    parser.add_argument("--device", type=int, metavar="N", help="number of the EGL device, from 0")
    args = parser.parse_args(arguments)
    if args.list:
        print("\n".join(f"{case.name:20}{case.stresses}" for case in CASES.values()))
        return 0
    with Renderer(args.backend, args.device) as renderer:
        if args.explain:
            return explain(args.explain, renderer)
        info = renderer.info
        print(f"{info.renderer}, OpenGL {info.version} ({info.backend})\n{heading()}")
        results, format_line = list[Result](), lines if len(args.case or CASES) <= FEW else line
        for name in args.case or CASES:
            results.append(run_case(CASES[name], renderer))
            print(format_line(results[-1]), flush=True)
    print(verdict(results))
    if args.guide:
        GUIDE.write_text(TABLE.sub(lambda _: f"{as_markdown(results)}\n", GUIDE.read_text("utf-8")), "utf-8")
    return 0 if all(result.ok for result in results) else BROKEN


def explain(name: str, renderer: Renderer) -> int:
    """Prints a page on a case: description, analysis if available, and checks."""
    case = CASES[name]
    print(about(case))
    if name in PAGES:
        print(f"\n{PAGES[name](Bench(renderer))}")
    result = run_case(case, renderer)
    print(f"\n{heading()}\n{lines(result)}")
    return 0 if result.ok else BROKEN


if __name__ == "__main__":
    sys.exit(main())

"""Tables and explanations of stress cases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from textwrap import fill

import numpy as np
from paper.tables import TEXT_WIDTH, Table

from splatgl.reference.field import ray_integral
from tests.stress import attenuation
from tests.stress.case import (
    Bench,
    Case,
    Check,
    Result,
    alpha,
    block,
    dots,
    lattice,
    middle,
    optical_depth,
    parallel,
    peak,
)

TARGETS = ("rgba8", "rgba16f", "rgba32f")
# thicknesses of a shell in voxels: the same shell at decreasing resolution
THICKNESSES = (4.3, 2.3, 1.3, 0.7, 0.4, 0.1, 0.01)
# number of positions of a shell within its voxel
PLACES = 16
COUNTS = (10**3, 10**4, 10**5, 10**6)


def skin_over_fog(bench: Bench) -> str:
    """Page on fog before an opaque skin: errors by voxel size and frame buffer."""
    steps = Table(
        ("voxel", "right", "splats' error", "field's error", "σ R h"),
        tuple(_skin_row(bench, step) for step in (1.0, 0.5, 0.25, 0.125)),
    )
    splats, (_, back) = attenuation.skin_and_fog(0.125), attenuation.skin_cameras(0.0625)
    right = attenuation.from_behind()
    drawn = {target: middle(bench.draw(splats, back, target=target)) for target in TARGETS}
    drawn["float64"] = middle(bench.truth(splats, back))
    targets = Table(
        ("frame buffer", "error"), tuple((name, float(np.abs(p - right).max())) for name, p in drawn.items())
    )
    return _page(
        f"A ray that leaves fog (τ = {attenuation.FOG:g} a unit) meets an opaque skin "
        f"(τ = {attenuation.SKIN:g}): a jump of {attenuation.SKIN / attenuation.FOG:.0e} within one voxel. Splats "
        "are whole sheets drawn one after the other, so that the fog before the skin keeps its full depth at every "
        "resolution. A field that is interpolated first, as a "
        "ray caster's is, smears the skin over R voxels of fog and loses that much of the path: its error falls with "
        "the voxel's size only.",
        (f"Seen through {attenuation.FOG_LAYERS} units of fog; largest error of a channel:", steps),
        "Each layer is an 'over', rounded to the frame buffer. 128 layers of fog of 0.0025 each are less than a level "
        "of 8 bits, 0.0039, and a few of half float's steps; float32 holds them.",
        ("By frame buffer, voxels of 1/8:", targets),
    )


def _skin_row(bench: Bench, step: float) -> tuple[float, ...]:
    splats, (_, back) = attenuation.skin_and_fog(step), attenuation.skin_cameras(0.5 * step)
    right = attenuation.from_behind()
    drawn = middle(bench.draw(splats, back))
    field = middle(ray_integral(splats, back).pixels)
    smear = attenuation.FOG * 1.556228 * step
    return step, float(right[0]), float(np.abs(drawn - right).max()), float(np.abs(field - right).max()), smear


def thin_shell(bench: Bench) -> str:
    """Page on a shell thinner than a voxel: its optical depth by sampling and frame buffer."""
    rows, camera, width = [], *attenuation.shell_view(0.5, 0.0)
    for thickness in THICKNESSES:
        row = [thickness]
        for is_averaged in (True, False):
            places = (np.arange(PLACES) + 0.25) / PLACES
            shells = [attenuation.shell(place, width, thickness, is_averaged) for place in places]
            depths = [float(optical_depth(bench.draw(shell, camera)[0, 0, 3])) / attenuation.SHELL for shell in shells]
            row += [min(depths), max(depths)]
        rows.append(tuple(row))
    resolution = Table(("thickness", "averaged, least", "most", "centre, least", "most"), tuple(rows))
    precision = []
    for depth in (1e-1, 1e-2, 1e-3, 1e-5, 1e-7):
        splats = dots(lattice(*(np.arange(n) - n // 2 for n in width), [0.0]), depth)
        ratios = [optical_depth(bench.draw(splats, camera, target=target)[0, 0, 3]) / depth for target in TARGETS]
        precision.append((depth, *map(float, ratios)))
    return _page(
        f"A shell of optical depth {attenuation.SHELL:g} that is thinner than a voxel is a scale jump between samples: "
        "its voxels' centres meet it or miss it. Measured over exact optical depth of a ray, for a shell at "
        f"{PLACES} places in its voxel:",
        ("Thickness in voxels: the same shell, sampled ever more coarsely", resolution),
        "Samples that are averages over their voxels (of extinction, not of opacity) keep the shell's optical depth at "
        "any resolution; samples at centres are off by up to a voxel over the thickness, either way, and may lose the "
        "shell altogether from one voxel down. No renderer can mend that: average before, or sample more finely.",
        ("A sheet of small optical depth: drawn over exact, by frame buffer", Table(("τ", *TARGETS), tuple(precision))),
    )


def sheet_across_z_k(bench: Bench) -> str:
    """Page on a floor that crosses z_k: its optical depth by attenuation form and number of rows."""
    splats, camera, right = attenuation.tilted_sheet(129)
    chosen, depth = attenuation.sheet_rows(camera)
    changes: dict[str, dict[str, str]] = {form: {"attenuation": form} for form in attenuation.FORMS}
    changes["no antialiasing"] = {"antialias": "off"}
    ratios = {
        name: (optical_depth(alpha(bench.draw(splats, camera, **change)))[:, 0] / right)[chosen]
        for name, change in changes.items()
    }
    ratios["paper"] = (optical_depth(alpha(bench.paper(splats, camera)))[:, 0] / right)[chosen]
    picks = [int(np.abs(depth - z).argmin()) for z in (0.6, 0.8, 0.95, 1.0, 1.05, 1.1, 1.2, 1.5, 1.9)]
    along = Table(("z/z_k", *ratios), tuple((float(depth[i]), *(float(v[i]) for v in ratios.values())) for i in picks))
    steps = []
    for rows in (33, 65, 129, 257, 513):
        splats, camera, right = attenuation.tilted_sheet(rows)
        chosen, _ = attenuation.sheet_rows(camera)
        ratio = (optical_depth(alpha(bench.draw(splats, camera)))[:, 0] / right)[chosen]
        steps.append((float(rows), float(np.abs(ratio - 1).max()), float(np.abs(np.diff(ratio)).max())))
    return _page(
        "A thin floor of opacity 0.5 runs from 0.55 to 2 z_k. At z_k a voxel is one pixel wide; before it splats keep "
        "their size and are exact, behind it they grow with the pixel, and their matter is spread. −ln(1−α) over "
        "τ sec θ, row by row of the picture (1 is right):",
        ("129 rows", along),
        "Optical depth passes z_k without a seam, since the sum of stretched splats is the sheet's own depth; what is "
        "left is the kernel's ripple, largest just behind z_k (1.08 % at 1.1 z_k). Opacity's deficit sets in at z_k "
        "and grows. Without antialiasing there is no deficit and no filter: what is finer than a pixel aliases.",
        (
            "More rows move z_k away, and change nothing: worst error, worst step from row to row",
            Table(("rows", "error", "step"), tuple(steps)),
        ),
    )


def million_faint(bench: Bench) -> str:
    """Page on very many faint splats on one pixel: the error of α by their number and frame buffer."""
    rows = []
    camera = parallel(1.0, (1, 1))
    for count in COUNTS:
        opacity = 0.1 / count
        splats = dots(np.zeros((count, 3)), -np.log1p(-opacity) / peak())
        right = -np.expm1(count * np.log1p(-opacity))
        changes = [{"target": target} for target in TARGETS] + [{"order": "front-to-back"}, {"blend": "xray"}]
        alphas = [float(bench.draw(splats, camera, **change)[0, 0, 3]) for change in changes]
        alphas[-1] = float(-np.expm1(-alphas[-1]))
        rows.append((f"{count:.0e}", *(value / right - 1 for value in alphas)))
    table = Table(("splats", *TARGETS, "front first", "X-ray sum"), tuple(rows))
    return _page(
        "Very many splats, each of very small opacity, on one pixel: Σ opacity is 0.1, and 1 − exp(−0.1) is right. "
        "Every 'over' rounds the pixel to its own last place, 7e−9 at 0.1 in float32; a splat of 1e−7 loses up to 4 %, "
        "always in the same direction. Relative error of α:",
        ("By number of splats and frame buffer", table),
        "In 8 bits nothing below 1/510 counts, in half floats nothing below 3e−5. In float32 an error of 1e−3 takes "
        "some hundred thousand equal splats on one pixel; with the usual few hundred it is 1e−6. Drawn front to back "
        "the loss starts later. The remedy is to sum optical depth in blocks.",
    )


def thick_edge(bench: Bench) -> str:
    """Page on the edge of a dense block: widening by each form and by supersampling."""
    columns = (*attenuation.FORMS, "a F/m²", "supersampled")
    alphas, halves = [], []
    for m in attenuation.EDGE_ZOOMS:
        edges = [attenuation.draw_edge(m, partial(bench.draw, attenuation=form)) for form in attenuation.FORMS]
        edges.append(attenuation.sum_edge(m, "paper"))
        edges.append(attenuation.draw_edge(m, partial(bench.draw, antialias="supersample", samples=2 * int(m))))
        alphas.append((m, *(e.outside for e in edges)))
        halves.append((m, *(e.crossing for e in edges)))
    return _page(
        f"The edge of {attenuation.LAYERS} layers of opacity {attenuation.DENSE:g}, m voxels a pixel. Splats "
        "are filtered before they hide each other: behind z_k each is as wide as a pixel's kernel, and dense matter "
        "is opaque as far as its kernels reach, up to 1.5 pixels beyond the edge. The right filter comes after "
        "visibility: supersampling.",
        ("α of the pixel one pixel outside of the edge (0 is right)", Table(("m", *columns), tuple(alphas))),
        ("Where α falls below a half, pixels beyond the edge (0 is right)", Table(("m", *columns), tuple(halves))),
        "More resolution (m towards 1) narrows it to half a voxel's kernel; more precision changes nothing. 'a F/m²' "
        "is the printed form, opacity times the footprint: it widens dense edges less, as it limits a layer to 0.99, "
        "but makes walls transparent (--explain wall-0.99).",
    )


def wall(bench: Bench) -> str:
    """Page on a closed wall of opacity 0.99: α by form and voxels a pixel."""
    rows = []
    for m in attenuation.WALL_ZOOMS:
        view = attenuation.Wall(m, False, 0.0)
        splats, camera = block(view.size, 0.99), view.camera()
        pictures = [bench.draw(splats, camera, attenuation=form) for form in attenuation.FORMS]
        pictures.append(bench.paper(splats, camera))
        rows.append((m, *(float(middle(p)[3]) for p in pictures), attenuation.printed_form(view, 0.99)))
    return _page(
        "A closed wall one voxel thick of opacity 0.99, straight on, m voxels a pixel: α of the middle pixel (0.99 is "
        "right). 'a F/m²' is the printed form in float64: a splat weakened by (z_k/z_v)² covers that share of its "
        "pixel, and its neighbours, which in a closed wall cover the rest, are taken to lie behind it at random; "
        "1 − exp(−0.99) = 0.63 is left. 'opacity' weakens the opacity of the splat's own footprint, 1 − exp(−τF), "
        "which is broader. Optical depths add up whatever lies where, so that a closed wall is right and a lone splat "
        "is too dense. 'paper' is the 8-bit picture.",
        ("α", Table(("m", *attenuation.FORMS, "paper", "a F/m²"), tuple(rows))),
        "Neither resolution nor precision changes this error of the model; supersampling does.",
    )


def _page(*parts: str | tuple[str, Table]) -> str:
    """Paragraphs and tables with their headings, wrapped to the page width."""
    blocks = [
        fill(part, TEXT_WIDTH) if isinstance(part, str) else f"{fill(part[0], TEXT_WIDTH)}\n{part[1].text()}"
        for part in parts
    ]
    return "\n\n".join(blocks)


PAGES: dict[str, Callable[[Bench], str]] = {
    "skin-over-fog": skin_over_fog,
    "thin-shell": thin_shell,
    "sheet-across-z_k": sheet_across_z_k,
    "million-faint": million_faint,
    "thick-edge": thick_edge,
    "wall-0.99": wall,
}


# widths of the table's columns in characters: 97 with the spaces between them
WIDTHS = (18, 24, 9, 9, 8, 8, 8, 6)
HEAD = ("case", "what", "right", "found", "error", "bound", "paper's", "")
# page width in characters
LINE_WIDTH = 96


def heading() -> str:
    """Names of the columns."""
    return _line(HEAD)


def line(result: Result) -> str:
    """Line of a case, with the check nearest to its bound, or farthest over it."""
    return _check_line(result.case.name, result.worst, result.ok)


def lines(result: Result) -> str:
    """All checks of a case, one per line."""
    return "\n".join(_check_line(result.case.name, check, check.ok) for check in result.checks)


def verdict(results: Sequence[Result]) -> str:
    """Number of cases within their bounds, and the names of the others."""
    broken = [result for result in results if not result.ok]
    pictures, bad = (sum(getattr(result, name) for result in results) for name in ("pictures", "bad_pixels"))
    seconds = sum(result.seconds for result in results)
    parts = [
        f"{len(results) - len(broken)} of {len(results)} cases keep their bounds; {pictures} pictures, "
        f"{bad} values in them not finite; {seconds:.0f} s"
    ]
    for result in broken:
        checks = "; ".join(check.what for check in result.checks if not check.ok)
        bad = f"{result.bad_pixels} values not finite" if result.bad_pixels else ""
        parts.append(f"broken: {result.case.name}: {'; '.join(filter(None, (checks, bad)))}")
    return "\n".join(fill(part, LINE_WIDTH) for part in parts)


def about(case: Case) -> str:
    """Description of a case."""
    parts = ((case.name, case.stresses), ("how", case.how), ("right", case.right))
    return "\n".join(fill(f"{name}: {text}", LINE_WIDTH, subsequent_indent="  ") for name, text in parts)


def as_markdown(results: Sequence[Result]) -> str:
    """Markdown table of all cases with the check nearest to its bound."""
    lines = []
    for result in results:
        worst = result.worst
        error, bound = (_error(value, worst.relative) for value in (worst.error, worst.bound))
        paper = "" if worst.paper_error is None else _error(worst.paper_error, worst.relative)
        marked = error if result.ok else f"**{error}**"
        lines.append((f"`{result.case.name}`", marked, bound, paper))
    table = Table(("case", "error", "bound", "paper's"), tuple(lines))
    return table.markdown()


def _check_line(name: str, check: Check, ok: bool) -> str:
    paper = "" if check.paper_error is None else _error(check.paper_error, check.relative)
    error, bound = (_error(value, check.relative) for value in (check.error, check.bound))
    values = f"{check.right:.4g}", f"{check.found:.4g}"
    return _line((name, check.what, *values, error, bound, paper, "ok" if ok else "BROKEN"))


def _line(cells: Sequence[str]) -> str:
    parts = []
    for n, (cell, width) in enumerate(zip(cells, WIDTHS, strict=True)):
        text = cell if len(cell) <= width else cell[: width - 1] + "…"
        parts.append(text.ljust(width) if n < 2 or n == len(WIDTHS) - 1 else text.rjust(width))
    return " ".join(parts).rstrip()


def _error(value: float, relative: bool) -> str:
    if np.isinf(value):
        return "∞"
    if not relative:
        return f"{value:.2g}"
    return f"{100 * value:.2g}%" if value < 0.1 else f"{100 * value:.0f}%"

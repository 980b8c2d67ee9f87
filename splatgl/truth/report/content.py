"""Content of a report, as blocks rendered alike by Markdown and HTML."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from splatgl.truth.report.front import ERRORS, cheapest, front, standing
from splatgl.truth.report.methods import AXES, TRUTHS, axis_of, methods
from splatgl.truth.report.results import Results, Row, Scene
from splatgl.truth.report.subject import LEVELS
from splatgl.truth.report.words import (
    Gist,
    as_milliseconds,
    grouped,
    milliseconds,
    number,
    relative,
    rivals,
    story,
    times,
)

INTRO = (
    "Each method draws the same view. Its time is the wall clock around a finished frame with its pixels read back: "
    "the median of {rounds} rounds in which every method has its turn, each round in another random order, each turn "
    "after a frame of the same that is not counted; in brackets the least and the most. Machines are not as fast at "
    "one time as at another: what other reports find within these brackets are the times over those of exact, round "
    "by round. Errors are those of linear, premultiplied light over all four channels; RMSE is relative to the truth's "
    "own root mean square. {truths} The sampled truth is drawn in float32; the ray integral is sampled more coarsely, "
    "and its difference from splats of the same samples added to the sampled truth. The field is sampled as coarsely, "
    "at {rays}×{rays} rays a pixel and {steps} points a voxel. Of a scene with a formula it is the formula, so that "
    "errors are those of a true picture. Of other samples it is what the b-spline reconstructs: methods with that "
    "kernel miss only what sheets, steps and pixels add, others also how far their field is from it. Extraction is "
    "not part of a frame: its seconds are in the table of all methods."
)
FRONT = (
    "A method is on the front if, beside every other that is as right or more, it takes less than 1/1.1 of the time in "
    "three quarters of the rounds; if it does so in a quarter or less beside one of them, that one dominates it; what "
    "is in between is told as such. Times are compared round by round, since whatever else a machine does falls on "
    "both: another report may find in between what is on the front or dominated here, but not the one to be the other. "
    "Errors that agree to 26 % count as the same; of methods of the same error and time the first stands for all."
)
PEERS = (
    "VTK casts rays through the same box of samples with the same camera, opacities over the same length, linear "
    "colours and head light. It interpolates samples and classifies what comes out, as methods classified after "
    "reconstruction do: it is on the front of the field with them. Against the other truths it is not comparable: "
    "splats classify voxels and mix what comes out. Its light is parallel, and it lights samples without a gradient by "
    "ambient light alone; its caster for the CPU interpolates the light of samples, not their gradients, which is "
    "brighter, and ends rays at an opacity of 0.992; the one for OpenGL writes 8 bits; at k×k its own samples are "
    "averaged."
)
FRONT_HEAD = ("method", "ms a frame", "times exact's", "RMSE", "maximum", "99.9 %", "over 1/255", "energy", "FLIP", "")
GIST_HEAD = (
    "scene",
    "splats, pixels",
    "RMSE of drawing, 1998",
    "exact",
    "",
    "time, exact : 1998",
    "antialiasing, 1998",
    "exact",
    "splatting itself",
    "the field, exact",
    "default",
    "nearest",
)
# name of the diagram without a scene
CONVERGENCE = "convergence"
NAMES = {"reference": "drawing", "sampled": "antialiasing", "integral": "splatting", "field": "the field"}


@dataclass(frozen=True)
class Heading:
    """A heading; level: 1 for the report's title, 2 and more for sections."""

    text: str
    level: int = 2


@dataclass(frozen=True)
class Text:
    """Paragraphs, one per line, or the items of a list."""

    lines: tuple[str, ...]
    bullets: bool = False


@dataclass(frozen=True)
class Table:
    """title: its caption. folded: collapsed by default, where possible. strong: highlighted rows."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    folded: bool = False
    strong: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Diagram:
    """Error against time of each method, for the scene of that name, or CONVERGENCE."""

    scene: str


@dataclass(frozen=True)
class Pictures:
    """Thumbnails of the scene of that name."""

    scene: str


Block = Heading | Text | Table | Diagram | Pictures


def blocks(results: Results) -> Iterator[Block]:
    """All blocks of the report, in reading order."""
    machine = results.head["machine"]
    yield Heading("Error against run time", 1)
    by = f"{machine['renderer']}, OpenGL {machine['opengl']}"
    yield Text((f"{by}; {machine['processor']}, {machine['cores']} cores.",))
    if len(results.scenes) > 1:
        yield _gists(results)
    for scene in results.scenes:
        yield from _scene(scene)
    if results.convergence:
        yield from _convergence(results)
    yield from _how(results)


def _gists(results: Results) -> Table:
    """A one-line summary of each scene."""
    rows = []
    for scene in results.scenes:
        gist = Gist.of(scene)
        drawn = (number(gist.old), number(gist.new), f"÷ {times(gist.gain)}" if gist.gain else "")
        cost = f"{gist.cost:.2g}" if gist.cost else ""
        width, height = scene.about["size"]
        size = f"{grouped(scene.about['splats'])}, {width}×{height}"
        fielded = *map(number, gist.field), f"{number(gist.nearest.error)}, {gist.nearest.name}" if gist.nearest else ""
        rows.append((scene.name, size, *drawn, cost, *map(number, gist.filtered), number(gist.least), *fielded))
    return Table("", GIST_HEAD, tuple(rows))


def _scene(scene: Scene) -> Iterator[Block]:
    about = scene.about
    width, height = about["size"]
    note = f" ({about['note']})" if about["note"] else ""
    yield Heading(scene.name)
    yield Text((f"{grouped(about['splats'])} splats{note}, {width}×{height} pixels.",))
    yield Text(tuple(story(scene)), bullets=True)
    yield Diagram(scene.name)
    yield Pictures(scene.name)
    yield _cheapest(scene)
    yield _tolerances(scene)
    for truth in scene.truths:
        yield _front(scene, truth)
    peers = [row for row in scene.rows if row.axis == "peers" and row.errors]
    if peers:
        for truth in ("integral", "field"):
            if truth in scene.truths:
                yield _table(f"Peers: {TRUTHS[truth]}", [(*_cells(scene, row, truth), "") for row in peers])
        yield Text((PEERS,))
    yield _all(scene)
    omitted = _omitted(scene)
    if omitted.rows:
        yield omitted


def _cells(scene: Scene, row: Row, truth: str) -> tuple[str, ...]:
    found = {name: row.error(truth, name) for name in ("rmse", "maximum", "p999", "share_over", "energy", "flip")}
    share = found["share_over"]
    return (
        row.method,
        milliseconds(row.timing),
        relative(row.timing, scene.usual),
        number(found["rmse"]),
        number(found["maximum"]),
        number(found["p999"]),
        "" if share is None else f"{100 * share:.2g} %",
        number(found["energy"]),
        number(found["flip"]),
    )


def _front(scene: Scene, truth: str) -> Table:
    """The Pareto front, from the fastest to the most accurate, including uncertain members."""
    points = rivals(truth, scene)
    cells = []
    for point in front(points, unsure=True):
        row, stands = scene.row(point.name), standing(point, points)
        if row is not None:
            cells.append((*_cells(scene, row, truth), "" if stands.word == "front" else str(stands)))
    return _table(f"The front: {TRUTHS[truth]}", cells)


def _table(title: str, cells: list[tuple[str, ...]]) -> Table:
    """Rows of FRONT_HEAD, without empty columns."""
    empty = {n for n in range(len(FRONT_HEAD)) if not any(line[n] for line in cells)}
    rows = tuple(tuple(cell for n, cell in enumerate(line) if n not in empty) for line in (FRONT_HEAD, *cells))
    return Table(title, rows[0], rows[1:])


def _cheapest(scene: Scene) -> Table:
    truths = scene.truths
    found = {truth: cheapest(rivals(truth, scene)) for truth in truths}
    rows = []
    for n, limit in enumerate(ERRORS):
        points = [found[truth][n][1] for truth in truths]
        if any(points):
            named = [f"{p.name}, {as_milliseconds(p.time.median)} ms" if p else "–" for p in points]
            rows.append(("1/255" if limit == 1 / 255 else number(limit), *named))
    return Table("The cheapest under each RMSE", ("RMSE", *(NAMES[truth] for truth in truths)), tuple(rows))


def _tolerances(scene: Scene) -> Table:
    """For each requested tolerance, the measured error and time."""
    rows: list[tuple[str, ...]] = []
    strong = set()
    for method in AXES["tolerance"].methods:
        row = scene.row(method.name)
        got = row.error("reference", "maximum") if row else None
        if row is None or got is None or row.tolerance is None:
            continue
        text, kept = verdict(got, row.tolerance, row.bound)
        text += f"; nothing to save: the picture of {row.same_as}" if row.same_as else ""
        if not kept:
            strong.add(len(rows))
        rows.append((number(row.tolerance), number(got), number(row.bound), milliseconds(row.timing), text))
    head = ("tolerance", "largest error", "bound", "ms a frame", "")
    return Table("Tolerance asked for, error got, time paid", head, tuple(rows), strong=frozenset(strong))


def verdict(error: float, tolerance: float, bound: float | None) -> tuple[str, bool]:
    """Whether a tolerance is met, as text, with the reason if not."""
    if error <= tolerance:
        sure = bound is not None and bound <= tolerance
        return ("kept, as promised" if sure else "kept; the picture's bound promises less"), True
    why = "what float32 and exact's second order beyond z_k leave at this size"
    said = "; the picture's bound says so" if bound is not None and bound >= error else "; BEYOND ITS BOUND"
    return f"not kept: {why}{said}", False


def _all(scene: Scene) -> Table:
    """Every method: its time, and its error and standing against each truth."""
    truths = scene.truths
    points = {truth: rivals(truth, scene) for truth in truths}
    rows = []
    for row in scene.rows:
        if row.omitted:
            continue
        times = milliseconds(row.timing), relative(row.timing, scene.usual), number(row.extraction)
        cells = [row.method, axis_of(row.method).name, *times]
        for truth in truths:
            own = next((p for p in points[truth] if p.name == row.method), None)
            error = number(row.error(truth))
            cells.append(f"{error} {standing(own, points[truth])}" if own else error)
        rows.append((*cells, f"the same picture as {row.same_as}" if row.same_as else ""))
    head = (
        "method",
        "what is varied",
        "ms a frame",
        "times exact's",
        "s to extract",
        *(f"RMSE, {NAMES[truth]}" for truth in truths),
        "",
    )
    return Table(f"All {len(rows)} methods", head, tuple(rows), folded=True)


def _omitted(scene: Scene) -> Table:
    rows = [(row.method, row.omitted) for row in scene.rows if row.omitted]
    rows += [(f"{row.method}, {NAMES[truth]}", why) for row in scene.rows for truth, why in row.missing.items()]
    rows += [(row.method, "not timed: interrupted") for row in scene.rows if row.timing is None and not row.omitted]
    return Table("Left out", ("what", "why"), tuple(rows), folded=True)


def _convergence(results: Results) -> Iterator[Block]:
    yield Heading("Convergence")
    yield Text(("A smooth ball of which everything is known. The order is the power of the error in what is refined.",))
    yield Diagram(CONVERGENCE)
    yield _orders(results)
    for line in results.convergence:
        orders = ["" if order is None else f"{order:.2f}" for order in line["orders"]]
        cells = zip(line["values"], line["errors"], orders, strict=True)
        rows = tuple((f"{value:g}", number(error), order) for value, error, order in cells)
        title = f"{line['study']}: expected order {line['expected']:g}; floor: {line['floor']}"
        yield Table(title, (line["unit"], "relative RMSE", "order"), rows, folded=True)


def _orders(results: Results) -> Table:
    """The observed and expected order of each study: the median of the orders between neighbours."""
    rows = []
    for line in results.convergence:
        orders = sorted(order for order in line["orders"] if order is not None)
        errors = f"{number(line['errors'][0])} … {number(line['errors'][-1])}"
        between = f"{line['values'][0]:g} … {line['values'][-1]:g} {line['unit']}"
        middle = f"{orders[len(orders) // 2]:.2f}" if orders else ""
        rows.append((line["study"], between, errors, middle, f"{line['expected']:g}", line["floor"]))
    head = ("what is refined", "from … to", "relative RMSE", "order", "expected", "what ends it")
    return Table("Observed orders, the median, beside the expected", head, tuple(rows))


def registry() -> Table:
    """Every method, by what is varied; also in splatgl/reference/README.md."""
    rows = tuple((axis.name, axis.about, " · ".join(m.name for m in axis.methods)) for axis in AXES.values())
    return Table(
        f"all {len(methods())} methods, by what is varied", ("axis", "what it is", "methods"), rows, folded=True
    )


def _how(results: Results) -> Iterator[Block]:
    head = results.head
    machine = head["machine"]
    yield Heading("How it was measured")
    truths = "; ".join(f"**{NAMES[truth]}**: against {about}" for truth, about in TRUTHS.items())
    level = LEVELS[head["level"]]
    how = {"rounds": head["rounds"], "rays": level.rays, "steps": level.steps}
    yield Text((INTRO.format(truths=f"What is measured: {truths}.", **how), FRONT))
    yield registry()
    versions = ", ".join(f"{name} {found}" for name, found in machine["versions"].items())
    yield Text((f"Level {head['level']}; {machine['system']}, Python {machine['python']}, {versions}.",))
    if not results.flip:
        yield Text(("FLIP left out: flip-evaluator is not installed (pip install 'splatgl[compare]').",))

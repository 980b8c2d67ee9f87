"""The blocks and sentences of an accuracy report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from splatgl.studies.accuracy.ground_truth import LEVELS
from splatgl.studies.accuracy.methods import AXES, DEFAULT, EXACT, PAPER, TRUTHS, axis_of, methods
from splatgl.studies.accuracy.pareto import ERRORS, FASTER, Point, Timing, cheapest, front, standing
from splatgl.studies.accuracy.sweep import Results, Row, Scene
from splatgl.studies.tables import Heading, Table, Text

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
    return Table(GIST_HEAD, tuple(rows))


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
    return Table(rows[0], rows[1:], title)


def _cheapest(scene: Scene) -> Table:
    truths = scene.truths
    found = {truth: cheapest(rivals(truth, scene)) for truth in truths}
    rows = []
    for n, limit in enumerate(ERRORS):
        points = [found[truth][n][1] for truth in truths]
        if any(points):
            named = [f"{p.name}, {as_milliseconds(p.time.median)} ms" if p else "–" for p in points]
            rows.append(("1/255" if limit == 1 / 255 else number(limit), *named))
    return Table(("RMSE", *(NAMES[truth] for truth in truths)), tuple(rows), "The cheapest under each RMSE")


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
    return Table(head, tuple(rows), "Tolerance asked for, error got, time paid", strong=frozenset(strong))


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
    return Table(head, tuple(rows), f"All {len(rows)} methods", folded=True)


def _omitted(scene: Scene) -> Table:
    rows = [(row.method, row.omitted) for row in scene.rows if row.omitted]
    rows += [(f"{row.method}, {NAMES[truth]}", why) for row in scene.rows for truth, why in row.missing.items()]
    rows += [(row.method, "not timed: interrupted") for row in scene.rows if row.timing is None and not row.omitted]
    return Table(("what", "why"), tuple(rows), "Left out", folded=True)


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
        yield Table((line["unit"], "relative RMSE", "order"), rows, title, folded=True)


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
    return Table(head, tuple(rows), "Observed orders, the median, beside the expected")


def registry() -> Table:
    """Every method, by what is varied; also in the guide."""
    rows = tuple((axis.name, axis.about, " · ".join(m.name for m in axis.methods)) for axis in AXES.values())
    title = f"all {len(methods())} methods, by what is varied"
    return Table(("axis", "what it is", "methods"), rows, title, folded=True)


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


def number(value: float | None) -> str:
    """Two digits: 0.00012 as 1.2e−4."""
    if value is None:
        return ""
    if value == 0 or 0.001 <= abs(value) < 1000:
        return f"{value:.2g}".replace("-", "−")
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−")


def grouped(count: float) -> str:
    """A whole number, in groups of three digits: 960 970."""
    return f"{count:,.0f}".replace(",", " ")


def times(factor: float) -> str:
    """A ratio to two digits: 27 000, 12, 1.4."""
    return grouped(float(f"{factor:.2g}")) if factor >= 100 else f"{factor:.2g}"


def milliseconds(timing: Timing | None) -> str:
    """The median with minimum and maximum."""
    if timing is None:
        return ""
    median, low, high = map(as_milliseconds, (timing.median, timing.low, timing.high))
    return f"{median} ({low}–{high})"


def relative(timing: Timing | None, other: Timing | None) -> str:
    """Ratio to the other's time: median with minimum and maximum."""
    if timing is None or other is None:
        return ""
    found = timing.over(other)
    return f"{found.median:.2g} ({found.low:.2g}–{found.high:.2g})"


def as_milliseconds(seconds: float) -> str:
    """Three digits, with all digits before the decimal point."""
    value = 1e3 * seconds
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def rivals(truth: str, scene: Scene) -> list[Point]:
    """The points that compete for the front of that truth."""
    return [p for p in scene.points(truth) if axis_of(p.name).competes(truth)]


@dataclass(frozen=True)
class Gist:
    """Key results of a scene; None if unknown.

    old, new: drawing errors of the paper's settings and of exact splats; cost: the ratio of their times, new over
    old. filtered: errors against supersampling, of both. least: the smallest error against the ray integral, by `best`.
    field: errors of exact splats and of the default settings against the field; nearest: the rival nearest to it.
    """

    old: float | None
    new: float | None
    cost: float | None
    filtered: tuple[float | None, float | None]
    least: float | None
    best: str
    field: tuple[float | None, float | None]
    nearest: Point | None

    @classmethod
    def of(cls, scene: Scene) -> Gist:
        """Compares a scene's rows of the paper's settings, of exact splats, and of the default settings."""
        paper, exact = scene.row(PAPER), scene.row(EXACT)
        before, now = (row.timing if row else None for row in (paper, exact))
        cost = now.over(before).median if now and before else None
        old, new = (row.error("reference") if row else None for row in (paper, exact))
        unfiltered, filtered = (row.error("sampled") if row else None for row in (paper, exact))
        best = min(rivals("integral", scene), key=lambda p: p.error, default=None)
        least, name = (best.error, best.name) if best else (None, "")
        own = scene.row(DEFAULT)
        field = exact.error("field") if exact else None, own.error("field") if own else None
        nearest = min(rivals("field", scene), key=lambda p: p.error, default=None)
        return cls(old, new, cost, (unfiltered, filtered), least, name, field, nearest)

    @property
    def gain(self) -> float | None:
        """Factor by which exact splats reduce the drawing error."""
        return self.old / self.new if self.old and self.new else None


def story(scene: Scene) -> list[str]:
    """Summary of the results, a sentence each."""
    gist = Gist.of(scene)
    found = (_drawing(gist), _filtering(scene, gist), _splatting(gist), _worth(scene), _field(scene, gist))
    return [text for text in found if text]


def caption(scene: Scene, truth: str) -> str:
    """Summary for one truth, as the caption of its diagram."""
    gist = Gist.of(scene)
    if truth == "reference" and gist.gain and gist.cost:
        return f"exact against 1998: error ÷ {times(gist.gain)}, time × {gist.cost:.2g}"
    if truth == "sampled" and gist.filtered[1]:
        return f"exact is {number(gist.filtered[1])} away, 1998 {number(gist.filtered[0])}"
    if truth == "integral" and gist.least:
        return f"nothing comes below {number(gist.least)}"
    if truth == "field" and gist.nearest and all(gist.field):
        exact, own = map(number, gist.field)
        return f"the default is {own} away, exact splats {exact}"
    return ""


def _drawing(gist: Gist) -> str:
    if not gist.gain or not gist.cost:
        return ""
    return (
        f"**Drawing**: exact errs {times(gist.gain)} times less than the settings of 1998 (RMSE {number(gist.new)} "
        f"against {number(gist.old)}), {'in' if gist.cost < 1 else 'at'} {gist.cost:.2g} times their time."
    )


def _filtering(scene: Scene, gist: Gist) -> str:
    exact = next((p for p in scene.points("sampled") if p.name == EXACT), None)
    if exact is None:
        return ""
    names = {method.name for method in AXES["supersampling"].methods}
    nearer = [p for p in scene.points("sampled") if p.name in names and p.error < exact.error]
    text = f"**Antialiasing**: stretched splats are within {number(exact.error)} of supersampling"
    if gist.filtered[0] is not None:
        text += f", those of 1998 within {number(gist.filtered[0])}"
    if not nearer:
        return text + "; no number of samples tried here is nearer."
    best = min(nearer, key=lambda p: p.time.median)
    ratio = best.time.over(exact.time).median
    how = "in as much time" if 1 / FASTER < ratio < FASTER else f"in {ratio:.2g} times their time"
    return text + f"; {best.name} samples a pixel get to {number(best.error)} {how}."


def _splatting(gist: Gist) -> str:
    if gist.least is None:
        return ""
    return (
        f"**Splatting itself**, which mixes what overlaps in the wrong order, leaves {number(gist.least)} against the "
        f"ray integral, however well it is drawn ({gist.best})."
    )


def _worth(scene: Scene) -> str:
    """Members of the front for drawing errors."""
    points = rivals("reference", scene)
    return f"**On the front** when drawing: {_members(points)}" if points else ""


def _field(scene: Scene, gist: Gist) -> str:
    """The errors against the field, and the members of its front; or why there is no field."""
    if scene.about.get("no_field"):
        return f"**The field** is no truth here: {scene.about['no_field']}."
    if gist.field[0] is None or gist.nearest is None:
        return ""
    what = "the formula" if scene.about.get("formula") else "the samples' b-spline"
    near, points = gist.nearest, rivals("field", scene)
    own = "" if gist.field[1] is None else f"the default is {number(gist.field[1])} away, "
    return (
        f"**The field itself** ({what}, classified after reconstruction): {own}exact splats {number(gist.field[0])}, "
        f"{near.name} {number(near.error)} in {as_milliseconds(near.time.median)} ms. On its front: {_members(points)}"
    )


def _members(points: list[Point]) -> str:
    """The front by name, and methods that the timings cannot distinguish from its members."""
    stands = {p.name: standing(p, points).word for p in points}
    text = ", ".join(p.name for p in front(points))
    unsure = [name for name, word in stands.items() if word == "unsure"]
    if unsure:
        text += "; perhaps " + ", ".join(unsure)
    beaten = list(stands.values()).count("dominated")
    return text + f". {beaten} more are dominated: another is as right, and not slower."

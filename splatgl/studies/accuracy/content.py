"""Blocks and sentences of an accuracy report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from splatgl.studies.accuracy.ground_truth import LEVELS
from splatgl.studies.accuracy.methods import (
    AXES,
    DEFAULT,
    EXACT,
    PAPER,
    PAPER_FLOAT,
    PAPER_TABLE,
    TRUTHS,
    axis_of,
    methods,
)
from splatgl.studies.accuracy.pareto import ERRORS, FASTER, Point, Timing, cheapest, dominance, front
from splatgl.studies.accuracy.sweep import Results, Row, SceneResults
from splatgl.studies.tables import Heading, Table, Text

INTRO = (
    "Each method draws the same view. Its time is the wall clock around a finished frame with its pixels read back: "
    "the median of {rounds} rounds in which every method has its turn, each round in another random order, each turn "
    "after a warm-up frame of the same method; minimum and maximum in brackets. The speed of a machine varies: "
    "reproducible are the times relative to exact, round by round. Errors are those of linear, premultiplied light "
    "over all four channels; RMSE is relative to the truth's own root mean square. {truths} The sampled truth is "
    "drawn in float32; the ray integral is sampled more coarsely, and its difference from splats of the same samples "
    "added to the sampled truth. The field is sampled as coarsely, at {rays}×{rays} rays a pixel and {steps} points a"
    " voxel. Of a scene with a formula it is the formula, so that errors are against the true picture. For other "
    "samples it is the b-spline reconstruction: methods with that kernel differ only by sheets, steps and pixels, "
    "others also by their reconstruction. Extraction is not part of a frame: its seconds are in the table of all "
    "methods."
)
FRONT = (
    "A method is on the front if it takes less than 1/1.1 of the time of every method that is as accurate or more, in "
    "three quarters of the rounds. If it does so in a quarter of the rounds or less, the other method dominates it; "
    "cases in between are marked. Times are compared round by round, since other load on the machine slows both "
    "methods: another report may mark a method of the front as uncertain, but not as dominated. Errors that agree to "
    "26 % count as equal; of methods with equal error and time the first represents all."
)
PEERS = (
    "VTK casts rays through the same box of samples with the same camera, opacities over the same length, linear "
    "colours and head light. It interpolates samples and classifies the result, as methods classified after "
    "reconstruction do, and competes with them on the front of the field. It is not comparable against other truths: "
    "splats classify voxels and blend the results. Its light is parallel, and it lights samples without a gradient by "
    "ambient light alone; its caster for the CPU interpolates the light of samples, not their gradients, which is "
    "brighter, and ends rays at an opacity of 0.992; the one for OpenGL writes 8 bits; at k×k its own samples are "
    "averaged."
)
FRONT_HEAD = ("method", "ms a frame", "times exact's", "RMSE", "maximum", "99.9 %", "over 1/255", "energy", "FLIP", "")
# what errors are against, for newcomers
PLAIN = {
    "reference": "an exact drawing of the same splats",
    "sampled": "the same splats at many samples a pixel",
    "integral": "light along each ray through the splats",
    "field": "the true picture",
}
# a preview errs at most this many times as much as the default, and takes less than the default by this factor
PREVIEW_ERROR, PREVIEW_TIME = 3.0, 1.5
SUMMARY_HEAD = (
    "scene",
    "splats, pixels",
    "RMSE of drawing, forms of 1998",
    "their 8-bit table",
    "and blending",
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
# end of the name of a scene's diagram for deciding
OVERVIEW = "-overview"
NAMES = {"reference": "drawing", "sampled": "antialiasing", "integral": "splatting", "field": "the field"}


@dataclass(frozen=True)
class Diagram:
    """Error against time of each method, for the scene of that name, with OVERVIEW the few to choose from; or
    CONVERGENCE.
    """

    scene: str
    folded: bool = False


@dataclass(frozen=True)
class Pictures:
    """Thumbnails of the scene of that name."""

    scene: str


Block = Heading | Text | Table | Diagram | Pictures


def blocks(results: Results) -> Iterator[Block]:
    """All blocks of the report, in reading order."""
    machine = results.head["machine"]
    yield Heading("Error against run time", 1)
    yield from _decide(results)
    by = f"{machine['renderer']}, OpenGL {machine['opengl']}"
    yield Text((f"{by}; {machine['processor']}, {machine['cores']} cores.",))
    if len(results.scenes) > 1:
        yield _summaries(results)
    for scene in results.scenes:
        yield from _scene(scene)
    if results.convergence:
        yield from _convergence(results)
    yield from _how(results)


@dataclass(frozen=True)
class Choice:
    """A method that is recommended for a purpose: default, previews or print."""

    purpose: str
    point: Point

    @property
    def text(self) -> str:
        """Its name, error and time."""
        return f"{methods()[self.point.name].words}: {percent(self.point.error)} off in {self.time}"

    @property
    def time(self) -> str:
        """Milliseconds a frame."""
        return f"{as_milliseconds(self.point.time.median)} ms"


def percent(error: float) -> str:
    """A relative error in per cent."""
    return f"{number(100 * error)} %"


def deciding_truth(scene: SceneResults) -> str:
    """The truth that includes most errors, of those that the default is measured against; "" for none."""
    return next((truth for truth in reversed(scene.truths) if scene.error(DEFAULT, truth) is not None), "")


def choices(scene: SceneResults) -> tuple[Choice, ...]:
    """Methods that are recommended for a scene: the default, a fast one for previews, the most accurate one for print.

    Empty if the default was not measured. What is no better than the default is the default.
    """
    truth = deciding_truth(scene)
    error, time = scene.error(DEFAULT, truth), scene.timing(DEFAULT)
    if not truth or error is None or time is None:
        return ()
    default = Point(DEFAULT, error, time)
    others = [p for p in rivals(truth, scene) if p.name != DEFAULT and not methods()[p.name].peer]
    quick = [p for p in others if p.error <= PREVIEW_ERROR * error and time.over(p.time).median >= PREVIEW_TIME]
    finer = [p for p in others if p.rounded < default.rounded]
    fastest = min(quick, key=lambda p: p.time.median, default=default)
    best = min(finer, key=lambda p: p.error, default=default)
    return Choice("default", default), Choice("previews", fastest), Choice("print", best)


def _decide(results: Results) -> Iterator[Block]:
    """Recommendation in one sentence a scene, and a table."""
    rows, sentences = [], []
    several = len(results.scenes) > 1
    for scene in results.scenes:
        made = choices(scene)
        if not made:
            continue
        default = made[0]
        also = "".join(f", for {c.purpose}, too" for c in made[1:] if c.point.name == DEFAULT)
        others = "".join(f"; for {c.purpose} {c.text}" for c in made[1:] if c.point.name != DEFAULT)
        start = f"{scene.name}: " if several else ""
        sentences.append(f"{start}**Take the default** ({default.text.partition(': ')[2]}){also}{others}.")
        for choice in made:
            method = methods()[choice.point.name]
            name = f"{method.words} ({method.options})" if method.options else method.words
            what = f"{scene.name}, {choice.purpose}" if several else choice.purpose
            rows.append((what, name, percent(choice.point.error), choice.time))
    if rows:
        truths = {PLAIN[deciding_truth(scene)] for scene in results.scenes if choices(scene)}
        yield Text((*sentences, f"Off: root mean square of the differences from {' or '.join(sorted(truths))}."))
        yield Table(("for", "take", "off", "a frame"), tuple(rows))


def _summaries(results: Results) -> Table:
    """Summary table, a row per scene."""
    rows = []
    for scene in results.scenes:
        summary = Summary.of(scene)
        errors = map(number, (summary.old, summary.table, summary.blending, summary.new))
        drawing = (*errors, f"÷ {times(summary.gain)}" if summary.gain else "")
        cost = f"{summary.cost:.2g}" if summary.cost else ""
        width, height = scene.about["size"]
        size = f"{group_digits(scene.about['splats'])}, {width}×{height}"
        nearest = f"{number(summary.nearest.error)}, {summary.nearest.name}" if summary.nearest else ""
        errors = map(number, (*summary.filtered, summary.best.error if summary.best else None, *summary.field))
        rows.append((scene.name, size, *drawing, cost, *errors, nearest))
    return Table(SUMMARY_HEAD, tuple(rows))


def _scene(scene: SceneResults) -> Iterator[Block]:
    about = scene.about
    width, height = about["size"]
    note = f" ({about['note']})" if about["note"] else ""
    yield Heading(scene.name)
    yield Text((f"{group_digits(about['splats'])} splats{note}, {width}×{height} pixels.",))
    yield Diagram(f"{scene.name}{OVERVIEW}")
    yield Text(tuple(conclusion(scene)), bullets=True)
    yield Diagram(scene.name, folded=True)
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
    omitted = [(row.method, row.omitted) for row in scene.rows if row.omitted]
    omitted += [(f"{row.method}, {NAMES[truth]}", why) for row in scene.rows for truth, why in row.missing.items()]
    omitted += [(row.method, "not timed: interrupted") for row in scene.rows if row.timing is None and not row.omitted]
    if omitted:
        yield Table(("what", "why"), tuple(omitted), "Left out", folded=True)


def _cells(scene: SceneResults, row: Row, truth: str) -> tuple[str, ...]:
    """Cells of FRONT_HEAD but the last."""
    rmse, maximum, p999, energy, flip = (
        number(row.error(truth, name)) for name in ("rmse", "maximum", "p999", "energy", "flip")
    )
    share = row.error(truth, "share_over")
    over = "" if share is None else f"{100 * share:.2g} %"
    times = milliseconds(row.timing), relative(row.timing, scene.timing(EXACT))
    return (row.method, *times, rmse, maximum, p999, over, energy, flip)


def _front(scene: SceneResults, truth: str) -> Table:
    """Pareto front, from the fastest to the most accurate method, with uncertain members."""
    points = rivals(truth, scene)
    cells = []
    for point in front(points, unsure=True):
        row, stands = scene.row(point.name), dominance(point, points)
        if row is not None:
            cells.append((*_cells(scene, row, truth), "" if stands.word == "front" else str(stands)))
    return _table(f"The front: {TRUTHS[truth]}", cells)


def _table(title: str, cells: list[tuple[str, ...]]) -> Table:
    """Table with FRONT_HEAD, without empty columns."""
    empty = {n for n in range(len(FRONT_HEAD)) if not any(line[n] for line in cells)}
    rows = tuple(tuple(cell for n, cell in enumerate(line) if n not in empty) for line in (FRONT_HEAD, *cells))
    return Table(rows[0], rows[1:], title)


def _cheapest(scene: SceneResults) -> Table:
    truths = scene.truths
    best = {truth: cheapest(rivals(truth, scene)) for truth in truths}
    rows = []
    for n, limit in enumerate(ERRORS):
        points = [best[truth][n][1] for truth in truths]
        if any(points):
            named = [f"{p.name}, {as_milliseconds(p.time.median)} ms" if p else "–" for p in points]
            rows.append(("1/255" if limit == 1 / 255 else number(limit), *named))
    return Table(("RMSE", *(NAMES[truth] for truth in truths)), tuple(rows), "The cheapest under each RMSE")


def _tolerances(scene: SceneResults) -> Table:
    """Measured error and time of each requested tolerance."""
    rows: list[tuple[str, ...]] = []
    strong = set()
    for method in AXES["tolerance"].methods:
        row = scene.row(method.name)
        got = row.error("reference", "maximum") if row else None
        if row is None or got is None or row.tolerance is None:
            continue
        text, is_met = verdict(got, row.tolerance, row.bound)
        text += f"; nothing to save: the picture of {row.same_as}" if row.same_as else ""
        if not is_met:
            strong.add(len(rows))
        rows.append((number(row.tolerance), number(got), number(row.bound), milliseconds(row.timing), text))
    head = ("tolerance", "largest error", "bound", "ms a frame", "")
    return Table(head, tuple(rows), "Tolerance asked for, error got, time paid", strong=frozenset(strong))


def verdict(error: float, tolerance: float, bound: float | None) -> tuple[str, bool]:
    """(text with the reason, whether the tolerance is met)."""
    if error <= tolerance:
        sure = bound is not None and bound <= tolerance
        return ("kept, as promised" if sure else "kept; the picture's bound promises less"), True
    why = "what float32 and exact's second order beyond z_k leave at this size"
    said = "; the picture's bound says so" if bound is not None and bound >= error else "; BEYOND ITS BOUND"
    return f"not kept: {why}{said}", False


def _all(scene: SceneResults) -> Table:
    """Table of all methods: time, and error and dominance against each truth."""
    truths = scene.truths
    points = {truth: rivals(truth, scene) for truth in truths}
    rows = []
    for row in scene.rows:
        if row.omitted:
            continue
        times = milliseconds(row.timing), relative(row.timing, scene.timing(EXACT)), number(row.extraction)
        cells = [row.method, axis_of(row.method).name, *times]
        for truth in truths:
            point = next((p for p in points[truth] if p.name == row.method), None)
            error = number(row.error(truth))
            cells.append(f"{error} {dominance(point, points[truth])}" if point else error)
        rows.append((*cells, f"the same picture as {row.same_as}" if row.same_as else ""))
    errors = (f"RMSE, {NAMES[truth]}" for truth in truths)
    head = ("method", "what is varied", "ms a frame", "times exact's", "s to extract", *errors, "")
    return Table(head, tuple(rows), f"All {len(rows)} methods", folded=True)


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
    """Observed order of each study, the median between neighbours, and the expected order."""
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
    """All methods by axis; also in the guide."""
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
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
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


def group_digits(count: float) -> str:
    """A whole number, in groups of three digits: 960 970."""
    return f"{count:,.0f}".replace(",", " ")


def times(factor: float) -> str:
    """A ratio to two digits: 27 000, 12, 1.4."""
    return group_digits(float(f"{factor:.2g}")) if factor >= 100 else f"{factor:.2g}"


def milliseconds(timing: Timing | None) -> str:
    """Median with minimum and maximum."""
    if timing is None:
        return ""
    median, low, high = map(as_milliseconds, (timing.median, timing.low, timing.high))
    return f"{median} ({low}–{high})"


def relative(timing: Timing | None, other: Timing | None) -> str:
    """Ratio to the other's time: median with minimum and maximum."""
    if timing is None or other is None:
        return ""
    ratio = timing.over(other)
    return f"{ratio.median:.2g} ({ratio.low:.2g}–{ratio.high:.2g})"


def as_milliseconds(seconds: float) -> str:
    """Three digits, with all digits before the decimal point."""
    value = 1e3 * seconds
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def rivals(truth: str, scene: SceneResults) -> list[Point]:
    """Points that compete for the front of that truth."""
    return [p for p in scene.points(truth) if axis_of(p.name).competes(truth)]


@dataclass(frozen=True)
class Summary:
    """Key results of a scene; None if unknown.

    old, new: drawing errors of the paper's forms, without 8 bits, and of exact splats. table, blending: of the paper's
    settings with its table of 8 bits, and with its framebuffer too, against what that mixes. cost: ratio of times, new
    over the paper's. filtered: errors of old and new against supersampling. best: the rival nearest to the ray
    integral. field: errors of exact splats and of the default settings against the field; nearest: the rival nearest
    to it.
    """

    old: float | None
    new: float | None
    table: float | None
    blending: float | None
    cost: float | None
    filtered: tuple[float | None, float | None]
    best: Point | None
    field: tuple[float | None, float | None]
    nearest: Point | None

    @classmethod
    def of(cls, scene: SceneResults) -> Summary:
        """Compares a scene's rows of the paper's settings, of exact splats, and of the default settings."""
        before, now = scene.timing(PAPER), scene.timing(EXACT)
        best, nearest = (
            min(rivals(truth, scene), key=lambda p: p.error, default=None) for truth in ("integral", "field")
        )
        return cls(
            old=scene.error(PAPER_FLOAT, "reference"),
            new=scene.error(EXACT, "reference"),
            table=scene.error(PAPER_TABLE, "reference"),
            blending=scene.error(PAPER, "reference"),
            cost=now.over(before).median if now and before else None,
            filtered=(scene.error(PAPER_FLOAT, "sampled"), scene.error(EXACT, "sampled")),
            best=best,
            field=(scene.error(EXACT, "field"), scene.error(DEFAULT, "field")),
            nearest=nearest,
        )

    @property
    def gain(self) -> float | None:
        """Factor by which exact splats reduce the drawing error."""
        return self.old / self.new if self.old and self.new else None


def conclusion(scene: SceneResults) -> list[str]:
    """Sentences about the results."""
    summary = Summary.of(scene)
    points = rivals("reference", scene)
    on_front = f"**On the front** when drawing: {_members(points)}" if points else ""
    texts = _drawing(summary), _filtering(scene, summary), _splatting(summary), on_front, _field(scene, summary)
    return [text for text in texts if text]


def caption(scene: SceneResults, truth: str) -> str:
    """Caption of the diagram for one truth."""
    summary = Summary.of(scene)
    if truth == "reference" and summary.gain and summary.cost:
        return f"exact against the forms of 1998: error ÷ {times(summary.gain)}, time × {summary.cost:.2g}"
    if truth == "sampled" and summary.filtered[1]:
        return f"exact is {number(summary.filtered[1])} away, 1998 {number(summary.filtered[0])}"
    if truth == "integral" and summary.best and summary.best.error:
        return f"nothing comes below {number(summary.best.error)}"
    if truth == "field" and summary.nearest and all(summary.field):
        exact, default = map(number, summary.field)
        return f"the default is {default} away, exact splats {exact}"
    return ""


def _drawing(summary: Summary) -> str:
    if not summary.gain or not summary.cost:
        return ""
    text = (
        f"**Drawing**: exact errs {times(summary.gain)} times less than the forms of 1998 "
        f"(RMSE {number(summary.new)} against {number(summary.old)}), "
        f"{'in' if summary.cost < 1 else 'at'} {summary.cost:.2g} times their time."
    )
    if summary.table is None or summary.blending is None:
        return text
    return (
        f"{text} With tables of 8 bits these err by {number(summary.table)}, and if display values are blended in 8 "
        f"bits, too, by {number(summary.blending)}, which is measured against blending those in float64."
    )


def _filtering(scene: SceneResults, summary: Summary) -> str:
    exact = next((p for p in scene.points("sampled") if p.name == EXACT), None)
    if exact is None:
        return ""
    names = {method.name for method in AXES["supersampling"].methods}
    nearer = [p for p in scene.points("sampled") if p.name in names and p.error < exact.error]
    text = f"**Antialiasing**: stretched splats are within {number(exact.error)} of supersampling"
    if summary.filtered[0] is not None:
        text += f", those of 1998 within {number(summary.filtered[0])}"
    if not nearer:
        return text + "; no number of samples tried here is nearer."
    best = min(nearer, key=lambda p: p.time.median)
    ratio = best.time.over(exact.time).median
    how = "in as much time" if 1 / FASTER < ratio < FASTER else f"in {ratio:.2g} times their time"
    return text + f"; {best.name} samples a pixel get to {number(best.error)} {how}."


def _splatting(summary: Summary) -> str:
    if summary.best is None:
        return ""
    return (
        f"**Splatting itself**, which blends overlapping splats in the wrong order, leaves "
        f"{number(summary.best.error)} against the ray integral, however well it is drawn ({summary.best.name})."
    )


def _field(scene: SceneResults, summary: Summary) -> str:
    """Errors against the field and members of its front, or the reason why there is no field."""
    if scene.about.get("no_field"):
        return f"**The field** is no truth here: {scene.about['no_field']}."
    if summary.field[0] is None or summary.nearest is None:
        return ""
    what = "the formula" if scene.about.get("formula") else "the samples' b-spline"
    near, points = summary.nearest, rivals("field", scene)
    default = "" if summary.field[1] is None else f"the default is {number(summary.field[1])} away, "
    return (
        f"**The field itself** ({what}, classified after reconstruction): {default}exact splats "
        f"{number(summary.field[0])}, {near.name} {number(near.error)} in {as_milliseconds(near.time.median)} ms. "
        f"On its front: {_members(points)}"
    )


def _members(points: list[Point]) -> str:
    """Names of the front, and of methods that the timings cannot exclude."""
    stands = {p.name: dominance(p, points).word for p in points}
    text = ", ".join(p.name for p in front(points))
    unsure = [name for name, word in stands.items() if word == "unsure"]
    if unsure:
        text += "; perhaps " + ", ".join(unsure)
    beaten = list(stands.values()).count("dominated")
    return text + f". {beaten} more are dominated: another is as right, and not slower."

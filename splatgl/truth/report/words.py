"""Formatting of numbers, and sentences that summarize a scene's results."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.truth.report.front import FASTER, Point, Timing, front, standing
from splatgl.truth.report.methods import AXES, DEFAULT, EXACT, PAPER, axis_of
from splatgl.truth.report.results import Scene


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

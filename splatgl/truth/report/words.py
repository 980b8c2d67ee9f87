"""Numbers as a reader wants them, and what a scene's numbers say in sentences."""

from __future__ import annotations

from splatgl.truth.report.front import ALIKE, Point, Timing, front, standing
from splatgl.truth.report.methods import AXES, DEFAULT, PAPER, axis_of
from splatgl.truth.report.results import Row, Scene


def number(value: float | None) -> str:
    """Two digits: 0.00012 as 1.2e−4."""
    if value is None:
        return ""
    if value == 0 or 0.001 <= abs(value) < 1000:
        return f"{value:.2g}".replace("-", "−")
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}".replace("-", "−")


def times(factor: float) -> str:
    """A ratio in words: 27 000, 12, 1.4."""
    if factor >= 100:
        digits = f"{float(f'{factor:.2g}'):,.0f}".replace(",", " ")
        return digits
    return f"{factor:.2g}"


def milliseconds(timing: Timing | None) -> str:
    """The median, and the quartiles around it."""
    if timing is None:
        return ""
    return f"{_ms(timing.median)} ({_ms(timing.low)}–{_ms(timing.high)})"


def _ms(seconds: float) -> str:
    value = 1e3 * seconds
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def story(scene: Scene) -> list[str]:
    """What the numbers say, a sentence each."""
    return [text for text in (_against_paper(scene), _filtering(scene), _splatting(scene), _needless(scene)) if text]


def rivals(truth: str, scene: Scene) -> list[Point]:
    """The points that compete for the front of that truth."""
    return [p for p in scene.points(truth) if truth in axis_of(p.name).truths and axis_of(p.name).competes]


def _pair(scene: Scene, truth: str) -> tuple[Row, Row, float, float] | None:
    """The paper's row and the default one, and their errors."""
    rows = scene.row(PAPER), scene.row(DEFAULT)
    if rows[0] is None or rows[1] is None:
        return None
    old, new = rows[0].error(truth), rows[1].error(truth)
    if not old or not new or rows[0].timing is None or rows[1].timing is None:
        return None
    return rows[0], rows[1], old, new


def _against_paper(scene: Scene) -> str:
    found = _pair(scene, "reference")
    if found is None:
        return ""
    paper, exact, old, new = found
    assert paper.timing is not None and exact.timing is not None
    cost = exact.timing.median / paper.timing.median
    verb = "in" if cost < 1 else "at"
    return (
        f"Drawing: exact errs {times(old / new)} times less than the settings of 1998 (RMSE {number(new)} against "
        f"{number(old)}), {verb} {cost:.2g} times their time."
    )


def _filtering(scene: Scene) -> str:
    exact = next((p for p in scene.points("sampled") if p.name == DEFAULT), None)
    if exact is None:
        return ""
    names = {method.name for method in AXES["supersampling"].methods}
    nearer = [p for p in scene.points("sampled") if p.name in names and p.error < exact.error]
    text = f"Antialiasing: stretched splats are within {number(exact.error)} of supersampling"
    found = _pair(scene, "sampled")
    if found is not None:
        text += f", those of 1998 within {number(found[2])}"
    if not nearer:
        return text + "; no number of samples tried here is nearer."
    best = min(nearer, key=lambda p: p.time.median)
    ratio = best.time.median / exact.time.median
    how = "in as much time" if 1 / ALIKE < ratio < ALIKE else f"in {ratio:.2g} times their time"
    return text + f"; {best.name} samples a pixel get to {number(best.error)} {how}."


def _splatting(scene: Scene) -> str:
    points = rivals("integral", scene)
    if not points:
        return ""
    best = min(points, key=lambda p: p.error)
    return (
        f"Splatting itself, which mixes what overlaps in the wrong order, leaves {number(best.error)} against the "
        f"ray integral, however well it is drawn ({best.name})."
    )


def _needless(scene: Scene) -> str:
    """What costs more than what is at least as right, beyond the spread."""
    points = rivals("reference", scene)
    if not points:
        return ""
    beaten_by = [p.name for p in points if standing(p, points).startswith("dominated")]
    text = "Worth their time when drawing: " + ", ".join(p.name for p in front(points)) + "."
    if beaten_by:
        text += " Another is as right and faster: " + ", ".join(beaten_by) + "."
    return text

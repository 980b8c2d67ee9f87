"""HUD text: device, splat counts, omitted splats, frame time, z_k, and the plan."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from splatgl.data.volume import Volume
from splatgl.planning.plan import Plan
from splatgl.transfer.statistics import Statistics
from splatgl.viewer.adaptive_quality import FULL, Level
from splatgl.viewer.document import Document
from splatgl.viewer.reference_view import Difference
from splatgl.viewer.state import State


@dataclass(frozen=True, eq=False)
class Frame:
    """The displayed frame: the renderer's info, seconds, level and plan. beyond: the share of splats beyond z_k.

    hidden: number of splats omitted because no view shows them. blurred: whether motion blur was applied.
    off: for a full frame that replaced a preview, the preview's error against it. whole: seconds of a frame in motion
    with its text, panel and display, as measured before this one.
    """

    info: Mapping[str, object]
    seconds: float
    level: Level
    plan: Plan
    beyond: Callable[[], float]
    hidden: int
    blurred: bool = False
    off: Difference | None = None
    whole: float = 0.0

    @property
    def full(self) -> bool:
        """Whether this is the full-quality frame, not a preview."""
        return self.level == FULL and not self.blurred

    @property
    def given_up(self) -> str:
        """Text listing the quality reductions of a preview."""
        return f"{self.level}{', blurred' if self.blurred else ''}"


def short_lines(state: State, document: Document, frame: Frame | None, busy: str | None) -> tuple[str, ...]:
    """File, view and quality."""
    name = document.volume.name or document.scene.volume
    camera = state.pose.camera
    view = f"perspective, {state.pose.fov:.3g} degrees" if camera.perspective else "orthographic"
    notes = [document.stand_in.note] if document.stand_in and document.stand_in.note else []
    if document.is_loading:
        return (name, *([busy] if busy else []))
    return (name, *notes, view, busy or progress_text(frame))


def full_lines(state: State, document: Document, frame: Frame | None, busy: str | None) -> tuple[str, ...]:
    """Device, splats, time, z_k, error bound and plan of the picture."""
    if frame is None or document.is_loading:
        return short_lines(state, document, frame, busy)
    info, size = frame.info, state.pose.camera.size
    return (
        f"{document.volume.name or document.scene.volume}  {size[0]} x {size[1]}",
        f"{info['renderer']} ({info['backend']})",
        *_splats(document, frame),
        *_instead(state, document),
        *_pace(state, frame, busy),
        _depths(document, frame),
        *_bound(info),
        "",
        *frame.plan.explain().splitlines(),
    )


# names of types of samples
KINDS = {"b": "truth values", "i": "whole numbers", "u": "whole numbers", "f": "decimal numbers"}


def describe_volume(volume: Volume, stats: Statistics, segments: int) -> str:
    """Sentences on the voxels and values of a volume. segments: their number, 0 for amounts."""
    size = " x ".join(map(str, reversed(volume.shape)))
    steps = tuple(f"{step:.4g}" for step in volume.spacing)
    apart = " x ".join(steps if len(set(steps)) > 1 else steps[:1])
    kind = np.dtype(volume.samples.dtype)
    text = f"{size} voxels, {apart} {volume.unit}".rstrip() + f" apart, {8 * kind.itemsize}-bit {KINDS[kind.kind]}."
    if segments:
        return f"{text} They number {segments:,} segment{'s' * (segments > 1)}."
    if not len(stats.values):
        return f"{text} No value is finite."
    ends = [
        f"{number:.4g}" for number in (stats.percentile(25), stats.percentile(75), stats.values[0], stats.values[-1])
    ]
    unit = f" {volume.value_unit}".rstrip()
    return f"{text} Values: half from {ends[0]} to {ends[1]}{unit}, all from {ends[2]} to {ends[3]}{unit}."


def describe_picture(document: Document, frame: Frame | None) -> str:
    """Sentences on what the picture shows, how long it took, and how exact it is."""
    if frame is None or document.is_loading:
        return "No picture yet."
    if not frame.full:
        return f"A picture in motion, coarser than at rest, in {frame.seconds:.2g} s."
    layers, bound = document.drawn_layers, frame.info.get("error_bound")
    share = sum(len(layer.finest) for layer in layers) / max(sum(layer.volume.count for layer in layers), 1)
    exact = f", and is right to {bound:.2g} of full brightness" if isinstance(bound, float) else ""
    return f"{100 * share:.2g} % of the voxels have an opacity. The picture took {frame.seconds:.2g} s{exact}."


def progress_text(frame: Frame | None) -> str:
    """Short text on the quality of the frame relative to the settings, and the rate of frames in motion."""
    if frame is None:
        return ""
    if frame.full:
        bound = frame.info.get("error_bound")
        return f"refined: error at most {bound:.2g}" if isinstance(bound, float) else "refined"
    rate = f"{1 / frame.whole:.0f} frames/s, " if frame.whole else ""
    return f"moving: {rate}{frame.given_up}"


def _splats(document: Document, frame: Frame) -> list[str]:
    """The visible part of the volume, numbers of drawn and total splats, and why the others are missing."""
    layers, first = document.drawn_layers, document.layers[0]
    kept, total = sum(len(layer.finest) for layer in layers), sum(layer.volume.count for layer in layers)
    notes = [document.stand_in.note] if document.stand_in and document.stand_in.note else []
    if frame.level.stride > 1 or 1 not in document.extracted:
        return [*notes, f"of {total:,} voxels, blocks of {frame.level.stride}^3 are drawn"]
    most = f"at most {first.threshold:g}" if first.threshold else "0"
    left = f"the rest: opacity {most}{' around' * first.is_post_classified}"
    notes.append(f"{kept:,} of {total:,} voxels are splats ({left})")
    drawn = frame.info.get("drawn", kept - frame.hidden)
    if isinstance(drawn, int) and drawn < kept:
        notes.append(f"{drawn:,} drawn; the rest can't be seen from here")
    return notes


def _instead(state: State, document: Document) -> list[str]:
    """The reason why splats are classified before reconstruction although the settings ask for after."""
    if document.layers[0].is_post_classified or state.settings.classification != "post":
        return []
    why = document.layers[0].why_pre_classified(state.moving, True)
    return [f"{why} takes splats classified before reconstruction: so they are"]


def _pace(state: State, frame: Frame, busy: str | None) -> list[str]:
    rate = f"{frame.seconds * 1e3:.0f} ms"
    work = f", {busy} ..." if busy else ""
    if not frame.full:
        return [f"{rate}  moving: {frame.given_up}{work}"]
    lines = [f"{rate}  refined to {_tolerance(state.settings.tolerance)}{work}"]
    if frame.off is not None:
        lines.append(f"in motion it was off by RMSE {frame.off.rmse:.2g}, largest {frame.off.largest:.2g}")
    return lines


def _tolerance(tolerance: float) -> str:
    return f"1/{1 / tolerance:.0f}" if abs(1 / tolerance - round(1 / tolerance)) < 1e-6 else f"{tolerance:g}"


def _depths(document: Document, frame: Frame) -> str:
    z_k, unit = frame.plan.resolved.z_k, document.volume.unit
    if frame.plan.program.seen.perspective:
        return f"z_k = {z_k:.4g}{' ' + unit if unit else ''}, {frame.beyond():.0%} of the splats beyond"
    return "z_k: voxels are " + ("narrower" if z_k == 0 else "wider") + " than pixels everywhere"


def _bound(info: Mapping[str, object]) -> list[str]:
    bound, dropped = info.get("error_bound"), info.get("dropped_depth")
    lines = [f"error at most {bound:.2g}"] if isinstance(bound, float) else []
    if isinstance(dropped, float) and dropped > 0:
        lines.append(f"the threshold dropped an optical depth of up to {dropped:.2g}")
    if "tolerance_met" in info and not info["tolerance_met"]:
        lines.append("the tolerance could not be kept" if isinstance(bound, float) else "its error has no known bound")
    return lines

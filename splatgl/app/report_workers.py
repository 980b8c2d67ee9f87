"""`splatgl report --workers`: truths computed by workers, before anything is timed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from splatgl.app.report_scene import subject
from splatgl.distributed.worker import Drawing, kept, renderer
from splatgl.studies.accuracy.ground_truth import Level, Subject, Truths, Wanted
from splatgl.studies.accuracy.sweep import Task, truths_of

if TYPE_CHECKING:
    from distributed import Client

    from splatgl.gl.renderer import Renderer


def prepare(
    client: Client, here: Renderer, sources: Sequence[str], scenes: Sequence[Subject], task: Task, drawing: Drawing
) -> int:
    """Has workers compute the truths that are not in the folder, writes them there, and returns how many."""
    from splatgl.distributed.cluster import spread

    truths = {scene.name: Truths(here, scene, task.level, task.folder) for scene in scenes}
    items = []
    for source, scene in zip(sources, scenes, strict=True):
        there = str(Path(source).resolve()) if Path(source).exists() else source
        for wanted in truths_of(truths[scene.name], task):
            path = truths[scene.name].path(wanted[0])
            if path is not None and not path.exists():
                items.append((f"{scene.name}: {wanted[1]}", (there, scene.name, task.level, drawing, wanted)))
    for _, (name, key, pixels) in spread(client, _truth, items):
        truths[name].keep(key, pixels)
    return len(items)


def _truth(source: str, name: str, level: Level, drawing: Drawing, wanted: Wanted) -> tuple[str, str, np.ndarray]:
    """On a worker: one truth."""
    scene = kept((source, name, level), lambda: replace(subject(source, level), name=name))
    return name, wanted[0], Truths(renderer(drawing), scene, level).made(*wanted)

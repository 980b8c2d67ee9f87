"""Scenes of a report: from a source's name to splats and a camera, downsampled to the level's limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from splatgl.data.scenes import FORMULAS
from splatgl.data.volume import Volume, coarser
from splatgl.errors import expected
from splatgl.scene.scene_file import Scene
from splatgl.splat.extract import extract
from splatgl.splat.splats import Splats
from splatgl.splat.transfer import Transfer
from splatgl.studies.accuracy.content import CONVERGENCE
from splatgl.studies.accuracy.ground_truth import Level, Subject


def subjects(sources: Sequence[str], level: Level) -> list[Subject]:
    """The scenes of all sources, each with a unique name valid for files. InputError as `subject`."""
    found: list[Subject] = []
    for source in sources:
        made = subject(source, level)
        taken = {CONVERGENCE, *(each.name for each in found)}
        free = (f"{made.name}-{n}" for n in count(2))
        name = made.name if made.name not in taken else next(each for each in free if each not in taken)
        found.append(replace(made, name=name))
    return found


def subject(source: str, level: Level) -> Subject:
    """The scene of a source, downsampled until it has at most as many splats as the level allows."""
    scene = Scene.from_toml(Path(source)) if source.endswith(".toml") else Scene(source)
    scene.refuse_more()
    volume = scene.open()
    transfer, scene = scene.transfer_for(volume), scene.cut(volume)
    # keep the unit length of opacities when voxels are merged
    transfer = replace(transfer, unit=transfer.unit or float(abs(_volume_of_voxel(volume)) ** (1 / 3)))
    splats = extract(volume, transfer, scene.threshold, classification="pre")
    if not len(splats):
        raise expected(source, "voxels that are not transparent", "none", "give a scene.toml with a transfer function")
    camera = replace(scene.view, size=_fitted(scene.view.size, level.size)).camera(volume, splats)
    formula = FORMULAS.get(scene.volume) if not scene.load else None
    joined = 0
    # joined voxels would not be samples of the formula
    while formula is None and level.splats is not None and len(splats) > level.splats and min(volume.shape) > 1:
        joint = coarser(volume, bool(transfer.labels))
        fewer = extract(joint, transfer, scene.threshold, classification="pre")
        # thin structures may vanish when averaged with empty voxels
        if not len(fewer):
            break
        volume, splats, joined = joint, fewer, joined + 1
    note = f"voxels joined {2**joined}×{2**joined}×{2**joined}" if joined else ""
    build = _Build(volume, transfer, scene.threshold)
    name = Path(source).name.split(".")[0]
    return Subject(name, camera, scene.settings, build, note, (volume, transfer), formula)


class _Build:
    """Splats of a volume above a threshold, or of a downsampled one."""

    def __init__(self, volume: Volume, transfer: Transfer, threshold: float) -> None:
        self.volume, self.transfer, self.threshold = volume, transfer, threshold

    def __call__(self, threshold: float, coarse: int, post: str) -> Splats:
        volume = self.volume
        for _ in range(coarse):
            volume = coarser(volume, bool(self.transfer.labels))
        least = max(threshold, self.threshold)
        how = "post" if post else "pre"
        return extract(volume, self.transfer, least, classification=how, kernel=post)


def _volume_of_voxel(volume: Volume) -> float:
    return float(np.linalg.det(volume.world_from_index))


def _fitted(size: tuple[int, int], longest: int) -> tuple[int, int]:
    """The size scaled to `longest` pixels on its longer side."""
    scale = longest / max(size)
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))

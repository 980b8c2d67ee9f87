"""Meshes beside volumes: `--mesh`, and the tables [[mesh]] of scene files."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from splatgl.scene.meshes import MeshFile


def mesh_option(text: str) -> MeshFile:
    """An argparse type: the mesh of FILE[:COLOUR[:OPACITY]]; COLOUR: or MAP, MAP=ARRAY or =ARRAY."""
    file, look, opacity = with_look(text, _is_color, "COLOUR")
    color, _, array = look.partition("=")
    return MeshFile(file, color, opacity, array=array)


def _is_color(text: str) -> bool:
    return not any(sign in text.partition("=")[0] for sign in "./")


def with_look(text: str, is_look: Callable[[str], bool], word: str) -> tuple[str, str, float]:
    """File, look and opacity of FILE[:LOOK[:OPACITY]]; word: what argparse's error calls the look."""
    source, look, opacity = text, "", 1.0
    head, colon, last = source.rpartition(":")
    if colon and (number := _number(last)) is not None:
        source, opacity = head, number
        head, colon, last = source.rpartition(":")
    if colon and is_look(last):
        source, look = head, last
    if not source or not 0 <= opacity <= 1:
        told = f"expected FILE[:{word}[:OPACITY]] with an opacity from 0 to 1, got {text!r}"
        raise argparse.ArgumentTypeError(told)
    return source, look, opacity


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None

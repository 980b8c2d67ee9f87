"""Backgrounds of pictures: what is asked for, else white or black, as suits the transfer function."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.data.color import AUTO, CLEAR, Color
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.scene.scene_file import SceneFile


BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# files that are computed with: they keep alpha, unless a colour is asked for
DATA = (".npy", ".exr")


def suited(transfer: Transfer, settings: Settings) -> Color:
    """Black behind what glows and behind values along rays, white behind shaded surfaces."""
    surfaces = settings.shading == "on" or (settings.shading == "auto" and transfer.shading)
    return WHITE if surfaces and settings.blend == "composite" else BLACK


def as_drawn(volume: Volume, transfer: Transfer) -> Transfer:
    """The transfer function with the shading that is drawn: several channels glow."""
    return replace(transfer, shading=False) if len(volume.channels) > 1 else transfer


def backed(
    args: argparse.Namespace, scene: SceneFile, transfer: Transfer, output: Path, reference: Image | None = None
) -> SceneFile:
    """The scene with the background of its picture: what is asked for, else the reference's, else one that suits."""
    return replace(scene, settings=grounded(scene.settings, ground_of(args, scene, reference), transfer, output))


def ground_of(args: argparse.Namespace, scene: SceneFile, reference: Image | None = None) -> Color | str | None:
    """The background that is asked for, else the reference's, else AUTO; None where a scene.toml or a version says all
    there is to say.
    """
    if args.background is not None:
        found: Color | str = args.background
        return found
    if args.source.endswith(".toml") or "background" in scene.settings.given or args.like or args.paper:
        return None
    if reference is None:
        return AUTO
    match reference.info.get("background"):
        case [float() | int() as red, float() | int() as green, float() | int() as blue]:
            return float(red), float(green), float(blue)
    return CLEAR


def grounded(settings: Settings, asked: Color | str | None, transfer: Transfer, output: Path | None = None) -> Settings:
    """The settings with the background that is asked for. AUTO: one that suits, in a picture of light; none in DATA.

    output: the file that is written, if any.
    """
    if asked is None:
        return settings
    if asked == AUTO:
        data = (output is not None and output.suffix.lower() in DATA) or BLENDS[settings.blend].unbounded
        return settings.but(background=None if data else suited(transfer, settings))
    return settings.but(background=None if asked == CLEAR else asked)

"""Backgrounds of pictures: the requested one, else white or black, as suits the transfer function."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from splatgl.data.color import AUTO, CLEAR, Color
from splatgl.data.image import Image
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.scene.scene_file import SceneFile


BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
# files for computations: they keep alpha, unless a colour is requested
DATA = (".npy", ".exr")


def default_background(transfer: Transfer, settings: Settings) -> Color:
    """Black behind what glows and behind values along rays, white behind shaded surfaces."""
    surfaces = settings.shading == "on" or (settings.shading == "auto" and transfer.shading)
    return WHITE if surfaces and settings.blend == "composite" else BLACK


def requested_background(
    args: argparse.Namespace, file: SceneFile, reference: Image | None = None
) -> Color | str | None:
    """The background of --background, else of the reference, else AUTO; None: a scene.toml or a version decides."""
    if args.background is not None:
        color: Color | str = args.background
        return color
    if args.source.endswith(".toml") or "background" in file.settings.given or args.like or args.paper:
        return None
    if reference is None:
        return AUTO
    match reference.info.get("background"):
        case [float() | int() as red, float() | int() as green, float() | int() as blue]:
            return float(red), float(green), float(blue)
    return CLEAR


def with_background(
    settings: Settings, color: Color | str | None, transfer: Transfer, output: Path | None = None
) -> Settings:
    """The settings with a background. None: as they are. AUTO: the default one, in a picture of light; none in DATA.

    output: the file to write, if any.
    """
    if color is None:
        return settings
    if color == AUTO:
        is_data = (output is not None and output.suffix.lower() in DATA) or BLENDS[settings.blend].unbounded
        return settings.but(background=None if is_data else default_background(transfer, settings))
    return settings.but(background=None if color == CLEAR else color)

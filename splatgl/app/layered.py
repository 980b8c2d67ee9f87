"""Pictures of several volumes: `--layer`, and scene files with layers."""

from __future__ import annotations

import argparse
import re

from splatgl.app.meshes import mesh_option, with_look
from splatgl.app.vectors import add_vectors
from splatgl.scene.parse import color_of, window_of
from splatgl.scene.scene_file import Scene
from splatgl.splat.presets import is_preset
from splatgl.splat.segment_surfaces import SMOOTHING

# a preset or a colour map behind a file's name
LOOK = re.compile(r"#?[\w-]+")


def add_layers(parser: argparse.ArgumentParser) -> None:
    """Adds the options of what is drawn beside the volume, and of its channels."""
    parser.add_argument(
        "--layer",
        type=layer_option,
        action="append",
        metavar="FILE[:LOOK[:OPACITY]]",
        help="another volume in the picture, with a preset or a colour map, and a factor of its opacities",
    )
    parser.add_argument(
        "--color-of",
        type=color_of,
        action="append",
        metavar="CHANNEL=COLOR",
        help="the colour of a channel, #rrggbb or a name",
    )
    parser.add_argument(
        "--window-of", type=window_of, action="append", metavar="CHANNEL=LOW,HIGH", help="from clear to full"
    )
    about = "a surface (.ply, .stl, .obj, .vtp, …) or lines (.trk, .tck), a colour, or MAP=ARRAY for values, an opacity"
    parser.add_argument("--mesh", type=mesh_option, action="append", metavar="FILE[:COLOUR[:OPACITY]]", help=about)
    about = "--clip and --crop cut meshes, too"
    parser.add_argument("--clip-meshes", action="store_true", help=about)
    add_vectors(parser)
    parser.add_argument("--labels", metavar="FILE", help="a segmentation that is laid over the volume")
    about = f"segmentations as smooth closed surfaces, smoothed from 0 to 1 ({SMOOTHING}), instead of voxels"
    parser.add_argument("--surfaces", nargs="?", const=SMOOTHING, type=float, metavar="S", help=about)


def layer_option(text: str) -> Scene:
    """An argparse type: the layer of FILE[:LOOK[:OPACITY]]; LOOK: a preset or a colour map."""
    source, look, opacity = with_look(text, lambda last: not last or bool(LOOK.fullmatch(last)), "LOOK")
    return Scene(source, transfer={"preset" if is_preset(look) else "colormap": look} if look else {}, opacity=opacity)

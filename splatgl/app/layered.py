"""Pictures of several volumes: `--layer`, and scene files with layers."""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

from splatgl.app.meshes import is_mesh, mesh_option, surfaces_of, with_look
from splatgl.app.options import color_of, window_of
from splatgl.app.output import tell
from splatgl.app.scene import Scene
from splatgl.app.vectors import add_vectors
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import expected
from splatgl.fileio import size_of
from splatgl.splat.presets import is_preset
from splatgl.splat.segment_surfaces import SMOOTHING, is_segmentation
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.app.render import Drawing
    from splatgl.splat.clipping import Plane
    from splatgl.splat.scene import Layer
    from splatgl.splat.scene import Scene as Layers

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


def of_channels(
    scene: Scene, volume: Volume, transfer: Transfer, planes: tuple[Plane, ...] | None = None
) -> list[Layer]:
    """The layers of a volume: one for each of its channels. planes: their own."""
    from splatgl.splat.scene import Layer, channel_transfers

    colors, windows = (dict(scene.transfer.get(name, ())) for name in ("color_of", "window_of"))
    if len(volume.channels) < 2:
        if colors or windows:
            raise expected("--color-of and --window-of", "several channels", "one", "load more by --channel")
        return [Layer(volume, transfer, visible=scene.visible, threshold=scene.threshold, clip=planes)]
    if all(each.labels for each in volume.channels) and not (colors or windows):
        segments = segmented(scene, volume)
        return [Layer(each, look, 1.0, scene.visible, scene.threshold, planes) for each, look in segments]
    # of which each has the opacity below
    plain = replace(scene, opacity=1.0)
    base = plain.transfer_for(volume) if scene.transfer.keys() & {"points", "preset"} else None
    found = channel_transfers(volume, colors, windows, base)
    looks = zip(volume.channels, (each.weakened(scene.opacity) for each in found), strict=True)
    return [Layer(each, look, 1.0, scene.visible, scene.threshold, planes) for each, look in looks]


def segmented(scene: Scene, volume: Volume) -> list[tuple[Volume, Transfer]]:
    """The channels of overlapping segments with their transfer functions; one of which none is to be seen is clear."""
    only = scene.transfer.get("only_labels") or ()
    found = []
    for each in volume.channels:
        numbers = {label.number for label in each.labels or ()}
        mine = [(number, factor) for number, factor in only if number in numbers]
        looks = {**scene.transfer, "only_labels": mine} if only else scene.transfer
        look = replace(scene, transfer=looks).transfer_for(each)
        found.append((each, look if mine or not only else look.weakened(0.0)))
    return found


def is_layered(scene: Scene, volume: Volume) -> bool:
    """Whether a scene's picture is of several layers or channels, or has meshes."""
    of_channels = len(volume.channels) > 1 or scene.transfer.keys() & {"color_of", "window_of"}
    alone = is_mesh(scene.volume) or not scene.visible
    drawn = scene.surfaces is not None or scene.vectors.drawn
    return bool(scene.layers or scene.meshes or drawn or of_channels or alone)


def layers_of(scene: Scene, volume: Volume, transfer: Transfer, quiet: bool = True) -> list[Layer]:
    """All layers of a scene that are to be seen, of which `volume` is the first one's; if none is, that one, clear.

    quiet: whether notes on the other layers' files are not printed.
    """
    layers = of_channels(scene, volume, transfer)
    for layer in (each for each in scene.layers if each.visible):
        masked = replace(layer, mask=scene.mask) if layer.mask is None else layer
        source = replace(masked, surfaces=scene.surfaces) if layer.surfaces is None else masked
        other = source.open()
        tell(other, quiet, channels=True, layer=source.volume)
        own = None if source.clip is None and not source.crop else source.cut(other).settings.clip
        found = of_channels(source, other, source.transfer_for(other), own)
        layers += found if layer.surfaces is None else [replace(each, surfaces=layer.surfaces) for each in found]
    if scene.surfaces is not None:
        layers = _as_surfaces(layers, scene)
    if not any(each.visible for each in layers):
        return [replace(layers[0], transfer=layers[0].seen.weakened(0.0), visible=True)]
    return layers


def _as_surfaces(layers: list[Layer], scene: Scene) -> list[Layer]:
    """The layers, segmentations among them as surfaces. InputError where there are none."""
    labelled = [is_segmentation(each.volume, each.seen) for each in layers]
    if not any(labelled):
        fix = "--values labels, if its numbers are names"
        raise expected("surfaces", "a segmentation among the volumes", f"amounts in {scene.volume}", fix)
    every = zip(layers, labelled, strict=True)
    return [replace(each, surfaces=scene.surfaces) if yes and each.surfaces is None else each for each, yes in every]


def layered(scene: Scene, volume: Volume, transfer: Transfer, quiet: bool = True) -> Layers:
    """The layers and meshes of a scene, of which `volume` is the first one's, cut by its planes. quiet: as above."""
    from splatgl.splat.scene import Scene as Layers

    meshes = [each.open() for each in surfaces_of(scene) if each.visible]
    meshes += scene.vectors.meshes(volume)
    drawn = Layers(layers_of(scene, volume, transfer, quiet), scene.settings.clip, meshes)
    for note in () if quiet else drawn.notes:
        print(f"splatgl: {note}", file=sys.stderr)
    return drawn


def draw_layers(how: Drawing, scene: Scene, volume: Volume, transfer: Transfer) -> Image:
    """The image of a scene of several layers or channels; the first is `volume`, whose view it has by default."""
    from splatgl.reference.check import check_layers

    for name in ("field", "savings"):
        if getattr(how, name):
            raise expected(f"--{name}", "a picture of one volume", "layers" if scene.layers else "meshes")
    drawn, settings = layered(scene, volume, transfer, how.quiet), scene.settings.but(clip=())
    check_fits(scene, drawn, how.memory)
    camera = scene.view.camera(volume, drawn)
    with how.renderer() as renderer:
        if how.explain:
            for splats, own in drawn.drawn(settings):
                print(f"{splats.name}:\n{renderer.plan(splats, camera, own).explain()}")
        image = renderer.render(drawn, camera, settings)
    if not (image.info["splats"] or drawn.meshes):
        raise expected(scene.volume, "layers with an opacity", "none", "set the points to the values that matter")
    return check_layers(image, drawn, camera, settings, how.check)


def check_fits(scene: Scene, drawn: Layers, memory: int | None = None) -> None:
    """InputError for a layer that is drawn in bricks alone. memory: bytes; None: half of what is free."""
    from splatgl.fileio import budget
    from splatgl.splat.bricks import bricks_of, fits

    most = budget() if memory is None else memory
    for layer in drawn.shown:
        bricks = None if layer.threshold else bricks_of(layer.volume, layer.seen, scene.settings)
        need = fits(bricks, scene.view.size, most) if bricks else None
        if need is not None:
            name = layer.volume.name or "layer"
            raise expected(name, f"a layer that fits into {size_of(most)}", size_of(need.bytes), "use a smaller volume")

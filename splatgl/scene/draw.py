"""Draws a scene: chooses level of detail, bricks or splats, joins layers, and adds annotations."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl import __version__
from splatgl.annotations.annotate import ROOM, check, check_size, check_time, parsed
from splatgl.data.image import Image
from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected
from splatgl.fileio import format_bytes
from splatgl.readers.channels import TIME_HINT
from splatgl.scene.meshes import is_mesh, surfaces_of
from splatgl.scene.scene_file import SceneFile, check_masked
from splatgl.splat.segment_surfaces import is_segmentation
from splatgl.splat.settings import BLENDS, Settings
from splatgl.splat.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.gl.large_volumes import Level
    from splatgl.gl.renderer import Renderer
    from splatgl.splat.camera import Camera
    from splatgl.splat.clipping import Part, Plane
    from splatgl.splat.scene import Layer
    from splatgl.splat.scene import Scene as Layers
    from splatgl.splat.splats import Splats


def asked_for(text: str | None, reference: str | None, scene: SceneFile) -> tuple[str, ...]:
    """The annotations of a command's picture, else of its scene, but in comparisons; InputError for what can't be laid
    over it, before anything is drawn.
    """
    if text is None:
        asked = () if reference is not None else check(scene.annotate)
    else:
        asked = parsed(text)
        if reference is not None:
            raise expected("annotate", "no --ref, which compares pictures without annotations", reference)
    check_size(asked, scene.view.size)
    check_time(asked)
    return asked


def of_movie(text: str | None, scenes: Sequence[SceneFile]) -> tuple[str, ...]:
    """The annotations of a movie, else of its scene: time stands for that of each volume of a series. InputError as
    `check`, and for a time of one volume.
    """
    asked = check(scenes[0].annotate) if text is None else parsed(text)
    check_size(asked, scenes[0].view.size)
    if len(scenes) == 1:
        check_time(asked)
    return asked


def at_time(asked: Sequence[str], scene: SceneFile, number: int, step: float | None) -> tuple[str, ...]:
    """The annotations of a frame that shows volume `number` of a series. step: seconds between two time points."""
    point = int(scene.load.get("time", number))
    told = f"{point * step:g} s" if step else f"{point}"
    return tuple(f"time={told}" if one == "time" else one for one in asked)


def unbacked(settings: Settings, asked: Sequence[str]) -> Settings:
    """The settings of a picture under annotations: with a box it is drawn without its background, so that edges behind
    the box come between both. Sums have none.
    """
    return settings.but(background=None) if "box" in asked and not BLENDS[settings.blend].unbounded else settings


def with_room(scene: SceneFile, volume: Volume, asked: Sequence[str]) -> SceneFile:
    """The scene, with a view that shows the box and its numbers, where they are asked for."""
    if "box" not in asked:
        return scene
    return replace(scene, view=scene.view.fitted(room(volume)))


def room(volume: Volume) -> Part:
    """What a view is fitted to that shows a volume's box and its numbers."""
    from splatgl.splat.clipping import Part

    return Part(volume.center + (volume.corners - volume.center) * ROOM, volume.frame)


def lay(
    image: Image, scene: SceneFile, volume: Volume, transfer: Transfer, asked: Sequence[str], quiet: bool = False
) -> Image:
    """The picture of a scene under annotations, by the camera that it was drawn with; prints why some are left out."""
    from splatgl.annotations.annotate import annotated, left_out, on_ground
    from splatgl.annotations.canvas import Scale, Subject
    from splatgl.scene.meshes import is_mesh

    told, drawn = Subject.of(volume), None
    if is_layered(scene, volume):
        drawn = layered(scene, volume, transfer)
        told = replace(told, scales=Scale.of(drawn.meshes), empty=is_mesh(scene.volume))
    camera = camera_of(scene, volume, transfer, drawn)
    found = annotated(image, told, transfer, camera, asked, scene.settings.background)
    found = on_ground(found, None if BLENDS[scene.settings.blend].unbounded else scene.settings.background)
    for note in () if quiet else left_out(found):
        print(f"splatgl: {note}", file=sys.stderr)
    return found


# what is looked for where nothing is said: half of the light, or what the blend shows
HALF = 0.5
OF_BLENDS = {"mip": "max", "minip": "min"}


def depths_of(
    scene: SceneFile, volume: Volume, transfer: Transfer, at: float | str, quiet: bool = True
) -> tuple[np.ndarray, Camera]:
    """Depths float64 [H, W] of a scene whose cuts are in its settings, and the camera of its picture."""
    from splatgl.reference.depth_map import depths

    drawn = layered(scene, volume, transfer, quiet)
    camera = camera_of(scene, volume, transfer, drawn)
    return depths(drawn, camera, at, scene.settings.but(clip=())), camera


def camera_of(scene: SceneFile, volume: Volume, transfer: Transfer, drawn: Layers | None) -> Camera:
    """The camera of the scene's picture, which is fitted to what that is drawn from. drawn: of layers or meshes."""
    from splatgl.splat.extract import why_only_pre
    from splatgl.splat.opaque_bounds import Opaque
    from splatgl.splat.resolve import why_per_splat

    if drawn is not None and is_layered(scene, volume):
        return scene.view.camera(volume, drawn)
    if scene.view.is_fixed(volume):
        return scene.view.camera(volume, volume)
    before = scene.settings.classification == "pre" or why_per_splat(scene.settings, moving=False)
    # of several levels, one is chosen by the camera
    if not volume.coarser and (before or why_only_pre(volume, transfer, scene.threshold)):
        splats = scene.splats(volume, transfer)
        if len(splats):
            return scene.view.camera(volume, splats)
    return scene.view.camera(volume, Opaque(volume, transfer))


def depth_share(given: float | str | None, settings: Settings) -> float | str:
    """The share that is given, else ½, or the value that the blend shows."""
    return OF_BLENDS.get(settings.blend, HALF) if given is None else given


def of_channels(
    scene: SceneFile, volume: Volume, transfer: Transfer, planes: tuple[Plane, ...] | None = None
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


def segmented(scene: SceneFile, volume: Volume) -> list[tuple[Volume, Transfer]]:
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


def is_layered(scene: SceneFile, volume: Volume) -> bool:
    """Whether a scene's picture is of several layers or channels, or has meshes."""
    of_channels = len(volume.channels) > 1 or scene.transfer.keys() & {"color_of", "window_of"}
    alone = is_mesh(scene.volume) or not scene.visible
    drawn = scene.surfaces is not None or scene.vectors.drawn
    return bool(scene.layers or scene.meshes or drawn or of_channels or alone)


def layers_of(scene: SceneFile, volume: Volume, transfer: Transfer, quiet: bool = True) -> list[Layer]:
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


def _as_surfaces(layers: list[Layer], scene: SceneFile) -> list[Layer]:
    """The layers, segmentations among them as surfaces. InputError where there are none."""
    labelled = [is_segmentation(each.volume, each.seen) for each in layers]
    if not any(labelled):
        fix = "--values labels, if its numbers are names"
        raise expected("surfaces", "a segmentation among the volumes", f"amounts in {scene.volume}", fix)
    every = zip(layers, labelled, strict=True)
    return [replace(each, surfaces=scene.surfaces) if yes and each.surfaces is None else each for each, yes in every]


def layered(scene: SceneFile, volume: Volume, transfer: Transfer, quiet: bool = True) -> Layers:
    """The layers and meshes of a scene, of which `volume` is the first one's, cut by its planes. quiet: as above."""
    from splatgl.splat.scene import Scene as Layers

    meshes = [each.open() for each in surfaces_of(scene) if each.visible]
    meshes += scene.vectors.meshes(volume)
    drawn = Layers(layers_of(scene, volume, transfer, quiet), scene.settings.clip, meshes)
    for note in () if quiet else drawn.notes:
        print(f"splatgl: {note}", file=sys.stderr)
    return drawn


def draw_layers(how: DrawOptions, scene: SceneFile, volume: Volume, transfer: Transfer) -> Image:
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


def check_fits(scene: SceneFile, drawn: Layers, memory: int | None = None) -> None:
    """InputError for a layer that is drawn in bricks alone. memory: bytes; None: half of what is free."""
    from splatgl.fileio import budget
    from splatgl.splat.bricks import bricks_of, excess_need

    most = budget() if memory is None else memory
    for layer in drawn.shown:
        bricks = None if layer.threshold else bricks_of(layer.volume, layer.seen, scene.settings)
        need = excess_need(bricks, scene.view.size, most) if bricks else None
        if need is not None:
            name = layer.volume.name or "layer"
            raise expected(
                name, f"a layer that fits into {format_bytes(most)}", format_bytes(need.bytes), "use a smaller volume"
            )


def tell(volume: Volume, quiet: bool = False, channels: bool = False, times: bool = False, layer: str = "") -> None:
    """Prints what the reader left out or assumed, on standard error. channels, times: whether all are shown. layer: the
    file of a volume beside the first.
    """
    notes = [note for note in volume.notes if not (times and note.endswith(TIME_HINT))]
    if len(volume.channels) > 1 and not channels:
        notes.append(f"channel {volume.channels[0].name} of {len(volume.channels)} is taken: --channel picks another")
    for note in () if quiet else notes:
        print(f"splatgl: {Path(layer).name}: {note}" if layer else f"splatgl: {note}", file=sys.stderr)


# most labels that a picture stores: some 16 kB of text
LABELS = 512
# delay of the progress bar in seconds
PATIENCE = 1.0


@dataclass(frozen=True)
class DrawOptions:
    """How this process draws, as the options of `splatgl render` say. kept: by the renderer that calls share."""

    backend: str = "auto"
    device: int | None = None
    gpu: bool = False
    kept: bool = False
    memory: int | None = None
    check: int | None = None
    field: bool = False
    explain: bool = False
    savings: bool = False
    quiet: bool = True

    @classmethod
    def of(cls, args: argparse.Namespace) -> DrawOptions:
        """The options of a command."""
        return cls(**{each.name: getattr(args, each.name) for each in fields(cls) if each.name != "kept"})

    @contextmanager
    def renderer(self) -> Iterator[Renderer]:
        """A renderer for one picture."""
        from splatgl.gl.renderer import Renderer
        from splatgl.scene.shared_renderer import shared_renderer

        opened = shared_renderer() if self.kept else Renderer(self.backend, self.device, self.gpu)
        with opened as renderer:
            yield renderer


def draw(how: DrawOptions, scene: SceneFile, volume: Volume, transfer: Transfer) -> Image:
    """The image, drawn by this process."""
    if is_layered(scene, volume):
        return draw_layers(how, scene, volume, transfer)
    check_masked(scene.volume, volume, transfer)
    camera, told = None, dict[str, object]()
    if volume.coarser:
        camera, chosen = _level(how, scene, volume, transfer)
        volume, transfer, told = chosen.volume, chosen.transfer, chosen.info
    image = _in_bricks(how, scene, volume, transfer, camera)
    if image is None:
        splats = scene.splats(volume, transfer, None if how.quiet else _bar)
        if not len(splats):
            raise nothing(scene, volume)
        image = drawn(how, scene, splats, camera or scene.view.camera(volume, splats))
    return Image(image.pixels, {**image.info, **told})


def _level(how: DrawOptions, scene: SceneFile, volume: Volume, transfer: Transfer) -> tuple[Camera, Level]:
    """The camera, and the level of a multiscale image that it takes."""
    from splatgl.gl.large_volumes import just_finer, level_for
    from splatgl.splat.opaque_bounds import Opaque

    camera = scene.view.camera(volume, Opaque(volume, transfer))
    if just_finer(volume, camera) == 0:
        return camera, level_for(volume, transfer, camera, scene.settings)
    with how.renderer() as renderer:
        found = level_for(volume, transfer, camera, scene.settings, renderer)
    if not how.quiet:
        print(found)
    return camera, found


def _in_bricks(
    how: DrawOptions, scene: SceneFile, volume: Volume, transfer: Transfer, camera: Camera | None
) -> Image | None:
    """The image, drawn brick by brick, if it needs more than --memory; else None."""
    from splatgl.fileio import budget
    from splatgl.splat.bricks import bricks_of, excess_need
    from splatgl.splat.opaque_bounds import Opaque

    bricks = None if scene.threshold else bricks_of(volume, transfer, scene.settings)
    if bricks is None:
        return None
    most = budget() if how.memory is None else how.memory
    need = excess_need(bricks, scene.view.size, most)
    if need is None:
        return None
    for name in ("check", "field", "savings"):
        if getattr(how, name):
            fix = "give more --memory, or a part of the volume"
            raise expected(f"--{name}", f"a picture that fits into {format_bytes(most)}", format_bytes(need.bytes), fix)
    if not how.quiet:
        told = f"{need}, together more than {format_bytes(most)}"
        if need.bytes <= most:
            told = f"up to about {need.most:,} splats are more than are drawn at once"
        print(f"{told}: drawn in {len(bricks.low):,} bricks, nearest first")

    camera = camera or scene.view.camera(volume, Opaque(volume, transfer))
    with how.renderer() as renderer, _work_bar(how.quiet, "brick") as bar:
        if how.explain:
            print(renderer.plan(bricks.whole, camera, scene.settings).explain())
        image = renderer.render_bricks(bricks, camera, scene.settings, bar, bands=need.bands(most))
    if not image.info["splats"]:
        raise nothing(scene, volume)
    if how.check is None:
        from splatgl.reference.check import check_bricks

        image = check_bricks(image, bricks, camera, scene.settings)
    return image


def drawn(how: DrawOptions, scene: SceneFile, splats: Splats, camera: Camera) -> Image:
    """The image, checked; prints what --explain and --savings ask for."""
    from splatgl.reference.check import check, check_input
    from splatgl.scene.shared_renderer import savings

    check_input(splats, camera, scene.settings, how.check, how.field)
    with how.renderer() as renderer:
        if how.explain:
            print(renderer.plan(splats, camera, scene.settings).explain())
        image = renderer.render(splats, camera, scene.settings)
        if how.check is not None or how.field or image.info["error_bound"] is None:
            image = check(image, splats, camera, scene.settings, how.check, how.field)
        if how.explain:
            print(f"{accuracy(image)}, against the float64 reference of the same splats")
        if how.savings:
            print("\n".join(savings(renderer, splats, camera, renderer.plan(splats, camera, scene.settings))))
    return image


def origin(scene: SceneFile, transfer: Transfer) -> dict[str, object]:
    """Provenance stored in an image; of very many labels only how many, as readers of PNG limit texts."""
    few = len(transfer.labels) <= LABELS
    return {
        "version": __version__,
        "source": Path(scene.volume).name,
        "threshold": scene.threshold,
        "transfer": transfer.to_toml() if few else f"# {len(transfer.labels):,} labels in colours of their numbers",
    }


def nothing(scene: SceneFile, volume: Volume) -> InputError:
    """The error for a scene without splats, with the reason."""
    if not any(np.isfinite(slab.samples).any() for slab in volume.slabs(1, halo=0)):
        return expected(scene.volume, "finite samples", "none")
    return expected(
        scene.volume,
        f"voxels with an opacity above the threshold {scene.threshold:g}",
        "none",
        "lower --threshold, or set --points to the values that matter",
    )


def _bar(parts: Iterator[Any], count: int) -> Iterator[Any]:
    """Progress bar over parts of a volume, if tqdm is installed and stderr is a terminal."""
    if not sys.stderr.isatty():
        return parts
    try:
        from tqdm import tqdm
    except ImportError:
        return parts
    return iter(tqdm(parts, "extracting", total=count, unit="part", delay=PATIENCE, leave=False))


@contextmanager
def _work_bar(quiet: bool, unit: str) -> Iterator[Callable[[int, int], None] | None]:
    """What is told of units that are done: a progress bar, if tqdm is installed and stderr is a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    try:
        from tqdm import tqdm
    except ImportError:
        yield None
        return
    with tqdm(desc="drawing", unit=unit, delay=PATIENCE, leave=False) as bar:

        def done(count: int, total: int) -> None:
            bar.total = total
            bar.update(count - bar.n)

        yield done


def accuracy(image: Image) -> str:
    """Text of the error bound and whether it meets the tolerance, and of what was compared."""
    info = image.info
    error, tolerance = info["error_bound"], info["tolerance"]
    known = f"error bound {error:.3g}" if isinstance(error, float) else "no error bound"
    missed = "not " if isinstance(error, float) else "not known to be "
    told = f"{known}: the tolerance {tolerance:.3g} is {'' if info['tolerance_met'] else missed}met"
    return f"{told}\n{compared(image)}" if isinstance(info.get("checked"), dict) else told


def compared(image: Image) -> str:
    """How far the compared pixels are off, and off the field, in a line each."""
    info = image.info
    checked = info["checked"]
    assert isinstance(checked, dict)
    # sums have no largest value of their own
    of = f" of {image.pixels.max():.3g}" if BLENDS[str(info["blend"])].unbounded else ""
    every = image.pixels.shape[0] * image.pixels.shape[1]
    told = f"off by up to {checked['largest']:.2g}{of}, RMSE {checked['rmse']:.2g}, in {checked['pixels']} of {every} "
    told += "pixels drawn in float64"
    if info.get("level"):
        told += f", of level {info['level']}'s voxels"
    if int(checked["pixels"]) < every:
        told += "; the others were not compared"
    field = checked.get("field")
    if field is None:
        return told
    far = f"off the field itself by up to {field['largest']:.2g}{of}, RMSE {field['rmse']:.2g}"
    return f"{told}\n{far}, in {field['pixels']} of these pixels"

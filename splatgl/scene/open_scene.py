"""`OpenScene`: a scene that is read; its layers, meshes, camera and settings."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from splatgl import __version__
from splatgl.annotations.annotate import ROOM, check_size, with_time
from splatgl.annotations.canvas import AnnotatedSubject, ColorScale
from splatgl.data.color import AUTO
from splatgl.data.scenes import SCENES
from splatgl.data.volume import Label, Volume, halve_volume
from splatgl.errors import USER_ERRORS, InputError, expected, list_names
from splatgl.fileio import budget, format_bytes
from splatgl.geometry.scissors import cut_volume
from splatgl.options import LIMITED
from splatgl.readers import require_source
from splatgl.readers.channels import TIME_HINT
from splatgl.scene.meshes import Vectors, is_mesh, surfaces_of
from splatgl.scene.scene_file import SceneFile
from splatgl.scene.transfer_choice import AMOUNT_KEYS, CHANNEL_KEYS, COLOR_KEYS, SeriesLook, faint_share, with_window
from splatgl.scene.view import FIT_OF_0_3
from splatgl.splat.segment_surfaces import is_segmentation
from splatgl.splat.settings import Settings
from splatgl.transfer.colormaps import labels_of
from splatgl.transfer.presets import slice_defaults
from splatgl.transfer.statistics import SAMPLED_STEPS, mean_deviation, sampled_steps
from splatgl.transfer.transfer import Transfer

if TYPE_CHECKING:
    from splatgl.geometry.camera import Bounded, Camera
    from splatgl.geometry.clipping import Plane
    from splatgl.planning.bricks import Bricks, MemoryEstimate
    from splatgl.planning.scene import Layer, Scene
    from splatgl.splat.splats import Splats

# extraction and cameras are imported once there is a volume: bad input is reported at once

# most labels that the provenance lists: some 16 kB of text
LABELS = 512
# volumes with fewer voxels are not halved
SMALL = 1 << 15
# most times that the voxels of layers that exceed limits are averaged
MOST_HALVINGS = 4


class LayerSource(NamedTuple):
    """A file of a scene that is read. volume: masked and cut, in its own frame; layers: one for each channel."""

    file: SceneFile
    volume: Volume
    layers: list[Layer]


@dataclass(frozen=True, eq=False)
class OpenScene:
    """A scene whose first volume is read; other layers and meshes are read once they are needed.

    file: the names and options; the planes of its clip and crop are in its settings, and its view shows a box with its
    numbers. volume, transfer: of the first layer. is_quiet: whether notes on files are not printed. is_live: whether a
    window shows it, in which hidden layers can be shown. is_moving: whether pictures are motion-blurred. fixed_camera:
    the camera that a level of detail was chosen for. halvings: how often voxels are averaged over 2×2×2, for a draft or
    because of limits, of which `limits` are the notes.
    """

    file: SceneFile
    volume: Volume
    transfer: Transfer
    is_quiet: bool = True
    is_live: bool = False
    is_moving: bool = False
    fixed_camera: Camera | None = None
    halvings: int = 0
    limits: tuple[str, ...] = ()

    @classmethod
    def read(cls, file: SceneFile, is_quiet: bool = True, is_live: bool = False) -> OpenScene:
        """Reads the first volume, and prints notes on it. is_live: whether a window of any size shows it, at all times
        of its file. Raises InputError for a picture too small for its annotations.
        """
        if not is_live:
            check_size(file.annotate, file.view.size)
        volume = file.open()
        # before notes on the first volume
        for layer in (layer for layer in file.layers if layer.held is None and layer.volume not in SCENES):
            require_source(layer.volume)
        print_notes(volume, is_quiet, has_times=is_live)
        return cls.of(file, volume, is_quiet, is_live)

    @classmethod
    def of(cls, file: SceneFile, volume: Volume, is_quiet: bool = True, is_live: bool = False) -> OpenScene:
        """The scene of a file and its volume, which is in memory."""
        file, volume = cut_scene(file, volume)
        transfer = file.transfer_for(volume)
        return cls(on_background(file, volume, transfer), volume, transfer, is_quiet, is_live)

    @cached_property
    def is_single(self) -> bool:
        """Whether the picture is of one volume, which may be drawn in bricks or at a coarser level; else of several
        layers or channels, or with meshes.
        """
        file = self.file
        of_channels = len(self.volume.channels) > 1 or file.transfer.keys() & set(CHANNEL_KEYS)
        is_hidden = is_mesh(file.volume) or not file.visible
        has_meshes = file.meshes or file.slice_planes or file.surfaces is not None or file.vectors.has_lines
        return not (file.layers or has_meshes or of_channels or is_hidden or file.uncut)

    @cached_property
    def scene(self) -> Scene:
        """The visible layers and meshes, clipped by the planes of the scene; of one volume a single layer."""
        from splatgl.geometry.slices import Slice
        from splatgl.planning.scene import Scene

        meshes = [mesh.open() for mesh in surfaces_of(self.file) if mesh.visible]
        meshes += self.file.vectors.meshes(self.volume)
        planes = [Slice(text) for text in self.file.slice_planes]
        scene = Scene(self._visible_layers(), self.file.settings.clip, meshes, planes)
        print_lines(scene.notes, self.is_quiet)
        return scene

    def read_layers(self) -> list[LayerSource]:
        """The files of the visible layers, of a live scene all files. Of a single volume, the transfer function has the
        opacity.
        """
        file, volume = self.file, self.volume
        own = channel_layers(file, volume, self.transfer) if self.is_single else source_layers(file, volume)
        others = (layer for layer in file.layers if layer.visible or self.is_live)
        opened = (open_layer(layer, file, self.is_quiet, self.is_live) for layer in others)
        return [LayerSource(file, volume, own), *opened]

    def _visible_layers(self) -> list[Layer]:
        """The layers; if none is visible, the first one, clear."""
        layers = [layer for source in self.read_layers() for layer in source.layers]
        if self.halvings:
            layers = [replace(layer, volume=self._halved(layer.volume, layer.faded)) for layer in layers]
        if self.file.surfaces is not None:
            layers = with_surfaces(layers, self.file)
        if not any(layer.visible and layer.opacity for layer in layers):
            return [replace(layers[0], only_slices=True, opacity=1.0, visible=True)]
        return layers

    @cached_property
    def splats(self) -> Splats:
        """The splats of the first volume."""
        from splatgl.planning.resolve import extract_for_settings

        progress, file = None if self.is_quiet else extraction_bar, self.file
        look = self._halved(self.volume, self.transfer), self.transfer, file.settings, file.threshold
        return extract_for_settings(*look, progress, self.is_moving)

    def _halved(self, volume: Volume, transfer: Transfer) -> Volume:
        """The volume of a layer in fewer voxels; clouds of points stay."""
        for _ in range(self.halvings if volume.points is None else 0):
            if volume.coarser:
                level, rest = volume.coarser[0], volume.coarser[1:]
                volume = replace(level, name=volume.name, hints=volume.hints, frame=volume.frame, coarser=rest)
            elif volume.count > SMALL:
                volume = halve_volume(replace(volume, coarser=()), bool(transfer.labels))
        return volume

    @property
    def subject(self) -> Splats | Scene:
        """Subject of a renderer: the splats of a single volume, or layers and meshes."""
        return self.splats if self.is_single else self.scene

    @property
    def settings(self) -> Settings:
        """The settings of the renderer: layers have their planes, and annotations with a box get the background behind
        the box.
        """
        settings = self.file.settings if self.is_single else replace(self.file.settings, clip=())
        return without_background(settings, self.file.annotate)

    @cached_property
    def camera(self) -> Camera:
        """The camera of the picture; a view without an eye is fitted as its `fit` says."""
        if self.fixed_camera is not None:
            return self.fixed_camera
        return self.file.view.camera(self.volume, self.fitted)

    @property
    def fitted(self) -> Bounded:
        """Subject to which a view without an eye is fitted."""
        from splatgl.planning.culling import OpaqueBounds
        from splatgl.planning.resolve import why_per_splat
        from splatgl.splat.extract import why_only_pre

        settings, volume = self.file.settings, self.volume
        if not self.is_single:
            return self.scene
        if self.file.view.is_fixed(volume):
            return volume
        why = why_only_pre(volume, self.transfer, self.file.threshold) or why_per_splat(settings, moving=False)
        is_pre = (settings.classification == "pre" or why is not None) and self.file.view.fit == FIT_OF_0_3
        # of several levels, one is chosen by the camera
        if is_pre and not volume.coarser and len(self.splats):
            return self.splats
        return OpaqueBounds(volume, self.transfer)

    @property
    def annotated_subject(self) -> AnnotatedSubject:
        """Box, unit, frame and scales of the volume and the meshes, for annotations."""
        scales, is_empty = ColorScale.of(self.scene.meshes), is_mesh(self.file.volume)
        layers = [(layer.volume, layer.faded) for layer in self.scene.shown]
        layers = [(self.volume, self.transfer)] if self.is_single else layers
        subject = AnnotatedSubject.of(self.volume, self.legend[0], layers)
        return replace(subject, scales=scales, empty=is_empty, measures=self.file.measures)

    @cached_property
    def parts(self) -> list[tuple[Bricks, Settings]]:
        """Bricks and settings of what is drawn apart: a single volume, or each layer of a blend without an order; none
        of scenes that bricks cannot draw.
        """
        from splatgl.planning.bricks import bricks_of

        settings = self.settings
        if self.is_single:
            looks = [(self.volume, self.transfer, settings, self.file.threshold)]
        elif settings.hides or self.scene.surfaces(settings):
            return []
        else:
            cut = [replace(settings, clip=(*settings.clip, *planes), background=None) for planes in self.scene.planes]
            shown = zip(self.scene.shown, cut, strict=True)
            looks = [(layer.volume, layer.seen, own, layer.threshold) for layer, own in shown]
        made = [(None if least else bricks_of(volume, look, own), own) for volume, look, own, least in looks]
        parts = [(bricks, own) for bricks, own in made if bricks is not None]
        return parts if len(parts) == len(looks) else []

    @property
    def names(self) -> tuple[str, ...]:
        """The annotations; the time of a file of several time points has its text."""
        return with_time(self.file.annotate, self.volume, self.volume.time)

    @property
    def legend(self) -> tuple[Volume, Transfer]:
        """Volume and transfer function of the colour bar: those of the first visible layer or channel."""
        first = None if self.is_single else self.scene.shown[0]
        return (self.volume, self.transfer) if first is None else (first.volume, first.faded)

    @property
    def has_matter(self) -> bool:
        """Whether planes leave any splats or meshes."""
        from splatgl.planning.resolve import select_splats

        settings, subject = self.settings, self.subject
        kept = (select_splats(splats, look, self.is_moving) for splats, look in subject.drawn(settings))
        return bool(subject.surfaces(settings)) or any(map(len, kept))

    def within_limits(self) -> OpenScene:
        """The scene, with the voxels of its layers averaged as often as one pass and the memory budget need; its
        `limits` say so. Raises InputError for layers that do not fit then.
        """
        from splatgl.splat.splats import MOST_KEPT

        less, excess = self, self._excess()
        if excess is None:
            return self
        name, need = excess
        while excess is not None and less.halvings < MOST_HALVINGS:
            less = replace(less, halvings=less.halvings + 1)
            excess = less._excess()
        # the budget varies, which files must not
        fits = need.bytes <= budget()
        if excess is None:
            side, most = 2**less.halvings, f"takes at most {MOST_KEPT:,} splats" if fits else "fits into --memory"
            note = f"voxels of layers averaged over {side}×{side}×{side}, so that each {most} {LIMITED}"
            return replace(less, limits=(note,))
        if fits:
            most, fix = f"a layer of at most {MOST_KEPT:,} splats", "begin the window higher, or take a part"
            raise expected(name, most, f"about {need.most:,}", fix)
        this, got = f"a layer that fits into {format_bytes(budget())}", format_bytes(need.bytes)
        raise expected(name, this, got, "give more --memory, or use a smaller volume")

    def _excess(self) -> tuple[str, MemoryEstimate] | None:
        """Name and memory of the first layer that only bricks could draw; None if there is none."""
        from splatgl.planning.bricks import excess_bricks

        for layer in () if self.is_single else self.scene.shown:
            excess = excess_bricks(layer.volume, layer.seen, self.file.settings, self.file.view.size, layer.threshold)
            if excess is not None:
                return layer.volume.name or "layer", excess[1]
        return None

    def check(self) -> None:
        """Raises InputError if the masks of a single volume, which is no step of a series, keep only transparent
        voxels.
        """
        from splatgl.planning.culling import OpaqueBounds

        is_masked = self.is_single and self.file.look is None and self.volume.masks
        if is_masked and OpaqueBounds(self.volume, self.transfer).nothing:
            fix = "change --points or --mask"
            raise expected(self.file.volume, "visible voxels inside its masks", "none", fix)

    def nothing_visible(self) -> InputError:
        """The error for a scene without splats and meshes, with the reason."""
        file = self.file
        if not self.is_single:
            return expected(file.volume, "layers with an opacity", "none", "change --points")
        if self.volume.share_missing() == 1:
            return expected(file.volume, "finite samples", "none")
        if self.transfer.iso and not any(opacity for _, opacity in self.transfer.points):
            values = ", ".join(f"{surface.value:g}" for surface in self.transfer.iso)
            this, fix = "a value that the field passes", "splatgl info lists its values"
            return expected(f"{file.volume}: iso", this, values, fix)
        this = f"voxels with an opacity above the threshold {file.threshold:g}"
        clip = "clip or crop less, " if file.settings.clip or file.clip or file.crop else ""
        fix = f"{clip}lower --threshold, or change --points"
        return expected(file.volume, this, "none", fix)


def cut_scene(file: SceneFile, volume: Volume) -> tuple[SceneFile, Volume]:
    """The scene with the planes of its clip and crop in its settings, and its first volume as scissors leave it.

    Scissors without a camera take the view of the whole. The view is fitted to the crop, or to a box with numbers.
    """
    from splatgl.geometry.camera import FittedPoints

    if file.scissors:
        whole = OpenScene.of(replace(file, scissors=()), volume)
        camera = whole.camera
        scissors = tuple(each.seen_by(camera, volume.world) for each in file.scissors)
        view = whole.file.view.fitted(FittedPoints(whole.fitted.outline, volume.frame))
        file = replace(file, scissors=scissors, view=view)
        volume = cut_volume(volume, scissors)
    file = file.cut(volume)
    if "box" in file.annotate:
        corners = volume.center + (volume.corners - volume.center) * ROOM
        file = replace(file, view=file.view.fitted(FittedPoints(corners, volume.frame)))
    return file, volume


BLACK, WHITE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


def on_background(file: SceneFile, volume: Volume, transfer: Transfer) -> SceneFile:
    """The scene with the default background, unless it states one. volume, transfer: of its first layer."""
    if file.slices and file.settings.background == AUTO:
        return replace(file, settings=replace(file.settings, background=BLACK))
    # several channels glow
    glows = len(volume.channels) > 1 and volume.points is None
    return replace(file, settings=with_background(file.settings, transfer.shading and not glows))


def with_background(settings: Settings, is_lit: bool) -> Settings:
    """The settings with the default background, unless they state one: black behind what glows and behind values along
    rays, white behind shaded surfaces; none of sums. is_lit: whether the matter is shaded by default.
    """
    if settings.background != AUTO:
        return settings
    if settings.is_sum:
        return replace(settings, background=None)
    surfaces = settings.shading == "on" or (settings.shading == "auto" and is_lit)
    return replace(settings, background=WHITE if surfaces and settings.hides else BLACK)


def provenance_of(file: SceneFile, transfer: Transfer, length: object) -> dict[str, object]:
    """Version, source, transfer function, and the length of its opacities, for an image; of very many labels their
    number, as readers of PNG limit texts.
    """
    labels = transfer.labels
    text = transfer.to_toml() if len(labels) <= LABELS else f"# {len(labels):,} labels in colours of their numbers"
    about: dict[str, object] = {"version": __version__, "source": Path(file.volume).name, "threshold": file.threshold}
    return {**about, "transfer": text, "opacity_length": length}


def print_notes(
    volume: Volume, is_quiet: bool = False, is_alone: bool = False, has_times: bool = False, layer: str = ""
) -> None:
    """Prints what the reader left out or assumed, on standard error.

    is_alone: whether one channel is taken of several. has_times: whether all time points are shown. layer: the file of
    a layer after the first.
    """
    notes = [note for note in volume.notes if not (has_times and note.endswith(TIME_HINT))]
    if len(volume.channels) > 1 and is_alone:
        notes.append(f"channel {volume.channels[0].name} of {len(volume.channels)} is taken: --channel picks another")
    print_lines([f"{Path(layer).name}: {note}" for note in notes] if layer else notes, is_quiet)


def print_lines(notes: Sequence[str], is_quiet: bool = False) -> None:
    """Prints notes on standard error, unless it is to be quiet."""
    for note in () if is_quiet else notes:
        print(f"splatgl: {note}", file=sys.stderr)


# delay of progress bars in seconds
PATIENCE = 1.0


def extraction_bar(parts: Iterator[Any], count: int) -> Iterator[Any]:
    """Progress bar over parts of a volume, if tqdm is installed and stderr is a terminal."""
    if not (sys.stderr and sys.stderr.isatty()):
        return parts
    try:
        from tqdm import tqdm
    except ImportError:
        return parts
    return iter(tqdm(parts, "extracting", total=count, unit="part", delay=PATIENCE, leave=False))


def without_background(settings: Settings, names: tuple[str, ...]) -> Settings:
    """The settings of a picture under annotations: with a box it is drawn without its background, so that edges behind
    the box come between both. Sums have no background.
    """
    return replace(settings, background=None) if "box" in names and not settings.is_sum else settings


def open_layer(layer: SceneFile, scene: SceneFile, is_quiet: bool = True, has_times: bool = False) -> LayerSource:
    """Reads a layer of a scene, with the scene's mask and surfaces if it has none. is_quiet, has_times: as of
    `print_notes`.
    """
    masked = replace(layer, mask=scene.mask) if layer.mask is None else layer
    source = replace(masked, surfaces=scene.surfaces) if layer.surfaces is None else masked
    volume = cut_volume(source.open(), scene.scissors)
    print_notes(volume, is_quiet, has_times=has_times, layer=source.volume)
    planes = None if source.clip is None and not source.crop else source.cut(volume).settings.clip
    layers = source_layers(source, volume, planes)
    return LayerSource(source, volume, [replace(each, surfaces=layer.surfaces) for each in layers])


def source_layers(file: SceneFile, volume: Volume, planes: tuple[Plane, ...] | None = None) -> list[Layer]:
    """The layers of a source, as of `channel_layers`, with its opacity beside their transfer functions."""
    plain = replace(file, opacity=1.0, layers=(), vectors=Vectors())
    transfer = plain.transfer_for(volume)
    opacity = file.opacity * faint_share(file, volume, transfer)
    return [replace(layer, opacity=opacity) for layer in channel_layers(plain, volume, transfer, planes)]


def channel_layers(
    file: SceneFile, volume: Volume, transfer: Transfer, planes: tuple[Plane, ...] | None = None
) -> list[Layer]:
    """The layers of a volume: one for each of its channels. planes: that clip these layers alone."""
    from splatgl.planning.scene import Layer

    if len(volume.channels) < 2:
        for name in CHANNEL_KEYS:
            if file.transfer.get(name):
                raise expected(name, "several channels", "one", "load more by --channel")
        uncut = file.uncut or None
        # the stand-in of a mesh has no matter, whatever the transfer function
        is_visible = file.visible and not is_mesh(file.volume)
        return [Layer(volume, transfer, 1.0, is_visible, file.threshold, planes, uncut=uncut)]
    if file.transfer.get("iso"):
        raise expected("iso", "one channel", len(volume.channels), "--channel picks one")
    if volume.points is not None:
        transfers = [transfer] * len(volume.channels)
    elif all(channel.labels for channel in volume.channels) and not any(map(file.transfer.get, CHANNEL_KEYS)):
        part = replace(file, look=SeriesLook(None))
        transfers = [part.transfer_for(channel) for channel in volume.channels]
    else:
        looks = file.look.channels if file.look else ()
        looks = looks if len(looks) == len(volume.channels) else _channel_looks(file, volume)
        unit = {"unit": file.transfer["unit"]} if file.transfer.get("unit") else {}
        transfers = [replace(look, **unit).weakened(file.opacity) for look in looks]
    channels = zip(volume.channels, transfers, strict=True)
    uncut = file.uncut or None
    return [Layer(channel, look, 1.0, file.visible, file.threshold, planes, uncut=uncut) for channel, look in channels]


def _channel_looks(file: SceneFile, volume: Volume) -> tuple[Transfer, ...]:
    """The transfer functions of channels, without the scene's opacity: the file's for each, in the colours, over the
    windows and with the looks of channels.
    """
    from splatgl.planning.scene import channel_transfers

    colors, windows, looks = (dict(file.transfer.get(name, ())) for name in CHANNEL_KEYS)
    plain, keys, bases = replace(file, opacity=1.0, look=None), file.transfer.keys(), None
    if keys & (AMOUNT_KEYS - set(COLOR_KEYS) | {"preset"}):
        bases = [plain.transfer_for(channel) for channel in volume.channels]
    elif window := with_window(dict(file.transfer)).get("window"):
        windows = {**{str(number): window for number in range(len(volume.channels))}, **windows}
    return tuple(channel_transfers(volume, colors, windows, bases, file.settings, looks))


# keys that leave nothing of a look to the values
ALL_STATED = ({"points", "colormap", "window"}, {"file"})


def series_look(files: Sequence[SceneFile]) -> SeriesLook | None:
    """The transfer functions shared by the steps of a series, as their options state them for the values of one step,
    of each channel: of a few from the first to the last the one whose values vary most. None of one step, and if none
    can be read.
    """
    widest, labels, read = list[tuple[float, int, Volume]](), dict[int, Label](), set[int]()
    is_stated = any(keys <= files[0].transfer.keys() for keys in ALL_STATED)
    for most in (1,) if is_stated else SAMPLED_STEPS:
        if len(files) < 2 or is_mesh(files[0].volume) or (widest and all(width for width, _, _ in widest)):
            break
        for step in sorted({*sampled_steps(len(files), most)} - read):
            read.add(step)
            # a step that cannot be read is an error where it is drawn
            with suppress(*USER_ERRORS):
                volume = replace(files[step], look=None).open()
                found = [(mean_deviation(part), step, part) for part in volume.channels or (volume,)]
                if len(found) == len(widest or found):
                    pairs = zip(found, widest or found, strict=True)
                    widest = [new if new[0] > known[0] else known for new, known in pairs]
                labels |= {label.number: label for label in labels_of(volume)} if volume.labels is not None else {}
    if not widest:
        return None
    _, chosen, parts = zip(*widest, strict=True)
    volume = replace(parts[0], channels=parts if len(parts) > 1 else ())
    volume = replace(volume, labels=tuple(labels.values())) if volume.labels is not None else volume
    return replace(_look_of(replace(files[0], look=None), volume), steps=chosen)


def _look_of(file: SceneFile, volume: Volume) -> SeriesLook:
    """The look of a volume, for its series."""
    transfer, channels = file.stated_transfer(volume), tuple[Transfer, ...]()
    has_labels = volume.labels is not None or all(part.labels for part in volume.channels or (volume,))
    if volume.channels and volume.points is None and not has_labels:
        channels = _channel_looks(file, volume)
    if transfer.labels or has_labels:
        return SeriesLook(None)
    is_plain, slices = not (volume.channels or volume.color is not None or volume.points is not None), None
    # a volume without values has no slices
    with suppress(InputError):
        slices = slice_defaults(volume) if is_plain else None
    return SeriesLook(transfer, channels, slices)


def look_notes(look: SeriesLook | None, files: Sequence[SceneFile]) -> list[str]:
    """The note on a look of other steps than the first. files: of the steps."""
    if look is None or not any(look.steps):
        return []
    steps = [files[step] for step in dict.fromkeys(look.steps)]
    names = [f"time {step.load['time']}" if "time" in step.load else Path(step.volume).name for step in steps]
    return [
        f"all use the transfer function of {list_names(names)}, whose values vary most; --points and --window change it"
    ]


def with_surfaces(layers: list[Layer], file: SceneFile) -> list[Layer]:
    """The layers, segmentations among them as surfaces. InputError if there is no segmentation."""
    are_segments = [is_segmentation(layer.volume, layer.seen) for layer in layers]
    if not any(are_segments):
        fix = "--values labels, if its numbers are names"
        raise expected("surfaces", "a segmentation among the volumes", f"amounts in {file.volume}", fix)
    return [
        replace(layer, surfaces=file.surfaces) if is_segments and layer.surfaces is None else layer
        for layer, is_segments in zip(layers, are_segments, strict=True)
    ]

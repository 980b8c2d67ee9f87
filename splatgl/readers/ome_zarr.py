"""Zarr 2 and 3, and OME-Zarr.

Of a multiscale image the finest level is read unless `level` or `array` names another; spacing, origin and unit come
from the level's coordinate transformations (OME-Zarr 0.4 and 0.5).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from splatgl.data.affine import metres_in, shared_unit, unit_name, value_unit_name
from splatgl.data.times import Times, seconds_in
from splatgl.data.volume import Hints, Label, Lengths, Triple, Volume
from splatgl.errors import MissingOption, expected, import_extra, list_names
from splatgl.fileio import WHOLE_BYTES, byte_count, held_within_budget
from splatgl.readers.channels import MOST_CHANNELS, Channel, ChannelSet, hex_color, mark_microscope, parse_window
from splatgl.readers.chunked import Chunked, TransposedChunks
from splatgl.readers.common import array_fields, decoder_errors
from splatgl.readers.contents import ZARR
from splatgl.readers.options import LoadOptions
from splatgl.readers.remote import Remote
from splatgl.readers.zarr_files import (
    channel_names,
    check_array,
    check_files,
    dimension_kind,
    dimension_names,
    open_zip,
    read_lattice,
    read_packing,
)

Multiscale = Mapping[str, Any]


def natural_key(name: str) -> list[Any]:
    """Sort key that orders names by the numbers in them: 2 before 10."""
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in re.split(r"(\d+)", name) if part]


def axis_names(node: Any, multiscale: Multiscale | None, group: Any = None) -> list[str]:
    """One name per axis, with y and x, and z except for an image of one plane; without metadata the last of t, c, z, y,
    x. group: of the array, which may hold the coordinates of its dimensions.
    """
    count = len(node.shape)
    axes = (multiscale or {}).get("axes")
    names = [axis if isinstance(axis, str) else str(axis.get("name", "?")) for axis in axes] if axes else []
    if not names:
        names = [
            dimension_kind(group, name, size) for name, size in zip(dimension_names(node), node.shape, strict=False)
        ]
        names = names if len(names) == count and {"z", "y", "x"} <= set(names) else []
    names = names or list("tczyx")[5 - min(count, 5) :]
    space = sorted(name for name in names if name in ("z", "y", "x"))
    if len(names) != count or space not in (["x", "y", "z"], ["x", "y"]) or (len(space) < 3 and not axes):
        raise expected("axes", "z, y and x among the array's axes", f"{names} of {count}")
    return [name if name in tuple("zyxt") else f"c {name}" for name in names]


def find_channels(omero: Any, node: Any, multiscale: Multiscale | None, group: Any = None) -> ChannelSet:
    """The channels and time points of an array. omero: the group's metadata of channels."""
    names = axis_names(node, multiscale, group)
    sizes = dict(zip(names, node.shape, strict=True))
    count = max((size for name, size in sizes.items() if name not in tuple("zyxt")), default=1)
    if count > MOST_CHANNELS:
        raise expected("channels", f"at most {MOST_CHANNELS}", count, "the header is damaged")
    metadata = omero.get("channels", []) if isinstance(omero, Mapping) else []
    described = channel_names(group, node, names, count) if multiscale is None and count > 1 else metadata
    channels = [_read_channel(n, described[n] if n < len(described) else {}) for n in range(count)]
    step, moments = _time_step(multiscale, names), None if multiscale else _find_times(group, node, names)
    return ChannelSet(tuple(channels), None, sizes.get("t", 1), step, moments=moments)


def _find_times(group: Any, node: Any, names: Sequence[str]) -> Times | None:
    """The times in an array of numbers with the name of the time's dimension, as xarray writes them."""
    dimensions = [name for name, kind in zip(dimension_names(node), names, strict=False) if kind == "t"]
    array: Any = group.get(dimensions[0]) if group is not None and dimensions else None
    shape = node.shape[list(names).index("t")] if "t" in names else 0
    if getattr(array, "shape", None) != (shape,) or array.dtype.kind not in "uif":
        return None
    about = array.attrs.asdict()
    return Times.of(array[:], str(about.get("units") or ""), str(about.get("calendar") or ""))


def _read_channel(number: int, metadata: Any) -> Channel:
    metadata = metadata if isinstance(metadata, Mapping) else {}
    color = str(metadata.get("color", "")).removeprefix("#")
    window = metadata.get("window")
    window = window if isinstance(window, Mapping) else {}
    return Channel(
        str(metadata.get("label") or number),
        f"#{color.lower()}" if re.fullmatch("[0-9a-fA-F]{6}", color) else None,
        parse_window(window.get("start"), window.get("end")),
        metadata.get("active") is not False,
        metadata.get("inverted") is True,
    )


def read_labels(attributes: Mapping[str, Any]) -> tuple[Label, ...] | None:
    """The labels of an image of labels, with their colours (image-label); None for other images."""
    metadata = attributes.get("image-label")
    if not isinstance(metadata, Mapping):
        return None
    names = {entry.get("label-value"): str(entry.get("name", "")) for entry in metadata.get("properties") or ()}
    labels: dict[int, Label] = {}
    for entry in metadata.get("colors") or ():
        number, rgba = entry.get("label-value"), entry.get("rgba", ())
        if isinstance(number, int) and number != 0 and len(rgba) >= 3:
            labels[number] = Label(number, names.get(number, ""), hex_color(rgba))
    return tuple(labels.values())


def _time_step(multiscale: Multiscale | None, names: list[str]) -> float | None:
    """Seconds between two time points: the scale along t, if its unit is known. Versions 0.1 to 0.3 have no unit."""
    axes = (multiscale or {}).get("axes")
    if multiscale is None or not axes or "t" not in names:
        return None
    axis = names.index("t")
    unit = seconds_in(axes[axis].get("unit")) if isinstance(axes[axis], Mapping) else None
    return _transform(multiscale, multiscale["datasets"][0]["path"], len(names))[0][axis] * unit if unit else None


# most bytes of a coarser level that are read at once: a picture seldom needs more than one level
WHOLE_LEVEL = 0
# axes of samples in order
SPACE = ("z", "y", "x")
# most groups and arrays that are searched for images
MOST_GROUPS = 1000


def is_store(path: Path) -> bool:
    """Whether a folder is a Zarr store."""
    return any((path / marker).is_file() for marker in ZARR[:3])


def read(path: Path, options: LoadOptions, remote: Remote | None = None) -> Volume:
    """The volume of a Zarr store, with its coarser levels; `channel` picks a channel. Samples of more than WHOLE_BYTES
    are read in parts. remote: the store that `path` is a copy of; its files are fetched when needed.
    """
    zarr = import_extra("zarr", "Zarr stores", "zarr", "readers")
    # a store's contents are untrusted: any failure is attributed to the store
    with decoder_errors("Zarr"):
        group, path = _open(path)
        if not isinstance(group, zarr.Group):
            for name in ("array", "level"):
                if getattr(options, name) is not None:
                    raise expected(name, "a group of arrays, where this is one", getattr(options, name), "leave it out")

            def read_array(channel: int | None) -> Volume:
                channel_options = replace(options, channel=channel)
                return _read_volume(path, None, group, None, channel_options, remote, held_within_budget(WHOLE_BYTES))

            return find_channels(None, group, None).volume(options, read_array)
        group, options, notes = _select_image(group, options, remote)
        multiscale = _multiscale(group)
        levels = multiscale["datasets"] if multiscale else []
        if remote:
            names = [entry["path"] for entry in levels] + ([options.array] if options.array else [])
            remote.refresh([f"{group.path}/{name}/{file}".lstrip("/") for name in names for file in ZARR])
        nodes = [_select_level(group, multiscale, options)]
        if multiscale is not None and options.array is None and options.level is None:
            others = [group.get(entry["path"]) for entry in levels[1:]]
            nodes += [node for node in others if node is not None]
        # here the option `array` is a name, not a time point
        options = replace(options, array=None)

        def read_one(channel: int | None) -> Volume:
            channel_options = replace(options, channel=channel)
            volumes = []
            for node in nodes:
                most = held_within_budget(WHOLE_BYTES) if node is nodes[0] else WHOLE_LEVEL
                volume = _read_volume(path, group, node, multiscale, channel_options, remote, most)
                volumes.append(_with_stored_colors(path, group, node, volume, remote))
            return replace(volumes[0], coarser=tuple(volumes[1:]))

        channel_set = find_channels(_metadata(group).get("omero"), nodes[0], multiscale, group)
        volume = replace(channel_set.volume(options, read_one), labels=read_labels(_metadata(group)))
        volume = replace(volume, notes=(*notes, *volume.notes))
        return mark_microscope(volume) if multiscale and "splatgl" not in group.attrs else volume


def _open(path: Path) -> tuple[Any, Any]:
    """(group or array of a store, its root), of a folder or a zip."""
    import zarr

    if path.is_file():
        store, root, name = open_zip(path)
        return zarr.open(store, mode="r", path=name), root
    check_files(path)
    return zarr.open(path, mode="r"), path


def _with_stored_colors(path: Any, group: Any, node: Any, volume: Volume, remote: Remote | None) -> Volume:
    """The volume; a level of splatgl's own stores gets its orientation, one of its pyramids colours and hints, too."""
    metadata = group.attrs.asdict().get("splatgl")
    if not metadata:
        return volume
    volume = replace(volume, direction=np.array(metadata["direction"]), frame=metadata["frame"])
    if "color" not in metadata:
        return volume
    name = f"{metadata['color']}/{node.path.rsplit('/', 1)[-1]}"
    if remote:
        remote.refresh([f"{name}/{file}" for file in ZARR])
    color = group[name]
    files = check_array(path, color, False, remote.fetch if remote else None)
    hints = Hints(points=((0.0, 0.0), (1.0, 1.0)), unit=float(metadata["unit"]), shading=bool(metadata["shading"]))
    shade = Chunked(str(remote or path), color, [slice(None)] * 4, files)
    return replace(volume, color=shade if isinstance(volume.samples, Chunked) else shade[:], hints=hints)


def _select_image(group: Any, options: LoadOptions, remote: Remote | None) -> tuple[Any, LoadOptions, tuple[str, ...]]:
    """(group to read, remaining options, notes): the group itself, the group that `array` names, the field of a plate,
    or the first image in its subgroups (series of bioformats2raw's layout and others).
    """
    import zarr

    attributes = _metadata(group)
    if options.array is not None:
        if options.well is not None or options.field is not None:
            raise expected("array", "none together with well and field", repr(options.array), "leave it out")
        name = _plain(str(options.array))
        node = group.get(name) if name else group
        if isinstance(node, zarr.Group):
            return node, replace(options, array=None), ()
        owner, name = _find_owner(group, name, remote)
        return owner, replace(options, array=name), ()
    if isinstance(attributes.get("plate"), Mapping) or isinstance(attributes.get("well"), Mapping):
        return _select_field(group, attributes, options, remote)
    for name in ("well", "field"):
        if getattr(options, name) is not None:
            raise expected(name, "a plate", "a store without wells", "leave it out")
    if _multiscale(group) is not None or any(_is_volume(child) for _, child in _children(group)):
        return group, options, ()
    if remote:
        if "bioformats2raw.layout" not in attributes:
            return group, options, ()
        remote.refresh([f"0/{image}" for image in ZARR])
        node = group.get("0")
        return (node, options, ()) if isinstance(node, zarr.Group) else (group, options, ())
    images = _find_images(group)
    if not images:
        return group, options, ()
    names = [_plain(image.path[len(group.path) :]) for image in images]
    first = images[0] if isinstance(images[0], zarr.Group) else group
    remaining = options if first is images[0] else replace(options, array=names[0])
    others = list_names(names[1:])
    notes = (f"image {names[0]} of {len(names)} is read; --array picks another: {others}",) if len(names) > 1 else ()
    return first, remaining, notes


def _find_owner(group: Any, path: str, remote: Remote | None) -> tuple[Any, str]:
    """(the multiscale image below a group that an array is a level of, its path there); the group without one."""
    steps = path.split("/")
    for count in range(len(steps) - 1, 0, -1):
        above, name = "/".join(steps[:count]), "/".join(steps[count:])
        if remote:
            remote.refresh([f"{above}/{file}" for file in ZARR])
        multiscale = _multiscale(group[above]) if above in group else None
        if multiscale and any(entry["path"] == name for entry in multiscale["datasets"]):
            return group[above], name
    return group, path


def _select_field(
    group: Any, attributes: Mapping[str, Any], options: LoadOptions, remote: Remote | None
) -> tuple[Any, LoadOptions, tuple[str, ...]]:
    """(group of the field of a plate or a well, remaining options, notes); by default the first field that exists."""
    wells = _well_paths(attributes)
    if options.well is not None and options.well.strip("/") not in wells:
        raise expected("well", f"one of {list_names(wells)}" if wells[0] else "a plate", repr(options.well))
    # the first well that is there, of a plate in parts
    there = (name for name in wells if not name or remote or name in group)
    well = next(there, wells[0]) if options.well is None else options.well.strip("/")
    if well and remote:
        remote.refresh([f"{well}/{file}" for file in ZARR])
    fields = _field_paths(group.get(well) if well else group)
    if not fields:
        raise expected("well", f"images in {well}", "none", "the plate is not complete")
    number = options.field or 0
    if number >= len(fields):
        raise expected("field", f"a number from 0 to {len(fields) - 1} in well {well}", number)
    path = f"{well}/{fields[number]}".strip("/")
    if remote:
        remote.refresh([f"{path}/{file}" for file in ZARR])
    node = group.get(path)
    if node is None or _multiscale(node) is None:
        raise expected("field", f"an image in {path}", "none", "the plate is not complete")
    notes = []
    if options.well is None and len(wells) > 1:
        notes.append(f"well {well} of {len(wells)} is read; --well picks another: {list_names(wells[1:])}")
    if options.field is None and len(fields) > 1:
        notes.append(f"field 0 of {len(fields)} is read; --field picks another")
    return node, replace(options, well=None, field=None), tuple(notes)


def _well_paths(attributes: Mapping[str, Any]) -> list[str]:
    """The paths of a plate's wells, such as B/3; [""] for a well itself."""
    plate = attributes.get("plate")
    if not isinstance(plate, Mapping):
        return [""]
    wells = [str(well.get("path", "")).strip("/") for well in plate.get("wells") or ()]
    if not wells:
        raise expected("plate", "wells", "none", "the metadata are damaged")
    return wells


def _field_paths(well: Any) -> list[str]:
    """The paths of a well's images: those in its metadata, else its images by name. [] if there are none."""
    if well is None:
        return []
    images = (_metadata(well).get("well") or {}).get("images") or ()
    return [str(image.get("path", "")) for image in images] or _child_images(well)


def _child_images(group: Any) -> list[str]:
    """The names of the multiscale images in a group."""
    import zarr

    groups = [(name, child) for name, child in _children(group) if isinstance(child, zarr.Group)]
    return [name for name, child in groups if _multiscale(child) is not None]


def _children(group: Any) -> list[tuple[str, Any]]:
    """(name, array or group) of each child of a group, sorted by `natural_key`, opened one by one: zarr opens them at
    once, and where one is damaged, asyncio prints the errors of the others.
    """
    from zarr.core.sync import sync

    async def listed() -> list[str]:
        return [name async for name in group.store.list_dir(group.path)]

    if group.metadata.consolidated_metadata is not None:
        return sorted(group.members(), key=lambda member: natural_key(member[0]))
    children = [(name, group.get(name)) for name in sorted(sync(listed()), key=natural_key) if name not in ZARR]
    return [(name, child) for name, child in children if child is not None]


def _find_images(group: Any) -> list[Any]:
    """Multiscale groups, and arrays that may be volumes, below a group, sorted by `natural_key`."""
    import zarr

    images, waiting, visited = list[Any](), [group], 0
    while waiting and visited < MOST_GROUPS:
        node = waiting.pop(0)
        for _, child in _children(node):
            visited += 1
            if not isinstance(child, zarr.Group):
                images += [child] * _is_volume(child)
            elif _multiscale(child) is not None:
                images.append(child)
            else:
                waiting.append(child)
    return images


def list_images(path: Path) -> list[str]:
    """A line for each image of a store with several, for each field of a plate, and for labels beside an image."""
    import zarr

    with decoder_errors("Zarr"):
        group, _ = _open(path)
        if not isinstance(group, zarr.Group):
            return []
        attributes = _metadata(group)
        if isinstance(attributes.get("plate"), Mapping):
            wells = _well_paths(attributes)[:MOST_GROUPS]
            fields = [(well, n, field) for well in wells for n, field in enumerate(_field_paths(group.get(well)))]
            return [f"* {well}/{field}  well {well}, field {n}" for well, n, field in fields]
        images = [group] if _multiscale(group) is not None else _find_images(group)
        lines = []
        for image in images:
            multiscale = _multiscale(image) if isinstance(image, zarr.Group) else None
            array = image[multiscale["datasets"][0]["path"]] if multiscale else image
            lines.append(f"* {_plain(image.path[len(group.path) :]) or '/'}  {_describe_array(array)}")
            names = list_labels(image) if multiscale else []
            lines += [f"* {f'{image.path}/labels/{name}'.strip('/')}  labels, --labels {name}" for name in names]
        return lines


def list_labels(image: Any) -> list[str]:
    """The names of the label images of an image."""
    import zarr

    labels = image.get("labels")
    if not isinstance(labels, zarr.Group):
        return []
    return _child_images(labels)


def find_labels(path: Path, options: LoadOptions, name: str) -> str:
    """The path in a store of the labels of that name for the image that options pick. InputError without them."""
    import_extra("zarr", "Zarr stores", "zarr", "readers")
    with decoder_errors("Zarr"):
        group, _ = _open(path)
        image, _, _ = _select_image(group, options, None)
        names = list_labels(image)
        if name not in names:
            this = f"a file, or one of {list_names(names) or 'the labels of an image'}"
            raise expected("labels", this, repr(name))
        return _plain(f"{image.path[len(group.path) :]}/labels/{name}")


def _is_volume(array: Any) -> bool:
    """Whether a node is an array that may be a volume, not a coordinate."""
    return len(getattr(array, "shape", ())) >= 3 and array.dtype.kind in "buif"


def _read_volume(
    path: Any,
    group: Any,
    node: Any,
    multiscale: Multiscale | None,
    options: LoadOptions,
    remote: Remote | None,
    most: int,
) -> Volume:
    """The volume of an array in a group. most: bytes of samples that are read at once; copies are read in parts."""
    # 1. the array
    if min(node.shape, default=0) < 1 or node.dtype.kind not in "buif":
        raise expected("array", "real numbers along at least three axes", f"{node.dtype} {node.shape}")
    # 2. its samples
    names = axis_names(node, multiscale, group)
    wanted = [*(name for name in names if name not in SPACE), *SPACE]
    array = TransposedChunks(node, names, wanted, read_packing(node) if multiscale is None else None)
    index = _index(array.shape, wanted, options)
    whole = remote is None and byte_count(array.shape[-3:], node.dtype) <= most
    files = check_array(path, node, whole, remote.fetch if remote else None)
    files.index = array.turned.source
    samples: Any = array[index] if whole else Chunked(str(remote or path), array, index, files)
    # 3. its grid
    if multiscale is None:
        grid = read_lattice(group, node, names, even=options.spacing is not None)
        unit, title = (str(node.attrs.asdict().get(name) or "") for name in ("units", "long_name"))
        unit = "" if metres_in(unit) else value_unit_name(unit)
        about = array_fields(node.path.rsplit("/", 1)[-1], array.dtype, unit, grid.unit, title=title)
        return grid.volume(samples, "coordinates", **about)
    spacing, origin = _grid(multiscale, _plain(node.path[len(group.path) :]), names)
    path = multiscale["datasets"][0]["path"]
    finest, lengths = group.get(path), None
    if finest is not None and finest is not node:
        shape = [finest.shape[names.index(axis)] for axis in SPACE if axis in names]
        lengths = Lengths.of(np.diag(_grid(multiscale, path, names)[0]), shape)
    return Volume(samples, spacing, origin, unit=_unit(multiscale)[0], whole=lengths)


def _metadata(group: Any) -> Mapping[str, Any]:
    """OME's metadata of a group, which version 0.5 has below "ome"."""
    attributes = group.attrs.asdict()
    return attributes.get("ome", attributes)


def _multiscale(group: Any) -> Multiscale | None:
    """The metadata of a group's image, in which paths of levels are plain; None without an image."""
    images = _metadata(group).get("multiscales")
    if not images:
        return None
    return images[0] | {"datasets": [entry | {"path": _plain(entry["path"])} for entry in images[0]["datasets"]]}


def _plain(path: str) -> str:
    """The names that lead to a node, joined by slashes."""
    return "/".join(step for step in path.split("/") if step not in ("", "."))


def _select_level(group: Any, multiscale: Multiscale | None, options: LoadOptions) -> Any:
    """The array that `array` names, else the level `level` (default 0), else the only array of the group."""
    import zarr

    name = options.array
    arrays = [(key, child) for key, child in _children(group) if isinstance(child, zarr.Array)]
    volumes = [key for key, array in arrays if _is_volume(array)]
    names = volumes or [key for key, _ in arrays]
    levels = [entry["path"] for entry in multiscale["datasets"]] if multiscale is not None else []
    if options.level is not None and (name is not None or options.level >= len(levels)):
        several = levels and name is None
        this = f"a number from 0 to {len(levels) - 1}" if several else "a multiscale image, and no array"
        raise expected("level", this, options.level)
    if name is None and levels:
        name = levels[options.level or 0]
    if name is None and len(names) == 1:
        name = names[0]
    node = group.get(name) if name is not None else None
    if not isinstance(node, zarr.Array):
        names = names or [_plain(image.path[len(group.path) :]) for image in _find_images(group)]
        if not names:
            held = list_names([key for key, _ in _children(group)]) or "nothing"
            raise expected("store", "an array of three axes in one of its groups", held, "check the path")
        got = "several arrays" if name is None else repr(name)
        fix = f"pick one with array=NAME; there are: {', '.join(names)}"
        error = expected("array", "the name of one array", got, fix)
        listed = [(key, _describe_array(array)) for key, array in arrays if key in names]
        raise MissingOption(str(error), "array", listed) if options.array is None else error
    return node


def _describe_array(array: Any) -> str:
    """An array's size, x first, and its type."""
    return f"{' × '.join(map(str, array.shape[::-1]))} {array.dtype.name}"


def _index(shape: Sequence[int], names: list[str], options: LoadOptions) -> tuple[int | slice, ...]:
    long = [axis for axis, name in enumerate(names) if name not in "zyxt" and shape[axis] > 1]
    if len(long) > 1:
        raise expected(
            "axes", "one axis in addition to z, y, x and t", [names[axis] for axis in long], "save a part of it"
        )
    picked: dict[int, str | int] = {axis: 0 for axis, name in enumerate(names) if name not in SPACE}
    picked |= {axis: "time" for axis, name in enumerate(names) if name == "t" and shape[axis] > 1}
    return options.index(shape, picked | dict.fromkeys(long, "channel"))


def _grid(multiscale: Multiscale, level: str, names: list[str]) -> tuple[Triple, Triple]:
    """Spacing and origin (x, y, z) in the unit of x. level: the path of its array below the image's group."""
    scale, origin = _transform(multiscale, level, len(names))
    x, y = names.index("x"), names.index("y")
    # a plane is as thick as a pixel is wide
    z = names.index("z") if "z" in names else x
    _, factors = _unit(multiscale)
    (sx, sy, sz), (ox, oy, oz) = ((factors * numbers[[x, y, z]]).tolist() for numbers in (scale, origin))
    return (sx, sy, sz), (ox, oy, oz if "z" in names else 0.0)


def _transform(multiscale: Multiscale, level: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Scale and translation [count] along the axes of a level: its own, then the whole image's."""
    scale, origin = np.ones(count), np.zeros(count)
    datasets = [entry for entry in multiscale["datasets"] if entry["path"] == level]
    for owner in (*datasets[:1], multiscale):
        for step in owner.get("coordinateTransformations", ()):
            kind = step.get("type")
            values = np.asarray(step.get(kind, ()), dtype=np.float64)
            if kind == "identity":
                continue
            if values.shape != scale.shape or kind not in ("scale", "translation"):
                this = "a scale or translation with one number per axis"
                raise expected("coordinateTransformations", this, step)
            scale, origin = (scale * values, origin * values) if kind == "scale" else (scale, origin + values)
    return scale, origin


def _unit(multiscale: Multiscale) -> tuple[str, np.ndarray]:
    """The unit of x, and what the units of x, y and z are in it."""
    units = {axis.get("name"): axis.get("unit", "") for axis in multiscale.get("axes", ()) if isinstance(axis, Mapping)}
    # a plane is as thick as a pixel is wide
    names = [units.get(name, units.get("x", "")) for name in "xyz"]
    return shared_unit([unit_name(str(name)) for name in names])

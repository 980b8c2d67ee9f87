"""`TransferChoice`: options of a transfer function that are not its fields: preset, labels, looks of channels."""

from __future__ import annotations

from dataclasses import dataclass

from splatgl.data.color import srgb_of_name
from splatgl.options import Group, Kind, option


def read_channel_color(text: str) -> tuple[str, str]:
    """Returns the channel and #rrggbb of CHANNEL=COLOR. Raises ValueError for other text."""
    name, _, color = text.rpartition("=")
    if not name:
        raise ValueError
    return name, "#{:02x}{:02x}{:02x}".format(*srgb_of_name(color))


def read_channel_window(text: str) -> tuple[str, tuple[float, float]]:
    """Returns the channel and window of CHANNEL=LOW,HIGH. Raises ValueError for other text."""
    name, _, window = text.rpartition("=")
    if not name:
        raise ValueError
    low, high = Kind.interval().check(Kind.interval().read(window))
    return name, (low, high)


def read_label_name(text: str) -> tuple[int, str]:
    """Returns the number and name of NUMBER=NAME. Raises ValueError for other text."""
    number, _, name = text.partition("=")
    if not name.strip():
        raise ValueError
    return int(number), name.strip()


def read_labels(text: str) -> tuple[tuple[int, float], ...]:
    """Returns labels and opacity factors from N or N:A, separated by commas; () for "all". Raises ValueError."""
    pairs = [part.partition(":") for part in text.split(",")] if text != "all" else []
    return tuple((int(number), float(factor or 1)) for number, _, factor in pairs)


@dataclass(frozen=True)
class TransferChoice:
    """Options of a transfer function that are not its fields."""

    preset: str = option(
        "",
        Kind.instance("a name", str),
        "ct-bone, mr-angio, mip, …: splatgl presets lists all",
        group=Group.TRANSFER,
        level="basic",
    )
    curve: str = option(
        "",
        Kind.instance("a shape and its values", str, metavar="SHAPE[:VALUES[:A]]"),
        "opacity by a shape: ramp:60,120, band:50%,90%:0.4, tent. Or step, sigmoid, gate; VALUES: values or "
        "percentiles (default: from the object to the 99.9th); A: highest opacity (default 0.8)",
        group=Group.TRANSFER,
        level="basic",
    )
    colors: str = option(
        "",
        Kind.instance("colours at values", str, metavar="V:COLOUR,…"),
        "colours at values or percentiles, such as 60:red,95%:#ffd0a0, between which they are mixed",
        group=Group.TRANSFER,
    )
    only_labels: tuple[tuple[int, float], ...] = option(
        (),
        Kind("labels N or N:A", tuple, read_labels, "N[:A],N…", written="labels N or N:A, separated by commas, or all"),
        "labels of a segmentation to show, or all. A: a factor of their opacity",
        group=Group.TRANSFER,
    )
    name_of: tuple[tuple[int, str], ...] = option(
        (),
        Kind("a whole number and a name", tuple, read_label_name, "NUMBER=NAME"),
        "name of a segment, instead of the file's, by the number of its voxels (repeatable)",
        group=Group.TRANSFER,
        repeat=True,
    )
    color_of: tuple[tuple[str, str], ...] = option(
        (),
        Kind("a colour #rrggbb, #rgb or of a name in CSS", tuple, read_channel_color, "CHANNEL=COLOR"),
        "colour of a channel, #rrggbb or a CSS name (repeatable)",
        group=Group.TRANSFER,
        repeat=True,
    )
    window_of: tuple[tuple[str, tuple[float, float]], ...] = option(
        (),
        Kind("LOW below HIGH", tuple, read_channel_window, "CHANNEL=LOW,HIGH"),
        "values of a channel that its colours span, from clear to opaque (repeatable)",
        group=Group.TRANSFER,
        repeat=True,
    )

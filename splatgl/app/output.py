"""Checks that an output file can be written, before any work; notes of a reader."""

from __future__ import annotations

import sys
from pathlib import Path

from splatgl.data.volume import Volume
from splatgl.readers.channels import PICKED


def tell(volume: Volume, quiet: bool = False, channels: bool = False, times: bool = False, layer: str = "") -> None:
    """Prints what the reader left out or assumed, on standard error. channels, times: whether all are shown. layer: the
    file of a volume beside the first.
    """
    notes = [note for note in volume.notes if not (times and note.endswith(PICKED))]
    if len(volume.channels) > 1 and not channels:
        notes.append(f"channel {volume.channels[0].name} of {len(volume.channels)} is taken: --channel picks another")
    for note in () if quiet else notes:
        print(f"splatgl: {Path(layer).name}: {note}" if layer else f"splatgl: {note}", file=sys.stderr)

"""Masks of scenes: `--mask`, and the keys of scene files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from splatgl.data.mask import OUTSIDE, named
from splatgl.errors import expected
from splatgl.readers.remote import is_address

if TYPE_CHECKING:
    from splatgl.data.volume import Volume
    from splatgl.splat.transfer import Transfer


def mask_table(folder: Path, what: str, given: Any) -> tuple[str, ...] | None:
    """The masks of a scene file in a folder. Raises InputError for what is neither text nor a list of it."""
    if given is None:
        return None
    every = given if isinstance(given, list) else [given] if given else []
    if not all(isinstance(each, str) and each for each in every):
        raise expected(f"{what}: mask", "FILE[:N,N…][:outside], or several, each in quotes", repr(given)[:80])
    return tuple(each if is_address(each) else mask_moved(each, lambda file: str(folder / file)) for each in every)


def mask_anywhere(mask: Any) -> Any:
    """A mask by its absolute path; one in memory, or at an address, as it is."""
    if not isinstance(mask, str) or is_address(mask):
        return mask
    return mask_moved(mask, lambda file: str(Path(file).resolve()))


def mask_moved(mask: str, moved: Callable[[str], str]) -> str:
    """A mask whose file's name is replaced by what `moved` makes of it."""
    file, labels, outside = named(mask)
    told = [moved(file), ",".join(map(str, labels)), OUTSIDE * outside]
    return ":".join(part for part in told if part)


def check_masked(source: str, volume: Volume, transfer: Transfer) -> None:
    """InputError for masks that keep nothing that can be seen."""
    from splatgl.splat.opaque_bounds import Opaque

    if volume.masks and Opaque(volume, transfer).nothing:
        fix = "set the points to the values that matter, or take another mask"
        raise expected(source, "voxels with an opacity that its masks keep", "none", fix)

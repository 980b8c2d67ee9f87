"""Arrays without a grid: numpy's, nested lists, and those of dask, zarr and h5py, which are read in parts."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.volume import Volume
from splatgl.errors import InputError, expected

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions

# most entries of a first or last axis that are taken for channels
CHANNELS = 8
# most names of a group's members that are told
TOLD = 8


def of_array(x: Any, options: ArrayOptions) -> Volume:
    """The volume of an array [z, y, x] on a grid of unit spacing."""
    options.no_array("an array")
    return Volume(checked(x), name=_name(x))


def checked(x: Any, what: str = "array") -> Any:
    """`x` as 3-D samples of real numbers: itself or a view, a copy only of what is no array. InputError otherwise."""
    samples = _masked(x) if isinstance(x, np.ma.MaskedArray) else _as_array(x, what)
    if samples.dtype.kind not in "buif":
        raise expected(what, "real numbers", f"samples of type {samples.dtype}", _real(samples.dtype))
    check_axes(samples.shape, what)
    if not all(isinstance(size, int | np.integer) for size in samples.shape):
        raise expected(what, "sizes that are known", samples.shape, "call x.compute_chunk_sizes()")
    return samples


def check_axes(shape: tuple[int, ...], what: str = "array") -> None:
    """InputError unless there are three axes, naming what the others may be."""
    got, count = "×".join(map(str, shape)) or "a single number", len(shape)
    if count == 3:
        return
    if count == 2:
        raise expected(what, "3 axes [z, y, x]", f"2 ({got})", "stack planes into one array: np.stack(planes)")
    if count == 4:
        # a few entries at one end are channels, at the front they may be points in time, too
        last = shape[-1] <= CHANNELS < shape[0]
        fix = f"pick a channel: x[..., 0] … x[..., {shape[-1] - 1}]" if last else "pick a channel or time: x[0]"
        raise expected(what, "3 axes [z, y, x]", f"4 ({got})", fix)
    raise expected(what, "3 axes [z, y, x]", f"{count} ({got})")


def _as_array(x: Any, what: str) -> Any:
    """What has a shape, a numpy dtype and slices; other libraries' arrays and lists as numpy's."""
    if isinstance(x, str | bytes | PurePath):
        raise expected(what, "an array or image", f"the text {str(x)[:80]!r}", "read a file by sg.load(path)")
    if hasattr(x, "keys"):
        # zarr's and h5py's groups, npz files, dictionaries
        names = [str(name) for name in list(x.keys())[: TOLD + 1]]
        listed = ", ".join(names[:TOLD]) + ", …" * (len(names) > TOLD)
        raise expected(what, "an array", f"a {type(x).__name__} of {listed or 'nothing'}", "pick one: x[name]")
    try:
        dtype = getattr(x, "dtype", None)
        if isinstance(dtype, np.dtype) and hasattr(x, "shape") and hasattr(x, "__getitem__"):
            return x
        found = np.asarray(x)
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise expected(
            what, "an array [z, y, x]", f"{type(x).__name__} ({reason})", "convert it by np.asarray"
        ) from error
    if found.dtype == object:
        raise expected(what, "an array [z, y, x]", f"a {type(x).__name__}", "convert it to an array of numbers")
    return found


def _masked(x: Any) -> np.ndarray:
    """A masked array with NaN where it is masked, which is not drawn."""
    if not np.ma.is_masked(x) or x.dtype.kind not in "buif":
        return np.asarray(x.data)
    wide = x.dtype if x.dtype.kind == "f" else np.dtype(np.float32 if x.dtype.itemsize < 4 else np.float64)
    return np.asarray(x.astype(wide).filled(np.nan))


def _real(dtype: np.dtype) -> str:
    """How to convert samples of that type."""
    return "take abs(x), x.real or x.imag" if dtype.kind == "c" else "convert it by x.astype(…)"


def _name(x: Any) -> str:
    """The last part of an array's own path in its file; "" for what has none."""
    name = getattr(x, "name", None)
    inside = type(x).__module__.partition(".")[0] in ("h5py", "zarr")
    return name.strip("/").rpartition("/")[2] if inside and isinstance(name, str) else ""

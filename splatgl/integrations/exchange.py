"""Volumes as arrays and images of other libraries; `Volume.of` takes them back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.errors import expected, import_extra

if TYPE_CHECKING:
    from splatgl.data.volume import Volume

# symbols of UDUNITS, as CF's conventions name units
_CF_UNITS = {"um": "micrometer", "nm": "nanometer"}
# a grid is axis-aligned up to so much of an axis
_ALIGNED = 1e-6


def to_xarray(volume: Volume) -> Any:
    """As of `Volume.to_xarray`; coordinates are those of the voxels' centres."""
    xarray = import_extra("xarray", "DataArrays", "xarray", "arrays")
    signs = np.diag(volume.direction)
    if not np.allclose(volume.direction, np.diag(np.sign(signs)), atol=_ALIGNED):
        raise expected("direction", "axes along x, y and z of the world", "a turned grid", "to_simpleitk keeps it")
    unit = {"units": _CF_UNITS.get(volume.unit, volume.unit)} if volume.unit else {}
    coords: dict[str, Any] = {}
    for axis, name in enumerate("xyz"):
        steps = np.arange(volume.shape[2 - axis]) * volume.spacing[axis] * np.sign(signs[axis])
        coords[name] = xarray.Variable((name,), volume.origin[axis] + steps, {"axis": name.upper(), **unit})
    dims = ["z", "y", "x"]
    samples = [lazy_samples(part.samples) for part in volume.channels or (volume,)]
    if len(samples) > 1:
        dims = ["channel", *dims]
        coords["channel"] = [part.name for part in volume.channels]
        stack = np.stack if all(isinstance(part, np.ndarray) for part in samples) else _dask().stack
        samples = [stack(samples)]
    about = {"units": volume.value_unit, "long_name": volume.quantity, "frame": volume.frame}
    attributes = {name: value for name, value in about.items() if value}
    return xarray.DataArray(samples[0], coords, dims, volume.name or None, attributes)


def to_dask(volume: Volume) -> Any:
    """As of `Volume.to_dask`, in the chunks of its store."""
    array, dask = lazy_samples(volume.samples), _dask()
    return dask.from_array(array) if isinstance(array, np.ndarray) else array


def to_simpleitk(volume: Volume) -> Any:
    """As of `Volume.to_simpleitk`; all samples are read."""
    library = import_extra("SimpleITK", "images of SimpleITK", "SimpleITK", "arrays")
    placed, samples = _placed(volume, "LPS")
    direction = np.asarray(placed.direction)
    if not np.allclose(direction.T @ direction, np.eye(3), atol=1e-5):
        raise expected("direction", "axes at right angles", "a sheared grid", "to_nibabel keeps it")
    image = library.GetImageFromArray(samples)
    image.SetSpacing(placed.spacing)
    image.SetOrigin(placed.origin)
    image.SetDirection(direction.ravel().tolist())
    return image


def to_nibabel(volume: Volume) -> Any:
    """As of `Volume.to_nibabel`; its array is a view of samples in memory."""
    nibabel = import_extra("nibabel", "images of nibabel", "nibabel", "readers")
    placed, samples = _placed(volume, "RAS")
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = placed.world_from_index, placed.origin
    # NIfTI-1 counts voxels along an axis in 15 bits
    kind = nibabel.Nifti1Image if max(samples.shape) < 2**15 else nibabel.Nifti2Image
    image = kind(samples.T, affine, dtype=samples.dtype)
    image.header.set_xyzt_units("mm" if placed.unit else "unknown")
    if volume.labels is not None and samples.dtype.kind in "iu":
        image.header.set_intent("label")
    return image


def _placed(volume: Volume, frame: str) -> tuple[Volume, np.ndarray]:
    """The volume in a frame and, if its unit is known, in millimetres; and its samples in a type that files have: no
    half floats, and no bits.
    """
    placed = volume.placed(frame, "mm" if volume.unit else "")
    samples = np.asarray(placed.samples[...])
    kind = {"f2": np.float32, "b1": np.uint8}.get(samples.dtype.str[1:], samples.dtype)
    return placed, samples.astype(kind, copy=False)


def lazy_samples(samples: Any) -> Any:
    """Samples as a numpy array, or as a Dask array of what is read in parts."""
    if isinstance(samples, np.ndarray) or hasattr(samples, "dask"):
        return samples
    chunks, meta = getattr(samples, "chunks", None) or "auto", np.empty((0,) * len(samples.shape), samples.dtype)
    return _dask().from_array(samples, chunks=chunks, name=False, meta=meta)


def _dask() -> Any:
    return import_extra("dask.array", "Dask arrays", "dask", "arrays")

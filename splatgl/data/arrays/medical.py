"""Images of SimpleITK (LPS, mm) and of nibabel (RAS): their memory or file, and their grid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from splatgl.data.arrays.parts import Turned, kept
from splatgl.data.arrays.plain import checked
from splatgl.data.readers.grid import axes_of, triple
from splatgl.data.volume import Volume
from splatgl.errors import expected

if TYPE_CHECKING:
    from splatgl.data.arrays import ArrayOptions


def of_simpleitk(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a SimpleITK image, a read-only view of its memory: world in LPS, mm."""
    if not hasattr(x, "GetNumberOfComponentsPerPixel"):
        raise expected("array", "an Image of SimpleITK", f"a {type(x).__name__}", "execute it first")
    import SimpleITK

    options.no_array("an image")
    size, count = x.GetSize(), x.GetNumberOfComponentsPerPixel()
    if len(size) != 3:
        fix = "take a volume of it: x[:, :, :, 0]" if len(size) == 4 else "join planes by SimpleITK.JoinSeries"
        raise expected("image", "3 dimensions", f"{len(size)} ({'×'.join(map(str, size))})", fix)
    if count > 1:
        fix = f"pick one of 0 … {count - 1} by SimpleITK.VectorIndexSelectionCast(x, 0)"
        raise expected("image", "one number per voxel", f"{count} channels", fix)
    samples = checked(kept(SimpleITK.GetArrayViewFromImage(x), x), "image")
    direction = np.array(x.GetDirection()).reshape(3, 3)
    spacing, origin = triple(x.GetSpacing(), "spacing"), triple(x.GetOrigin(), "origin")
    return Volume(samples, spacing, origin, direction, "mm", frame="LPS")


def of_nibabel(x: Any, options: ArrayOptions) -> Volume:
    """The volume of a nibabel image, as `load` reads its file; `array` picks the time point of a 4-D one."""
    if not hasattr(x, "dataobj") or not hasattr(x, "affine"):
        raise expected("array", "a volume image of nibabel", f"a {type(x).__name__}")
    from splatgl.data.readers.nifti import of_image
    from splatgl.data.readers.options import LoadOptions

    if "sform_code" in x.header:
        return of_image(x, LoadOptions(array=options.array))
    # MGH and others, in mm: nibabel gives their affines to RAS
    options.no_array("an image")
    if len(x.shape) != 3:
        fix = "pick one by x.slicer[..., 0]"
        raise expected("image", "3 axes [x, y, z]", f"{len(x.shape)} ({'×'.join(map(str, x.shape))})", fix)
    data = x.dataobj
    samples = data.T if isinstance(data, np.ndarray) else Turned(data, (2, 1, 0))
    spacing, direction = axes_of(x.affine[:3, :3], "affine")
    return Volume(checked(samples, "image"), spacing, triple(x.affine[:3, 3], "affine"), direction, "mm", frame="RAS")

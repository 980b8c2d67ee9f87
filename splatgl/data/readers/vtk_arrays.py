"""Selects a volume's samples and vectors from a VTK image's arrays; shared by all VTK readers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from splatgl.data.quantities import hints_of
from splatgl.data.readers.options import LoadOptions
from splatgl.data.volume import Hints
from splatgl.errors import choice, expected

MOST_TOLD = 8
"""Most names of arrays that a note lists."""


@dataclass(frozen=True)
class PointArray:
    """One array of a VTK grid. read() loads it as [D, H, W, components]; loading is lazy."""

    name: str
    components: int
    is_vectors: bool
    read: Callable[[], np.ndarray]
    dtype: np.dtype | None = None


def pick(arrays: Sequence[PointArray], options: LoadOptions) -> tuple[np.ndarray, np.ndarray | None]:
    """(samples [D, H, W], vectors float32 [D, H, W, 3] or None) out of a file's arrays.

    Without options the first array with one component, else the length of the first vectors, becomes the samples.
    `array` names another one; "scalars", "vectors" and "speed" also stand for the first of their kind. `channel`
    picks a component. Raises InputError naming the arrays if the choice is not clear.
    """
    if not arrays:
        raise expected("arrays", "point or cell data", "none")
    vectors = next((array for array in arrays if array.is_vectors), None)
    chosen = _chosen(arrays, vectors, options)
    if chosen.is_vectors:
        vectors = chosen
    field = None if vectors is None else np.asarray(vectors.read(), dtype=np.float32)
    if options.channel_number is None and chosen.is_vectors and field is not None:
        return _lengths(field), field
    return _component(chosen, options), field


def hints_for(arrays: Sequence[PointArray], options: LoadOptions, samples: np.ndarray) -> Hints:
    """How what `pick` chose is drawn: speeds, and arrays that are named as a simulation's, as a field."""
    chosen = _chosen(arrays, next((array for array in arrays if array.is_vectors), None), options)
    return hints_of(chosen.name, chosen.is_vectors) if samples.dtype.kind == "f" else Hints()


def told(arrays: Sequence[PointArray], options: LoadOptions) -> tuple[str, ...]:
    """A note on the arrays of a file that are left out, if none was asked for."""
    chosen = _chosen(arrays, next((array for array in arrays if array.is_vectors), None), options)
    others = [array.name for array in arrays if array.name != chosen.name]
    if options.array is not None or not others:
        return ()
    listed = ", ".join(others[:MOST_TOLD]) + ", …" * (len(others) > MOST_TOLD)
    return (f"array {chosen.name} of {len(arrays)} is drawn; --array picks another: {listed}",)


def _chosen(arrays: Sequence[PointArray], vectors: PointArray | None, options: LoadOptions) -> PointArray:
    scalars = next((array for array in arrays if array.components == 1), None)
    if options.array is None:
        return scalars or vectors or arrays[0]
    named = next((array for array in arrays if array.name == options.array), None)
    chosen = named or {"scalars": scalars, "vectors": vectors, "speed": vectors}.get(str(options.array))
    if chosen is None:
        listed = ", ".join(f"{array.name} ({array.components})" for array in arrays)
        raise expected("array", f"one of {listed}", repr(options.array))
    return chosen


def _component(chosen: PointArray, options: LoadOptions) -> np.ndarray:
    count = chosen.components
    if options.channel_number is None and count > 1:
        fix = f"pick one with channel=0 … channel={count - 1}"
        error = expected("array", "one number per voxel", f"{count} in {chosen.name!r}", fix)
        raise choice(error, "channel", [(f"0 … {count - 1}", f"numbers of each voxel in {chosen.name!r}")])
    if options.channel_number is not None and options.channel_number >= count:
        raise expected("channel", f"a number from 0 to {count - 1}", options.channel_number)
    return chosen.read()[..., options.channel_number or 0]


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths float32 [D, H, W], plane by plane."""
    lengths = np.empty(vectors.shape[:3], np.float32)
    for plane, source in zip(lengths, vectors, strict=True):
        plane[...] = np.linalg.norm(source, axis=-1)
    return lengths

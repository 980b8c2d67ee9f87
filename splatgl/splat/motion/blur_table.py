"""The moving footprint as a table for the GPU, and its float twin: two numbers a texel, ten texels a fragment.

G(u, v) of `blur.py` is the whole line's area times the share of it before u. Over u in half chords
√(R² − v²) and v² the share hardly changes from line to line, so that few texels suffice: at 64 × 512 its error
is 5e−7 of the line's area, while G itself over u and v² needs 256 × 1024 for 8e−6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from splatgl.splat.kernel.kernels import Kernel, kernel
from splatgl.splat.motion.blur import half_chord, line_area, partial_area

# along the chord, from its middle to its end, and over v²/R² from 0 to 1
COLUMNS, ROWS = 64, 512
# a path shorter than this many voxels is summed by Simpson's rule from three footprints: the difference of
# two areas in float32 loses more than the rule does
SHORT = 0.03


@dataclass(frozen=True, eq=False)
class BlurTable:
    """texels [ROWS, COLUMNS + 1, 2]: over v²/R² and |u|/chord in [0, 1], half of the share between the chord's
    middle and u, and its slope per column; in the last column the line's area over F(0), and its slope per row.

    kernel: for the footprint itself. The methods repeat the shader's steps in the texels' type.
    """

    kernel: Kernel
    texels: np.ndarray

    @property
    def bytes(self) -> int:
        """Bytes of all texels."""
        return self.texels.nbytes

    @property
    def packed(self) -> np.ndarray:
        """[ROWS − 1, COLUMNS + 1, 4]: each row interleaved with the next, so that one fetch reads both."""
        return np.concatenate([self.texels[:-1], self.texels[1:]], axis=-1)

    def blurred(self, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
        """B(u, v, l)/F(0), arrays that broadcast."""
        real = self.texels.dtype.type
        u, v, length = np.broadcast_arrays(*(np.asarray(x, dtype=real) for x in (u, v, length)))
        q = v * v
        chord = np.sqrt(np.maximum(real(self.kernel.radius**2) - q, real(1e-12)))
        area, row, part = self._line(q)
        moves = length > SHORT
        safe = np.where(moves, length, real(1))
        ends = [self._share((u + side * safe / 2) / chord, row, part) for side in (real(1), real(-1))]
        long = area * (ends[0] - ends[1]) / safe
        return np.where(moves, np.where(q < self.kernel.radius**2, long, 0), self._simpson(u, v, length))

    def _line(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The line's area over F(0), the row before it and the fraction of the step to the next."""
        last = len(self.texels) - 1
        place = np.clip(q * self.texels.dtype.type(last / self.kernel.radius**2), 0, last)
        row = np.minimum(place.astype(np.intp), last - 1)
        part = place - row.astype(self.texels.dtype)
        return hermite(self.texels[row, -1], self.texels[row + 1, -1], part), row, part

    def _share(self, t: np.ndarray, row: np.ndarray, part: np.ndarray) -> np.ndarray:
        """Share of the line from its middle to t half chords, odd in t, ±½ at most."""
        last = self.texels.shape[1] - 2
        place = np.minimum(np.abs(t), 1) * self.texels.dtype.type(last)
        column = np.minimum(place.astype(np.intp), last - 1)
        along = place - column.astype(self.texels.dtype)
        here, there = (hermite(self.texels[r, column], self.texels[r, column + 1], along) for r in (row, row + 1))
        return np.copysign(here + (there - here) * part, t)

    def _simpson(self, u: np.ndarray, v: np.ndarray, length: np.ndarray) -> np.ndarray:
        """F + (F₊ − 2F + F₋)/6: bit-identical to F for a path of length 0."""
        peak = float(self.kernel.footprint(np.zeros(())))
        first, middle, last = (
            (self.kernel.footprint(np.hypot(u + side * length / 2, v)) / peak).astype(self.texels.dtype)
            for side in (-1, 0, 1)
        )
        return np.asarray(middle + (first - 2 * middle + last) / 6)


@lru_cache(maxsize=8)
def blur_table(name: str, columns: int = COLUMNS, rows: int = ROWS, dtype: str = "<f4") -> BlurTable:
    """The table of that kernel, cached. InputError for an unknown kernel."""
    shape = kernel(name)
    # the last line has length 0: use the limit, from a line close by
    q = np.minimum(np.linspace(0.0, 1.0, rows), 1 - 1e-9)[:, None] * shape.radius**2
    chord = half_chord(shape.radius, np.sqrt(q))
    t = np.linspace(0.0, 1.0, columns)
    area = line_area(shape, np.sqrt(q))
    texels = np.empty((rows, columns + 1, 2))
    texels[:, :-1, 0] = partial_area(shape, chord * t, np.sqrt(q)) / area
    texels[:, :-1, 1] = shape.footprint(np.hypot(chord * t, np.sqrt(q))) * chord / area / (columns - 1)
    # the area of the line beyond v is π ∫ g(√s) ds from v² to R², so that its slope is −π g
    peak = float(shape.footprint(np.zeros(())))
    texels[:, -1, 0] = area[:, 0] / peak
    texels[:, -1, 1] = -np.pi * shape.value(np.sqrt(q[:, 0])) * shape.radius**2 / (rows - 1) / peak
    texels[-1, -1, 0] = 0.0
    return BlurTable(shape, texels.astype(dtype))


def hermite(first: np.ndarray, last: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Cubic Hermite interpolation of two values [..., 0] with slopes [..., 1] per step, at `part` of the step."""
    rise = last[..., 0] - first[..., 0]
    bend = 3 * rise - 2 * first[..., 1] - last[..., 1]
    twist = first[..., 1] + last[..., 1] - 2 * rise
    return np.asarray(first[..., 0] + part * (first[..., 1] + part * (bend + part * twist)))

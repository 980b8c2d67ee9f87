"""Splats as 3-D Gaussians, in the layouts that viewers of Gaussian splatting read: PLY, and SPZ of version 2.

Positions are in world units and axes; colours are spherical harmonics of degree 0.
"""

from __future__ import annotations

import gzip
import struct
from dataclasses import dataclass

import numpy as np

from splatgl.data.color import srgb_from_linear
from splatgl.geometry.camera import quaternion_of
from splatgl.splat.kernels import Kernel
from splatgl.splat.quantized import JoinedMatter

# zeroth spherical harmonic
HARMONIC = 0.28209479177387814
# largest opacity, whose logarithm of odds is finite
MOST_OPACITY = 1 - 1 / 4096
NAMES = (
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity"),
    *("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
)
# SPZ: its magic number and version, bits of a position, and most fractional ones
MAGIC, VERSION, POSITION_BITS, FRACTION_BITS = 0x5053474E, 2, 24, 16
# and how it stores colours and scales
COLOR_SCALE, LOG_ZERO, LOG_STEPS = 0.15, 10.0, 16.0


@dataclass(frozen=True, eq=False)
class Gaussians:
    """3-D Gaussians. position [N, 3]: world. opacity [N]: of the middle. color [N, 3]: sRGB. scale [N, 3]: standard
    deviations, world. rotation [4]: quaternion w, x, y, z of their axes. rmse: of the footprint, share of its peak.
    """

    position: np.ndarray
    opacity: np.ndarray
    color: np.ndarray
    scale: np.ndarray
    rotation: np.ndarray
    rmse: float

    @classmethod
    def of(cls, matter: JoinedMatter, kernel: Kernel, light: np.ndarray) -> Gaussians:
        """The Gaussians of voxels. light [N]: factor of their colours, as a Gaussian is not shaded."""
        side = 2.0 ** matter.column("size")
        width, rmse = gaussian_width(kernel)
        axes, widths, _ = np.linalg.svd(matter.grid.world_from_index)
        if np.linalg.det(axes) < 0:
            axes[:, 2] *= -1
        turn = np.roll(quaternion_of(axes), 1)
        turn *= 1 if turn[0] >= 0 else -1
        peak = float(kernel.footprint(np.zeros(())))
        opacity = -np.expm1(-matter.column("depth") * side * peak)
        scale = widths * width * side[:, None]
        lit = srgb_from_linear(np.clip(matter.column("color") * light[:, None], 0, 1))
        return cls(matter.world, np.minimum(opacity, MOST_OPACITY), lit, scale, turn, rmse)

    @property
    def harmonic(self) -> np.ndarray:
        """The colours as spherical harmonics of degree 0 [N, 3]."""
        return (self.color - 0.5) / HARMONIC

    def ply(self) -> bytes:
        """A binary PLY in the layout of 3-D Gaussian splatting."""
        normals, turn = np.zeros_like(self.position), np.broadcast_to(self.rotation, (len(self.position), 4))
        odds = np.log(self.opacity / (1 - self.opacity))[:, None]
        columns = (self.position, normals, self.harmonic, odds, np.log(self.scale), turn)
        rows, names = np.hstack(columns).astype("<f4"), "".join(f"property float {name}\n" for name in NAMES)
        head = f"ply\nformat binary_little_endian 1.0\ncomment splatgl\nelement vertex {len(rows)}\n{names}end_header\n"
        return head.encode() + rows.tobytes()

    def spz(self) -> bytes:
        """A compressed SPZ."""
        reach = max(float(np.abs(self.position).max(initial=0.0)), 1e-6)
        bits = int(np.clip(np.floor(POSITION_BITS - 1 - np.log2(reach * 1.001)), 0, FRACTION_BITS))
        fixed = np.rint(self.position * 2**bits).astype("<i4")
        places = fixed.view(np.uint8).reshape(-1, 3, 4)[..., :3]
        parts = (
            places,
            _byte(self.opacity * 255),
            _byte(self.harmonic * (COLOR_SCALE * 255) + 0.5 * 255),
            _byte((np.log(self.scale) + LOG_ZERO) * LOG_STEPS),
            np.broadcast_to(_byte(self.rotation[1:] * 127.5 + 127.5), (len(self.position), 3)),
        )
        head = struct.pack("<IIIBBBB", MAGIC, VERSION, len(self.position), 0, bits, 0, 0)
        return gzip.compress(head + b"".join(np.ascontiguousarray(part).tobytes() for part in parts), mtime=0)


def _byte(values: np.ndarray) -> np.ndarray:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def gaussian_width(kernel: Kernel) -> tuple[float, float]:
    """Standard deviation, in voxels, of the Gaussian whose footprint is nearest to a kernel's, and the root mean square
    of the difference over the kernel's disc, as a share of the peak.
    """
    d = np.linspace(0, kernel.radius, 512)
    shape = kernel.footprint(d) / kernel.footprint(np.zeros(()))
    widths = np.linspace(0.3, 1.5, 1201)[:, None]
    apart = (np.exp(-0.5 * (d / widths) ** 2) - shape) ** 2 @ d / d.sum()
    best = int(apart.argmin())
    return float(widths[best, 0]), float(np.sqrt(apart[best]))

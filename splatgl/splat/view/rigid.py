"""Rigid motions x → Q x + t and fractions of them: rotation about an axis, and screw interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# angles below this, in radians, use Taylor series
SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class Rigid:
    """x → rotation @ x + shift."""

    rotation: np.ndarray
    shift: np.ndarray

    @classmethod
    def about(cls, turn: np.ndarray, center: np.ndarray) -> Rigid:
        """A turn by |turn| radians about the axis `turn` through `center`, counter-clockwise seen from its tip."""
        q = rotation(turn)
        return cls(q, center - q @ center)

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Points [..., 3] moved."""
        return np.asarray(points @ self.rotation.T + self.shift)

    def after(self, first: Rigid) -> Rigid:
        """First `first`, then this."""
        return Rigid(self.rotation @ first.rotation, self.rotation @ first.shift + self.shift)

    def inverse(self) -> Rigid:
        """The motion that undoes this one."""
        return Rigid(self.rotation.T, -self.rotation.T @ self.shift)

    def part(self, share: float) -> Rigid:
        """A fraction of the motion, as a screw about and along one axis at constant speed.

        0 is the identity, 1 this motion. Half a turn or more goes the shorter way.
        """
        turn = rotation_vector(self.rotation)
        pace = np.linalg.solve(_swept(turn), self.shift)
        return Rigid(rotation(share * turn), _swept(share * turn) @ (share * pace))


def rotation(turn: np.ndarray) -> np.ndarray:
    """[3, 3]: the rotation by |turn| radians about `turn` (Rodrigues' formula)."""
    first, second, _ = _weights(turn)
    k = _cross(turn)
    return np.asarray(np.eye(3) + first * k + second * k @ k)


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """[3]: the axis times the angle in radians, at most π, of a rotation [3, 3]."""
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
    sine, cosine = float(np.linalg.norm(skew)), (float(np.trace(matrix)) - 1) / 2
    angle = float(np.arctan2(sine, cosine))
    if cosine > -0.5:
        return np.asarray(skew * (angle / sine if sine > 0 else 1.0))
    # near half a turn the axis follows from the symmetric part: Q + Qᵀ = 2 cos·1 + 2 (1 − cos) n nᵀ
    squares = (matrix + matrix.T) / 2 - cosine * np.eye(3)
    axis = squares[:, int(np.argmax(np.diag(squares)))]
    axis = axis / np.linalg.norm(axis)
    return np.asarray(axis * angle * (-1.0 if axis @ skew < 0 else 1.0))


def _swept(turn: np.ndarray) -> np.ndarray:
    """∫₀¹ rotation(s turn) ds: the displacement at unit velocity in a rotating frame."""
    _, second, third = _weights(turn)
    k = _cross(turn)
    return np.asarray(np.eye(3) + second * k + third * k @ k)


def _weights(turn: np.ndarray) -> tuple[float, float, float]:
    """Returns sin θ/θ, (1 − cos θ)/θ² and (θ − sin θ)/θ³, θ = |turn|."""
    angle = float(np.linalg.norm(turn))
    if angle < SMALL:
        return 1 - angle**2 / 6, 0.5 - angle**2 / 24, 1 / 6 - angle**2 / 120
    # (1 − cos θ)/θ² from the half angle, without cancellation
    return np.sin(angle) / angle, 2 * (np.sin(angle / 2) / angle) ** 2, (angle - np.sin(angle)) / angle**3


def _cross(v: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])

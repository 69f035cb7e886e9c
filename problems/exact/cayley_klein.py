"""Attitude from the Cayley-Klein parameters, which have no singular orientation.

With 3-1-3 angles: p = cos(theta/2) exp(i (phi + psi)/2), s = sin(theta/2) exp(i (phi - psi)/2). They are the unit
quaternion (Re p, Re s, Im s, Im p). Each is a quotient of theta series times an even turn:
``over(z)/under(z) exp(i mu t)``, z = z0 + rate t.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.spatial.transform import Rotation

from .theta import ThetaSeries

ComplexSeries = Complex[np.ndarray, " nt"]


@dataclass(frozen=True)
class CayleyKlein:
    """p and s as functions of time; rates in rad/s."""

    over_p: ThetaSeries
    over_s: ThetaSeries
    under: ThetaSeries
    z0: float
    rate: float
    mu_p: float
    mu_s: float

    def attitude(
        self, t: Float[np.ndarray, " nt"], turn_p: complex = 1.0, turn_s: complex = 1.0
    ) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
        """R and Omega (body), p and s turned by constant unit factors."""
        zeta = self.z0 + self.rate * t
        below = self.under(zeta)
        p, p_dot = self._pair(self.over_p(zeta), below, self.mu_p, turn_p * np.exp(1j * self.mu_p * t))
        s, s_dot = self._pair(self.over_s(zeta), below, self.mu_s, turn_s * np.exp(1j * self.mu_s * t))
        return rotation_and_rate(p, s, p_dot, s_dot)

    def turns(self, R0: Float[np.ndarray, "3 3"], Omega0: Float[np.ndarray, " 3"]) -> tuple[complex, complex]:
        """The factors that make the motion start at ``R0``, ``Omega0``: phi about the vertical, psi about the axis.

        phi takes the axis and its velocity to the given ones; together they fix it even when the axis is upright.
        """
        R, Omega = (a[0] for a in self.attitude(np.zeros(1)))
        axis, axis_dot = _horizontal(R, Omega)
        axis0, axis0_dot = _horizontal(R0, Omega0)
        phi = np.angle(axis0 * np.conj(axis) * self.rate**2 + axis0_dot * np.conj(axis_dot))
        left = R.T @ Rotation.from_euler("Z", -phi).as_matrix() @ R0
        psi = np.arctan2(left[1, 0] - left[0, 1], left[0, 0] + left[1, 1])
        return complex(np.exp(0.5j * (phi + psi))), complex(np.exp(0.5j * (phi - psi)))

    def _pair(
        self,
        above: tuple[ComplexSeries, ComplexSeries],
        below: tuple[ComplexSeries, ComplexSeries],
        mu: float,
        turn: ComplexSeries,
    ) -> tuple[ComplexSeries, ComplexSeries]:
        (N, dN), (D, dD) = above, below
        value = N / D * turn
        return value, self.rate * (dN - N * dD / D) / D * turn + 1j * mu * value


def rotation_and_rate(
    p: ComplexSeries, s: ComplexSeries, p_dot: ComplexSeries, s_dot: ComplexSeries
) -> tuple[Float[np.ndarray, "nt 3 3"], Float[np.ndarray, "nt 3"]]:
    """R, and Omega = 2 vec(q* q_dot) (body), of the quaternion q = (Re p, Re s, Im s, Im p)."""
    w, x, y, z = p.real, s.real, s.imag, p.imag
    dw, dx, dy, dz = p_dot.real, s_dot.real, s_dot.imag, p_dot.imag
    rate = (
        w * dx - x * dw - y * dz + z * dy,
        w * dy - y * dw - z * dx + x * dz,
        w * dz - z * dw - x * dy + y * dx,
    )
    Omega = 2.0 * np.stack(rate, axis=-1) / (np.abs(p) ** 2 + np.abs(s) ** 2)[:, None]
    return Rotation.from_quat(np.stack((x, y, z, w), axis=-1)).as_matrix(), Omega  # normalises


def _horizontal(R: Float[np.ndarray, "3 3"], Omega: Float[np.ndarray, " 3"]) -> tuple[complex, complex]:
    """X + i Y of the body axis z and of its velocity."""
    axis, velocity = R[:, 2], R @ np.array([Omega[1], -Omega[0], 0.0])
    return complex(axis[0], axis[1]), complex(velocity[0], velocity[1])

"""Jacobi theta functions as short Fourier series: constants in extended precision, values for arrays of real phases.

With nome q and phase z = zeta - i eta (zeta real, eta fixed)::

    theta1(z) = 2 sum (-1)^n q^((n+1/2)^2) sin((2n+1) z)     theta3(z) = 1 + 2 sum        q^(n^2) cos(2 n z)
    theta2(z) = 2 sum        q^((n+1/2)^2) cos((2n+1) z)     theta4(z) = 1 + 2 sum (-1)^n q^(n^2) cos(2 n z)

They are entire: motions written by them have no singular orientation, as angles have (Whittaker, Analytical Dynamics,
ch. VI; NIST DLMF ch. 20).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from mpmath import mp, mpf

CUT = mpf(10) ** -20  # terms below this part of the largest are dropped: 1e-4 of rounding


@dataclass(frozen=True)
class ThetaSeries:
    """sum c_n cos(n zeta) + s_n sin(n zeta)."""

    multiple: Float[np.ndarray, " terms"]
    c: Complex[np.ndarray, " terms"]
    s: Complex[np.ndarray, " terms"]

    def __call__(self, zeta: Float[np.ndarray, " nt"]) -> tuple[Complex[np.ndarray, " nt"], Complex[np.ndarray, " nt"]]:
        """Value and derivative with respect to zeta."""
        value, slope = np.zeros((2, *zeta.shape), dtype=complex)
        for n, c, s in zip(self.multiple, self.c, self.s, strict=True):
            cos, sin = np.cos(n * zeta), np.sin(n * zeta)
            value += c * cos + s * sin
            slope += n * (s * cos - c * sin)
        return value, slope


def theta(kind: int, q: mpf, eta: mpf | int = 0, scale: mpf | int = 1) -> ThetaSeries:
    """``scale`` theta_kind(zeta - i eta) as a series in zeta."""
    odd = kind in (1, 2)
    multiple, c, s = [], [], []
    n, largest = 0, mpf(0)
    while True:
        m = 2 * n + 1 if odd else 2 * n
        weight = scale * (2 if odd or n else 1) * q ** (mpf(m) / 2) ** 2 * (-1 if kind in (1, 4) and n % 2 else 1)
        size = abs(weight) * mp.cosh(m * eta)
        largest = max(largest, size)
        if n > 1 and size <= CUT * largest:
            break
        cosh, sinh = float(weight * mp.cosh(m * eta)), float(weight * mp.sinh(m * eta))
        multiple.append(float(m))
        c.append(-1j * sinh if kind == 1 else cosh + 0j)  # sin(p - i e) = sin p cosh e - i cos p sinh e
        s.append(cosh + 0j if kind == 1 else 1j * sinh)  # cos(p - i e) = cos p cosh e + i sin p sinh e
        n += 1
    return ThetaSeries(np.array(multiple), np.array(c), np.array(s))


def log_slope(kind: int, z: mp.mpc, q: mpf) -> mp.mpc:
    """theta_kind' / theta_kind at ``z``."""
    return mp.jtheta(kind, z, q, 1) / mp.jtheta(kind, z, q)

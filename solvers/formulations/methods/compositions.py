"""Symmetric compositions of a symmetric second-order step: sub-steps gamma_i dt, sum gamma = 1, some negative.

Coefficients: Suzuki (1990), Phys. Lett. A 146; Kahan and Li (1997), Math. Comp. 66, s9odr6a and s17odr8a as printed in
Hairer, Lubich, Wanner, Geometric Numerical Integration, V.3.2.
"""

import numpy as np

_SUZUKI = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
_KAHAN_LI_6 = (0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.08221359629355080023)
_KAHAN_LI_8 = (
    0.13020248308889008088, 0.56116298177510838456, -0.38947496264484728641, 0.15884190655515560090,
    -0.39590389413323757734, 0.18453964097831570709, 0.25837438768632204729, 0.29501172360931029887,
)  # fmt: skip


def _complete_coefficients(half: tuple[float, ...]) -> np.ndarray:
    """Return all coefficients of a symmetric composition, of sum 1, from those before the middle one, ``half``."""
    middle = 1.0 - 2.0 * sum(half)
    return np.array([*half, middle, *reversed(half)])


COMPOSITIONS = {  # name: (steps, order)
    "plain": (np.array([1.0]), 2),
    "suzuki4": (_complete_coefficients((_SUZUKI, _SUZUKI)), 4),
    "kahan_li6": (_complete_coefficients(_KAHAN_LI_6), 6),
    "kahan_li8": (_complete_coefficients(_KAHAN_LI_8), 8),
}
RATE = "reversible step control: steps of dt / (1 + sum |Omega / rate|^4)^(1/4), about; 0: steps of dt"

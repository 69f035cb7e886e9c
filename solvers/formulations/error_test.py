"""Absolute tolerances of integrators with error control, unknown by unknown."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

# absolute tolerance that takes a variable out of error test and Newton test (IDA divides by it). Half and twice change
# the evaluations of a pendulum by -4 to 5 %, and of a top by one; behind a singular pose the motion is another one.
OUT_OF_TEST = 1e3


def tolerances(rtol: float, n: int, out_of_test: Sequence[slice]) -> Float[np.ndarray, " n"]:
    """Return the absolute tolerance of each of ``n`` unknowns: ``rtol``, but ``OUT_OF_TEST`` in the slices given.

    ``out_of_test`` are the slices of unknowns that take no part in the error test.
    """
    atol = np.full(n, rtol)
    for part in out_of_test:
        atol[part] = OUT_OF_TEST
    return atol

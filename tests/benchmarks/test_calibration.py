"""What the machine does in the same minute: kernels are compared with this, not with another day's seconds."""

import numpy as np
import scipy.linalg as sl

SIZE = 200


def test_calibration(benchmark):
    """Dense LU of a fixed matrix on one thread: library code that no change of ours touches."""
    A = np.random.default_rng(1).standard_normal((SIZE, SIZE))
    factors, _ = benchmark(sl.lu_factor, A)
    assert np.all(np.isfinite(factors))

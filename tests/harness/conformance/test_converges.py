"""The observed order, on errors that are given."""

import math

import pytest

from mbsbench.harness.conformance.trials import Evidence, check_order
from mbsbench.harness.results.records import RunRecord


def measured(errors: list[float], order: float = 4.0):
    """The finding on a solver of fixed steps with these errors at halved steps."""
    runs = {
        f"finer {k}": RunRecord(
            status="success", claimed="success", dt_s=0.5**k, length_scale_m=1.0, position_error_max_m=e,
            orientation_error_max_rad=0.0,
        )
        for k, e in enumerate(errors)
    }  # fmt: skip
    return check_order(Evidence("dt", order, runs, {}))


def test_a_floor_of_newton_iterations_is_no_lower_order():
    """Fourth order down to 1e-10, where corrections end; the floor is above rounding."""
    found = measured([1e-6, 1e-6 / 16.0, 3e-10, 2.5e-10])
    assert found.holds and found.measured.value == pytest.approx(math.log2(1e-6 / 16.0 / 3e-10), rel=1e-12)


def test_an_error_that_stays_far_above_such_a_floor_is_a_missing_term():
    """The first halving is of the declared order, then nothing helps."""
    found = measured([1e-2, 1e-2 / 16.0, 5e-4, 4.9e-4])
    assert not found.holds and found.measured.value < 0.1


def test_a_slow_solver_is_called_slow():
    """Runs that their wall limit ended say nothing about signs."""
    runs = {f"finer {k}": RunRecord(status="stalled", claimed="stalled", cpu_limit_s=20.0) for k in range(4)}
    found = check_order(Evidence("dt", 2.0, runs, {}))
    assert not found.holds and "too slow" in found.required.remedy and "20 s" in found.required.remedy

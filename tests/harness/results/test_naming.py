"""Options and parameters are formatted as they are typed, whatever type of number they come in."""

import numpy as np
import pytest

from mbsbench.harness.base.naming import format_exactly, format_name
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.mechanics.types import StepControl


@pytest.mark.parametrize("value", [1.0 / 3.0, 0.1, 1e-9, 1e300 / 7.0])
def test_a_number_of_numpy_is_formatted_as_a_plain_one(value):
    """The text is read back as the same number."""
    assert format_exactly(np.float64(value)) == format_exactly(value)
    assert float(format_exactly(np.float64(value))) == value


def test_a_case_names_no_type():
    """A problem made in a script, or an instance of a solver, may hold numbers of NumPy."""
    third = np.float64(1.0 / 3.0)
    spec = RunSpec("mine", "rattle", StepControl(dt=third), {"length": third}, {"gamma": (third, 1.0)})
    assert spec.case == "mine[length=0.3333333333333333] rattle[gamma=(0.3333333333333333,1)] dt=0.3333333333333333"
    assert format_name("mine", {}) == "mine"

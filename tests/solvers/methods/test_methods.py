"""Methods on code of a whole mechanism and on loops over its joints: the same motion of everything."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.types import Problem, StepControl
from mbsbench.solvers.formulations.compiled.host import Method, integrate, tolerance_of
from mbsbench.solvers.formulations.compiled.mechanism import make_mechanism
from mbsbench.solvers.formulations.methods import rattle, rkmk
from mbsbench.solvers.formulations.methods.tableaux import DOPRI853, Tableau
from mbsbench.solvers.formulations.rows.means import mean_row_loop

PROBLEMS = {  # name: (t_end [s], dt [s]); pins, springs and dampers, line rows, drives, rows of velocities alone
    "heavy_top": (0.3, 1e-3), "chain": (0.1, 1e-3), "flyball_governor": (0.05, 1e-4), "damped_linkage": (0.3, 1e-3),
    "slider_crank": (0.3, 1e-3),
    "driven_slider_crank": (0.5, 1e-2), "stewart_platform": (0.2, 1e-2), "rolling_disc": (0.5, 1e-2),
}  # fmt: skip
SAME = 1e-9  # [m] of step sizes that differ by rounding; fixed steps below agree to the iteration's tolerance


def problem(name: str) -> Problem:
    return dataclasses.replace(registry.problems()[name].make(), t_end=PROBLEMS[name][0])


def explicit(tableau: Tableau) -> Method:
    return dataclasses.replace(rkmk.explicit_pair(tableau), explicit=False)


def symplectic(of: Problem) -> Method:
    return rattle.symplectic_steps(of.system, np.array([1.0]), tolerance_of(1e-13, of)[0], discrete=False, rate=0.0)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("steps", ["adaptive", "fixed"])
def test_code_of_a_whole_mechanism_gives_the_same_motion(name: str, steps: str) -> None:
    """Straight code instead of loops over joints: the same steps, the same motion and reactions to rounding."""
    of = problem(name)
    control = StepControl(rtol=1e-9) if steps == "adaptive" else StepControl(dt=PROBLEMS[name][1])
    method = explicit(DOPRI853) if steps == "adaptive" else symplectic(of)
    assert make_mechanism(of.system) is not None
    new, old = (integrate(of, control, dataclasses.replace(method, explicit=whole)) for whole in (True, False))
    assert len(new.t) == len(old.t)
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < SAME
    assert np.max(np.abs(new.states.R[-1] - old.states.R[-1])) < SAME
    assert np.max(np.abs(new.reaction[-1] - old.reaction[-1])) < 1e3 * SAME * max(1.0, np.max(np.abs(old.reaction)))


def test_a_row_that_is_not_quadratic_has_no_mean() -> None:
    """The length of a driven link is a root."""
    with pytest.raises(ValueError, match="no mean rows"):
        mean_row_loop("driven distance", (0,), True)

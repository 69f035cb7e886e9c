"""The public ``accelerations`` and ``project``, on the kernel, against the judge's index 1 and the harness's own."""

import multiprocessing
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mbsbench
from mbsbench import MultibodySystem, State, States
from mbsbench.harness.catalogue.registry import make_problem, problems
from mbsbench.harness.mechanics import consistency, dynamics, motion
from mbsbench.harness.mechanics.consistency import perturbed
from mbsbench.harness.mechanics.counting import Count, counting
from mbsbench.harness.mechanics.index1 import index_1

from ..arbitrary_systems import consistent, with_user_forces

JUDGED = 1e-7  # relative: the judge's A_dot v is a difference
REDUNDANT = ("andrews", "bricard", "four_bar_grid")


def started(name: str, seed: int) -> tuple[MultibodySystem, State]:
    problem = make_problem(name)
    return problem.system, perturbed(problem.system, problem.initial, 1e-2, seed)


def both(rates: mbsbench.Rates) -> np.ndarray:
    return np.concatenate((rates.v_dot, rates.Omega_dot), axis=1)


def check_against_judge(system: MultibodySystem, s: State) -> None:
    judged, rates = index_1(system, States.one(s)), mbsbench.accelerations(system, s)
    size = np.max(np.abs(judged.a)) + np.max(s.Omega**2)
    assert np.max(np.abs(both(rates) - judged.a[0])) < JUDGED * size
    load = mbsbench.constraint_jacobian(system, s).T @ rates.reaction
    most = size * (np.max(system.mass) + np.max(system.inertia)) + np.max(np.abs(motion.applied(system, States.one(s))))
    assert np.max(np.abs(load - judged.load[0].ravel()), initial=0.0) < JUDGED * most


@pytest.mark.parametrize("name", sorted(problems()))
def test_accelerations_and_loads_are_the_judges_on_all_problems(name: str) -> None:
    check_against_judge(*started(name, 1))


@pytest.mark.parametrize("name", REDUNDANT)
def test_redundant_rows_share_their_load_by_least_squares(name: str) -> None:
    """As the singular values have it, which are NumPy's."""
    system, s = started(name, 2)
    known = dynamics.accelerations(system, s).reaction
    assert np.max(np.abs(mbsbench.accelerations(system, s).reaction - known)) < 1e-7 * np.max(np.abs(known))


@pytest.mark.parametrize("name", ["andrews", "chain", "driven_slider_crank", "knife_edge"])
def test_rows_are_given_what_is_asked_of_phi_ddot(name: str) -> None:
    system, s = started(name, 3)
    wanted = dynamics.equations(system, s).A @ np.random.default_rng(1).standard_normal(6 * system.nb)
    known, rates = dynamics.accelerations(system, s, wanted), mbsbench.accelerations(system, s, phi_ddot=wanted)
    assert np.max(np.abs(both(rates) - both(known))) < JUDGED * np.max(np.abs(both(known)))
    assert np.max(np.abs(rates.reaction - known.reaction)) < JUDGED * np.max(np.abs(known.reaction))


@pytest.mark.parametrize("name", ["heavy_top", "four_bar_grid", "bricard", "driven_slider_crank"])
def test_project_reaches_the_state_of_the_harness(name: str) -> None:
    system, s = started(name, 4)
    off = dynamics.moved(s, mbsbench.accelerations(system, s), 1e-2)
    assert np.max(np.abs(motion.constraint(system, States.one(off)))) > 1e-10
    found, known = mbsbench.project(system, off), consistency.project(system, off)
    for x, y in ((found.r, known.r), (found.R, known.R), (found.v, known.v), (found.Omega, known.Omega)):
        assert np.max(np.abs(x - y)) < 1e-10
    assert found.t == off.t


def test_project_refuses_what_no_pose_satisfies() -> None:
    problem = make_problem("slider_crank")
    s = problem.initial
    torn = State(s.r + np.array([[0.0, 0.0, 0.0], [40.0, 7.0, 3.0], [-30.0, 5.0, 2.0]]), s.R, s.v, s.Omega, s.t)
    with pytest.raises(consistency.InconsistentStart):
        mbsbench.project(problem.system, torn, iterations=1)


def test_what_has_no_accelerations_is_refused_in_the_same_words() -> None:
    """Of a pose that is not finite; of axes without inertia in ``test_zero_inertia``."""
    system, zero = make_problem("heavy_top").system, np.zeros((1, 3))
    s = State(zero, np.full((1, 3, 3), np.nan), zero, zero, 0.0)
    with np.errstate(all="ignore"):
        with pytest.raises(np.linalg.LinAlgError) as known:
            dynamics.accelerations(system, s)
        with pytest.raises(np.linalg.LinAlgError, match=str(known.value)):
            mbsbench.accelerations(system, s)


def test_a_call_is_one_evaluation_with_its_factorisation() -> None:
    system, s = started("bricard", 1)
    with counting(Count()) as count:
        mbsbench.accelerations(system, s)
        mbsbench.project(system, s)
    assert (count.evaluations, count.factorisations) == (1, 1)


def _many(given: tuple[MultibodySystem, list[State]]) -> list[np.ndarray]:
    system, states = given
    return [both(mbsbench.accelerations(system, s)) for s in states for _ in range(20)]


def test_threads_and_forked_processes_have_arrays_of_their_own() -> None:
    system = with_user_forces()
    parts = [(system, [consistent(system, seed) for seed in range(3 * k, 3 * k + 3)]) for k in range(4)]
    alone = [_many(part) for part in parts]
    with ThreadPoolExecutor(4) as pool:
        for found, known in zip(pool.map(_many, parts), alone, strict=True):
            assert np.array_equal(found, known)
    read, write = multiprocessing.Pipe(duplex=False)
    context = multiprocessing.get_context("fork")
    child = context.Process(target=lambda: write.send(_many(parts[1])))
    child.start()
    _many(parts[0])
    assert read.poll(60) and np.array_equal(read.recv(), alone[1])
    child.join()

"""Accelerations and reactions of index 1: dense, sparse and public, redundant rows, projection."""

import multiprocessing
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import mbsbench
from mbsbench import MultibodySystem, State, States, StepControl, advance, equations
from mbsbench.harness.catalogue.registry import make_problem, make_solver, problems
from mbsbench.harness.mechanics import consistency, dynamics, index1, motion
from mbsbench.harness.mechanics.consistency import perturb, project
from mbsbench.harness.mechanics.counting import CallCount, collect_counts
from mbsbench.tests.comparing import assert_same

from ...solvers.arbitrary_systems import consistent, with_user_forces

LARGE = {"four_bar_grid": {"columns": 20, "rows": 20}, "chain": {"links": 399}}
both_routes = pytest.mark.parametrize(
    "accelerations", [dynamics.accelerations, mbsbench.accelerations], ids=["numpy", "public"]
)


@pytest.mark.parametrize("most", [np.inf, -1.0])
def test_states_that_are_all_not_finite_have_no_accelerations(most, monkeypatch):
    monkeypatch.setattr(index1, "DENSE", most)
    problem = make_problem("slider_crank")
    state = problem.initial
    lost = States(*(np.full_like(x, np.nan)[None] for x in (state.r, state.R, state.v, state.Omega)))
    for x in index1.solve_index_1(problem.system, lost):
        np.testing.assert_array_equal(x, np.nan)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("bricard", {}),
        ("slider_crank", {}),
        ("heavy_top", {}),
        ("driven_slider_crank", {}),
        ("four_bar_grid", {"columns": 4, "rows": 3}),
        ("chain", {"links": 30}),
    ],
)
def test_sparse_and_dense_algebra_agree(name, parameters, monkeypatch):
    """Also with redundant rows, where reactions are not unique and what they do to bodies is."""
    problem = make_problem(name, {"t_end": 0.2, **parameters})
    run = make_solver("gc_augmented_lagrangian").solve(problem, StepControl(dt=0.01))
    found = []
    for most in (np.inf, -1.0):
        monkeypatch.setattr(index1, "DENSE", most)
        found.append(index1.solve_index_1(problem.system, run.states.at(slice(0, None, 5))))
    for dense, sparse in ((found[0].a, found[1].a), (found[0].load, found[1].load)):
        np.testing.assert_allclose(sparse, dense, rtol=0, atol=1e-8 * np.max(np.abs(dense)))


@pytest.mark.parametrize("name", LARGE)
def test_large_systems_are_solved_to_rounding(name):
    """M a = f + A^T reaction and A a = -A_dot v, with thousands of rows."""
    problem = make_problem(name, LARGE[name])
    system, one = problem.system, problem.initial
    s = States(one.r[None], one.R[None], one.v[None], one.Omega[None])
    found = index1.solve_index_1(system, s)
    f = motion.applied_loads(system, s)
    f[..., 3:] -= np.cross(one.Omega, np.einsum("bij,bj->bi", system.inertia, one.Omega))
    Ma = np.concatenate(
        (system.mass[:, None] * found.a[..., :3], np.einsum("bij,tbj->tbi", system.inertia, found.a[..., 3:])), axis=-1
    )
    np.testing.assert_allclose(Ma, f + found.load, rtol=0, atol=1e-9 * np.max(np.abs(f)))
    faster = States(s.r, s.R, found.a[..., :3], found.a[..., 3:])  # A a, where no row moves by itself
    opening = motion.constraint_rate(system, faster) + motion.evaluate_acceleration_bias(system, s)
    np.testing.assert_allclose(opening, 0.0, atol=1e-8 * np.max(np.abs(found.a)))


@both_routes
def test_redundant_rows_stay_redundant_in_a_stage_off_the_constraints(accelerations):
    """Bricard's redundant row is one where phi = 0; in a stage phi is O(h^2), and so is what its accelerations are off.

    Counted as independent there, it asks for a load of any size.
    """
    problem = make_problem("bricard")
    system, s = problem.system, problem.initial
    for _ in range(40):
        s = project(system, advance(s, accelerations(system, advance(s, accelerations(system, s), 1.25e-3)), 2.5e-3))
    off = []
    for h in (0.02, 0.01):
        stage = advance(s, accelerations(system, s), h)
        there, on = accelerations(system, stage), accelerations(system, project(system, stage))
        off.append(np.max(np.abs(there.v_dot - on.v_dot)))
    assert 3.0 < off[0] / off[1] < 5.0 and off[0] < 1.0


@pytest.mark.parametrize(
    "drawn",
    [
        {"size": 1e5, "mechanism_seed": 31},
        {"size": 1e5, "mechanism_seed": 5},
        {"size": 1e-5, "contrast": 10.0, "mechanism_seed": 31},
    ],
)
@both_routes
def test_rows_of_small_or_heavy_bodies_are_no_redundant_ones(drawn, accelerations):
    """A a + A_dot v = 0 in every row, whatever the sizes and masses: none is taken for redundant."""
    problem = make_problem("random_mechanism", drawn)
    e, rates = equations(problem.system, problem.initial), accelerations(problem.system, problem.initial)
    a = np.concatenate((rates.v_dot, rates.Omega_dot), axis=1).ravel()
    assert np.max(np.abs(e.A @ a + e.A_dot_v)) < 1e-9 * np.max(np.abs(a))


JUDGED = 1e-7  # relative: the judge's A_dot v is a difference
REDUNDANT = ("andrews", "bricard", "four_bar_grid")


def started(name: str, seed: int) -> tuple[MultibodySystem, State]:
    problem = make_problem(name)
    return problem.system, perturb(problem.system, problem.initial, 1e-2, seed)


def both(rates: mbsbench.Rates) -> np.ndarray:
    return np.concatenate((rates.v_dot, rates.Omega_dot), axis=1)


def check_against_judge(system: MultibodySystem, s: State) -> None:
    judged, rates = index1.solve_index_1(system, States.one(s)), mbsbench.accelerations(system, s)
    size = np.max(np.abs(judged.a)) + np.max(s.Omega**2)
    assert np.max(np.abs(both(rates) - judged.a[0])) < JUDGED * size
    load = mbsbench.constraint_jacobian(system, s).T @ rates.reaction
    most = size * (np.max(system.mass) + np.max(system.inertia)) + np.max(
        np.abs(motion.applied_loads(system, States.one(s)))
    )
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
    off = dynamics.advance(s, mbsbench.accelerations(system, s), 1e-2)
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


@pytest.mark.parametrize("name", sorted(problems()))
def test_equations_are_those_of_the_harness(name: str) -> None:
    """Another code, row by row; A_dot_v, which is exact, to what a difference of sixth order leaves."""
    system, s = started(name, 5)
    found, known = equations(system, s), dynamics.equations(system, s)
    for part, within in (("M", 1e-14), ("A", 1e-13), ("A_dot_v", 1e-10), ("f", 1e-12)):
        size = max(1.0, np.max(np.abs(getattr(known, part)), initial=0.0))
        np.testing.assert_allclose(getattr(found, part), getattr(known, part), rtol=0, atol=within * size)


@pytest.mark.parametrize("name", ["chain", "driven_slider_crank", "stewart_platform", "rolling_disc"])
def test_the_equations_hold_for_the_accelerations(name: str) -> None:
    """M a = f + A^T reaction, and A a = -A_dot_v to rounding, which a difference did not reach."""
    system, s = started(name, 6)
    e, rates = equations(system, s), mbsbench.accelerations(system, s)
    a = both(rates)
    rows = e.A @ a.ravel() + e.A_dot_v
    assert np.max(np.abs(rows)) < 1e-12 * (np.max(np.abs(a)) + np.max(s.Omega**2) + np.max(s.v**2))
    left = np.einsum("bij,bj->bi", e.M, a) - e.f - (e.A.T @ rates.reaction).reshape(-1, 6)
    assert np.max(np.abs(left)) < 1e-10 * np.max(np.abs(e.f))


def test_equations_are_free_to_change_and_take_no_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user may write into what it is given; the differences, two thirds of the time of a call, are not taken."""
    monkeypatch.setattr(dynamics, "evaluate_acceleration_bias", None)
    system, s = started("bricard", 1)
    first = equations(system, s)
    kept = {name: value.copy() for name, value in vars(first).items()}
    for value in vars(first).values():
        value += 1.0
    again = equations(system, s)
    for name, value in kept.items():
        assert_same(getattr(again, name), value, what=name)


def test_a_call_is_one_evaluation_with_its_factorisation_if_any() -> None:
    system, s = started("bricard", 1)
    with collect_counts(CallCount()) as count:
        mbsbench.accelerations(system, s)
        mbsbench.equations(system, s)
        mbsbench.project(system, s)
    assert (count.evaluations, count.factorisations) == (2, 1)


def _many(given: tuple[MultibodySystem, list[State]]) -> list[np.ndarray]:
    system, states = given
    return [both(mbsbench.accelerations(system, s)) for s in states for _ in range(20)]


def test_threads_and_forked_processes_have_arrays_of_their_own() -> None:
    system = with_user_forces()
    parts = [(system, [consistent(system, seed) for seed in range(3 * k, 3 * k + 3)]) for k in range(4)]
    alone = [_many(part) for part in parts]
    with ThreadPoolExecutor(4) as pool:
        for found, known in zip(pool.map(_many, parts), alone, strict=True):
            assert_same(found, known)
    read, write = multiprocessing.Pipe(duplex=False)
    context = multiprocessing.get_context("fork")
    child = context.Process(target=lambda: write.send(_many(parts[1])))
    child.start()
    _many(parts[0])
    assert read.poll(60)
    assert_same(read.recv(), alone[1])
    child.join()

"""Computed references against exact motions and laws; and that a route with an error is found out."""

import dataclasses
import multiprocessing
from functools import partial

import numpy as np
import pytest

from mbsbench import Joint, Problem, Reference, RigidBody, State, assemble, so3
from mbsbench.harness.catalogue.registry import make_problem, rotate_problem
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.state import rotate_states
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.mechanics.work import compute_power
from mbsbench.harness.reference import computation as module
from mbsbench.harness.reference import orbit
from mbsbench.harness.reference.computation import compute_reference, explain_end, find_reference, is_computable
from mbsbench.harness.reference.directors import Directors
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.harness.reference.principal import LIGHT
from mbsbench.problems.exact.one_body import find_one_body_motion
from mbsbench.tests.comparing import assert_each, assert_same

from .mechanisms import problem, slider_crank, sprung

DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0  # of sixth order, at seven times


@pytest.fixture(scope="module", autouse=True)
def fresh_references(tmp_path_factory):
    """Computed anew: a file from older equations must not vouch for them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(orbit, "FOLDER", tmp_path_factory.mktemp("references"))
        yield


EXACT = {
    "pendulum": ("spherical_pendulum", {"omega_z": 3.0, "t_end": 0.5}),
    "turned": ("spherical_pendulum", {"omega_z": 3.0, "rotation": (0.3, -0.5, 0.7), "t_end": 0.2}),
    "top": ("heavy_top", {"t_end": 0.1}),
    "free": ("torque_free_body", {"inertia_factors": (1.0, 1.5, 2.0), "t_end": 1.0}),
    "flight": ("free_body", {"t_end": 0.3}),  # no joints
    "chain": ("chain", {"t_end": 0.06}),
    "link": ("simple_pendulum", {"support": "link", "perturb": 0.2, "t_end": 0.3}),
    "grid": ("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.2}),  # 64 rows of rank 58
}


def agree(found: Reference, exact: Reference, t: np.ndarray) -> bool:
    """Whether positions differ by no more than both references state."""
    gap = np.max(np.linalg.norm(found.states(t).r - exact.states(t).r, axis=2), axis=1)
    return bool(np.all(gap <= found.error(t) + exact.error(t)))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", EXACT)
def test_it_is_the_exact_motion_within_its_stated_error(name: str) -> None:
    """Theta functions or a planar linkage on one side, full systems in space on the other: no common equation."""
    p = make_problem(*EXACT[name])
    exact, found = p.reference(), compute_reference(p)
    assert exact is not None and found is not None and found.horizon == p.t_end
    t = np.linspace(0.0, p.t_end, 101)
    assert np.max(found.error(t) + exact.error(t)) < 1e-10 and agree(found, exact, t)
    E = energy(p.system, found.states(t))
    assert np.ptp(E) < 1e-9 * np.max(np.abs(E))


@pytest.mark.parametrize("p", [slider_crank(t_end=0.2, hinged=True), sprung(0.0, 0.3), sprung(3.0, 0.3)], ids=range(3))
def test_it_obeys_the_laws_where_nothing_is_known(p: Problem) -> None:
    """Joints, velocities, and energy less the dampers' work: stated in (r, R), not by either route."""
    found = find_reference(p)
    assert found is not None and found.horizon == p.t_end
    t = np.linspace(0.0, p.t_end, 4001)
    s = found.states(t)
    assert np.max(np.abs(constraint(p.system, s))) < 1e-11
    assert np.max(np.abs(constraint_rate(p.system, s))) < 1e-10
    E, P, dt = energy(p.system, s), compute_power(p.system, s), t[1]
    work = np.sum(P[:-2:2] + 4.0 * P[1:-1:2] + P[2::2]) * dt / 3.0  # Simpson
    assert abs(E[-1] - E[0] - work) < 1e-9 * np.max(np.abs(E))
    k = np.arange(20, 3980, 20)  # differences of sixth order: dt^6 and rounding / dt are both below 1e-9
    r_dot = sum(c * s.r[k + 4 * n] for n, c in zip(range(-3, 4), DIFFERENCE, strict=True)) / (4.0 * dt)
    R_dot = sum(c * s.R[k + 4 * n] for n, c in zip(range(-3, 4), DIFFERENCE, strict=True)) / (4.0 * dt)
    assert np.max(np.abs(r_dot - s.v[k])) < 1e-8
    assert np.max(np.abs(R_dot - s.R[k] @ so3.hat(s.Omega[k]))) < 1e-8


@pytest.mark.parametrize("light", [1e-7, 1e-9])
def test_a_nearly_massless_axis_changes_nothing_where_a_hinge_holds_it(light: float) -> None:
    """Inertia across the hinge does not count: the motion of a regular body, in as many steps."""

    def swinging(third: float) -> Problem:
        Y, arm, R = (0.0, 1.0, 0.0), np.array([0.1, 0.05, -0.3]), so3.exp(np.array([0.0, 1.9, 0.0]))
        body = RigidBody(1.0, np.diag([0.02, 0.02, third]))
        system = assemble([body], [Joint(0, arm, GROUND, (0.0, 0.0, 0.0), Y, Y)], (0.0, 0.0, -9.81))
        r = -R @ arm
        start = State(r[None], R[None], np.cross((0.0, 2.0, 0.0), r)[None], np.array([[0.0, 2.0, 0.0]]))
        return problem("swinging", system, start, 1.0)

    even, found = compute_reference(swinging(0.015)), compute_reference(swinging(0.02 * light))
    assert even is not None and found is not None and found.horizon == 1.0
    t = np.linspace(0.0, 1.0, 51)
    assert agree(found, even, t) and found.error(t)[-1] < 1e-10
    assert len(found.orbit.y) < 1.2 * len(even.orbit.y)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.4, -1.1, 0.6)], ids=["principal", "tilted"])
@pytest.mark.parametrize("light", [3e-6, 1e-7, 1e-9])  # at ``LIGHT`` itself rounding decides
def test_a_nearly_massless_axis_has_the_motion_of_the_formula(light: float, tilt: tuple[float, float, float]) -> None:
    """A spinning rod on a ball joint, whatever frame its data are in: Lagrange's top, by theta functions."""
    Q, arm, R, Omega = so3.exp(np.array(tilt)), np.array([0, 0, 0.3]), so3.exp(np.array([0.3, 1.2, 0])), (1.5, 2.0, 0.7)

    def rod(Q: np.ndarray, light: float = light) -> Problem:
        inertia = Q @ np.diag([0.02, 0.02, 0.02 * light]) @ Q.T
        joint = Joint(0, -Q @ arm, GROUND, (0.0, 0.0, 0.0))
        system = assemble([RigidBody(1.0, 0.5 * (inertia + inertia.T))], [joint], (0.0, 0.0, -9.81))
        v = R @ np.cross(Omega, arm)
        return problem("rod", system, State((R @ arm)[None], (R @ Q.T)[None], v[None], (Q @ Omega)[None]), 1.0)

    exact = find_one_body_motion(rod(np.eye(3)).system, rod(np.eye(3)).initial)
    found, even = compute_reference(rod(Q)), compute_reference(rod(Q, 1.0))
    assert exact is not None and found is not None and even is not None and found.horizon == 1.0
    assert len(found.orbit.y) < 2 * len(even.orbit.y)  # rounding about the rod may have steps halved, once
    assert light < LIGHT
    t = np.linspace(0.0, 1.0, 51)
    one, other = found.states(t), exact.states(t)
    assert np.max(np.abs(one.r - other.r)) < found.error(t)[-1] < 1e-10
    turned = one.R @ Q  # about the rod a rounding of its arm, 1e-17 m, turns it by 1e-17 N m / (2e-2 kg m2 light)
    assert np.max(np.abs(turned[..., 2] - other.R[..., 2])) < 1e-11
    assert np.max(np.abs(turned - other.R)) < 1e-11 + 1e-14 / light
    assert np.max(np.abs(one.Omega @ Q - other.Omega)) < 1e-10 + 1e-14 / light


def test_a_turned_system_has_the_turned_motion() -> None:
    """Two computations, of other numbers throughout."""
    p = sprung(1.0, 0.2)
    Q = so3.exp(np.array([0.4, -1.1, 0.6]))
    here, there = compute_reference(p), compute_reference(rotate_problem(p, Q))
    assert here is not None and there is not None
    t = np.linspace(0.0, 0.2, 21)
    gap = rotate_states(here.states(t), Q).r - there.states(t).r
    assert_each(np.max(np.linalg.norm(gap, axis=2), axis=1), "<=", here.error(t) + there.error(t))


def _weaken(freedoms):
    Z, P, H = freedoms
    return Z, 0.99 * P, H


FAULTS = [  # route, function, the same with a fault, motion
    (
        NewtonEuler,
        "_sum_forces",
        lambda own: lambda self, r, R, v, Omega, t: own(self, r, R, v, 0.8 * Omega, t),
        "free",
    ),
    (NewtonEuler, "_evaluate_gamma", lambda own: lambda self, *a: -own(self, *a), "pendulum"),
    (NewtonEuler, "_evaluate_gamma", lambda own: lambda self, *a: -own(self, *a), "grid"),
    (Directors, "_sum_forces", lambda own: lambda self, *a: 1.001 * own(self, *a), "pendulum"),
    (Directors, "_reduce_rigidity", lambda own: lambda self, x: _weaken(own(self, x)), "free"),
]


@pytest.mark.parametrize(("route", "name", "fault", "of"), FAULTS)
def test_an_error_in_one_route_is_found_out(route, name, fault, of, monkeypatch, tmp_path) -> None:
    """Then both disagree: the reference ends where they do, and what is left of it says how far they are apart."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(route, name, fault(getattr(route, name)))
    p = make_problem(*EXACT[of])
    if (found := compute_reference(p)) is not None:
        assert found.horizon < 0.3 * p.t_end
        assert agree(found, p.reference(), np.linspace(0.0, found.horizon, 21))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["pendulum", "top", "grid"])
def test_collocation_finds_the_exact_motion(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """Stiff routes where nothing is stiff."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(module._Motion, "is_stiff", lambda *_: True)
    p = make_problem(*EXACT[name])
    exact, found = p.reference(), compute_reference(p)
    assert exact is not None and found is not None and found.horizon == p.t_end
    t = np.linspace(0.0, p.t_end, 101)
    assert np.max(found.error(t)) < 1e-10 and agree(found, exact, t)


@pytest.mark.sampled(0)
def test_a_stiff_system_has_a_reference_to_its_end(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """A governor with a transient of 0.1 ms, over 10 s; its first tenth of a second is that of explicit steps."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    p = make_problem("flyball_governor")
    found = compute_reference(p)
    assert found is not None and found.horizon == p.t_end and found.error(np.array([p.t_end]))[0] < 1e-9
    monkeypatch.setattr(module._Motion, "is_stiff", lambda *_: False)
    explicit = compute_reference(dataclasses.replace(p, t_end=0.1))
    assert explicit is not None and explicit.horizon == 0.1
    assert agree(found, explicit, np.linspace(0.0, 0.1, 201))
    assert "Radau IIA" in compute_reference(p).route and "DOP853" in explicit.route  # the first from its file


def test_a_perturbed_chain_has_a_reference_out_of_its_plane() -> None:
    """The planar linkage has none; the energy is that of the start, in all three directions."""
    p = make_problem("chain", {"perturb": 1e-3, "t_end": 0.05})
    assert p.reference() is None
    found = find_reference(p)
    assert found is not None and found.horizon == 0.05
    s = found.states(np.linspace(0.0, 0.05, 41))
    assert np.max(np.abs(s.r[:, :, 2])) > 1e-5
    assert np.ptp(energy(p.system, s)) < 1e-9
    assert np.max(np.abs(constraint(p.system, s))) < 1e-11


def test_a_singular_passage_ends_it_without_an_exception(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """A parallelogram turns through its folded position, where its rank falls; until then it is the exact motion."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(module, "BUDGET", 3.0)  # [s] there the steps shrink until it is spent
    p = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "rate": 8.0, "t_end": 0.25})
    exact, found = p.reference(), compute_reference(p)
    assert exact is not None and found is not None
    assert agree(found, exact, np.linspace(0.0, min(found.horizon, exact.horizon), 51))


def test_a_spent_budget_ends_it(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """What was certified until then stays."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(module, "BUDGET", 0.1)
    monkeypatch.setattr(module, "FEWEST", 10)
    found = compute_reference(make_problem("spherical_pendulum", {"omega_z": 3.0, "t_end": 5.0}))
    assert found is not None and 0.0 < found.horizon < 5.0


def test_a_large_system_has_none() -> None:
    """Hundreds of bodies would take hours: said at once."""
    p = make_problem("chain", {"links": 150, "perturb": 1e-6, "t_end": 0.01})
    assert not is_computable(p.system) and find_reference(p) is None


brief = partial(sprung, 0.5, t_end=0.05)  # its reference takes little to compute


def test_a_second_call_reads(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """Also that there is none is read."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    first = compute_reference(brief())
    monkeypatch.setattr(module, "_find_agreement", None)
    again = compute_reference(brief())
    t = np.linspace(0.0, 0.05, 7)
    assert first is not None and again is not None
    assert_same(first.states(t).r, again.states(t).r)
    monkeypatch.setattr(module, "_find_agreement", lambda *_: None)
    assert compute_reference(brief(t_end=0.06)) is None
    monkeypatch.setattr(module, "_find_agreement", None)
    assert compute_reference(brief(t_end=0.06)) is None


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not an archive", None])
def test_a_damaged_file_is_computed_anew(damage: bytes | None, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """Empty, of another kind, or cut in the middle."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    first = compute_reference(brief())
    (file,) = tmp_path.rglob("*.npz")
    file.write_bytes(file.read_bytes()[:2000] if damage is None else damage)
    again = compute_reference(brief())
    assert first is not None and again is not None
    assert_same(first.orbit.y, again.orbit.y)


def _compute(folder, queue) -> None:
    orbit.FOLDER = folder
    found = compute_reference(brief())
    queue.put(None if found is None else found.states(np.array([0.05])).r)


def test_two_processes_at_once_get_the_same(tmp_path) -> None:
    """Each writes a file of its own and moves it in place: no half of one is ever read."""
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    both = [context.Process(target=_compute, args=(tmp_path, queue)) for _ in range(2)]
    for process in both:
        process.start()
    a, b = queue.get(timeout=120), queue.get(timeout=120)
    for process in both:
        process.join()
    assert a is not None
    assert_same(a, b)
    assert [f.suffix for f in tmp_path.rglob("*") if f.is_file()] == [".npz"]


def test_the_wide_tolerance_goes_on_where_the_narrow_one_ends(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """The first level leaves its agreement in the first chunk, and the second cannot make a step at all."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(module, "AGREED", 0.0)
    monkeypatch.setattr(module, "LEVELS", (module.LEVELS[0], (1e-13, 1e-40)))
    p = make_problem("heavy_top", {"t_end": 0.1})
    exact, found = p.reference(), compute_reference(p)
    assert exact is not None and found is not None and found.horizon == p.t_end and found.ends == ""
    t = np.linspace(0.0, p.t_end, 101)
    assert agree(found, exact, t)
    assert_each(np.diff(found.error(t)), ">=", 0.0)
    again = compute_reference(p)  # from disk
    assert again is not None and again.horizon == p.t_end
    assert_same(again.states(t).r, found.states(t).r)


@pytest.mark.slow
def test_where_the_narrow_tolerance_ends_the_wide_one_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    """Of a chaotic motion: what the narrow one knows stays as exact as it is, and more is known; also from disk."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    p = make_problem("chain", {"perturb": 1e-6, "t_end": 10.0})
    found = compute_reference(p)
    assert found is not None and found.orbit.beyond is not None and found.ends
    first, second = found.orbit.end, found.orbit.horizon
    assert 2.5 < first < second < 10.0
    t = np.linspace(0.0, second, 400)
    error = found.error(t)
    assert_each(np.diff(error), ">=", 0.0)
    assert error[np.searchsorted(t, 0.1 * first)] < 1e-9
    below, above = found.states(np.array([first])), found.states(np.array([first + 1e-9]))
    assert np.max(np.abs(below.r - above.r)) < 2.0 * found.error(np.array([first + 1e-9]))[0] + 1e-6
    again = compute_reference(p)
    assert again is not None and again.horizon == second
    assert_same(again.states(t).r, found.states(t).r)


@pytest.mark.parametrize(
    ("budget", "words"), [(0.02, "its budget of time is spent"), (4.0, "its routes differ by more")]
)
def test_one_that_ends_early_says_why(budget: float, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    monkeypatch.setattr(module, "BUDGET", budget)
    monkeypatch.setattr(module, "FEWEST", 1)
    if budget > 1.0:
        monkeypatch.setattr(module, "WORST", 2e-11)
    p = slider_crank(t_end=2.0, hinged=True)
    found = compute_reference(p)
    assert found is not None and 0.0 < found.horizon < p.t_end
    (note,) = explain_end(found)
    assert note.startswith(f"reference ends at {found.horizon:.4g} s: ") and words in note
    assert explain_end(compute_reference(p)) == [note]  # from disk

"""The kit passes right models and fails wrong ones, each by a margin that follows from its tolerance."""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from mbsbench import States, accelerations, advance, kit
from mbsbench.harness.judge.law import DEVIATIONS, EVALUATION, PRECISIONS
from mbsbench.harness.lab.kit.cases import make_case
from mbsbench.harness.lab.kit.conditioning import measure_growth
from mbsbench.harness.mechanics.types import Law
from mbsbench.harness.reference.computation import find_reference

SINGLE, DOUBLE = np.float32, np.float64
QUICK = ("spin_products", "top", "four_bar_turned", "driven_hinge")
each_case = pytest.mark.parametrize(
    "case", [c if c in QUICK else pytest.param(c, marks=pytest.mark.slow) for c in kit.CASES]
)
LOOPS = ("four_bar_turned", "slider_crank_turned")


def rows(s, dtype=DOUBLE):
    omega = np.einsum("tbij,tbj->tbi", s.R, s.Omega)
    return zip(*(a.astype(dtype).astype(DOUBLE) for a in (s.r, s.R, s.v, omega)), strict=True)


def exact(dtype=DOUBLE, change=lambda s, t: s):
    """An engine that knows the motion; ``change`` makes it wrong."""

    def motion(case):
        t = case.dt * np.arange(round(case.problem.t_end / case.dt) + 1)
        t[-1] = case.problem.t_end
        return rows(change(find_reference(case.problem).states(t), t), dtype)

    return motion


def midpoint(change=lambda system: system, dtype=DOUBLE, order=2):
    """An engine of ours on a system that ``change`` makes wrong, its state rounded to ``dtype`` after each step."""

    def motion(case):
        system, s = change(case.problem.system), case.problem.initial
        while True:
            kept = {k: getattr(s, k).astype(dtype).astype(DOUBLE) for k in ("r", "R", "v", "Omega")}
            s = dataclasses.replace(s, **kept)
            yield next(iter(rows(States.one(s))))
            first = accelerations(system, s)
            rates = first if order == 1 else accelerations(system, advance(s, first, case.dt / 2))
            s = advance(s, rates, case.dt)

    return motion


def fails(words, case, motion, **settings):
    with pytest.raises(kit.EngineFailure) as error:
        kit.check(case, motion, **settings)
    lines = str(error.value).splitlines()
    assert all(line.startswith(f"{case}: ") for line in lines)
    assert any(words in line for line in lines), lines


@pytest.mark.sampled(1)
@each_case
def test_the_exact_motion_passes_in_both_precisions(case):
    kit.check(case, exact(), order=8)
    kit.check(case, exact(SINGLE), order=8, precision="float32")


def test_single_precision_is_not_double():
    fails("start: ", "top", exact(SINGLE))
    rounded = exact(change=lambda s, t: States(s.r.astype(SINGLE).astype(DOUBLE), s.R, s.v, s.Omega, t))
    fails("error: off by", "free_fall", rounded)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(("share", "passes"), [(0.9, True), (1.1, False)])
def test_the_verdict_turns_at_the_tolerance(precision, share, passes):
    """A shift of the free body that grows as the tolerance does: no other law sees it."""
    problem = make_case("spin_sphere")
    grown, growth = measure_growth(problem)

    def shifted(s, t):
        step = np.linspace(0.0, 2000.0, len(t))  # of the half step, whichever run it is
        allowed = PRECISIONS[precision] * (DEVIATIONS + step) + EVALUATION * PRECISIONS["float64"]
        away = share * allowed * np.interp(t, grown, growth[Law.MOTION, ""]) * (t > 0.0)
        return States(s.r + away[:, None, None] * np.array([1.0, 0.0, 0.0]), s.R, s.v, s.Omega, t)

    motion = exact(change=shifted)
    if passes:
        kit.check("spin_sphere", motion, precision=precision, order=8)
    else:
        fails("error: off by", "spin_sphere", motion, precision=precision, order=8)


@pytest.mark.sampled(1)
@each_case
def test_a_right_model_passes_at_the_order_it_claims(case):
    kit.check(case, midpoint(), order=2, dt=5e-4 if case == "top" else 2e-3)  # it turns by 0.1 rad in 2 ms


@pytest.mark.sampled(1)
@pytest.mark.parametrize("case", ["spin_asymmetric", "ball_pendulum", "four_bar_turned"])
def test_a_right_model_in_single_precision_passes(case):
    kit.check(case, midpoint(dtype=SINGLE), order=2, precision="float32")


def signed(system):
    flipped = np.array(system.inertia)
    flipped[:, 0, 1] *= -1.0
    flipped[:, 1, 0] *= -1.0
    return dataclasses.replace(system, inertia=flipped)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("case", ["pendulum", "slider_crank"])
def test_a_mass_wrong_by_a_hundredth_fails(case, precision):
    wrong = midpoint(lambda s: dataclasses.replace(s, mass=s.mass * np.r_[np.ones(s.nb - 1), 1.01]))
    fails("error: off by", case, wrong, precision=precision, order=2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_an_inertia_product_of_the_wrong_sign_fails(precision):
    kit.check("spin_products", midpoint(), order=2, precision=precision)
    fails("error: off by", "spin_products", midpoint(signed), order=2, precision=precision)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("case", LOOPS)
def test_a_loop_that_opens_by_a_millimetre_fails(case, precision):
    def opened(s, t):
        away = np.zeros((len(t), s.nb, 3))
        away[:, -1, 1] = 1e-3 * t / t[-1]
        return States(s.r + away, s.R, s.v, s.Omega, t)

    fails("closure: off by", case, exact(change=opened), precision=precision)


def test_an_order_that_is_not_kept_fails():
    euler = midpoint(order=1)
    kit.check("spin_asymmetric", euler, order=1)
    fails("error: off by", "spin_asymmetric", euler, order=2)


def test_a_first_order_method_cannot_follow_the_top():
    fails("energy: off by", "top", midpoint(order=1), order=1)


def test_what_an_engine_returns_is_checked():
    fails("steps: expected", "top", lambda case: list(midpoint()(case)) if case is None else [])
    fails("shapes of r, q, v, omega", "top", lambda case: ((*row[:3], row[3][0]) for row in midpoint()(case)))
    nan = exact(change=lambda s, t: States(np.where(t[:, None, None] > 0.5, np.nan, s.r), s.R, s.v, s.Omega, t))
    fails("finite", "top", nan)
    for settings, words in (({"precision": "half"}, "float32 or float64"), ({"order": 0}, "order must be")):
        with pytest.raises(ValueError, match=words):
            kit.check("top", exact(), **settings)
    with pytest.raises(ValueError, match="unknown case 'tops' - did you mean 'top'"):
        kit.check("tops", exact())


@pytest.mark.parametrize("case", kit.CASES)
def test_the_files_hold_every_body(case):
    model = kit.Model(case, make_case(case), 1e-3)
    bodies = ET.fromstring(model.mjcf).findall(".//body")
    assert sorted(b.get("name") for b in bodies) == sorted(f"body{k}" for k in range(model.bodies))
    masses = sum(float(m.get("mass")) for m in ET.fromstring(model.mjcf).findall(".//inertial"))
    assert masses == pytest.approx(sum(b["mass"] for b in model.numbers["bodies"]))

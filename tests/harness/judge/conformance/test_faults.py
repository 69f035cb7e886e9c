"""Faults planted in a sound solver are found by the requirement that states them, with the number."""

import re

import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.conformance import solver as requirements
from mbsbench.harness.judge.conformance.trials import Evidence, check_drives
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.run.job import Job
from mbsbench.tests.factories import run_here

PAGE = (ROOT / "docs" / "solver-contract.md").read_text(encoding="utf-8")
(FIXED,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)
ADAPTIVE = (
    FIXED.replace('@solver("midpoint")\n', "").replace("class Midpoint:", "class Equations:")
    + '''

from mbsbench import so3
from scipy.integrate import RK45


@solver("dormand_prince")
@dataclass(frozen=True)
class DormandPrince(Equations):
    """The same equations under error control, poses as plain matrices."""

    control: ClassVar[str] = "rtol"

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Steps of scipy's RK45, each kept."""
        start = problem.initial

        def packed(*parts):
            return np.concatenate([np.ravel(part) for part in parts])

        def state(t, y):
            r, R, v, Omega = np.split(y, np.cumsum([3 * start.nb, 9 * start.nb, 3 * start.nb]))
            return State(r.reshape(-1, 3), R.reshape(-1, 3, 3), v.reshape(-1, 3), Omega.reshape(-1, 3), t)

        def rate(t, y):
            s = state(t, y)
            rates = self.rates(problem, s)
            return packed(s.v, s.R @ so3.hat(s.Omega), rates.v_dot, rates.Omega_dot)

        longest = control.max_step or np.inf
        y0 = packed(start.r, start.R, start.v, start.Omega)
        run = RK45(rate, 0.0, y0, problem.t_end, max_step=longest, rtol=control.rtol, atol=control.rtol)
        times, states = [0.0], [start]
        while run.status == "running" and len(times) <= control.max_steps:
            run.step()
            times.append(run.t)
            states.append(state(run.t, run.y))
        status = Status.SUCCESS if run.status == "finished" else Status.STALLED
        message = "max_steps reached"
        reactions = [self.rates(problem, s).reaction for s in states]
        stacked = States(*(np.array([getattr(x, name) for x in states]) for name in ("r", "R", "v", "Omega")))
        return Trajectory(
            np.array(times), stacked, status, message, {"steps": len(times) - 1}, reaction=np.array(reactions)
        )
'''
)
SOLVERS = {"midpoint": FIXED, "dormand_prince": ADAPTIVE}

ORDER, TORQUE = "errors fall with the declared order, or with rtol", "gyroscopic torque is Omega x J Omega"
REACTION, COUNTED = "reactions are those of the exact motion", "it records every step it counts"
GAPS, OPEN = "steps are no larger than dt or max_step", "open joints close with the steps, or with rtol"
STACKED = "        stacked = "
TENTH = """        counted = len(times) - 1
        kept = sorted({*range(0, len(times), 10), counted})
        times, states, PARTS = ([part[k] for k in kept] for part in (times, states, PARTS))
"""
FEWER, FEWER_LOADS = TENTH.replace("PARTS", "rates"), TENTH.replace("PARTS", "reactions")
GYRO = "        saddle = "
LESS = """        fifth = 0.2 * np.cross(s.Omega, np.einsum("bij,bj->bi", problem.system.inertia, s.Omega))
        e.f[:, 3:] += fifth
        saddle = """
FORCES, NEGATIVE = "reaction=x[n:]", "reaction=-x[n:]"
KEEP = "            times.append(t)\n"
SINKING = "            s = State(s.r - [0.0, 0.0, 1e-4 * (t - times[-1])], s.R, s.v, s.Omega, t)\n"
PUSHED = "            s = State(s.r, s.R, s.v + [1e-4 * (t - times[-1]), 0.0, 0.0], s.Omega, t)\n"
TILTING = "            s = State(s.r, so3.exp(np.array([1e-4, 0.0, 0.0]) * (t - times[-1])) @ s.R, s.v, s.Omega, t)\n"
SWOLLEN = "            s = State(s.r, s.R * (1.0 + 1e-4 * (t - times[-1])), s.v, s.Omega, t)\n"
SUNK = "            states.append(state(run.t, run.y))\n"

FAULTS = {  # the solver, what is changed (from, to, ...), the requirements that fail with the value measured
    "gyroscopic torque 20 % too small": ("midpoint", (GYRO, LESS), {TORQUE: 0.8, ORDER: 0.0}),
    "order 4 declared, 2 true": (
        "midpoint",
        ("order: ClassVar[float] = 2.0", "order: ClassVar[float] = 4.0"),
        {ORDER: 2.0},
    ),
    "reaction with the wrong sign": ("midpoint", (FORCES, NEGATIVE), {REACTION: 2.0}),
    "every tenth step recorded": ("midpoint", (STACKED, FEWER + STACKED), {GAPS: 10.0}),
    "every tenth step recorded, all counted": (
        "midpoint",
        (STACKED, FEWER + STACKED, '{"steps": len(times) - 1', '{"steps": counted'),
        {GAPS: 10.0, COUNTED: 0.1},
    ),
    "error control, gyroscopic torque 20 % too small": (
        "dormand_prince",
        (GYRO, LESS),
        {TORQUE: 0.8, ORDER: 1.0},
    ),
    "error control, reaction with the wrong sign": ("dormand_prince", (FORCES, NEGATIVE), {REACTION: 2.0}),
    "error control, every tenth step recorded": (
        "dormand_prince",
        ("for s in states]\n" + STACKED, "for s in states]\n" + FEWER_LOADS + STACKED),
        {GAPS: 10.0},
    ),
    "bodies sink by 0.1 mm/s": ("midpoint", (KEEP, SINKING + KEEP), {OPEN: 1e-4}),
    "bodies rise by 0.1 mm/s": ("midpoint", (KEEP, SINKING.replace("s.r -", "s.r +") + KEEP), {OPEN: 1e-4}),
    "bodies are pushed by 0.1 mm/s^2": ("midpoint", (KEEP, PUSHED + KEEP), {OPEN: 1e-4}),
    "bodies tilt by 1e-4 rad/s": (
        "midpoint",
        (KEEP, TILTING + KEEP, "    option, solver,", "    option, so3, solver,"),
        {OPEN: 1e-4},
    ),
    "rotations swell by 1e-4/s": ("midpoint", (KEEP, SWOLLEN + KEEP), {OPEN: 1e-4}),
    "error control, bodies sink by 0.1 mm/s": (
        "dormand_prince",
        (SUNK, SUNK.replace("run.y))", "run.y - np.eye(1, len(run.y), 2)[0] * 1e-4 * run.t))")),
        {OPEN: 1e-4, ORDER: 10.0},  # the error at 1e-4 is ten times what the sinking leaves at 1e-8
    ),
    "nothing": ("midpoint", (), {}),
    "error control, nothing": ("dormand_prince", (), {}),
}


PARTS = ("finer", "spinning", "hinge", "easy hinge")  # beginnings of the roles of these runs


def measured(name, text, folder):
    """Measurements on the runs that need no limit, half as long, by the requirement's name."""
    path = folder / f"{name}.py"
    path.write_text(text, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        for known in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
            patch.setattr(registry, known, type(getattr(registry, known))())
        for motion in ("MOVING", "SPINNING"):
            own = getattr(requirements, motion)
            patch.setattr(requirements, motion, {**own, "t_end": 0.5 * own["t_end"]})
        registry.load_plugin(path)
        specs = {k: s for k, s in requirements.group_runs(name).items() if k.startswith(PARTS)}
        store.create_folder(folder / "run")
        mine = {role: run_here(Job(spec, folder / "run")) for role, spec in specs.items()}  # in this process
        series = {role: store.read_run_series(folder / "run", r) for role, r in mine.items()}
        made = registry.make_solver(name)
        evidence = Evidence(made.control, made.order, mine, series)
        names = (ORDER, TORQUE, REACTION, COUNTED, GAPS, OPEN)
        return {r.name: r.measure(evidence) for r in requirements.REQUIREMENTS if r.name in names}


HALF = "            s = advance(states[-1], self.rates(problem, half)"
TIMELESS = "            half = State(half.r, half.R, half.v, half.Omega)\n" + HALF


@pytest.mark.parametrize("text", [FIXED, FIXED.replace(HALF, TIMELESS)], ids=["sound", "timeless"])
def test_a_solver_that_drops_time_does_not_follow_drives(text, tmp_path, monkeypatch):
    """The stage of a class's own loop at t = 0: nothing else of the requirements notices."""
    for known in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
        monkeypatch.setattr(registry, known, type(getattr(registry, known))())
    path = tmp_path / "midpoint.py"
    path.write_text(text, encoding="utf-8")
    registry.load_plugin(path)
    store.create_folder(tmp_path / "run")
    spec = requirements.group_runs("midpoint")["driven"]
    record = run_here(Job(spec, tmp_path / "run"))
    found = check_drives(Evidence("dt", 2.0, {"driven": record}, {}))
    assert found.is_tested and found.holds == (text == FIXED)


SLOW = [k for k in FAULTS if "error control" in k or "all counted" in k]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("fault", [pytest.param(k, marks=[pytest.mark.slow] if k in SLOW else []) for k in FAULTS])
def test_a_planted_fault_is_found_with_its_number(fault, tmp_path):
    """Gyroscopic torque, order, reactions, records and joints have a requirement each; nothing else fails with them."""
    name, changes, expected = FAULTS[fault]
    text = SOLVERS[name]
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text
        text = text.replace(old, new)
    found = measured(name, text, tmp_path)
    assert len(found) == 6 and {k for k, m in found.items() if not m.holds} == set(expected)
    for requirement, value in expected.items():
        assert found[requirement].value == pytest.approx(value, rel=0.05, abs=0.05), found[requirement]


@pytest.mark.slow
def test_a_higher_order_is_met_and_said(tmp_path):
    """Declared 1, observed 2."""
    found = measured(
        "midpoint", FIXED.replace("order: ClassVar[float] = 2.0", "order: ClassVar[float] = 1.0"), tmp_path
    )
    assert found[ORDER].holds and found[ORDER].value > 1.8 and found[ORDER].words.startswith("higher")

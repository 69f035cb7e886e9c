"""The first picture: margins are errors over limits, counts compare, the sentence names the best and the worst."""

import json
import math

import numpy as np
import pytest

from mbsbench.harness.base.files import write_text
from mbsbench.harness.columns.measured import Scales
from mbsbench.harness.mechanics.types import ALLOWED, Law, Reason
from mbsbench.harness.results.records import format_reasons
from mbsbench.harness.results.series import Series
from mbsbench.reports import site
from mbsbench.reports.model.heat import describe_extremes, make_cells, make_heat_map, sort_cells
from mbsbench.reports.model.margin import LEVELS, find_margin
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import put


def broken(law: Law, value: float, limit: float, unit: str) -> dict[str, str]:
    return {"status": "wrong", "wrong_because": format_reasons([Reason(law, value, limit, unit)])}


def test_margin_is_the_error_that_is_the_largest_part_of_its_limit():
    """0.03 of 0.1 J is nearer than 0.001 of 0.01 m; the limits are those that runs are judged by."""
    run = StoredRun(make_measured_record("aa01", energy_drift_max_J=0.03, phi_max=1e-3, phi_limit_m=0.01))
    found = find_margin(run)
    assert found is not None and found.error.law is Law.ENERGY and found.ratio == pytest.approx(0.3)
    assert found.words == "the energy error is 0.0300 of 0.100 J allowed"
    near = find_margin(StoredRun(make_measured_record("aa02", energy_drift_max_J=0.03, phi_max=5e-3, phi_limit_m=0.01)))
    assert near is not None and near.words == "|phi| is 0.00500 of 0.0100 m allowed"
    judged = Scales(length=1.0, speed=2.0, momentum=1.0, energy=3.0, reach=1.0, gap=1.0).limits
    assert judged == {
        law: part * {Law.ENERGY: 3.0, Law.CONSTRAINT_RATE: 2.0}.get(law, 1.0) for law, part in ALLOWED.items()
    }


def test_a_marginal_error_looks_marginal_and_a_large_one_does_not():
    """Just above its limit is another colour than five times it, and than what has no size at all."""
    near = find_margin(StoredRun(make_measured_record("aa01", **broken(Law.ENERGY, 1.05, 1.0, "J"))))
    far = find_margin(StoredRun(make_measured_record("aa02", **broken(Law.ENERGY, 45.0, 9.49, "J"))))
    other = find_margin(StoredRun(make_measured_record("aa03", **broken(Law.START, 1e-9, 1e-12, ""))))
    assert near is not None and far is not None and other is not None
    assert (near.level, far.level) == (LEVELS.index(1.5), len(LEVELS)) and math.isinf(other.ratio)


def test_constraints_count_by_their_limit_or_by_the_share_that_was_judged():
    """Hinges are judged in metres, and recorded with axis rows that have no unit: the length says nothing of them."""
    shared = find_margin(StoredRun(make_measured_record("aa03", phi_max=9e-3, gap_share_max=0.6)))
    assert shared is not None and shared.words == "|phi| is 0.600 of its limit" and shared.ratio == pytest.approx(0.6)
    found = find_margin(
        StoredRun(make_measured_record("aa01", phi_max=9e-3, phi_dot_max=0.04, speed_scale_m_per_s=1.0))
    )
    assert found is not None and found.error.law is Law.ENERGY
    fast = find_margin(StoredRun(make_measured_record("aa02", phi_dot_max=0.04, phi_dot_limit_m_per_s=0.05)))
    assert fast is not None and fast.error.law is Law.CONSTRAINT_RATE and fast.ratio == pytest.approx(0.8)


def test_a_success_is_never_above_a_limit():
    """Where a record lacks what a wider limit was reckoned from, that law is left out and not shown as broken."""
    found = find_margin(StoredRun(make_measured_record("aa01", phi_max=0.5, phi_limit_m=0.01, energy_drift_max_J=0.01)))
    assert found is not None and found.error.law is Law.ENERGY and found.ratio <= 1.0


@pytest.fixture
def folder(tmp_path):
    """Two problems that all ran and a variant that one ran; gamma is wrong on one, delta stops on it."""
    for name in ("hard", "easy"):
        for k, solver in enumerate(("alpha", "beta", "gamma", "delta")):
            ending = broken(Law.ENERGY, 0.45, 0.1, "J") if (name, solver) == ("hard", "gamma") else {}
            if (name, solver) == ("hard", "delta"):
                ending = {"status": "singular", "message": "pivot", "t_reached_s": 0.5}
            made = make_measured_record(
                f"{name}{k}", solver, problem=name, energy_drift_max_J=1e-6 * 10.0**k, phi_max=0.0, **ending
            )
            put(tmp_path, made, moving(k))
    put(
        tmp_path,
        make_measured_record("only1", "alpha", problem="hard", problem_parameters=json.dumps({"t_end": 1.0})),
        make_swing(),
    )
    write_text(tmp_path / "environment.json", "{}")
    return tmp_path


def moving(k: int) -> Series:
    """A bar that turns about the origin, at another rate for each solver."""
    plain, t = make_swing(), np.linspace(0.0, 2.0, 200)
    angle = (1.0 + 0.1 * k) * t
    r = np.stack((np.sin(angle), -np.cos(angle), 0.0 * t), axis=1)[:, None]
    q = np.stack((0.0 * t, 0.0 * t, np.sin(angle / 2), np.cos(angle / 2)), axis=1)[:, None]
    arrays = {
        "frame_t": t,
        "frame_r": r,
        "frame_q": q,
        "joint_i": np.array([0]),
        "joint_j": np.array([-1]),
        "joint_s_i": np.array([[0.0, 1.0, 0.0]]),
        "joint_s_j": np.zeros((1, 3)),
        "gravity": np.array([0.0, -9.81, 0.0]),
    }
    return Series({**plain.arrays, **arrays}, (), plain.body_names, ("O",), plain.units, plain.symbols)


def test_all_solvers_have_one_denominator_and_the_sentence_names_best_and_worst(folder):
    """A variant that one solver ran is no column; false success is worse than a stop, a stop than a success."""
    found = make_heat_map(read_results(folder))
    assert found is not None and [p.title for p in found.problems] == ["easy", "hard"]
    assert [(row.solver, row.succeeded) for row in found.rows] == [
        ("alpha", 2),
        ("beta", 2),
        ("delta", 1),
        ("gamma", 1),
    ]
    assert found.title == "2 of 4 solvers stay within every limit on all 2 problems, each at its finest setting"
    column = [row.boxes[1] for row in found.rows]
    ranked = [b.run.record.solver for b in sort_cells(column)]
    assert (ranked[0], ranked[-1]) == ("alpha", "gamma")
    said = describe_extremes(column)
    assert said.startswith("Each solver at its finest setting: farthest below its limits is alpha (dt = 0.01 s): ")
    assert said.endswith("Last is gamma (dt = 0.01 s): wrong, the energy error reaches 0.45 J, more than 0.1 J.")
    assert {b.run.record.solver: b.text for b in column}["delta"] == "at 25 %"


@pytest.mark.parametrize(
    ("errors", "words"),
    [
        ((1e-3, 1.05e-3, 1.09e-3), "all 3 stay as far below their limits, such as alpha (dt = 0.01 s)"),
        ((1e-3, 1.05e-3, 2e-3), "alpha (dt = 0.01 s): the energy error is 0.00100 of 0.100 J allowed; as far is beta."),
        ((1e-3, 1.2e-3, 2e-3), "alpha (dt = 0.01 s): the energy error is 0.00100 of 0.100 J allowed. Last is gamma"),
    ],
)
def test_no_solver_is_named_first_that_is_not(tmp_path, errors, words):
    """Margins within a tenth of each other are alike, whoever comes first in the alphabet."""
    for solver, error in zip(("alpha", "beta", "gamma"), errors, strict=True):
        put(
            tmp_path,
            make_measured_record(solver, solver, energy_drift_max_J=error, phi_max=0.0, position_error_max_m=0.0),
        )
    (variant,) = read_results(tmp_path).variants
    assert words in describe_extremes(make_cells(variant, "recommended"))


def test_a_solver_beside_the_comparison_has_its_row(folder):
    """It ran one of the two problems in another group: a place is empty, and it counts as not within."""
    put(folder, make_measured_record("zeta1", "zeta", problem="easy", label="work"), moving(0))
    put(
        folder,
        make_measured_record("zeta2", "zeta", problem="easy", label="work", dt_s=1e-4, solver_options='{"order": 4}'),
    )
    found = make_heat_map(read_results(folder))
    assert found is not None and len(found.problems) == 2
    row = next(row for row in found.rows if row.solver == "zeta")
    assert [b and b.run.record.run_id for b in row.boxes] == ["zeta1", None] and row.succeeded == 1
    words = "2 of 4 solvers with an outcome on all 2 problems stay within every limit, each at its finest setting"
    assert found.title == words


@pytest.mark.browser
def test_the_first_screen_shows_the_picture_and_the_mechanism_moves(folder, browser):
    """The mechanism is on the screen without scrolling and its pixels change with time; the margins have colours."""
    tab = browser.open(site.build_report(folder), width=1280, height=800)
    tab.until("window.MBS.onStage && MBS.onStage.play()")
    box = "document.querySelector('[data-stage]').getBoundingClientRect()"
    assert tab.evaluate(f"{box}.width") > 200 and tab.evaluate(f"{box}.bottom") < 800
    boxes = "[...document.querySelectorAll('.heat td[class^=h]')]"
    assert len(set(tab.evaluate(f"{boxes}.map((e) => getComputedStyle(e).backgroundColor)"))) >= 3
    frames = []
    for t in (0.0, 1.0):
        tab.evaluate(f"MBS.onStage.seek({t})")
        frames.append(tab.screenshot(selector="[data-stage]").astype(int))
    assert np.mean(np.abs(frames[0] - frames[1]).max(axis=2) > 40) > 0.005
    assert tab.ink("[data-stage]") > 0.005 and tab.faults == []

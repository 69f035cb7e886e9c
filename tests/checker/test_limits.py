"""Limits that no bundle of the tests comes near: each is the number of docs/bundle.md."""

from types import SimpleNamespace

import numpy as np
import pytest

from .test_check_bundle import checker

LENGTH, SPEED, ENERGY = 2.0, 3.0, 5.0  # [m], [m/s], [J]
FORCE, MOMENT, STATED = 7.0, 11.0, 1e-3  # [N], [N m], [m]


def test_limits_of_the_status_are_those_of_the_page():
    """The table of the section on status, of one mechanism."""
    columns = dict.fromkeys(
        (
            "t_reached_s",
            "energy_drift_max_J",
            "gap_share_max",
            "gap_rate_share_max",
            "orthogonality_max",
            "reaction_error_max_N",
            "moment_error_max_Nm",
            "kinematic_defect",
            "rate_error_judged_m_per_s",
            "motion_error_judged_m",
            "motion_between_max_m",
        ),
        0.0,
    )
    columns |= {"reaction_size_N": FORCE, "moment_size_Nm": MOMENT, "reference_own_error_judged_m": STATED}
    run = SimpleNamespace(
        record=columns,
        scales={"length": LENGTH, "speed": SPEED, "energy": ENERGY},
        is_one_mechanism=True,
        has_every_step=True,
        t=np.zeros(1),
        states=np.zeros((1, 20)),
        p=SimpleNamespace(t_end=4.0, start=np.zeros((1, 20))),
        find_exact_defect=lambda: 0.0,
    )
    limits = {law: limit for law, (_, limit) in checker.Run.list_limits(run).items()}
    assert limits == pytest.approx(
        {
            "end": 4e-9,
            "start": 6e-9,
            "energy": 0.5,
            "constraint": 1.0,
            "constraint_rate": 1.0,
            "orthogonality": 1e-3,
            "reaction": 10 * (7.0 + 2.5),
            "moment": 10 * (11.0 + 5.0),
            "kinematic": 0.5,
            "velocity": 3.0,
            "motion": 0.2 + 1e-3,
            "rows": 1.0 + 1e-3,
        },
        rel=1e-14,
    )


def test_rates_are_off_by_what_errors_of_poses_allow():
    """Rate error over 2 (motion + stated error)(1/median step + the fastest): 1.2 m/s, 6 cm, 0.1 s, 4 rad/s."""
    run = SimpleNamespace(
        judged_count=3,
        exact_t=np.array([0.0, 0.1, 0.2]),
        exact_rows=np.arange(3),
        record={"speed_scale_m_per_s": SPEED},
        rate_error=np.array([0.0, 1.2, 0.5]),
        motion_error=np.array([0.0, 0.05, 0.02]),
        stated_error=np.full(3, 0.01),
        bodies=SimpleNamespace(Omega=np.array([[[0.0, 0.0, 4.0]]] * 3)),
    )
    for fastest, expected in ((2.0, 4.0), (10.0, 10.0)):
        ratio = checker.Run.find_rate_ratio(run, fastest)
        assert ratio == pytest.approx(1.2 / (2 * 0.06 * (10.0 + expected)))
    run.record["speed_scale_m_per_s"] = 121.0  # below 1 % of the speed nothing is said
    assert checker.Run.find_rate_ratio(run, 2.0) == 0.0


@pytest.mark.parametrize(("stated", "judged"), [(0.9e-9, 9), (1.1e-9, 3), (3e-3, 3)])
def test_a_motion_is_judged_while_the_stated_error_is_small(stated, judged):
    """A jump of the stated error by more than 100 times ends it above 1e-9 length, of any size above 1e-3 length."""
    at = np.arange(10.0)
    errors = np.where(at > 3, stated * LENGTH, 1e-12)
    found = {}
    run = SimpleNamespace(
        record={"length_scale_m": LENGTH},
        exact_t=at,
        t=at,
        p=SimpleNamespace(covered_to=9.0),
        has_every_step=True,
        every_step_has_exact=True,
        report=SimpleNamespace(lossless=True),
        stated_error=errors,
        pose_size=1.0,
        knows_shares=True,
        is_one_mechanism=True,
        motion_error=np.zeros(10),
        require=lambda *words: None,
        compare=lambda column, value, *more: found.update({column: value}),
        check_time=lambda column, value, *more: found.update({column: value}),
    )
    checker.Run.check_errors_in_time(run)
    assert found["judged_to_s"] == judged


def test_the_table_takes_cpu_times_of_small_errors_alone():
    """The least error is of any success, the least time of one within a thousandth of the length."""
    right = {"status": "success", "length_scale_m": LENGTH, "cpu_median_s": 1.0}
    near, far = right | {"motion_error_judged_m": 0.9e-3 * LENGTH}, right | {"motion_error_judged_m": 1.1e-3 * LENGTH}
    wrong = near | {"status": "wrong", "cpu_median_s": 0.1}
    cells = checker.Report.count_cells(None, [near | {"cpu_median_s": 3.0}, far, wrong])
    assert cells == {
        "runs": 3,
        "success": 2,
        "inaccurate": 0,
        "wrong": 1,
        "least_motion_error_m": 0.9e-3 * LENGTH,
        "least_cpu_s": 3.0,
    }

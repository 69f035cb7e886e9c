"""Right motions on which bounds of rates are wide: the checker says of each what the harness says, and accuses none."""

import json

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import store
from mbsbench.tests.factories import specify_run, store_run

from ..harness.judge.metrics.test_right_motions import PRINTED
from .test_check_bundle import checker, read, write

MOTIONS = {  # problem, parameters, solver, options, step
    "rows redundant on the constraints alone": (
        "bricard",
        {"t_end": 2.0},
        "gc_augmented_lagrangian",
        PRINTED,
        {"dt": 0.01},
    ),
    "a stiff spring": (
        "spring_pendulum",
        {"tuning": 60.0, "drop": 0.01, "aside": 0.15, "speed": 0.0, "t_end": 1.0},
        "scipy_strong_form",
        {},
        {"rtol": 1e-4},
    ),
    "less than two rows a turn": (
        "torque_free_body",
        {"omega": [0.0, 0.0, 40.0], "t_end": 4.0},
        "dop853_joint",
        {},
        {"rtol": 1e-3},
    ),
    "two mechanisms, whose scales are set at times of their own": (
        "random_mechanism",
        {"bodies": 2, "loops": 0, "springs": 0, "loads": 0},
        "rkmk_dop853",
        {},
        {"rtol": 1e-6},
    ),
    "a singular set of rows on the way": ("andrews", {"t_end": 0.02}, "rkmk_dop853", {}, {"rtol": 1e-6}),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("what", MOTIONS)
def test_the_checker_agrees(what, tmp_path):
    problem, parameters, solver, options, step = MOTIONS[what]
    folder = store.create_folder(tmp_path / "results")
    record = store_run(folder, specify_run(problem, solver, parameters, options, **step))
    assert record.status == "success"
    assert main(["bundle", str(folder), "-o", str(tmp_path / "b.zip"), "--lossless"]) == 0
    files = read(tmp_path / "b.zip")
    with np.errstate(all="ignore"):
        assert checker.Report(write(tmp_path / "c.zip", files)).findings == []
    (run,) = json.loads(files["runs.json"])
    assert set(run["reactions"]) == (set() if what == "a stiff spring" else set(checker.REACTIONS))

"""Pages and terminal state the numbers of ``runs.parquet``: recomputed here from the table alone."""

import dataclasses
import html
import json

import numpy as np
import pandas as pd
import pytest
from msgspec.structs import replace

from mbsbench.api import Run as ApiRun
from mbsbench.cli.__main__ import main
from mbsbench.cli.solve import summarize_record
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.results import store
from mbsbench.harness.results.judgements.claims import ClaimFinding, ClaimGap, ClaimVerdict, MissingReason
from mbsbench.reports import site
from mbsbench.reports.model.words import number
from mbsbench.reports.pages.compare import write_compare
from mbsbench.reports.pages.judged.claims import describe_origins
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import put
from .outline import Outline
from .pages.synthetic import CLAIM

SIZES = (2, 4, 8)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Two errors a run, a mechanism in three sizes over two times, a problem with axis rows."""
    folder = tmp_path_factory.mktemp("pages")
    errors = {
        "position_error_judged_m": 0.0159,
        "position_error_max_m": 0.514,
        "orientation_error_judged_rad": 0.02,
        "orientation_error_max_rad": 0.9,
        "judged_to_s": 0.5,
        "phi_limit_m": 0.01,
    }
    put(folder, make_measured_record("aa01", **errors), make_swing())
    put(
        folder,
        make_measured_record("aa02", dt_s=0.005, **{**errors, "position_error_judged_m": 0.0039}),
        make_swing(600),
    )
    for k, n in enumerate(SIZES):
        for t_end, factor in ((0.2, 1.0), (20.0, 1.0 if k else 40.0)):  # the long motion of the smallest is dear
            put(
                folder,
                make_measured_record(
                    f"cc{n}{t_end:g}",
                    problem="chain",
                    t_end_s=t_end,
                    phi_limit_m=0.01,
                    problem_parameters=json.dumps({"links": n, "t_end": t_end}),
                    cpu_median_s=1e-3 * factor * n**1.25,
                ),
                make_swing(60, bodies=n),
            )
    put(
        folder,
        make_measured_record("gg01", problem="grid", energy_drift_max_J=1e-9, phi_max=5e-3, gap_share_max=0.7),
        make_swing(),
    )
    store.write_table(folder, store.load(folder).records)
    page = site.build_report(folder).parent
    return folder, pd.read_parquet(folder / "runs.parquet"), lambda name: (page / name).read_text(encoding="utf-8")


def test_exponents_of_growth_are_those_of_runs_over_the_same_time(built):
    """A motion of 20 s among those of 0.2 s is another motion."""
    _, table, page = built
    chain = table[table.problem == "chain"]
    text = Outline(page("cost.html")).text
    for t_end, own in chain.groupby("t_end_s"):
        bodies = own.problem_parameters.map(lambda p: json.loads(p)["links"])
        slope = np.polyfit(np.log(bodies), np.log(own.cpu_median_s / own.steps), 1)[0]
        smallest = 1e3 * (own.cpu_median_s / own.steps)[bodies == min(SIZES)].iloc[0]
        row = text.index(f"{t_end:g} s simulated", text.index("Smallest [ms]"))
        assert f"{number(slope)}2 to 8{number(smallest)}" in text[row : row + 200]


def test_joints_with_axis_rows_count_in_the_picture(built):
    """By the share of the limit that the table holds: 0.7 of it is nearer than 1e-9 J of the energy."""
    _, table, page = built
    (row,) = table[table.problem == "grid"].itertuples()
    assert f"|phi| is {number(row.gap_share_max)} of its limit" in html.unescape(page("index.html"))


def test_terminal_and_notebook_tell_the_error_of_the_pages(built, capsys, monkeypatch):
    """Up to where errors are judged, and up to when that is; 0.514 m is the error of chaos."""
    folder, table, page = built
    (row,) = table[table.run_id == "aa01"].itertuples()
    (r,) = (x for x in store.load(folder).records if x.run_id == "aa01")
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["show", str(folder), "--problem", "pendulum", "--sort", "error"]) == 0
    shown = capsys.readouterr().out
    assert main(["show", str(folder), "aa01"]) == 0
    whole = capsys.readouterr().out
    line = next(x for x in summarize_record(r) if x.startswith("error "))
    said = f"{row.position_error_judged_m:.3e} m, {row.orientation_error_judged_rad:.3e} rad (to {row.judged_to_s:g} s)"
    assert said in line and said in repr(ApiRun(r)) and said in whole
    assert "error to [s]" in shown and "0.0159" in shown and "0.514" not in shown
    assert number(row.position_error_judged_m) in Outline(page("runs/aa01.html")).text
    older = dataclasses.replace(r, position_error_judged_m=float("nan"), orientation_error_judged_rad=float("nan"))
    assert f"{row.position_error_max_m:.3e} m, {row.orientation_error_max_rad:.3e} rad (to 2 s)" in repr(ApiRun(older))


def test_two_results_without_a_difference_blame_no_solver(tmp_path):
    """Bit for bit identical, but one has a run more; then one that differs, and one that a limit ended."""
    a, b = tmp_path / "a", tmp_path / "b"
    for folder in (a, b):
        put(folder, make_measured_record("aa01"), make_swing())
        put(
            folder,
            make_measured_record("bb01", "beta", "stalled", t_reached_s=1.0 if folder == a else 1.2),
            make_swing(),
        )
        (folder / "environment.json").write_text(json.dumps({"run": "one", "commit": "c"}))

    def causes() -> str:
        text = Outline(write_compare(a, b, ConfinedPath(tmp_path) / "out").read_text(encoding="utf-8")).text
        return text[text.index("Possible causes") : text.index("Only in one of them")]

    assert "a limit on time or memory ended it" in causes() and "not deterministic" not in causes()
    put(b, make_measured_record("bb01", "beta", "stalled", t_reached_s=1.0), make_swing())
    assert "and no result does." in causes()
    put(b, make_measured_record("zz01"), make_swing())
    assert "there are runs in one of them only" in causes() and "not deterministic" not in causes()
    put(b, make_measured_record("aa01", energy_drift_max_J=0.3), make_swing())
    assert "1 run: a solver is not deterministic (pendulum alpha aa01)" in causes()


def test_claims_that_no_run_can_test_are_not_judged_from_these():
    """Counted as the file has them: each claim once."""
    untestable = replace(
        CLAIM,
        id="u",
        beyond=ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD),
        missing=(MissingReason(ClaimGap.NEED, "a curve"),),
    )
    lacking = replace(
        CLAIM,
        id="l",
        beyond=ClaimFinding(ClaimVerdict.CANNOT_BE_TOLD),
        missing=(MissingReason(ClaimGap.RUNS, found=0, wanted=3),),
    )
    said = describe_origins([untestable] * 4 + [lacking] * 80, 80)
    assert said.startswith("None of 84 claims is judged from these runs; for 80 they lack runs: 80 of these")
    assert "4 can be tested by no run" in said
    assert describe_origins([CLAIM, CLAIM, untestable, lacking], 1).startswith(
        "2 of 4 claims are judged from these runs; for 1"
    )

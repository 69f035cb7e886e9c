"""``try``: a solver of ten lines gets its page; a fault in it is a line that fails."""

import base64
import dataclasses
import json
import math
import re
from functools import partial
from importlib import import_module

import msgspec
import pytest
from markupsafe import escape

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.catalogue.suites.spec import make_spec
from mbsbench.harness.judge.conformance import assessment, presentations
from mbsbench.harness.mechanics.jacobian import independent_rows
from mbsbench.harness.mechanics.types import Trait
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.findings import Finding, Verdict
from mbsbench.harness.results.judgements.runs import Order, Symmetry, Unjudged
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.run.job import Job
from mbsbench.harness.run.pool import LocalPool
from mbsbench.harness.run.runner import Request
from mbsbench.reports.trial import write_page
from mbsbench.tests.factories import PLUGIN, run_here

PAGE = (ROOT / "docs" / "your-own-solver.md").read_text(encoding="utf-8")
SOLVER = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)[0]


@pytest.fixture
def laddered(tmp_path):
    """Findings of ``try`` on the coarser half of one ladder alone, of half the time: they decide on the order."""

    def laddered(text: str) -> tuple[list[Finding], list[Order]]:
        (tmp_path / "own.py").write_text(text.replace('"midpoint"', '"own"'), encoding="utf-8")
        registry.load_plugin(tmp_path / "own.py")
        own = [s for s in assessment.plan_runs("own", 60.0) if s.solver == "own" and s.label == "ladder"]
        specs = [s for s in own if s.problem == "spherical_pendulum"][:5]
        folder = store.create_folder(tmp_path / "results")
        records = [run_here(Job(spec, folder)) for spec in specs]  # in this process
        orders = assessment.certify_ladders("own", folder, records)
        return list(assessment.assess_solver("own", folder, records, orders)), orders

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_plugin_files", set())
        patch.setattr(registry, "_plugin_solvers", {})
        shorter = {**assessment.LADDERS["spherical_pendulum"], "t_end": 0.5}
        patch.setattr(assessment, "LADDERS", {"spherical_pendulum": shorter})
        yield laddered


def order_of_position(found: list[Finding]) -> Finding:
    (line,) = (line for line in found if line.quantity == "order, spherical_pendulum, position")
    return line


@pytest.mark.sampled(0)
def test_ten_lines_have_a_certificate_of_their_order_and_a_page(laddered, tmp_path):
    """Second order, as declared; the page has every line, and draws what was observed beside what is declared."""
    found, orders = laddered(SOLVER)
    line = order_of_position(found)
    assert line.verdict is Verdict.MET and line.limits == "2 declared"
    assert 1.8 < float(line.text.split()[0]) < 2.3
    write_page(tmp_path / "page.html", tmp_path / "results", "own", "", found, orders)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert all(escape(line.quantity) in text and escape(line.text) in text for line in found)
    charts = [base64.b64decode(image).decode() for image in re.findall(r"base64,([^\"]+)", text)]
    assert "declared: order 2" in charts[0] and "position error" in charts[-1]


def test_a_fault_falls_short_of_the_declared_order(laddered):
    """A stage at a third of the step is of first order."""
    assert SOLVER.count("dt / 2") == 1
    line = order_of_position(laddered(SOLVER.replace("dt / 2", "dt / 3"))[0])
    assert line.verdict is Verdict.FAILED and float(line.text.split()[0]) < 1.3


@pytest.mark.slow
@pytest.mark.parametrize(("stage", "code"), [("dt / 2", 0), ("dt / 3", 1)])
def test_the_example_passes_with_all_it_is_tried_on_and_a_planted_fault_fails(command, tmp_path, stage, code):
    """Second order in position and orientation on both ladders, all symmetries, statuses on all problems."""
    (tmp_path / "midpoint.py").write_text(SOLVER.replace("dt / 2", stage), encoding="utf-8")
    done = command("try", "midpoint.py", "--json", "--no-report", "--html", "page.html", timeout=900.0)
    assert done.returncode == code, done.stdout + done.stderr
    found = {line["quantity"]: line for line in map(json.loads, done.stdout.splitlines())}
    if code:
        assert found["order, spherical_pendulum, position"]["verdict"] == "failed"
        return
    orders = [f"order, {name}, {quantity}" for name in assessment.LADDERS for quantity in ("position", "orientation")]
    assert (
        all(found[name]["verdict"] == "met" for name in (*orders, "symmetries")) and (tmp_path / "page.html").exists()
    )
    assert any(what.startswith("work, ") for what in found) and found["energy over many periods"]["words"]


@pytest.mark.parametrize("solver", ["rattle", "rk45_strong_form"])
def test_the_runs_are_what_the_certificates_need(solver):
    """Ladders of more than four settings, each symmetry beside a run as it stands, no run twice."""
    specs = assessment.plan_runs(solver, cpu_limit=10.0)
    assert len({s.settings_id for s in specs}) == len(specs)
    for name in assessment.LADDERS:
        assert sum(s.problem == name and s.label == "ladder" and s.solver == solver for s in specs) > 4
    presented = [s for s in specs if s.label == "symmetries"]
    others = 4 if solver == "rattle" else 3  # as it stands, finer, nudged; at a tenth of a step's tolerance
    assert len(presented) == len(presentations.PRESENTED) + others and all(s.cpu_limit == 10.0 for s in specs)


def test_a_long_run_is_made_only_if_it_is_long():
    """1 ms a step pays 300 swings at 0.01 s in 30 s of CPU; 100 ms a step do not pay fifty."""
    run = RunRecord(solver="rattle", label="ladder", problem="spherical_pendulum", steps=100)
    ladders = ([dataclasses.replace(run, cpu_median_s=100.0 * each)] for each in (1e-3, 1e-1))
    fast, slow = (assessment.plan_long_run("rattle", ladder, 60.0) for ladder in ladders)
    assert slow is None and fast is not None and fast.parameters["t_end"] == pytest.approx(assessment.LONGEST, rel=0.01)
    assert fast.label == "long"


def said(label: str, problem: str, *statuses: str) -> list[Finding]:
    """The lines on runs of ``rattle`` that ended so."""
    runs = [RunRecord(solver="rattle", label=label, problem=problem, status=s, message="so it ended") for s in statuses]
    lines = assessment._assess_problems(runs) if label == "problems" else assessment._assess_orders([], runs)
    return [line for line in lines if problem in line.quantity]


def test_divergence_is_a_failure_but_on_a_stiff_problem_a_warning():
    """Whatever the method; a stiff problem's crash is a failure."""
    stiff = next(name for name, p in registry.problems().items() if Trait.STIFF in p.tests)
    other = next(name for name, p in registry.problems().items() if Trait.STIFF not in p.tests)
    on_stiff, crashed = said("problems", stiff, "diverged", "crashed")
    (on_other,) = said("problems", other, "diverged")
    assert [f.verdict for f in (on_stiff, crashed, on_other)] == [Verdict.OPEN, Verdict.FAILED, Verdict.FAILED]
    assert "diverged" in on_stiff.text


def test_a_slow_rung_hides_no_rungs_that_failed():
    """Too slow is said only where all that did not end were; else the statuses are named, and it is a failure."""
    (slow,) = said("ladder", "heavy_top", "success", "stalled", "stalled")
    words = "not determined: the runs were too slow for the budget"
    assert (slow.verdict, slow.text) == (Verdict.OPEN, words)
    (failed,) = said("ladder", "heavy_top", "stalled", "crashed", "diverged", "crashed")
    assert failed.verdict is Verdict.FAILED and failed.text.endswith(": 2 crashed, 1 diverged, 1 stalled")


def test_a_ladder_without_an_order_is_shown_beside_one_that_has_it():
    """All rungs on the top crashed: said, and a failure, though the pendulum has its order."""
    order = Order(
        problem="spherical_pendulum",
        variant="",
        solver="rattle",
        case="",
        quantity="position",
        symbol="r",
        unit="m",
        against="dt",
        declared=2.0,
        order=2.0,
        low=1.9,
        high=2.1,
        dt=(0.04, 0.02, 0.01, 0.005),
        error=(1.6e-3, 4e-4, 1e-4, 2.5e-5),
        used=(True,) * 4,
        floor=0.0,
        rtol=(),
        exponent=math.nan,
        exponent_low=math.nan,
        exponent_high=math.nan,
        verdict="certified",
        fit="power",
        slopes=(),
        unfinished=0,
        notes=(),
        t_end_s=1.0,
        settings_ids=(),
    )
    ladder = [
        RunRecord(problem="spherical_pendulum", status="success"),
        RunRecord(problem="heavy_top", status="crashed"),
    ]
    found = {line.quantity: line for line in assessment._assess_orders([order], ladder)}
    assert found["order, spherical_pendulum, position"].verdict is Verdict.MET
    top = found["order, heavy_top"]
    assert top.verdict is Verdict.FAILED and top.text.endswith(": 1 crashed")


def test_a_ladder_cut_by_the_budget_is_neither_met_nor_failed():
    """No rung at all, or good ones only: not determined. A rung that crashed is a failure all the same."""
    left = [s for s in assessment.plan_runs("rattle", 10.0) if s.solver == "rattle" and s.problem == "heavy_top"]
    left = [s for s in left if s.label == "ladder"]

    def top(*statuses: str) -> Finding:
        runs = [RunRecord(solver="rattle", label="ladder", problem="heavy_top", status=s) for s in statuses]
        lines = assessment._assess_orders([], runs, left[len(runs) :])
        return next(x for x in lines if "heavy_top" in x.quantity)

    assert (top().verdict, top().text) == (Verdict.OPEN, "not determined: no run of it within the budget")
    words = f"not determined: {len(left) - 2} of {len(left)} runs of it are left out by the budget"
    assert (top("success", "success").verdict, top("success", "success").text) == (Verdict.OPEN, words)
    assert top("success", "crashed").verdict is Verdict.FAILED


def test_symmetries_of_which_none_was_tested_are_not_ok():
    """Refused, all nine: not determined, with the reason; those of a mechanism that is taken count alone."""
    one = Symmetry("own", {}, "yaw", "four_bar_grid", "v", ("a", "b"), "refused", Unjudged.BASE, message="no loops")
    none = presentations._count_symmetries([one] * 9, {})
    assert not none.is_tested and none.words == "not determined: 9 refused on four_bar_grid: no loops"
    held = msgspec.structs.replace(one, problem="random_mechanism", verdict="holds", message="")
    some = presentations._count_symmetries([one, held, held], {})
    assert some.is_tested and some.holds and some.words.startswith("2 of 2 hold; 1 refused on four_bar_grid")
    undecided = presentations._count_symmetries([msgspec.structs.replace(held, verdict="undecided")], {})
    assert not undecided.is_tested


def test_a_solver_that_refuses_redundant_rows_is_tried_on_a_tree(monkeypatch):
    """The grid has redundant rows; the tree has the same presentations, and is asked for once."""
    monkeypatch.setattr(assessment, "plan_long_run", lambda *_: None)
    asked = []

    def run_stage(specs, rest, resume):
        asked.append([s for s in specs if s.label == "symmetries"])
        return [
            RunRecord(
                solver=s.solver,
                label=s.label,
                problem=s.problem,
                status="refused" if s.problem == "four_bar_grid" else "success",
            )
            for s in specs
        ]

    specs = assessment.run_stages("rattle", 1e9, run_stage)
    trees = [s for s in specs if s.label == "symmetries" and s.problem == "random_mechanism"]
    assert len(trees) == len({s.settings_id for s in trees}) == len(presentations.PRESENTED) + 4
    system = make_problem("random_mechanism", presentations.TREE)
    assert len(independent_rows(system.system, system.initial)) == system.system.nrows


@pytest.mark.parametrize("refused", [("four_bar_grid",), ("four_bar_grid", "random_mechanism")])
def test_the_tree_is_tried_once(refused):
    """Also where it is refused, too, and where a long run comes between."""

    def run_stage(specs, rest, resume):
        assert len(specs) < 1000
        ran = {"steps": 10, "cpu_median_s": 1e-3, "t_reached_s": 1.0}
        return [
            RunRecord(
                solver=s.solver,
                label=s.label,
                problem=s.problem,
                rtol=s.control.rtol or math.nan,
                **ran,
                status="refused" if s.problem in refused else "success",
            )
            for s in specs
        ]

    specs = assessment.run_stages("rattle", 1e9, run_stage)
    assert len(specs) == len({s.settings_id for s in specs})
    assert sum(s.problem == "random_mechanism" and s.label == "symmetries" for s in specs) > 4


def test_reactions_are_none_only_where_a_run_could_return_them():
    """Without a run, or without a successful one, nothing is known of them."""

    def reactions(*statuses: str) -> str:
        (line,) = assessment._assess_laws([], [RunRecord(claimed=s, reaction_size_N=math.nan) for s in statuses])
        return line.text

    assert reactions() == "not determined: no run of it within the budget"
    assert reactions("crashed") == "not determined: no run of the ladders succeeded"
    assert reactions("crashed", "success") == "not determined: none returned"


def test_rivals_that_the_budget_left_out_are_not_said_to_be_worse():
    """Only those whose whole ladder was run are named."""
    own = RunRecord(solver="rattle", label="ladder", problem="heavy_top", status="success", motion_error_max_m=1e-3)
    specs = assessment.plan_runs("rattle", 10.0)
    left = [s for s in specs if s.label == "ladder" and s.problem == "heavy_top" and s.solver != "ida_index1"]
    (some,), (none,), (all_,) = (list(assessment._assess_work("rattle", [own], x)) for x in (left, specs, []))
    assert some.text.endswith("; none of ida_index1 comes as near")
    assert "none of" not in none.text and all_.text.count(",") == 2


class Over(LocalPool):
    """Its time is up as soon as a run that sleeps runs."""

    def _is_over(self) -> bool:
        return self._stopped or any(job.spec.options for job in self._flying.values())


def test_what_a_budget_cut_short_is_counted_and_not_passed(tmp_path, capsys, monkeypatch):
    """One run done, one ended, one not started: the last two are not judged, no long run is begun; it is no pass."""
    fall = registry.make_problem("free_fall", {})
    specs = [
        make_spec(fall, "sleeps", options, {"dt": 0.5}, label="problems")
        for options in ({}, {"seconds": 500.0}, {"seconds": 501.0})
    ]
    command = import_module("mbsbench.cli.try")
    monkeypatch.setattr(assessment, "plan_runs", lambda *_, **__: specs)
    monkeypatch.setattr(command, "Request", partial(Request, pool=Over))
    line = ["try", "sleeps", "--plugin", str(PLUGIN), "--no-report", "--jobs", "1", "--budget", "50"]
    assert main([*line, "--out", str(tmp_path / "out"), "--json"]) == 1
    found = [json.loads(x) for x in capsys.readouterr().out.splitlines()]
    assert found[0]["quantity"] == "budget" and found[0]["words"].startswith("2 of 3 runs ended or left out when 50 s")
    assert [x["verdict"] for x in found if x["quantity"].startswith("free_fall")] == ["met"]
    assert not any(x["verdict"] == "failed" for x in found)
    cut = {x["quantity"] for x in found if x["words"] == "not determined: no run of it within the budget"}
    ladders = {f"order, {name}" for name in assessment.LADDERS}
    assert cut == {*ladders, "energy over many periods", "reactions", "symmetries"}
    assert main([*line, "--out", str(tmp_path / "again")]) == 1
    out, err = capsys.readouterr()
    said = " ".join(out.split())
    assert "stopped at the budget of 50 s (--budget), of which " in err
    assert "as expected; incomplete: 2 of 3 runs are left out by the budget" in said

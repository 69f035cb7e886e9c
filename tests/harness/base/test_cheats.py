"""Work that a solver does where nobody might look is in the cost recorded, or in what is shown beside it."""

import json

import pytest

from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.run.handover import COST, SolverReport, _add_hidden_cost
from mbsbench.tests.factories import PLUGIN, run_suite_text

from .. import cheating
from ..cheating import MUCH, WORK

FINE = 0.05  # [s]
TICKS = 0.9  # of the work: other processes are accounted in ticks of 10 ms
SUITE = """
[[runs]]
problem = "free_fall"
solver = "cheats"
repeats = 2
options = { where = ["call", "refuses", "daemon", "daemon_in_refuses", "child", "disowned", "clocks", "half", "set_up",
                     "first", "file", "block", "numba_event", "compiler", "report"] }
"""
AT_IMPORT = (
    "from mbsbench.tests.harness.cheating import Exact, work\nfrom mbsbench.harness.catalogue.registry import solver\n"
)
AT_IMPORT += 'from dataclasses import dataclass\nwork()\n@solver("prepared")\n@dataclass(frozen=True)\n'
AT_IMPORT += 'class Prepared(Exact):\n    """Has worked already."""\n'


@pytest.fixture(scope="module")
def records(own_supervisor, tmp_path_factory):
    """Of all ways, by where the work is done."""
    folder = tmp_path_factory.mktemp("cheats") / "run"
    found = run_suite_text(folder, SUITE, plugins=(PLUGIN, cheating.__file__))[0].records
    assert {r.status for r in found} == {"success"}
    return {json.loads(r.solver_options).get("where", "call"): r for r in found}


@pytest.mark.sampled(0)
@pytest.mark.parametrize("where", ["call", "daemon", "daemon_in_refuses", "child", "half"])
def test_work_between_call_and_return_is_its_cost(records, where):
    """Whatever process does it, in whatever session, and whatever the solver says it took."""
    r = records[where]
    beside = r.cpu_refuses_s if where == "daemon_in_refuses" else 0.0  # it begins to work there
    assert r.cpu_min_s + beside > TICKS * WORK and r.cpu_call_s + beside > TICKS * WORK


@pytest.mark.parametrize("where", ["refuses", "file", "set_up"])
def test_work_before_the_call_and_set_up_are_shown_beside_it(records, where):
    """Work that ``refuses`` does for ``solve``, in memory or on disk, and work that is called set-up."""
    r = records[where]
    assert r.setup_s > TICKS * WORK
    assert (r.cpu_refuses_s > TICKS * WORK) is (where != "set_up")


@pytest.mark.parametrize("where", ["block", "numba_event"])
def test_work_that_is_said_to_be_compilation_is_shown_beside_the_cost(records, where):
    """A plugin that opens the meter itself, or says that numba compiles, hides nothing: it may call it set-up, too."""
    r = records[where]
    assert r.code_s > TICKS * WORK and r.setup_s > TICKS * WORK and r.cpu_process_s > TICKS * WORK
    assert r.cpu_call_s < WORK


def test_what_a_plugin_compiles_is_set_up_and_what_it_computes_is_its_cost(records):
    """Numba's own events tell them apart, in each repeat; the plugin knows nothing of that."""
    r = records["compiler"]
    assert r.setup_s > 0.1 and r.code_s >= r.setup_s - r.cpu_refuses_s - r.cpu_import_s and r.repeats == 2
    assert TICKS * WORK < r.cpu_min_s <= r.cpu_call_s < WORK + 0.1
    assert records["call"].code_s == 0.0


def test_the_parents_meter_counts_code_not_the_words_of_the_solver(records):
    """A process that hands over its work as compilation, and has not told its meter, has made no code."""
    r = records["report"]
    assert r.code_s < FINE and r.cpu_min_s > TICKS * WORK


def test_more_code_than_cpu_time_is_a_breach(tmp_path):
    """No number in a record exceeds what the system has counted: budgets are kept by their difference."""
    text = SUITE[: SUITE.index("repeats")] + 'options = { where = "absurd_report" }'
    (r,) = run_suite_text(tmp_path / "run", text, 1, plugins=(PLUGIN, cheating.__file__))[0].records
    assert (r.status, r.ended_by) == ("crashed", "exception") and "code_s = 1e+05 does not fit" in r.message
    assert 0.0 <= r.code_s < FINE


def test_what_a_later_repeat_need_not_do_counts(records):
    """The first repeat alone, with a note."""
    r = records["first"]
    assert r.repeats == 1 and r.cpu_min_s > TICKS * WORK and "the first alone counts" in r.notes
    assert records["call"].repeats == 2 and "counts" not in records["call"].notes


@pytest.mark.parametrize("where", ["disowned", "clocks"])
def test_what_its_own_clocks_do_not_show_is_seen_from_outside(records, where):
    """A child that nobody waits for, a clock that stands still: all the process took is its cost, with a note."""
    r = records[where]
    assert r.cpu_min_s == r.cpu_process_s > TICKS * MUCH and "all counts" in r.notes


@pytest.mark.sampled(0)
def test_work_at_import_is_set_up(tmp_path):
    """Of the plugin that brings the solver."""
    plugin = tmp_path / "prepared.py"
    plugin.write_text(AT_IMPORT)
    text = '[[runs]]\nproblem = "free_fall"\nsolver = "prepared"'
    (r,) = run_suite_text(tmp_path / "run", text, 1, plugins=(PLUGIN, plugin))[0].records
    assert r.status == "success", r.message
    assert r.cpu_import_s > TICKS * WORK and r.setup_s > TICKS * WORK


WHOLE = dict.fromkeys(COST, 1e-9) | {"repeats": 1, "cpu_inside_s": 4.0}


@pytest.mark.parametrize("inside", [{}, {"cpu_inside_s": 0.1}, {"cpu_inside_s": "nan"}, {"cpu_inside_s": 8.0}])
def test_a_cost_without_its_clock_is_all_that_the_process_took(inside):
    """A report that a solver writes itself may leave out what its own clocks account for: then that is nothing."""
    claimed = {"cpu_min_s": 1e-9, "cpu_median_s": 1e-9, "cpu_max_s": 1e-9, **inside}
    found = _add_hidden_cost(SolverReport(claimed=Status.SUCCESS, cost=claimed), 8.07)
    assert {found.cost[name] for name in ("cpu_min_s", "cpu_median_s", "cpu_max_s")} == {8.07}
    assert "all counts" in found.notes[0]
    for left_out in WHOLE:
        some = {name: value for name, value in WHOLE.items() if name != left_out}
        assert _add_hidden_cost(SolverReport(claimed=Status.SUCCESS, cost=some), 8.07).cost["cpu_median_s"] == 8.07
    whole = SolverReport(claimed=Status.SUCCESS, cost=WHOLE)
    assert _add_hidden_cost(whole, 8.07) == whole
    for ended in (SolverReport(), SolverReport(claimed=Status.REFUSED)):  # neither claims a cost
        assert _add_hidden_cost(ended, 8.07) == ended

"""The command line: one file from one line, and every wrong call reported in one line."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.cli.solve import find_last_message
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import PLUGIN

WITH = ("--plugin", str(PLUGIN))
SOLVE = ("solve", "free_fall", "exact", "--out", "run.npz")  # in this process the plugin is loaded already


@pytest.fixture
def here(tmp_path, capsys, monkeypatch):
    """A command in an empty folder, in this process: its exit code and what it printed."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        capsys.readouterr()
        code = main(list(arguments))
        out, err = capsys.readouterr()
        return SimpleNamespace(returncode=code, stdout=out, stderr=err)

    return call


def test_solve_writes_the_promised_file(command, tmp_path):
    """Names and shapes as in docs/results-format.md; no pickle."""
    done = command(*SOLVE, *WITH, "--set", "dt=0.25", "--t-end", "1")
    assert done.returncode == 0, done.stderr
    assert "success" in done.stdout and not done.stderr
    with np.load(tmp_path / "run.npz", allow_pickle=False) as f:
        shapes = {"t": (5,), "r": (5, 1, 3), "R": (5, 1, 3, 3), "v": (5, 1, 3), "Omega": (5, 1, 3), "dt": (4,)}
        shapes |= dict.fromkeys(("energy", "phi_norm", "phi_dot_norm", "obs_height"), (5,))
        assert {k: f[k].shape for k in shapes} == shapes
        assert str(f["status"]) == "success" and json.loads(str(f["counters"])) == {"evaluations": 7}
        assert f["t"][-1] == 1.0 and str(f["message"]) == "reached the end"


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("solver", "status", "rows", "by", "words"),
    [
        ("gives_up", "step_underflow", 3, "solver", "too small"),
        ("raises", "crashed", 1, "exception", "a bug of mine"),
        ("segfaults", "crashed", 1, "signal", "SIGSEGV"),
        ("exits", "crashed", 1, "exit", "exited"),
        ("refuses", "refused", 1, "solver", "on principle"),
        ("not_numbers", "wrong", 5, "solver", "not finite"),
        ("spins", "unfinished", 1, "cpu_limit", "not finished here"),
    ],
)
def test_failed_solves_write_too(capsys, tmp_path, solver, status, rows, by, words):
    """Exit code 1, the steps so far, status and what ended it; the reason in words on the terminal."""
    out = tmp_path / "run.npz"
    assert main(["solve", "free_fall", solver, *WITH, "--out", str(out), "--set", "cpu_limit=1"]) == 1
    said = capsys.readouterr()
    assert "Traceback" not in said.out + said.err
    with np.load(out, allow_pickle=False) as f:
        assert str(f["status"]) == status and len(f["t"]) == rows and str(f["ended_by"]) == by
        assert words in said.out and bool(json.loads(str(f["reasons"]))) == (status == "wrong")


BAD = [
    (("solve", "free_fal", "exact", "--out", "x.npz"), "did you mean 'free_fall'"),
    (("solve", "free_fall", "exakt", "--out", "x.npz"), "did you mean 'exact'"),
    (("solve", "free_fall"), "required"),
    ((*SOLVE, "--set", "lfit=1"), "did you mean 'lift'"),
    ((*SOLVE, "--set", "lift"), "key=value"),
    ((*SOLVE, "--set", "=3"), "key=value"),
    ((*SOLVE, "--set", "dt="), "key=value"),
    ((*SOLVE, "--set", "dt=0"), "dt must be"),
    ((*SOLVE, "--set", "dt=-1"), "dt must be"),
    ((*SOLVE, "--set", "dt=nan"), "dt must be"),
    ((*SOLVE, "--set", "dt=inf"), "dt must be"),
    ((*SOLVE, "--set", "dt=soon"), "dt must be"),
    ((*SOLVE, "--set", "dt=0.1", "--set", "dt=0.2"), "twice"),
    ((*SOLVE, "--set", "dt=0.1", "--set", "rtol=1e-6"), "exactly one"),
    ((*SOLVE, "--set", "rtol=1e-6"), "controlled by dt"),
    (("solve", "spherical_pendulum", "ida_index1", "--out", "x.npz", "--set", "rtol=1"), "rtol must be < 1"),
    (("solve", "spherical_pendulum", "ida_index1", "--out", "x.npz", "--set", "rtol=30"), "rtol must be < 1"),
    ((*SOLVE[:-1], "run.txt"), "must end in .npz"),
    ((*SOLVE[:-1], "run"), "must end in .npz"),
    ((*SOLVE, "--set", "max_step=0.1"), "max_step"),
    ((*SOLVE, "--set", "max_steps=0"), "max_steps"),
    ((*SOLVE, "--set", "cpu_limit=-5"), "cpu_limit"),
    ((*SOLVE, "--set", "cpu_limit=1e300"), "at most 1e+07"),
    ((*SOLVE, "--set", "max_steps=1e30"), "max_steps must be a whole number > 0 that fits 64 bits"),
    ((*SOLVE, "--set", "lift=much"), "lift must be a number"),
    ((*SOLVE, "--problem-set", "mass=-1"), "mass must be > 0"),
    ((*SOLVE, "--problem-set", "mass=nan"), "mass"),
    ((*SOLVE, "--problem-set", "weight=1"), "no parameter 'weight'"),
    ((*SOLVE, "--t-end", "-1"), "--t-end must be"),
    ((*SOLVE, "--t-end", "0"), "--t-end must be"),
    ((*SOLVE, "--t-end", "nan"), "--t-end must be"),
    ((*SOLVE, "--t-end", "1", "--problem-set", "t_end=2"), "twice"),
    ((*SOLVE[:-1], "nowhere/run.npz"), "cannot write"),
    ((*SOLVE[:-1], "."), "must end in .npz"),
    ((*SOLVE[:-1], "/proc/run.npz"), "cannot write"),
    ((*SOLVE[:-1], "folder.npz/run.npz"), "cannot write"),
    (("solve", "free_fall", "exact", "--plugin", "nowhere.py", "--out", "x.npz"), "nowhere.py"),
    (("run", "no_such_suite"), "unknown suite"),
    (("run", "nowhere.toml"), "cannot read"),
    (("run", "ci", "--jobs", "0"), "--jobs"),
    (("run", "ci", "--jobs", "two"), "--jobs"),
    (("run", "ci", "--limit", "-1"), "--limit"),
    (("run", "ci", "--out", "/proc/run"), "cannot write"),
    (("run", "ci", "--shard", "3/2"), "--shard"),
    (("run", "ci", "--shard", "0/2"), "--shard"),
    (("run", "ci", "--shard", "1"), "--shard"),
    (("run", "ci", "--cluster", "tcp://localhost:1", "--jobs", "2"), "--jobs"),
    (("verify", "nowhere"), "not a results folder"),
    (("verify", "--sample", "0", "nowhere"), "--sample"),
    (("diff", "nowhere", "elsewhere"), "not a results folder"),
    (("diff", "nowhere"), "not a results folder"),
    (("merge", "out", "nowhere"), "not a results folder"),
    (("merge", "out"), "required"),
    (("show", "nowhere"), "not a results folder"),
    (("history", "nowhere"), "not a results folder"),
    (("history", "nowhere.jsonl"), "cannot read"),
    (("history", "--metric", "beauty"), "unknown metric"),
    (("history", "--metric", "phi_mx"), "did you mean 'phi_max'"),
    (("report", "nowhere"), "not a results folder"),
    (("report", "a", "b", "c"), "two to compare (got 3)"),
    (("gate", "--thresholds", "nowhere.toml"), "cannot read"),
    (("gate", "--suite", "nothing"), "unknown suite"),
    (("gate", "--junit", "nowhere/gate.xml"), "cannot write"),
    (("gate", "--junit", "gate.xml", "--update"), "cannot be combined with --update"),
    (("gate", "--write"), "needs --update"),
    (("gate", "--json", "--update"), "cannot be combined with --update"),
    (("list", "--jso"), "did you mean '--json'?"),  # an option may not be shortened
    (("solve", "heavy_top", "rattle", "--nativ"), "did you mean '--native'?"),
    (("run", "ci", "--limt", "3"), "did you mean '--limit'?"),
    (("run", "ci", "--in-turns", "0"), "--in-turns"),
    (("run", "ci", "--in-turns", "2", "--cluster", "tcp://nowhere:1"), "--in-turns"),
    *(
        (("solve", "heavy_top", "rk45_strong_form", "--set", f"rtol={least}"), "rtol must be at least 2.22e-14")
        for least in (1e-16, 1e-300)
    ),  # SciPy takes its least instead and says so to nobody; others take steps of none
    (("claim", "6-gc-plana"), "did you mean '6-gc-planar'"),
    (("claim", "6-gc-planar", "--jobs", "2"), "--jobs needs --run"),
    (("claim", "6-gc-planar", "--all"), "leave out ID"),
    (("claim", "--run"), "--run needs the ID of a claim"),
    (("claim", "--rows"), "--rows needs the ID of a claim"),
    (("claim", "6-gc-planar", "somewhere", "--run"), "give --out DIR"),
    (("claim", "6-gc-planar", "nowhere"), "is not a results folder"),
    (("list", "heavy_tap"), "did you mean 'heavy_top'"),
    (("export", "heavy_tops"), "heavy_top"),
    (("advise", "spherical_pendulum", "--error", "small"), "--error"),
    (("advise", "chain", "--error", "1e-3", "--problem-set", "links=90"), "no reference"),
    (("dance",), "no command is called 'dance' - known: solve, run, advise"),
    (("sovle", "heavy_top"), "did you mean 'solve'"),
    (("--version", "heavy_top"), "--version takes --verbose alone"),
    (("list", "problms"), "did you mean 'problems'"),
    (("completion", "tcsh"), "choose from 'bash', 'zsh', 'fish'"),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("arguments", "words"), BAD, ids=[" ".join(a[:1] + a[-1:]) for a, _ in BAD])
def test_wrong_calls_are_reported_in_one_line(capsys, monkeypatch, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(list(arguments)) == 2
    out, err = capsys.readouterr()
    assert err.count("\n") == 1 and words in err and not out
    assert not list(tmp_path.iterdir())


def test_a_wrong_call_ends_the_process_with_2(command):
    done = command("solve", "free_fal", "exact", *WITH, "--out", "x.npz")
    assert done.returncode == 2 and done.stderr.count("\n") == 1


def test_list_names_everything(here):
    """Entries of plugins too; those of each kind with their summaries, one with its options."""
    shown = {name: here("list", *filter(None, [name]), *WITH).stdout for name in ("", "problems", "free_fall", "exact")}
    for words in ("heavy_top", "segfaults", "free_fall", "singular: ", "engines"):
        assert words in shown[""]
    assert "gc_weak_form" not in shown["problems"] and "released from three" in " ".join(shown["problems"].split())
    for name, words in (
        ("free_fall", "yaw"),
        ("free_fall", "[kg]"),
        ("exact", "lift"),
        ("exact", "dt [s] (fixed step"),
    ):
        assert words in shown[name]


@pytest.mark.sampled(0)
def test_latest_is_the_newest_folder_that_run_named(here, tmp_path):
    """A folder of one's own, or one that other results were merged into, leaves it where it was."""
    (tmp_path / "small.toml").write_text(SUITE.replace(', "raises"', ""))
    local = tmp_path / "results" / "local"
    for more in ((), ("--out", "results/local/mine"), ("--limit", "1", "--out", "elsewhere")):
        assert here("run", "small.toml", *WITH, *more).returncode == 0
        assert (local / "latest").resolve().name.startswith("small-")
    assert here("merge", "results/local/both", "elsewhere", "results/local/mine").returncode == 0
    assert (local / "latest").resolve().name.startswith("small-") and not (tmp_path / "latest").exists()


def test_solve_replaces_no_motion_unasked(here):
    """The second run of a day gets a name of its own; one that is named is replaced, and that is said."""
    line = ("solve", "free_fall", "exact", *WITH, "--set", "dt=0.25")
    names = [here(*line).stdout.split("written to")[-1].split()[0] for _ in range(3)]
    assert names == ["free_fall-exact.npz", "free_fall-exact-2.npz", "free_fall-exact-3.npz"]
    assert "is replaced" in here(*line, "--out", names[0]).stdout
    assert "is replaced" not in here(*line, "--out", "new.npz").stdout


def test_solve_prints_its_numbers_where_nothing_can_be_written(capsys, monkeypatch):
    """Only the motion is lost, and the last line says so; JSON names no file."""
    monkeypatch.chdir("/proc")
    line = ["solve", "free_fall", "exact", *WITH, "--set", "dt=0.25"]
    assert main(line) == 2
    out, err = capsys.readouterr()
    assert "energy drift" in out and "written to" not in out and "shadow" not in out
    assert err.startswith("error: cannot write free_fall-exact.npz: ") and "give --out" in err and err.count("\n") == 1
    assert main([*line, "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["out"] is None


def test_of_a_standard_error_the_last_message_is_shown():
    """A warning has its line of code below it, a traceback its error at the end."""
    warning = "x.py:3: RuntimeWarning: overflow in multiply\n  return a[..., NEXT] * b[..., LAST]\n"
    assert find_last_message(warning) == "x.py:3: RuntimeWarning: overflow in multiply"
    assert find_last_message("Traceback:\n  File x\n    y\nValueError: no\n") == "ValueError: no"
    assert find_last_message("  indented alone") == "  indented alone"


SUITE = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "raises"]\n'
BOUND = """schema = 2
suite = "small"
[[status]]
case = "free_fall raises dt=0.5"
status = "crashed"
reason = "it always raises"
[problem.free_fall.bounds."exact dt=0.5"]
energy_drift_max_J = { value = 0.0, upper = 1e-10, reason = "exact" }
"""


@pytest.mark.sampled(0)
def test_run_show_and_gate(here, tmp_path, capsys, monkeypatch):
    """A run, its table, its machine-readable form, and the gate on it: open, then closed by a bound."""
    (tmp_path / "small.toml").write_text(SUITE)
    (tmp_path / "bounds.toml").write_text(BOUND)
    done = here("run", "small.toml", *WITH, "--out", "out")
    assert done.returncode == 0, done.stderr
    assert re.match(r"2 runs, \d+ at a time: about \d+ .*; results in out\n", done.stderr)  # before anything is run
    assert (
        "[2/2]" in done.stderr
        and "[2/2]" not in done.stdout
        and "1 success" in done.stdout
        and "1 crashed" in done.stdout
    )

    def said(*arguments, code=0):
        assert main(list(arguments)) == code
        out, err = capsys.readouterr()
        assert not err or (code == 1 and "mend what moved" in err)  # a closed gate says what to do
        return out

    assert "a bug of mine" in said("show", "out")
    assert [json.loads(line)["status"] for line in said("show", "out", "--json").splitlines()] == ["success", "crashed"]
    judge = ("gate", "--suite", "small.toml", *WITH, "--results", "out", "--thresholds", "bounds.toml")
    assert "gate CLOSED: 6 FAIL" in said(*judge, code=1)  # one bound is not all of them
    (tmp_path / "bounds.toml").write_text(BOUND.replace("1e-10", "-1.0"))
    closed = said(*judge, "--junit", "gate.xml", "--markdown", "gate.md", code=1)
    assert "failure" in (tmp_path / "gate.xml").read_text() and "CLOSED" in (tmp_path / "gate.md").read_text()
    assert "FAIL" in closed and "CLOSED" in closed
    (row, *_) = [json.loads(x) for x in (tmp_path / "results/local/history/out.jsonl").read_text().splitlines()]
    assert row["solver"] == "exact" and row["gate"] == "FAIL" and row["energy_drift_max_J"] < 1e-10
    plain = json.loads(said(*judge, "--json", code=1))
    assert not plain["open"] and plain["counts"]["FAIL"] == sum(f["state"] == "FAIL" for f in plain["findings"]) > 0
    assert "position_error_max_m" in said(*judge, "--update")
    (tmp_path / "bounds.toml").write_text("# why\n" + BOUND)
    assert "comments were removed" in said(*judge, "--update", "--write")
    assert "gate open" in said(*judge)
    monkeypatch.setattr("mbsbench.cli.gate.codes.digest_run_code", lambda *_, **__: "other")
    assert "result of other code" in said(*judge, "--json", code=1) and "gate open" in said(*judge, "--any-code")
    assert not [
        x for x in said(*judge, "--update").splitlines() if x[:1] == "+" and "exact" in x
    ]  # nor is it proposed from
    next((tmp_path / "out" / "runs").glob("*.json")).write_text("{")
    assert main([*judge, "--any-code"]) == 2  # that one may have failed, and a success of other code would hide it
    assert capsys.readouterr().err.startswith("error: 1 file cannot be judged: ")


def test_an_old_verdict_does_not_outlive_a_gate_that_came_to_none(tmp_path, capsys, monkeypatch):
    """Runs that cannot be run, a gate interrupted: files for CI say that it is not finished."""
    from mbsbench.harness.run.pool import PoolError

    monkeypatch.chdir(tmp_path)
    (tmp_path / "bounds.toml").write_text(BOUND)
    (tmp_path / "small.toml").write_text(SUITE)
    line = ["gate", "--suite", "small.toml", *WITH, "--thresholds", "bounds.toml"]
    for error, code, words in ((PoolError("gone"), 1, "gone"), (KeyboardInterrupt(), 130, "nothing was judged")):
        for name in ("gate.xml", "gate.md"):
            (tmp_path / name).write_text('failures="0"')

        def ended(*_, error=error, **__):
            raise error

        monkeypatch.setattr("mbsbench.cli.gate.run_watched", ended)
        assert main([*line, "--junit", "gate.xml", "--markdown", "gate.md"]) == code
        assert words in capsys.readouterr().err
        assert (
            'failures="1"' in (tmp_path / "gate.xml").read_text()
            and "not finished" in (tmp_path / "gate.md").read_text()
        )


@pytest.mark.sampled(0)
def test_files_that_cannot_be_used_are_reported_in_one_line(tmp_path, capsys, monkeypatch):
    """Names too long, a file where a folder must be, a folder where a file must be, lists in lists without end."""
    monkeypatch.chdir(tmp_path)
    long, deep = "x" * 300, tmp_path / "deep"
    deep.write_text("[" * 100_000)
    (tmp_path / "deep.jsonl").write_text("[" * 100_000)
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "runs").write_text("")
    (tmp_path / "b" / "runs").mkdir(parents=True)
    (tmp_path / "b" / ".lock").mkdir()
    (tmp_path / "c" / "runs").mkdir(parents=True)
    (tmp_path / "s.toml").write_text(f'name = "s"\nplugins = ["{PLUGIN}"]\n' + SUITE)
    for line in (
        ["show", long],
        ["run", "s.toml", "--out", long],
        ["gate", "--thresholds", long],
        ["judge", long],
        ["run", "s.toml", "--out", "a"],
        ["run", "s.toml", "--out", "b"],
        ["merge", "b", "c"],
        ["history", "deep.jsonl"],
        ["gate", "--thresholds", "deep"],
        ["judge", "c", "--claims", "deep"],
        ["diff", "c", "c"],
    ):
        assert main(line) == 2, line
        out, err = capsys.readouterr()
        assert err.startswith("error: ") and err.count("\n") == 1 and not out, line


def test_environment_and_suite_are_kept(here, tmp_path):
    (tmp_path / "small.toml").write_text(SUITE)
    here("run", "small.toml", *WITH, "--out", "out", "--limit", "1")
    stamp = json.loads((tmp_path / "out" / "environment.json").read_text())
    assert stamp["packages"]["numpy"] and stamp["code"] and stamp["threads"]["OMP_NUM_THREADS"] == "1"
    assert all(b["num_threads"] == 1 for b in stamp["blas"])
    assert (tmp_path / "out" / "suite.toml").read_text() == SUITE
    assert (ROOT / "locks" / "requirements.lock").exists()

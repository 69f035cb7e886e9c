"""A law that changes measures finished runs again: no number of a motion or a cost moves, those of the law do."""

import importlib
import json
import shutil
from contextlib import nullcontext
from dataclasses import replace

import msgspec
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import codes
from mbsbench.harness.results import environment, store
from mbsbench.harness.results.comparison import METRICS
from mbsbench.harness.run import remeasure
from mbsbench.harness.run.started_runs import StartedRuns
from mbsbench.tests.covering import few
from mbsbench.tests.factories import PLUGIN, run_suite_text

command_module = importlib.import_module("mbsbench.cli.remeasure")

TEXT = """
[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.2 }
solver = "gc_weak_form"
dt = [0.001, 0.02]
repeats = 3
[[runs]]
problem = "free_fall"
solver = ["exact", "raises", "refuses", "gives_up"]
"""
STRICTER = """
import os
from dataclasses import dataclass
from typing import ClassVar
from mbsbench import Problem, StepControl, Trajectory, solver
from mbsbench.harness.judge import law

if os.environ.get("STRICTER"):
    law.START = -1.0  # the law that changes, wherever this is loaded: no start is near enough


@solver("none")
@dataclass(frozen=True)
class Unused:
    \"\"\"Solves nothing.\"\"\"

    control: ClassVar[str] = "dt"
    paper_label: ClassVar[str] = ""

    def refuses(self, problem: Problem, control: StepControl) -> None:
        return None

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        raise NotImplementedError
"""


@pytest.fixture(scope="module")
def strict(tmp_path_factory):
    """A plugin with the law that changes: where runs are measured it is loaded, too."""
    path = tmp_path_factory.mktemp("strict") / "strict.py"
    path.write_text(STRICTER)
    return path


@pytest.fixture
def other_code(monkeypatch):
    """What measures has another digest; solvers, problems and clocks are as they were, and so are addresses of runs."""

    def change():
        other = msgspec.structs.replace(codes.read_column_digests(), measuring="another law")
        monkeypatch.setattr(codes, "read_column_digests", lambda: other)
        monkeypatch.setattr(remeasure, "provide_commit_folders", lambda: nullcontext(lambda commit: codes.ROOT))
        monkeypatch.setenv("STRICTER", "1")

    return change


def read(folder):
    return {r.case: r for r in store.load(folder).records}


def command(folder, *plugins):
    return ["remeasure", str(folder), *(w for p in plugins for w in ("--plugin", str(p))), "--jobs", "1"]


HOW = [(how, again) for how in ("lossless", "every row", "brief") for again in (False, True)]


@pytest.mark.sampled(0)
@pytest.mark.parametrize(("how", "again"), few(HOW, lambda case: case[1] is (case[0] == "brief")))
def test_a_law_that_changes_needs_no_new_motion(tmp_path, strict, other_code, how, again):
    """Numbers, costs and files are those of before; the status is that of the law; a suite finds all of it done."""
    folder, plugins = tmp_path / "run", (PLUGIN, strict)
    keep = (lambda spec: ("energy_error",)) if how == "brief" else None
    run_suite_text(folder, TEXT, 1, lossless=how == "lossless", choose_rows=keep, plugins=plugins)
    before = read(folder)
    assert {r.status for r in before.values()} >= {"success", "crashed", "refused", "step_underflow"}
    other_code()
    StartedRuns(folder).begin(r.run_id for r in before.values())  # as a runner leaves it that is killed
    assert main(command(folder, *plugins)) == 0
    after = read(folder)
    assert after.keys() == before.keys()
    for case, old in before.items():
        new = after[case]
        assert (new.run_id, new.code, new.finished) == (old.run_id, old.code, old.finished)
        assert new.measured_by == codes.read_column_digests().digest != old.measured_by
        same = [m for m in METRICS if m not in ("series_rows",)]
        assert all(repr(getattr(new, m)) == repr(getattr(old, m)) for m in (*same, *remeasure.KEPT)), case
        assert new.status == ("wrong" if case.startswith("free_fall exact") else old.status)
        assert any("measured again by code" in words for words in json.loads(new.notes))
        assert bool(new.series) == bool(old.series) and new.stderr.startswith("stderr/") == bool(old.stderr)
        if old.series:
            assert (folder / "set_aside" / old.series.removeprefix("series/")).is_file()
            assert store.read_run_series(folder, new).is_brief == (how == "brief")
    if not again:
        return
    assert main(command(folder, *plugins)) == 0  # nothing is left to do
    _, watcher = run_suite_text(
        folder, TEXT, 1, lossless=how == "lossless", choose_rows=keep, resume=True, plugins=plugins
    )
    assert watcher.ran == [] and watcher.set_aside == []


@pytest.mark.sampled(0)
def test_a_motion_with_other_bits_is_left_as_it_is(tmp_path, monkeypatch, other_code, capsys):
    """It is named; the others are measured again."""
    folder = tmp_path / "run"
    run_suite_text(folder, TEXT, 1)
    before = read(folder)
    other_code()
    honest = remeasure.limit_steps

    def another(spec, record):
        spec = honest(spec, record)
        return spec if record.dt_s != 0.02 else remeasure.dataclasses.replace(spec, options={"tolerance": 1e-4})

    monkeypatch.setattr(remeasure, "limit_steps", another)
    assert main(command(folder, PLUGIN)) == 1
    said = capsys.readouterr().out
    assert "5 runs measured again, 0 were of this code" in said and "its steps are not the same bit for bit" in said
    after = read(folder)
    (left,) = [case for case, r in after.items() if r.measured_by == before[case].measured_by]
    assert "dt=0.02" in left and repr(vars(after[left])) == repr(vars(before[left]))


SHORT = '[[runs]]\nproblem = "heavy_top"\nparameters = { t_end = 0.1 }\nsolver = "gc_weak_form"\ndt = [0.001, 0.002]\n'


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of that suite, made without plugins."""
    folder = tmp_path_factory.mktemp("made") / "run"
    run_suite_text(folder, SHORT, 1, plugins=())
    return folder


@pytest.mark.parametrize("what", ["solvers", "problems", "costs", "plugins", "commit"])
def test_what_is_more_than_a_law_is_run_again(tmp_path, made, monkeypatch, other_code, capsys, what):
    """Another solver, problem or clock has another cost; without the run's plugins its code is another."""
    folder = tmp_path / "run"
    if what == "plugins":
        run_suite_text(folder, SHORT, 1, plugins=(PLUGIN,))
    else:
        shutil.copytree(made, folder)
    before = {p.name: p.read_bytes() for p in (folder / "runs").iterdir()}
    other_code()
    here, part = codes.list_run_digests, PARTS.get(what)
    another = {part: "another"} if part else {}
    monkeypatch.setattr(codes, "list_run_digests", lambda *a: {**here(*a[:2]), **(another if a[2:] else {})})
    if what == "commit":
        monkeypatch.undo()
        monkeypatch.setattr(command_module, "find_outdated", lambda records, plugins: list(records))
        monkeypatch.setattr(store, "select_newest", lambda records: [replace(r, commit="0" * 40) for r in records])
    else:
        monkeypatch.setattr(remeasure, "provide_commit_folders", lambda: nullcontext(lambda commit: codes.ROOT))
    assert main(command(folder)) == 1
    said = capsys.readouterr().out
    assert "0 runs measured again" in said and WORDS[what] in said
    assert {p.name: p.read_bytes() for p in (folder / "runs").iterdir()} == before


PARTS = {"solvers": "its solver", "problems": "its problem", "costs": "what runs it and counts its cost"}
WORDS = {
    "solvers": "the code of its solver has changed",
    "problems": "the code of its problem has changed",
    "costs": "the code of what runs it and counts its cost has changed",
    "plugins": "it was made with --plugin misbehaving.py",
    "commit": "of its code is not in this repository",
}


@pytest.mark.sampled(0)
def test_an_interruption_keeps_what_is_done(tmp_path, made, monkeypatch, other_code):
    """Runs are replaced some at a time; the others are measured the next time."""
    folder = shutil.copytree(made, tmp_path / "run")
    other_code()
    monkeypatch.setattr(remeasure, "AT_ONCE", 1)
    solve, calls = command_module.run_watched, []

    def once(*a, **k):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return solve(*a, **k)

    monkeypatch.setattr(command_module, "run_watched", once)
    here = codes.read_column_digests().digest
    assert main(command(folder)) != 0
    assert [r.measured_by == here for r in read(folder).values()].count(False) == 1
    assert main(command(folder)) == 0
    assert {r.measured_by for r in read(folder).values()} == {here}


def test_the_code_of_a_commit_is_read_once(tmp_path):
    """Its digests are those of its files; an unknown commit is refused in words."""
    with remeasure.provide_commit_folders() as folder_of:
        head = environment.read_commit().removesuffix("+dirty")
        then = folder_of(head)
        assert then is folder_of(head) and then != codes.ROOT
        assert all(codes.list_run_digests("heavy_top", "rattle", then).values())
        for commit in ("", "1" * 40, f"{head}+dirty", "HEAD", f"--output={tmp_path}/written", "../outside"):
            with pytest.raises(ValueError, match="run its suite again"):
                folder_of(commit)
            assert environment.list_changed_files(commit, head) == []
    assert not list(tmp_path.iterdir())  # what a results folder says is no option of git

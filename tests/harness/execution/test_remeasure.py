"""A law that changes measures finished runs again: no number of a motion or a cost moves, those of the law do."""

import json

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.execution import remeasure
from mbsbench.harness.results import codes, store
from mbsbench.harness.results.comparison import METRICS

from ..conftest import PLUGIN, run_in

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
from dataclasses import dataclass
from typing import ClassVar
from mbsbench import Problem, StepControl, Trajectory, solver
from mbsbench.harness.metrics import verdict

verdict.START = -1.0  # the law that changes, wherever this is loaded: no start is near enough


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
    """The code is another: all that is measured has another digest."""

    def change():
        whole = codes.code_of
        monkeypatch.setattr(codes, "code_of", lambda *a, **k: whole(*a, **k)[::-1])

    return change


def read(folder):
    return {r.case: r for r in store.load(folder).records}


@pytest.mark.parametrize("how", ["lossless", "every row", "brief"])
def test_a_law_that_changes_needs_no_new_motion(tmp_path, strict, other_code, how):
    """Numbers, costs and files are those of before; the status is that of the law; a suite finds all of it done."""
    folder = tmp_path / "run"
    keep = (lambda spec: ("energy_error",)) if how == "brief" else None
    run_in(folder, TEXT, 1, lossless=how == "lossless", keep=keep)
    before = read(folder)
    assert {r.status for r in before.values()} >= {"success", "crashed", "refused", "step_underflow"}
    other_code()
    line = ["remeasure", str(folder), "--plugin", str(PLUGIN), "--plugin", str(strict), "--jobs", "1"]
    assert main(line) == 0
    after = read(folder)
    assert after.keys() == before.keys()
    for case, old in before.items():
        new = after[case]
        assert new.run_id != old.run_id and new.code != old.code and new.finished == old.finished
        same = [m for m in METRICS if m not in ("series_rows",)]
        assert all(repr(getattr(new, m)) == repr(getattr(old, m)) for m in (*same, *remeasure.KEPT)), case
        assert new.status == ("wrong" if case.startswith("free_fall exact") else old.status)
        assert any("measured again by code" in words for words in json.loads(new.notes))
        assert bool(new.series) == bool(old.series) and new.stderr.startswith("stderr/") == bool(old.stderr)
        if old.series:
            assert not (folder / old.series).exists()
            assert store.series_of(folder, new).is_brief == (how == "brief")
    assert main(line) == 0  # nothing is left to do
    _, watcher = run_in(folder, TEXT, 1, lossless=how == "lossless", keep=keep, resume=True,
                        plugins=(PLUGIN, strict))  # fmt: skip
    assert watcher.ran == []


def test_a_motion_with_other_bits_is_left_as_it_is(tmp_path, monkeypatch, other_code, capsys):
    """It is named; the others are measured again."""
    folder = tmp_path / "run"
    run_in(folder, TEXT, 1)
    before = read(folder)
    other_code()
    honest = remeasure.limit_steps

    def another(spec, record):
        spec = honest(spec, record)
        return spec if record.dt_s != 0.02 else remeasure.dataclasses.replace(spec, options={"tolerance": 1e-4})

    monkeypatch.setattr(remeasure, "limit_steps", another)
    assert main(["remeasure", str(folder), "--plugin", str(PLUGIN), "--jobs", "1"]) == 1
    said = capsys.readouterr().out
    assert "5 runs measured again, 0 were of this code" in said and "its steps have other bits" in said
    after = read(folder)
    (left,) = [case for case, r in after.items() if r.code == before[case].code]
    assert "dt=0.02" in left and repr(vars(after[left])) == repr(vars(before[left]))

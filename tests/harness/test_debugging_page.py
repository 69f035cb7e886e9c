"""docs/debugging.md: its examples run on a results folder, the last one without mbsbench."""

import re
import subprocess
import sys

import pytest

from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import run_suite_text

PAGE = (ROOT / "docs" / "debugging.md").read_text(encoding="utf-8")
AGAIN, PLAIN, READ = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
SUITE = """
[[runs]]
problem = "spherical_pendulum"
solver = "rk45_strong_form"
rtol = 1e-5
parameters = { t_end = 0.1 }
"""


@pytest.mark.parametrize("keep", [None, lambda spec: ("energy_error",)], ids=["every step", "brief"])
def test_results_are_read_by_numpy_alone_and_solved_again_here(tmp_path, keep, monkeypatch, capsys):
    """The numbers are those of the record; the same run in this process has the same bits."""
    folder = tmp_path / "results" / "local" / "latest"
    loaded, _ = run_suite_text(folder, SUITE, choose_rows=keep)
    (record,) = loaded.records
    assert record.series.endswith(".npz" if keep is None else ".npz.xz")
    code = f"{READ}\nimport sys; assert 'mbsbench' not in sys.modules"
    done = subprocess.run((sys.executable, "-c", code), cwd=tmp_path, capture_output=True, text=True, check=True)
    first, second = done.stdout.splitlines()
    assert first == f"{record.case} success {record.energy_drift_max_J}"
    assert second.split()[-2:] == [str(record.t_reached_s), str(record.energy_drift_end_J)]
    monkeypatch.chdir(tmp_path)
    shown = {}
    exec(AGAIN.replace('"latest"', repr(str(folder))), shown)
    assert shown["run"].record.energy_drift_end_J == record.energy_drift_end_J
    assert "success" in capsys.readouterr().out


def test_a_method_is_followed_in_plain_python(capsys):
    exec(PLAIN, {})
    assert "code=plain" in capsys.readouterr().out

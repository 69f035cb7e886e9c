"""A small run of real solvers becomes a report by the command line's own path."""

from mbsbench.cli.__main__ import main
from mbsbench.harness.execution.runner import Request, run_suite
from mbsbench.harness.suites.suite import parse_suite

from ..harness.conftest import Silent

SUITE = """
name = "tiny"
[[runs]]
label = "recommended"
problem = "spherical_pendulum"
parameters = { t_end = 0.3 }
solver = "gc_weak_form"
dt = [0.02, 0.01]
"""


def test_real_run_has_a_report(tmp_path, capsys):
    """Run, then ``report``: every run has its page, with plots, tables and its command."""
    folder = tmp_path / "run"
    loaded = run_suite(Request(parse_suite(SUITE, "tiny", "here"), folder, 1), Silent())
    assert main(["report", str(folder)]) == 0
    assert "index.html" in capsys.readouterr().out
    report = folder / "report"
    assert len(loaded.records) == 2
    for r in loaded.records:
        assert "mbsbench solve spherical_pendulum" in (report / "runs" / f"{r.run_id}.html").read_text("utf-8")
    problem = next(report.glob("problem-*.html")).read_text(encoding="utf-8")
    assert "observed order" not in problem and 'data-plot="energy"' in problem
    assert list((report / "tables").glob("*.csv")) and list((report / "data").glob("plots-problem-*.js"))

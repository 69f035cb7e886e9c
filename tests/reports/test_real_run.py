"""A small run of real solvers becomes a report by the command line's own path."""

from mbsbench.cli.__main__ import main
from mbsbench.harness.execution.runner import Request, run_suite
from mbsbench.harness.suites.suite import parse_suite

SUITE = """
name = "tiny"
[[runs]]
label = "recommended"
problem = "spherical_pendulum"
parameters = { t_end = 0.3 }
solver = "gc_weak_form"
dt = [0.02, 0.01]
"""


class Quiet:
    """Watches nothing."""

    def __getattr__(self, name):
        return lambda *a, **k: None


def test_real_run_has_a_report(tmp_path, capsys):
    """Run, then ``report``: every run has its page, with plots, tables and its command."""
    folder = tmp_path / "run"
    loaded = run_suite(Request(parse_suite(SUITE, "tiny", "here"), folder, 1), Quiet())
    assert main(["report", str(folder)]) == 0
    assert "index.html" in capsys.readouterr().out
    report = folder / "report"
    assert len(loaded.records) == 2
    for r in loaded.records:
        assert "mbsbench solve spherical_pendulum" in (report / "runs" / f"{r.run_id}.html").read_text("utf-8")
    problem = next(report.glob("problem-*.html")).read_text(encoding="utf-8")
    assert "observed order" not in problem and 'data-plot="energy"' in problem
    assert list((report / "tables").glob("*.csv")) and list((report / "data").glob("plots-problem-*.js"))


def test_wrong_calls_are_reported_in_one_line(tmp_path, capsys):
    """No folder, three folders, a place to write that no single report has."""
    (tmp_path / "runs").mkdir()
    for words, said in (
        (["report", str(tmp_path / "nowhere")], "nowhere"),
        (["report", "a", "b", "c"], "two to compare (got 3)"),
        (["report", str(tmp_path), "--out", "x"], "--out needs two results folders"),
    ):
        assert main(words) == 2
        complaint = capsys.readouterr().err
        assert said in complaint and "Traceback" not in complaint

"""A small run of real solvers becomes a report by the command line's own path."""

from harness.__main__ import main
from harness.runner import Request, run_suite
from harness.suites import parse_suite

SUITE = """
name = "tiny"
[[cells]]
label = "soundest"
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
    """Run, then ``report``: every cell is on the page, figures and tables are files."""
    folder = tmp_path / "run"
    loaded = run_suite(Request(parse_suite(SUITE, "tiny", "here"), folder, 1), Quiet())
    assert main(["report", str(folder)]) == 0
    assert "index.html" in capsys.readouterr().out
    html = (folder / "report" / "index.html").read_text(encoding="utf-8")
    assert len(loaded.records) == 2
    for r in loaded.records:
        assert f'id="cell-{r.cell}"' in html
    assert "observed order" in html
    for suffix in (".svg", ".png"):
        assert list((folder / "report" / "figures").glob(f"*laws{suffix}"))
    assert list((folder / "report" / "tables").glob("*.csv"))

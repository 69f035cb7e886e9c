"""Before the first run: each solver is said as soon as it is compiled, each reference as soon as it is computed."""

import re

from rich.console import Console

from mbsbench.cli.progress import ProgressDisplay
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.run.runner import Request, run_suite
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import Silent

TEXT = """
[[runs]]
problem = "spherical_pendulum"
parameters = { t_end = 0.1 }
solver = ["rk45_strong_form", "scipy_strong_form"]
rtol = 1e-3
"""


class Listening(Silent):
    """Remembers all news in their order."""

    def __init__(self) -> None:
        super().__init__()
        self.news: list[str] = []

    def on_warmup(self, times, references):
        assert_each([*times.values(), *references.values()], ">", 0.0, "seconds")
        self.news += [*times, *references]

    def on_start(self, job):
        self.news.append("run")


def test_each_solver_is_news_of_its_own_before_the_first_run(tmp_path):
    """Two minutes of compilation show where they are."""
    watcher = Listening()
    run_suite(Request(parse_suite(TEXT, "test", "test"), tmp_path / "results", 2), watcher)
    *prepared, first, second = watcher.news
    assert first == second == "run"
    assert sorted(prepared) == ["rk45_strong_form", "scipy_strong_form", "spherical_pendulum[t_end=0.1]"]


def test_a_line_for_what_took_its_time(tmp_path):
    """Code from the cache is not mentioned."""
    console = Console(record=True, width=100)
    watch = ProgressDisplay(console, None)
    watch.on_warmup({}, {"chain": 58.0, "heavy_top": 0.1})
    watch.on_warmup({"rattle": 40.4}, {})
    watch.on_warmup({"gc_weak_form": 0.2}, {})
    lines = console.export_text().splitlines()
    assert [re.sub(r",.*:", ":", line) for line in lines] == [
        "reference computed in 58 s: chain",
        "compiled in 40 s: rattle",
    ]

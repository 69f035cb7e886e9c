"""A suite in two passes: the first has a part of its runs, the second the rest, and the pages say which they are of."""

import json
import shutil
import subprocess
from pathlib import Path

import pandas as pd
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import write_text
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.reports import site
from mbsbench.tests.factories import make_measured_record

from .conftest import put

FIRST = """
[[runs]]
label = "recommended"
problem = "spherical_pendulum"
parameters = { t_end = 0.3 }
solver = "gc_weak_form"
dt = [0.02, 0.01]
"""
WHOLE = 'include = ["part"]\n' + FIRST.replace("recommended", "work").replace("[0.02, 0.01]", "[0.02, 0.005]")


def written_of(page: Path) -> str:
    return (page.parent / "data" / "written.js").read_text(encoding="utf-8").split(" = ")[1].strip("; \n")


@pytest.mark.sampled(0)
def test_the_first_pass_runs_its_part_and_the_second_the_rest_once(tmp_path, capsys):
    """The pages of the first say what is to come, those of the second do not; no run is made twice."""
    write_text(tmp_path / "part.toml", FIRST)
    write_text(tmp_path / "whole.toml", WHOLE)
    run = ["run", str(tmp_path / "whole.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    folder, page = tmp_path / "out", tmp_path / "out" / "report" / "index.html"

    assert main([*run, "--only", "part"]) == 0
    assert "whole: 3 runs, 1 at a time: about" in capsys.readouterr().err
    first = {r.dt_s: r.finished for r in store.load(folder).records}
    assert sorted(first) == [0.01, 0.02]
    assert main(["report", str(folder)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "index.html 1 of 3 runs of the suite are still to come" in said
    for name in ("index.html", "runs.html"):
        assert "2 runs of the 3 of the suite whole are here, 1 to come:" in (page.parent / name).read_text("utf-8")
    assert written_of(page) == "2"

    assert main([*run, "--resume"]) == 0
    assert "2 already done" in capsys.readouterr().err
    assert not (folder / "judgement").exists()
    both = {r.dt_s: r.finished for r in store.load(folder).records}
    assert sorted(both) == [0.005, 0.01, 0.02] and both.items() >= first.items()
    assert main(["report", "--judge", str(folder)]) == 0
    assert "to come" not in capsys.readouterr().out
    assert {path.stem for path in (folder / "judgement").iterdir()} >= {"claims", "certificates", "drift"}
    assert "data-written" not in page.read_text(encoding="utf-8") and written_of(page) == "3"
    assert main([*run, "--only", "part", "--resume"]) == 0
    assert len(pd.read_parquet(folder / "runs.parquet")) == 3


def test_results_that_cannot_be_judged_get_no_report(tmp_path, capfd):
    """One line, that of ``judge``, and its exit code; without --judge the pages are written."""
    put(tmp_path, make_measured_record("aa01", "rattle", problem="heavy_top", code="of another version"))
    assert main(["report", "--judge", str(tmp_path)]) == 2
    assert [line.startswith("error: 1 runs in") for line in capfd.readouterr().err.splitlines()[-1:]] == [True]
    index = tmp_path / "report" / "index.html"
    assert not index.exists() and main(["report", str(tmp_path)]) == 0 and index.exists()
    assert main(["report", "--judge", str(tmp_path)]) == 2 and index.exists()  # the pages before stay


def test_only_names_a_suite_that_is_included(tmp_path, capsys):
    """Else one line, and no folder."""
    write_text(tmp_path / "part.toml", FIRST)
    write_text(tmp_path / "whole.toml", WHOLE)
    run = ["run", str(tmp_path / "whole.toml"), "--out", str(tmp_path / "out"), "--only"]
    assert main([*run, "prat"]) == 2
    assert "--only must be a suite that whole includes: part (got 'prat')" in capsys.readouterr().err
    assert main(["run", str(tmp_path / "part.toml"), "--only", "part"]) == 2
    assert "includes: none" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.skipif(shutil.which("make") is None, reason="no make on this machine")
def test_make_bench_judges_and_reports_both_passes():
    """Each pass is run, judged and reported before the next begins."""
    dry = subprocess.run(["make", "-n", "-C", str(ROOT), "bench"], capture_output=True, text=True, check=True).stdout
    calls = [line.partition("bin/mbsbench ")[2] for line in dry.splitlines()]
    words = [call.partition(" >")[0] for call in calls if call]
    suite = words[0].split()[1]
    assert suite in ("bench", "bench_engines")
    assert words == [f"run {suite} --only first", "report --judge", f"run {suite} --resume", "report --judge"]


def test_the_first_page_has_the_numbers_of_each_solver_on_each_problem(matrices):
    """Energy error, constraint and steps beside the status, under the heat map of the same runs."""
    html = matrices.read_text(encoding="utf-8")
    tables = html.partition('id="numbers"')[2].partition("</details>")[0]
    assert tables.count("<table") > 0
    assert tables.count("<table") == html.partition('<h2 id="heat"')[2].partition("<tbody>")[0].count("data-slug=")
    for head in ("max |E−E₀| [J]", "Error [m]", "max |φ| [m]", "Steps", "Status"):
        assert tables.count(f">{head}</th>") == tables.count("<table")


@pytest.mark.browser
def test_an_open_page_says_when_the_report_has_been_written_anew(browser, tmp_path):
    """From a disk, without a network: the page of the first pass offers to load that of the second."""
    write_text(tmp_path / "environment.json", json.dumps({"suite": "bench", "suite_runs": 2}))
    put(tmp_path, make_measured_record("aa01"))
    tab = browser.open(site.build_report(tmp_path))
    notice = "document.querySelector('[data-written]')"
    assert "1 run of the 2 of the suite bench is here, 1 to come:" in tab.evaluate(f"{notice}.textContent")
    put(tmp_path, make_measured_record("aa02", dt_s=0.005))
    site.build_report(tmp_path)
    tab.until(f"{notice}.textContent.includes('written anew, with 2 runs')")
    tab.evaluate(f"{notice}.querySelector('button').click()")
    tab.until(f"document.readyState === 'complete' && {notice} === null")
    assert [f for f in tab.faults if "data/written.js" not in f] == []  # which is asked for while it is replaced

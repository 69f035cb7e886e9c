"""A metric is one declaration: what the manual adds in one file is in the record and wherever runs are shown."""

import json
import math
import os
import re
import subprocess
import sys

import pytest

from mbsbench.harness.catalogue.codes import package_sources
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import copy_checkout

pytestmark = pytest.mark.beyond_core

PAGE = (ROOT / "docs" / "adding.md").read_text(encoding="utf-8").partition("\n## A metric\n")[2].partition("\n## ")[0]
FOLDERS = ("checker", "cli", "harness", "locks", "problems", "reports", "results", "solvers", "tests")

# run in the copy: two runs, of which the second has a record that is older than the column
SCRIPT = '''
import contextlib, csv, io, json, re, sys
from pathlib import Path

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.codes import package_sources
from mbsbench.harness.results import store
from mbsbench.harness.results.comparison import METRICS
from mbsbench.reports import site
from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.tables import format_as_csv
from mbsbench.tests.attacks.changes import RECORDS
from mbsbench.tests.factories import PLUGIN, specify_run, store_run

folder = Path(sys.argv[1])
registry.load_plugin(PLUGIN)
new, old = (store_run(folder, specify_run("free_fall", "exact", dt=dt)) for dt in (0.05, 0.1))
plain = json.loads(store.format_record(old))
assert plain.pop("path_longest_m") > 0.0
text = json.dumps(plain)
store.locate_record(folder, old.run_id).write(json.dumps({"sha256": store._digest(text), "record": text}))


def shown(*arguments):
    """Return what the command prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["show", str(folder), *arguments]) == 0
    return out.getvalue()


records = {r.dt_s: r for r in store.load(folder).records}
series = store.read_run_series(folder, new)
variant = read_results(folder).variants[0]
page = site.build_report(folder).parent
sources = package_sources()
frame = store.table(records.values()).set_index("dt_s")
json.dump({
    "column": [records[dt].path_longest_m for dt in (0.05, 0.1)],
    "frame": frame.path_longest_m.tolist(),
    "compared": "path_longest_m" in METRICS,
    "peak": series.peaks["path_longest_m"],
    "series": series["path_longest_m"].tolist(),
    "show": shown(new.run_id),
    "show older": shown(old.run_id),
    "sorted": shown("--sort", "path_longest"),
    "csv": list(csv.DictReader(io.StringIO(format_as_csv(variant.runs)))),
    "method": (page / "method.html").read_text(),
    "problem": (page / f"problem-{variant.slug}.html").read_text(),
    "all runs": (page / "runs.html").read_text(),
    "run": (page / "runs" / f"{new.run_id}.html").read_text(),
    "run older": (page / "runs" / f"{old.run_id}.html").read_text(),
    "attacks": RECORDS["path_longest_m"].undecided,
    "code": [sources.digest_run_code("chain", "rattle"), sources.measuring],
    "columns": sources.columns.columns,
}, open(sys.argv[2], "w"))
'''


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a copy of the package, in which one file is edited as the page says, makes and shows of two runs."""
    place = tmp_path_factory.mktemp("metric")
    copy_checkout(place / "mbsbench", lambda name: name.split("/")[0] in FOLDERS or "/" not in name)
    (name,) = re.findall(r"^Edit `([\w./]+)`:$", PAGE, re.MULTILINE)
    text = (place / "mbsbench" / name).read_text(encoding="utf-8")
    for change in re.findall(r"```diff\n(.*?)```", PAGE, re.DOTALL):
        old, new = ("".join(f"{k[1:]}\n" for k in change.splitlines() if k[0] in marks) for marks in (" -", " +"))
        assert text.count(old) == 1
        text = text.replace(old, new)
    (place / "mbsbench" / name).write_text(text, encoding="utf-8")
    call = (sys.executable, "-c", SCRIPT, str(place / "runs"), str(place / "found.json"))
    env = {**os.environ, "PYTHONPATH": str(place), "COLUMNS": "250", "NUMBA_OPT": "0"}  # the laws are compiled anew
    done = subprocess.run(call, cwd=place, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads((place / "found.json").read_text())


@pytest.mark.sampled(0)
def test_the_record_and_the_table_of_runs_have_it_and_an_older_record_has_none(found):
    """The length of the parabola of a throw: v = (1, -10 t) m/s over 2 s; 40 chords are shorter, by less than 1e-4."""
    new, old = found["column"]
    exact = [(u * math.sqrt(1.0 + u * u) + math.asinh(u)) / 20.0 for u in (0.0, 20.0)]
    assert 0.0 < (exact[1] - exact[0]) / new - 1.0 < 1e-4 and math.isnan(old)
    assert found["frame"][0] == new and found["frame"][1] != found["frame"][1]
    assert found["compared"] and found["attacks"] == "no run is judged or ranked by it"


def test_its_value_at_each_step_is_stored_and_the_step_of_the_largest_is_kept(found):
    along = found["series"]
    assert along[0] == 0.0 and along == sorted(along) and along[-1] == found["column"][0]
    assert found["peak"] > 0.0


def test_the_terminal_shows_and_sorts_by_it(found):
    """By its key, too; the table has it then, with a dash for the run that lacks it."""
    assert re.search(r"path_longest_m +\d.*length of the path of a centre of mass", found["show"])
    assert "path_longest_m" not in found["show older"]
    head, first, second = found["sorted"].splitlines()[:3]
    assert head.split()[-1] == "path_longest_m"
    assert "dt=0.05" in first and float(first.split()[-1]) == pytest.approx(found["column"][0], rel=1e-2)
    assert "dt=0.1" in second and second.split()[-1] == "-"


def test_csv_and_pages_have_it_and_a_dash_where_it_lacks(found):
    rows = {row["settings"]: row["path_longest [m]"] for row in found["csv"]}
    assert rows == {"dt = 0.05 s": repr(found["column"][0]), "dt = 0.1 s": ""}
    head = '<th scope="col" class="n">Longest path [m]</th>'
    assert head in found["problem"] and head in found["all runs"]
    table = found["problem"].partition(head)[2].partition("</table>")[0]
    cells = [re.findall(r'<td class="n" data-v="([^"]*)">([^<]*)<', row) for row in table.split("<tr ")[1:]]
    place = found["problem"].partition(head)[0].rpartition("<tr>")[2].count('class="n"')
    assert sorted(row[place][0] == "" for row in cells) == [False, True]
    assert sorted(row[place][1] == "–" for row in cells) == [False, True]
    assert "<dt>Longest path [m]<dd>Length of the path of a centre of mass over all steps" in found["method"]
    assert "<dt>Longest path [m]<dd>" in found["run"] and "Longest path" not in found["run older"]


def test_the_page_of_the_problem_draws_it_over_time(found):
    assert 'data-plot="path-longest"' in found["problem"]
    assert "Length of the path so far" in found["problem"]


def test_nothing_that_was_published_becomes_stale(found):
    """The code of motions, of what measures them and of all other columns is that of before."""
    here = package_sources()
    assert found["code"] == [here.digest_run_code("chain", "rattle"), here.measuring]
    added = found["columns"].pop("path_longest_m")
    assert found["columns"] == here.columns.columns and added not in here.columns.columns.values()

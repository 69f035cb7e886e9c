"""The pages on adding to this and on looking into a run do what they say; files are as many as they say."""

import os
import re
import subprocess
import sys
import tomllib

import pytest

from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.factories import copy_checkout

pytestmark = pytest.mark.beyond_core

ADDING = (ROOT / "docs" / "adding.md").read_text(encoding="utf-8")
FENCED = r"```\w+\n(.*?)```"
MAP = (ROOT / "docs" / "map.md").read_text(encoding="utf-8")
STEP = re.compile(r"^(Save as|Edit|Append to) `([\w./]+)`:$((?:\n+```\w+\n.*?```)+)", re.MULTILINE | re.DOTALL)


def read_sections():
    """The text under each heading of the page, by its title."""
    parts = re.split(r"^## (.+)\n", ADDING, flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


SECTIONS = read_sections()


def edit(text, change):
    """The text after a change as the page prints it: its old lines must be there once."""
    lines = change.splitlines()
    old = "".join(f"{line[1:]}\n" for line in lines if line[0] in " -")
    new = "".join(f"{line[1:]}\n" for line in lines if line[0] in " +")
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_the_map_has_every_room_and_no_other():
    """In the drawing, those of the harness between the two boxes' lines; layers as pyproject.toml has them."""
    drawing = re.findall(FENCED, MAP, re.DOTALL)[0]
    boxed = [line[7:34].split("|")[0].split() for line in drawing.splitlines() if re.match(r" +\|   [a-z]", line)]
    drawn = [name for names in boxed for name in names if not name.endswith("/")]
    harness = ROOT / "harness"
    rooms = {p.parent.name for p in harness.glob("*/__init__.py")}
    assert set(drawn) == rooms | {p.stem for p in harness.glob("*.py")} - {"__init__"}
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    contracts = tomllib.loads(text)["tool"]["importlinter"]["contracts"]
    layers = next(c["layers"] for c in contracts if c["type"] == "layers")
    places = {name.removeprefix("harness."): k for k, layer in enumerate(layers) for name in layer.split(" | ")}
    assert [places[name] for name in drawn] == sorted(places[name] for name in drawn)


def test_files_that_the_map_draws_exist():
    """Also those inside a drawing, where links are not checked."""
    named = set(re.findall(r"(?<![\w./])((?:cli|harness|reports|solvers|checker)/[\w/]+\.py)", MAP))
    assert len(named) > 25 and not [name for name in named if not (ROOT / name).is_file()]


def read_rows():
    """The files to write and to edit in each row of the map's table, by the first two words of the row."""
    table = MAP.partition("## Where things live")[2].partition("\n\nFolders")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if line.startswith("| a ")]
    titles = [" ".join(row[0].replace(",", "").split()[:2]).capitalize() for row in rows]
    files = [[re.findall(r"`([\w<>]+/[\w./<>]+)`", cell) for cell in row[1:3]] for row in rows]
    return dict(zip(titles, files, strict=True))


@pytest.mark.parametrize("title", SECTIONS)
def test_the_map_names_the_files_of_each_addition(title):
    """The examples write and edit what its table says; what else may be edited, the section names in words."""
    text, (write, edited) = SECTIONS[title], read_rows()[title]
    steps = [(what, name) for what, name, _ in STEP.findall(text)]
    patterns = [re.sub(r"<\w+>", r"\\w+", re.escape(name)) for name in write]
    saved = [name for what, name in steps if what == "Save as"]
    assert all(any(re.fullmatch(pattern, name) for pattern in patterns) for name in saved)
    assert saved or all(f"`{name}`" in text for name in write)
    changed = {name for what, name in steps if what != "Save as"}
    places = [re.sub(r"<\w+>", r"\\w+", re.escape(name)) for name in edited]
    assert all(any(re.fullmatch(place, name) for place in places) for name in changed)
    unedited = [k for k, place in enumerate(places) if not any(re.fullmatch(place, name) for name in changed)]
    assert all(f"`{edited[k]}`" in text for k in unedited)


def test_the_reason_in_kinds_toml_is_for_the_class_of_the_example():
    """docs/kinds.toml has one for each reader there is, and the page shows the line of its own."""
    text = SECTIONS["A format"]
    (shown,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (key,) = tomllib.loads(shown)
    saved, blocks = next((name, blocks) for what, name, blocks in STEP.findall(text) if what == "Save as")
    assert key == f"{saved} Document" and "\nclass Document:" in blocks
    known = tomllib.loads((ROOT / "docs" / "kinds.toml").read_text(encoding="utf-8"))["names that classes share"]
    assert key.replace("bobs", "usd") in known and '["names that classes share"]' in text


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package to which every example of the page has been added."""
    folder = tmp_path_factory.mktemp("copy") / "mbsbench"
    copy_checkout(folder, lambda name: not name.startswith("docs/"))
    for what, name, blocks in (step for section in SECTIONS.values() for step in STEP.findall(section)):
        path = folder / name
        for block in re.findall(FENCED, blocks, re.DOTALL):
            if what == "Save as":
                assert not path.exists()
                path.write_text(block)
            elif what == "Edit":
                path.write_text(edit(path.read_text(), block))
            else:
                path.write_text(f"{path.read_text()}\n{block}")
    return folder


def run_code(copy, code):
    """Run code with the copied package, in a process of its own; return what it prints."""
    env = {**os.environ, "PYTHONPATH": str(copy.parent), "NUMBA_OPT": "0"}  # the laws are compiled anew
    done = subprocess.run((sys.executable, "-c", code), cwd=copy.parent, env=env, capture_output=True, text=True)  # noqa: PLW1510
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("title", SECTIONS)
def test_an_addition_takes_as_many_files_as_are_said(title):
    """The table says the same; an example by itself counts as the one file it is in."""
    (said,) = re.findall(r"\*\*Files: (\d)\*?", SECTIONS[title])
    shown = len(STEP.findall(SECTIONS[title]))
    assert int(said) == max(shown, 1)
    (row,) = re.findall(rf"\| .*\[{title.lower()}\].* \| (\d)", ADDING)
    assert row == said


def test_each_is_a_screen():
    """Beside the code to copy."""
    for title, text in SECTIONS.items():
        assert len(re.sub(FENCED, "", text, flags=re.DOTALL).splitlines()) <= 40, title


@pytest.mark.sampled(0)
def test_the_solver_the_joint_and_the_force_move(copy):
    """Laws: free fall, the axis stays, a drag only takes energy; the solver has a digest of its code."""
    force = re.findall(FENCED, SECTIONS["A force"], re.DOTALL)[0]
    out = run_code(
        copy,
        f"""
{force}
from mbsbench import Joint, solve
from mbsbench.harness.catalogue.codes import package_sources
assert "rk23_strong_form" in package_sources().solvers
print(solve(thrown, "rk23_strong_form", rtol=1e-8).status)
axes = dict(axis_i=(0.0, 0.0, 1.0), axis_j=(0.0, 0.0, 1.0))
body = RigidBody(1.0, np.diag([0.1, 0.2, 0.3]))
system = assemble([body], [Joint(0, (0.0, 0.0, 0.0), kind="parallel axes", **axes)], gravity=(0.0, 0.0, -9.81))
start = State(np.zeros((1, 3)), np.eye(3)[None], np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 0.0, 2.0]]))
slides = Problem("slides", system, start, t_end=0.3, dt=0.01, section="", source="it falls and turns")
run = solve(slides, "rk23_strong_form", rtol=1e-8)
last = run.trajectory.states[-1]
print(run.status, np.allclose(last.r[0], [0.3, 0.0, -0.5 * 9.81 * 0.09]), np.allclose(last.R[0][:, 2], [0, 0, 1]))
path = np.linalg.norm(np.diff(run.trajectory.states.r[:, 0], axis=0), axis=1).sum()
print(abs(run.record.path_longest_m - path) < 1e-12)
""",
    )
    assert out.split() == ["success", "success", "True", "True", "True"]


def test_the_format_is_read_and_refused_in_a_line(copy):
    (copy.parent / "two.bobs").write_text("1 1 30\n2 0.5 60\n")
    (copy.parent / "bad.bobs").write_text("1 1 30\n2 x 60\n")
    out = run_code(
        copy,
        """
from mbsbench import constraint, make_problem, States
two = make_problem("two.bobs")
print(two.system.nb, abs(constraint(two.system, States.one(two.initial))).max() < 1e-12)
try:
    make_problem("bad.bobs")
except ValueError as error:
    print(str(error).partition(": ")[2])
""",
    )
    assert out.splitlines()[0] == "2 True" and "line 2: expected mass, length and angle" in out


def test_the_claim_and_the_column_are_known(copy):
    """The claim is read with its map; the column has its row in the table of changes."""
    out = run_code(
        copy,
        """
from mbsbench.harness.judge.referee.claims.register import read_register
from mbsbench.harness.results.records import COLUMNS
(claim,) = [c for c in read_register().claims if c.id == "11-gc-whole-run"]
print(claim.map.name)
from mbsbench.tests.attacks.changes import RECORDS
print({c.name for c in COLUMNS} == set(RECORDS))
from mbsbench.reports.model.columns import COLUMNS as SHOWN
(shown,) = [c for c in SHOWN if c.key == "path_longest"]
print(shown.heading)
""",
    )
    assert out.splitlines() == ["top-gc", "True", "Longest path [m]"]


def test_the_page_is_written(copy, tmp_path):
    """From a record that was stored, with its link."""
    out = run_code(
        copy,
        f"""
from pathlib import Path
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord
from mbsbench.reports import site
folder = store.create_folder(Path({str(tmp_path)!r}))
given = dict(problem="heavy_top", solver="a", status="success", cpu_median_s=0.5)
store.write_record(folder, RunRecord("ab12", "ab12", "heavy_top a", **given))
print((site.build_report(folder).parent / "slowest.html").read_text())
""",
    )
    assert "heavy_top a</a>: 0.5 s" in out

"""Results folders with links out of them: every command refuses in one line, and nothing outside is changed or shown.

Each of these was followed once: 66 files of another folder were overwritten, and a link to /dev/zero filled the memory.
"""

import ast
import os
import shutil
import socket
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.confined_paths import ConfinedPath, UnsafeFile, confine_path
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.tests.covering import diagonal
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import every_kind, put

SUITE = """name = "t"
[defaults]
cpu_limit = 10.0
[[runs]]
problem = "simple_pendulum"
solver = "gc_weak_form"
dt = 0.1
"""
TOP = ("runs", "series", "stderr", "report", "judgement", "set_aside", ".spool")
IN_REPORT = ("report/runs", "report/tables", "report/data", "report/assets", "report/figures")
FILES = ("environment.json", "suite.toml", ".lock", "runs.parquet")
COMMANDS = {
    "report": ("report", "A"),
    "compare": ("report", "B", "A"),
    "judge": ("judge", "A", "--partial"),
    "resume": ("run", "suite.toml", "--resume", "--jobs", "1", "--out", "A"),
    "diff": ("diff", "A", "B"),
    "history": ("history", "A"),
    "show": ("show", "A"),
    "figures": ("figures", "A"),
    "merge": ("merge", "C", "A"),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """A folder with results of every kind."""
    folder = tmp_path_factory.mktemp("every-kind")
    every_kind(folder)
    (folder / "environment.json").write_text('{"suite": "t"}')
    return folder


@pytest.fixture
def folders(results, tmp_path, monkeypatch):
    """``A`` and ``B`` with results, ``outside`` with files of somebody else, named as a report names its own."""
    monkeypatch.chdir(tmp_path)
    for name in ("A", "B"):
        shutil.copytree(results, tmp_path / name)
    (tmp_path / "suite.toml").write_text(SUITE)
    outside = tmp_path / "outside"
    outside.mkdir()
    for name in ("index.html", "claims.json", "history.csv", "site.js", "thesis.txt", "aa01.json", "pendulum.csv"):
        (outside / name).write_text("secret words")
    return tmp_path


def content(folder: Path) -> dict[str, tuple[bytes, int]]:
    """All files with their content and time, links as they are."""
    return {str(p): (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file()}


def put_link(place: Path, target: Path) -> None:
    """A link in place of what is there, which is kept beside."""
    place.parent.mkdir(parents=True, exist_ok=True)
    if place.exists():
        place.rename(place.with_name(place.name + ".before"))
    place.symlink_to(target)


def refused(arguments, capsys, place: str) -> None:
    """Exit code 2, and a last line that names the place and what it is."""
    assert main(list(arguments)) == 2
    said = capsys.readouterr()
    *before, line = said.err.splitlines()
    assert not any("error" in words for words in before)  # what the command would do, and how long
    assert place in line and "it is a link" in line, line
    assert "secret" not in said.out + said.err


@pytest.mark.parametrize(("command", "place"), diagonal(list(COMMANDS), TOP + FILES))
def test_a_link_in_a_results_folder_is_refused(folders, capsys, place, command):
    """By every command that reads or writes there, before it has changed anything inside or outside."""
    outside = folders / "outside"
    put_link(folders / "A" / place, outside / "thesis.txt" if place in FILES else outside)
    before = content(outside), content(folders / "A")
    refused(COMMANDS[command], capsys, f"A/{place}")
    assert (content(outside), content(folders / "A")) == before


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", ["pipe", "socket"])
def test_what_is_no_file_is_refused(folders, capsys, command, kind):
    """In place of the stamp, which all read or write: one line."""
    (folders / "A" / "environment.json").unlink()
    if kind == "pipe":
        os.mkfifo("A/environment.json")
    else:
        socket.socket(socket.AF_UNIX).bind("A/environment.json")
    assert main([*COMMANDS[command]]) == 2
    assert f"it is a {kind}" in " ".join(capsys.readouterr().err.split())


def test_more_than_asked_for_is_not_read(tmp_path):
    """Its size is looked at before it is read."""
    (tmp_path / "x").touch()
    os.truncate(tmp_path / "x", 11)
    with pytest.raises(OSError, match="more than 10"):
        (ConfinedPath(tmp_path) / "x").read(10)


@pytest.mark.parametrize("place", IN_REPORT)
def test_a_link_in_a_report_is_refused(folders, capsys, place):
    """A new report replaces these folders; the old one is still there after the refusal."""
    (folders / "A" / "report").mkdir()
    (folders / "A" / "report" / "index.html").write_text("an earlier report")
    put_link(folders / "A" / place, folders / "outside")
    before = content(folders / "outside"), content(folders / "A")
    refused(COMMANDS["report"], capsys, f"A/{place}")
    assert (content(folders / "outside"), content(folders / "A")) == before


@pytest.mark.parametrize("place", ["report/data", "report/assets", "report/compare.html"])
def test_a_comparison_is_not_written_through_a_link(folders, capsys, place):
    """It is written beside the pages of a report."""
    target = folders / "outside"
    put_link(folders / "A" / place, target / "index.html" if place.endswith(".html") else target)
    before = content(target)
    refused(COMMANDS["compare"], capsys, f"A/{place}")
    assert content(target) == before


def test_a_linked_judgement_is_neither_read_nor_written(folders, capsys):
    """A link in ``judgement/`` is refused by the report, which reads it."""
    put_link(folders / "A" / "judgement" / "claims.json", folders / "outside" / "claims.json")
    refused(COMMANDS["report"], capsys, "A/judgement/claims.json")


def test_a_linked_device_fills_no_memory(folders, capsys):
    """``environment.json`` as a link to /dev/zero, and as a pipe that nobody writes to."""
    stamp = folders / "A" / "environment.json"
    put_link(stamp, Path("/dev/zero"))
    refused(COMMANDS["diff"], capsys, "A/environment.json")
    stamp.unlink()
    os.mkfifo(stamp)
    assert main(["diff", "A", "B"]) == 2
    assert "it is a pipe" in capsys.readouterr().err


def test_a_link_that_appears_later_is_refused(tmp_path):
    """Not the name is looked at, but what was opened: each folder in the one above it."""
    store.create_folder(tmp_path / "A")
    place = ConfinedPath(tmp_path / "A") / "report" / "runs" / "x.html"
    place.write("ours")
    (tmp_path / "A" / "report").rename(tmp_path / "A" / "before")
    (tmp_path / "outside" / "runs").mkdir(parents=True)
    (tmp_path / "A" / "report").symlink_to(tmp_path / "outside")
    attempts = (lambda: place.write("ours"), lambda: place.read(100), place.remove_file, place.open_new)
    for attempt in (*attempts, place.parent.names, place.parent.remove_folder):
        with pytest.raises(UnsafeFile, match=r"it is a link"):
            attempt()
    assert not list((tmp_path / "outside" / "runs").iterdir())


def test_another_name_of_a_file_keeps_its_content(tmp_path):
    """A hard link cannot be told from a file: it is read, but a new file is written in its place."""
    (tmp_path / "thesis.txt").write_text("thesis")
    folder = store.create_folder(tmp_path / "A")
    for name in ("environment.json", ".spool/x.rows", "stderr/x.txt"):
        (folder / name).parent.mkdir(exist_ok=True)
        os.link(tmp_path / "thesis.txt", folder / name)
    (ConfinedPath(folder) / "environment.json").write("ours")
    for name in (".spool/x.rows", "stderr/x.txt"):
        with (ConfinedPath(folder) / name).open_new() as file:
            file.write(b"ours")
    assert (tmp_path / "thesis.txt").read_text() == "thesis"


def test_the_present_folder_and_the_one_above_are_places(tmp_path, monkeypatch):
    (tmp_path / "inside").mkdir()
    monkeypatch.chdir(tmp_path / "inside")
    assert confine_path(Path(".")).path == tmp_path / "inside" and confine_path(Path("..")).path == tmp_path


def test_the_way_to_a_results_folder_may_be_a_link(tmp_path):
    """``results/local/latest`` is one, and a home may be elsewhere: these are the user's."""
    put(tmp_path / "A", make_measured_record("aa01"), make_swing())
    (tmp_path / "latest").symlink_to("A")
    assert store.load(tmp_path / "latest").records


@pytest.mark.parametrize("name", ["", "..", "a/../b", "/etc/passwd", "a//b", ".", "a/", "a\0"])
def test_no_place_is_outside(tmp_path, name):
    """A name is a way down."""
    with pytest.raises(ValueError, match="must be a path below"):
        ConfinedPath(tmp_path) / name


WAYS = {  # calls that open, look for or change files by their path; a Place has none of these names
    "open",
    "read_text",
    "read_bytes",
    "write_text",
    "write_bytes",
    "mkdir",
    "makedirs",
    "glob",
    "rglob",
    "iterdir",
    "unlink",
    "rmtree",
    "copy2",
    "copyfile",
    "copytree",
    "copyfileobj",
    "rename",
    "touch",
    "symlink_to",
    "rmdir",
    "hardlink_to",
    "savez",
    "savez_compressed",
    "savefig",
    "loadtxt",
    "to_csv",
    "to_pickle",
    "read_csv",
    "memmap",
    "read_parquet",
    "fromfile",
    "tofile",
    "scandir",
    "listdir",
    "is_file",
    "is_dir",
    "exists",
    "lexists",
    "stat",
    "is_symlink",
}
WATCHED = ("harness/results", "harness/run", "harness/base", "cli", "harness/judge/referee", "reports")
ELSEWHERE = {
    "cli/__main__.py": ("open", "the null device"),
    "cli/list.py": (
        "glob read_bytes rglob unlink",
        "our own code, and the catalogue kept in our cache",
    ),
    "reports/model/catalogue.py": ("is_file read_text", "our own code"),
    "cli/lab/bundle.py": ("stat", "the file that it has written"),
    "cli/lab/ladder.py": (
        "exists glob read_text",
        "a folder of bundles, each read as hostile data, and the labels beside them",
    ),
    "cli/solve.py": ("exists lexists", "the file to write, and whether its name is free"),
    "cli/lab/shadow.py": ("is_file", "a file that the user named"),
    "cli/check.py": ("glob", "a plugin, and the names beside it"),
    "cli/export.py": ("write_text", "a file that the user named"),
    "cli/gate.py": ("exists read_text write_text", "files that the user named"),
    "cli/judge.py": ("mkdir", "the folder of published verdicts, that the user named"),
    "cli/report.py": ("mkdir open", "the folder of a comparison, that the user named, and the null device"),
    "cli/arguments.py": ("is_dir open unlink", "the folder of a file that the user named"),
    "cli/show.py": ("glob iterdir", "lists the names of folders beside the one that the user named, and of their runs"),
    "harness/run/cluster.py": ("is_file", "a scheduler file that the user named"),
    "harness/run/costs.py": ("mkdir read_text write_text", "our own table, and what is kept in our cache"),
    "harness/run/remaining_time.py": ("glob is_symlink stat", "lists results/local"),
    "harness/run/runner.py": ("exists glob is_symlink", "lists results/local, and looks for a name that is free"),
    "harness/run/solve_file.py": ("unlink", "the file that the user named, half-written"),
    "harness/judge/referee/carried.py": ("read_text", "that of harness/base/files.py, of a place"),
    "harness/judge/referee/claims/register.py": ("read_text", "the register, or the file that the user named"),
    "harness/results/cleaning.py": (
        "glob is_dir is_file is_symlink iterdir scandir stat unlink",
        "lists results/local, and our cache",
    ),
    "harness/catalogue/codes.py": (
        "glob is_file mkdir read_bytes read_text stat write_text",
        "our own code and plugins, and what is kept of them in our cache",
    ),
    "harness/results/column_digests.py": ("read_text", "that of harness/base/files.py, of a place"),
    "harness/results/environment.py": ("exists is_file read_bytes", "our own code"),
    "harness/results/history.py": ("glob is_symlink mkdir read_text write_text", "lists results/local; files of rows"),
    "harness/results/judgements/files.py": ("read_text", "that of harness/base/files.py, of a place"),
    "harness/results/npz.py": ("open", "a member of an archive that is open already"),
    "harness/results/provenance.py": ("read_text", "that of harness/base/files.py, of a place"),
    "harness/results/stamps.py": ("read_text", "that of harness/base/files.py, of a place"),
    "harness/results/store.py": ("exists is_symlink mkdir symlink_to", "the folder itself, and latest beside it"),
    "harness/base/cache.py": ("exists is_file mkdir open rglob stat", "our own caches and checkout"),
    "harness/base/clock.py": ("listdir read_text", "/proc/PID"),
    "harness/base/confined_paths.py": ("listdir mkdir open rename rmtree stat unlink", "this is the one module"),
    "harness/base/generated/code.py": ("exists glob mkdir unlink", "kept machine code of ours, in our cache"),
    "harness/base/files.py": ("open unlink write_text", "files that the caller has chosen, and their temporary copies"),
    "harness/base/machine.py": ("mkdir read_text stat write_text", "names of SIMD features, kept in our cache"),
    "harness/base/seals.py": (
        "is_dir is_symlink read_bytes read_text rglob unlink write_text",
        "kept code of ours, in our cache",
    ),
    "harness/run/in_turns.py": ("read_text", "a temporary file of its own"),
    "harness/base/isolation.py": ("open read_text", "/dev/null, /proc/self/status"),
    "harness/base/memory.py": ("read_text", "/proc/PID/statm and smaps_rollup"),
    "reports/model/glossary.py": ("read_text", "our own glossary"),
    "reports/paper/catalogue.py": ("read_text", "our own figures"),
    "reports/pages/base.py": ("read_bytes", "our own assets"),
    "reports/plots/spec.py": ("glob", "our own catalogue"),
    "reports/site.py": ("iterdir", "our own assets"),
    "reports/rendering.py": ("write_text", "the page that the user named"),
    "reports/trial.py": ("read_bytes", "a temporary folder"),
}


@pytest.mark.parametrize("path", sorted(p for w in WATCHED for p in (ROOT / w).rglob("*.py")), ids=lambda p: p.stem)
def test_files_of_results_are_opened_in_one_module(path):
    """A file is opened by its path only where it cannot be one of a results folder; ``ELSEWHERE`` says which it is."""
    where = path.relative_to(ROOT).as_posix()
    calls = [n.func for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
    names = {(f.attr if isinstance(f, ast.Attribute) else getattr(f, "id", ""), ast.unparse(f)) for f in calls}
    allowed, _ = ELSEWHERE.get(where, ("", ""))
    found = {name: words for name, words in names if name in WAYS}
    assert set(found) == set(allowed.split()), found

"""A newcomer's first commands: help, the version, the catalogue and one of its entries; cheap, and in one wording."""

import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from mbsbench.cli import list as catalogue
from mbsbench.cli.__main__ import main
from mbsbench.cli.commands import add_commands
from mbsbench.cli.parser import make_parser
from mbsbench.harness.base import machine
from mbsbench.harness.base.cache import read_sealed_file
from mbsbench.harness.base.files import to_json
from mbsbench.harness.base.generated import code
from mbsbench.harness.catalogue import registry
from mbsbench.harness.reference import orbit
from mbsbench.harness.reference.computation import Source, describe_source
from mbsbench.harness.run.remaining_time import COMPILING, PREPARING, REFERENCES, describe_wait
from mbsbench.harness.run.run import MEASURING

_, DECLARED = make_parser()
add_commands(DECLARED)
COMMANDS = {a.dest: a.help for a in DECLARED._choices_actions}
HEAVY = ("numba", "scipy", "pandas", "casadi", "matplotlib", "numpy")


@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",)])
def test_help_lists_the_commands(capsys, arguments):
    """``mbsbench`` alone, too: exit code 0, on standard output, a line a command."""
    assert main(list(arguments)) == 0
    out, err = capsys.readouterr()
    assert not err and out.startswith("usage: mbsbench") and "docs/glossary.md" in out
    for name, summary in COMMANDS.items():
        assert re.search(f"\n    {name}\\s", out) and summary.split()[0] in out
    assert main(["--version"]) == 0 and capsys.readouterr().out.startswith("mbsbench ")


def test_every_file_of_a_command_is_listed():
    """A file that runs a command has a ``run``; nothing is declared without a file."""
    files = Path(import_module("mbsbench.cli").__file__).parent.rglob("*.py")
    assert {p.stem for p in files if "\ndef run(" in p.read_text(encoding="utf-8")} == {*COMMANDS}


CHEAP = ["", "--help", "--version", "list", "list solvers", "list chain", *(f"{c} --help" for c in COMMANDS)]
LOADED = f"""
import os, sys
from mbsbench.cli.__main__ import main
for call in {CHEAP!r}:
    if not os.fork():  # each finds what a new process has, which is started once
        try:
            main(call.split())
        except SystemExit:
            pass
        print(call, *(m for m in {HEAVY!r} if m in sys.modules), sep=":", file=sys.stderr, flush=True)
        os._exit(0)
    os.wait()
"""


def test_help_and_list_load_nothing_heavy():
    """No package that takes a tenth of a second to load; the catalogue is read from its file."""
    catalogue.load_catalogue()
    done = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, timeout=60, check=True)
    assert done.stderr.splitlines() == CHEAP


@pytest.mark.parametrize("command", ["gate", "solve"])
def test_help_of_a_command_is_a_success(command):
    """Also of the gate, whose child process must report its exit code before it ends."""
    call = [sys.executable, "-m", "mbsbench", command, "--help"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("usage: ")


def test_the_kept_catalogue_is_the_one_of_the_code(tmp_path, monkeypatch):
    """Nothing is lost on the way to the file; another code is another file."""
    monkeypatch.setattr(catalogue, "make_cache_folder", lambda *_: tmp_path)
    made, again = catalogue.load_catalogue(), catalogue.load_catalogue()
    assert json.loads(to_json(made)) == again == json.loads(to_json(catalogue.describe_catalogue(plugins=False)))
    (file,) = tmp_path.iterdir()
    file.write_text("no JSON")
    assert catalogue.load_catalogue()["problems"]
    monkeypatch.setattr(catalogue, "_digest_code", lambda: "other")
    catalogue.load_catalogue()
    assert [p.name for p in tmp_path.iterdir()] == ["other.json"]


def test_the_kept_catalogue_is_our_own(tmp_path, monkeypatch):
    """It is kept for every later command: what a plugin marks in the process that writes it is no part of it."""
    monkeypatch.setattr(registry, "_plugin_problems", {})
    monkeypatch.setattr(registry, "_plugin_solvers", {})
    monkeypatch.setattr(catalogue, "make_cache_folder", lambda *_: tmp_path / "kept")
    plugin = tmp_path / "mine.py"
    plugin.write_text(
        (Path(__file__).parents[1] / "harness" / "misbehaving.py").read_text().replace("free_fall", "falls")
    )
    registry.load_plugin(plugin)
    assert "falls" in [e["name"] for e in catalogue.describe_catalogue(plugins=True)["problems"]]
    for kind in ("problems", "solvers"):
        names = [e["name"] for e in catalogue.load_catalogue()[kind]]
        assert names == [n for n in getattr(registry, kind)() if getattr(registry, f"is_own_{kind[:-1]}")(n)]
    assert catalogue.load_catalogue() == json.loads(read_sealed_file(next((tmp_path / "kept").iterdir()), 2**26))


@pytest.mark.parametrize("columns", ["80", ""])
def test_the_overview_fits_a_screen(capsys, monkeypatch, columns):
    """24 to 40 lines of 80 columns, in a pipe too, with every name; each kind has its own list."""
    monkeypatch.setenv("COLUMNS", columns)
    for known in ("_plugin_problems", "_plugin_solvers"):  # of other tests in this process
        monkeypatch.setattr(registry, known, {})
    assert main(["list"]) == 0
    out = capsys.readouterr().out
    assert 24 <= len(out.splitlines()) <= 40 and max(map(len, out.splitlines())) <= 80
    names = {"problems": registry.problems(), "solvers": registry.solvers()}
    for kind, entries in names.items():
        assert all(name in out for name in entries)
        assert main(["list", kind]) == 0
        first = [line.split()[0] for line in capsys.readouterr().out.splitlines() if not line.startswith(" ")]
        assert first == [kind.removesuffix("s"), *entries]
        assert main(["list", kind, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert [e["name"] for e in said[kind]] == [*entries]
        assert not any(said[other] for other in names if other != kind)


def test_the_version_says_what_a_report_of_a_fault_needs(capsys):
    """Packages, machine, whose bits, engines; with --verbose the places of caches, those that modules write to."""
    assert main(["--version"]) == 0
    short = capsys.readouterr().out
    for words in ("python 3.", "numpy ", "cores", "bits ", "engines "):
        assert words in " ".join(short.split())
    assert main(["--version", "--verbose"]) == 0
    out = capsys.readouterr().out
    assert {" ".join(line.split()) for line in short.splitlines()} < {
        " ".join(line.split()) for line in out.splitlines()
    }
    for folder in (orbit.FOLDER, code.FOLDER, machine._locate_names_file().parent):
        assert f"  {folder.resolve()} (" in out


def test_list_of_one_problem(capsys):
    """Its options with units, its section, its time and where its reference comes from; no other entry."""
    assert main(["list", "heavy_top"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    for words in (
        "heavy_top",
        "Sect. 5.4 of the paper",
        "simulated time: 5 s",
        "its own exact motion",
        "[rad/s]",
        "unit_length",
    ):
        assert words in out
    assert "simple_pendulum" not in out and "gc_weak_form" not in out


def test_list_of_one_solver(capsys):
    assert main(["list", "gc_weak_form", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert not said["problems"] and [s["name"] for s in said["solvers"]] == ["gc_weak_form"]
    assert main(["list", "gc_weak_form"]) == 0
    assert "order " in capsys.readouterr().out


CERTIFIED = ("chain", "four_bar_grid", "n_four_bar", "pumped_pendulum")


@pytest.mark.parametrize("name", sorted(registry.problems()))
def test_a_certified_integration_is_not_called_exact(capsys, name):
    """A motion without a formula is said to be integrated, not to be exact."""
    source = describe_source(registry.make_problem(name))
    assert (source is Source.CERTIFIED) == (name in CERTIFIED)
    main(["list", name])
    assert ("certified integration" in capsys.readouterr().out) == (name in CERTIFIED)


def test_waiting_is_said_in_one_wording():
    """The work under way and how long is left; past the expected time, or with warm caches, how long it has taken."""
    words = describe_wait(COMPILING, 5.0, 25.0)
    assert words == "compiling kernels: about 20 s left (this once, not counted in any run)"
    for doing in (COMPILING, REFERENCES, PREPARING):
        assert describe_wait(doing, 3.0) == describe_wait(doing, 3.0, 2.0) == f"{doing}: 3 s so far"
    assert describe_wait(MEASURING, 12.0) == "measuring: 12 s so far"

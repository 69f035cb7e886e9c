"""Documentation names only what exists: files, modules, commands, links; and the layers as they are enforced."""

import re
import tomllib

import pytest

from mbsbench.cli.__main__ import import_commands
from mbsbench.harness.results.environment import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
PATH = re.compile(r"`((?:harness|reports|problems|solvers|tests|docs|results/baselines|results/published)/[\w./-]*)`")
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")
COMMAND = re.compile(r"^ *mbsbench (\w+)|`mbsbench (\w+)", re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_what_a_page_names_exists(page):
    """A file that was moved is found here first."""
    text = page.read_text(encoding="utf-8")
    assert not [p for p in PATH.findall(text) if not (ROOT / p).exists()]
    assert not [p for p in LINK.findall(text) if not (page.parent / p).exists()]
    commands = {m.__name__.rpartition(".")[2] for m in import_commands()}
    assert {a or b for a, b in COMMAND.findall(text)} - {"COMMAND"} <= commands


def test_the_page_on_the_layout_shows_the_layers_that_are_enforced():
    """One contract in pyproject.toml; the page repeats it for the reader."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = [c["layers"] for c in contracts if c["type"] == "layers"]
    page = (ROOT / "docs" / "decisions" / "layout.md").read_text(encoding="utf-8")
    assert "\n".join(f"    {layer}" for layer in layers) in page


def test_the_readme_has_a_line_for_every_room_of_the_harness():
    """``ls harness`` explains itself."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rooms = [p.name for p in (ROOT / "harness").iterdir() if (p / "__init__.py").exists()]
    assert rooms and not [room for room in rooms if f"| `harness/{room}/` |" not in readme]

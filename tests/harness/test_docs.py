"""Documentation names only what exists and fits its budget: files, commands, links, lines, layers."""

import ast
import re
import textwrap
import tomllib

import pytest

from mbsbench.cli.commands import add_commands
from mbsbench.cli.parser import make_parser
from mbsbench.harness.base.code_meter import CODE_LIMIT
from mbsbench.harness.lab.ladder.ranking import TARGET
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.run.contract import EXPLAINED
from mbsbench.harness.run.handover import HIDDEN

PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
GENERATED = "verdicts.md"
LONGEST = 140  # characters of a line
PROSE = 100  # characters of a line of prose: what an eye follows
UNWRAPPED = ("CHANGELOG.md", "CONTRIBUTING.md", GENERATED)
PATH = re.compile(r"`((?:harness|reports|problems|solvers|tests|docs|results/baselines|results/published)/[\w./-]*)`")
LINK = re.compile(r"\]\((?!https?:)([^)#]*)#?([^)]*)\)")
COMMAND = re.compile(r"^ *mbsbench (\w+)|`mbsbench (\w+)", re.MULTILINE)


def headings(page):
    """The anchors of its headings, as renderers make them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@each_page
def test_what_a_page_names_exists(page):
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^Save as .*:$", "", text, flags=re.MULTILINE)  # files that a reader makes
    assert not [p for p in PATH.findall(text) if not (ROOT / p).exists()]
    for target, anchor in LINK.findall(text):
        linked = page.parent / target if target else page
        assert linked.exists(), target
        assert not anchor or anchor in headings(linked), f"{target}#{anchor}"
    _, commands = make_parser()
    add_commands(commands)
    assert {a or b for a, b in COMMAND.findall(text)} - {"COMMAND"} <= {*commands.choices}


@each_page
def test_lines_fit(page):
    """Rows of tables, and lines that one link fills, cannot be broken."""
    lines = page.read_text(encoding="utf-8").splitlines() if page.name != GENERATED else []
    long = [line for line in lines if len(line) > LONGEST and not re.match(r"\||!?\[[^]]*\]\(\S*\)$", line)]
    assert not long, long


@each_page
def test_lines_of_prose_are_short(page):
    """Code, rows of tables and lines of one link are no prose."""
    text = page.read_text(encoding="utf-8") if page.name not in UNWRAPPED else ""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL).splitlines()
    code = re.compile(r"\||!?\[[^]]*\]\(\S*\)$| {4,}")
    assert not [line for line in prose if len(line) > PROSE and not code.match(line)]


@each_page
def test_python_on_a_page_can_be_read(page):
    """A block that imports is Python, in a fence or indented; wrapping it as prose would join its lines."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    indented = (textwrap.dedent(b) for b in re.findall(r"(?:^(?: {4}.*)?\n)+", text, re.MULTILINE))
    blocks += [b for b in indented if re.search(r"^(?:import \w|from [\w.]+ import )", b, re.MULTILINE)]
    for block in blocks:
        ast.parse(block, page.name)


@pytest.mark.parametrize("name", sorted({p.name for p in (ROOT / "docs").glob("*.md")} - {"bundle.md", "glossary.md"}))
def test_a_page_opens_with_an_example(name):
    """A reader with a question sees what runs before the second heading; a format and a list of words have none."""
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    opening = "\n## ".join(text.split("\n## ")[:2])
    assert re.search(r"^```\w+$|^    \S", opening, re.MULTILINE)


def test_the_page_on_the_layout_shows_the_layers_that_are_enforced():
    """One contract in pyproject.toml; the page repeats it for the reader."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(c["layers"] for c in contracts if c["type"] == "layers")
    page = (ROOT / "docs" / "decisions" / "layout.md").read_text(encoding="utf-8")
    shown = "\n".join(f"    {layer}" for layer in layers)
    assert shown in page, f"docs/decisions/layout.md must show the layers of pyproject.toml:\n{shown}"


def test_the_readme_shows_the_solver_of_its_page():
    """The ten lines that are tested are those that a newcomer copies; one page is the other's beginning."""
    readme, page = ((ROOT / n).read_text(encoding="utf-8") for n in ("README.md", "docs/your-own-solver.md"))
    (solver,) = re.findall(r"```python\n.*?```", readme, re.DOTALL)
    assert solver in page and len(readme.splitlines()) <= 70


def test_every_room_of_the_harness_says_what_it_is_for():
    rooms = list((ROOT / "harness").glob("*/__init__.py"))
    assert rooms and not [p for p in rooms if not p.read_text(encoding="utf-8").startswith('"""')]


def test_the_page_on_trust_has_the_numbers_of_the_code():
    """What a report may hide, what may be called compilation, how near is solved."""
    page = " ".join((ROOT / "docs" / "trust.md").read_text(encoding="utf-8").split())
    assert f"up to {CODE_LIMIT:g} s of it compilation" in page and f"solved to {TARGET:.1%} of the length" in page
    assert (HIDDEN, EXPLAINED) == (1.0, 0.5) and "by up to one second or half of it" in page


def test_the_page_for_assistants_is_a_screen_and_its_example_runs(capsys):
    text = (ROOT / "AGENTS.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(example, {})
    assert len(text.splitlines()) <= 60 and capsys.readouterr().out.startswith("success ")

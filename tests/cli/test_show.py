"""``show`` on a terminal: fits, filters, sorts, shows one run in detail; series in a few characters."""

import json
import math
import re
import shlex
import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

from mbsbench.cli.__main__ import main
from mbsbench.cli.arguments import UsageError
from mbsbench.cli.show import find_run
from mbsbench.cli.terminal import BARS, Column, draw_sparkline, draw_timeline, fit_table
from mbsbench.harness.judge.referee.claims.register import read_register
from mbsbench.harness.judge.referee.registers import PLACES
from mbsbench.harness.results import store
from mbsbench.harness.results.judgements import files
from mbsbench.reports.model import claim_groups, claim_words
from mbsbench.tests.factories import PLUGIN, run_suite_text

from .terminal import ESCAPE, in_terminal, seen

TEXT = """
[[runs]]
problem = "free_fall"
solver = "exact"
options = { lift = [0.0, 1e-6, 1e-3, 10.0] }
dt = 0.01
[[runs]]
problem = "free_fall"
solver = ["gives_up", "raises", "refuses", "segfaults", "hangs_later"]
cpu_limit = 1
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results with every kind of end."""
    where = tmp_path_factory.mktemp("show") / "run"
    run_suite_text(where, TEXT)
    return where


@pytest.fixture
def shown(folder, capsys, monkeypatch):
    """Exit code and outputs of ``show`` on these results."""

    def show(*arguments, width=120, of=folder):
        monkeypatch.setenv("COLUMNS", str(width))
        return main(["show", str(of), *map(str, arguments)]), *capsys.readouterr()

    return show


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_the_table_fits(shown, width):
    """Case, status and drift are there at any width; columns that count less go first."""
    code, out, _ = shown(width=width)
    assert code == 0 and all(cell_len(line) <= width for line in out.splitlines())
    head = out.splitlines()[0]
    assert "case" in head and "status" in head and "|dE| [J]" in head and "dE over time" in head
    assert ("CPU [s]" in head) == (width >= 120)
    assert "9 runs, 2 success" in out or "9 runs, 3 success" in out


def test_filters_and_sort(shown):
    """Names, several of them, largest first, cut."""
    _, out, _ = shown("--solver", "raises,refuses")
    assert "2 runs" in out and "segfaults" not in out
    _, out, _ = shown("--status", "crashed")
    assert "raises" in out and "refuses" not in out
    _, out, _ = shown("--sort", "drift", "--limit", "2", width=200)
    first, second = out.splitlines()[1:3]
    assert "lift=10" in first and "lift=0.001" in second and "2 runs" in out
    records = [json.loads(x) for x in shown("--sort", "steps", "--json")[1].splitlines()]
    assert [r["steps"] for r in records] == sorted((r["steps"] for r in records), reverse=True) and len(records) == 9


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--solver", "exakt"), "did you mean 'exact'"),
        (("--status", "sucess"), "did you mean 'success'"),
        (("--sort", "beauty"), "unknown column"),
        (("--sort", "driftt"), "did you mean 'drift'"),
        (("zzz",), "no run"),
        (("--limit", "0"), "--limit"),
        (("",), "no run"),
    ],
)
def test_unknown_names_are_reported_in_one_line(shown, arguments, words):
    code, out, err = shown(*arguments)
    assert code == 2 and words in err and err.count("\n") == 1 and not out


def test_an_id_of_another_folder_is_answered_with_ids(folder, shown, tmp_path):
    """Those that are here, and the folder beside that has it."""
    mine, other = tmp_path / "mine", tmp_path / "other"
    for one in (mine, other):
        shutil.copytree(folder, one)
    (gone, *_) = sorted((mine / "runs").glob("*.json"))
    gone.unlink()
    found = store.load(mine).records
    with pytest.raises(UsageError, match=f"no run '{gone.stem[:7]}' in these results: it is of other"):
        find_run(found, gone.stem[:7], mine)
    shutil.rmtree(other)
    with pytest.raises(UsageError, match=re.escape(f"which has {found[0].run_id[:7]} ({found[0].case}), ")):
        find_run(found, gone.stem[:7], mine)


def test_one_run_in_full(folder, shown):
    """By address, start of it, or case: settings, numbers, series over time, the command that runs it again."""
    case = "free_fall exact[lift=0.001] dt=0.01"
    (record,) = [r for r in store.load(folder).records if r.case == case]
    texts = {shown(name, width=80)[1] for name in (record.run_id, record.run_id[:7], case)}
    assert len(texts) == 1
    (out,) = texts
    *lines, _, command = out.rstrip().splitlines()
    assert all(cell_len(line) <= 80 for line in lines)
    for words in ("lift=0.001", "|dE| [J]", "|phi| [m]", "step [s]", "energy_drift_max_J", "P_X", "kg m/s", "▇█"):
        assert words in out
    words = shlex.split(command)
    assert words[:4] == ["mbsbench", "solve", "free_fall", "exact"] and str(PLUGIN) in words
    (plain,) = map(json.loads, shown(record.run_id, "--json")[1].splitlines())
    assert plain["command"] == command.strip() and plain["run_id"] == record.run_id


def test_a_run_that_failed_says_why_and_where(shown):
    """A star where it stopped; its standard error; without steps, that."""
    for solver, words in (
        ("gives_up", ("step_underflow", "too small", "*")),
        ("refuses", ("on principle", "no steps were kept")),
        ("raises", ("a bug of mine", "RuntimeError", "Standard error")),
    ):
        out = shown(f"free_fall {solver} dt=0.5")[1]
        assert all(word in out for word in words), solver


def test_a_damaged_series_is_reported(folder, shown, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "run")
    next((copy / "series").iterdir()).write_bytes(b"PK")
    code, out, err = shown(of=copy)
    assert code == 1 and "9 runs" in out and err.count("unreadable") == 1


def test_on_a_terminal_with_and_without_colour(folder, tmp_path):
    """80 columns are never passed; NO_COLOR leaves no colours."""
    code, text = in_terminal("show", str(folder), width=80, where=tmp_path)
    assert code == 0 and "\x1b[" in text and max(map(cell_len, seen(text))) <= 80
    code, plain = in_terminal("show", str(folder), width=80, where=tmp_path, NO_COLOR="1")
    assert code == 0 and not any(f"\x1b[{colour}" in plain for colour in ("3", "1;3", "9"))
    assert seen(plain) == seen(text)


@pytest.mark.sampled(0)
def test_a_run_on_a_terminal_shows_what_is_left_and_the_worst_drift(tmp_path):
    """A bar that is redrawn, lines that stay, nothing wider than the terminal; piped: plain lines only."""
    (tmp_path / "s.toml").write_text(
        f'plugins = ["{PLUGIN}"]\n[[runs]]\nproblem = "free_fall"\nsolver = "exact"\n'
        'options = { lift = [1e-3, 1e-2] }\n[[runs]]\nproblem = "free_fall"\nsolver = "sleeps"\n'
        "options = { seconds = [0.3, 0.6] }\n"
    )
    code, text = in_terminal("run", "s.toml", "--jobs", "1", width=80, where=tmp_path)
    assert code == 0 and "\x1b[" in text
    lines = seen(text)
    assert any("of 4 runs, " in line and " % of the work, about " in line and "━" in line for line in lines)
    assert any(line.startswith("worst drift: ") and "lift=0.01" in line for line in lines)
    assert any(" of about " in line and "sleeps" in line for line in lines)
    assert all(cell_len(line) <= 80 for line in lines if "━" in line or line.startswith((" ", "worst")))
    assert ESCAPE.sub("", text).rstrip().splitlines()[-1].startswith("largest energy drift: 0.033")


def test_a_timeline_stops_where_the_motion_did():
    """Half-way: half of it, a star, then nothing; a long step leaves no hole."""
    t = np.linspace(0.0, 5.0, 101)
    assert draw_timeline(t, 10.0**-t, 10.0, 10).startswith("█▇▆▅▄") and draw_timeline(t, 10.0**-t, 10.0, 10).endswith(
        "*   "
    )
    assert draw_timeline(np.array([0.0, 9.0, 10.0]), np.ones(3), 10.0, 10) == "██████████"
    assert draw_timeline(np.array([0.0]), np.zeros(1), 10.0, 4) == "▁*  " and draw_timeline(t, t, 0.0, 4) == ""


def test_a_sparkline_shows_growth_by_decades():
    """One bar a power of ten; the largest of each stretch, whatever its sign."""
    assert draw_sparkline([10.0**-k for k in range(8)], 8) == BARS[::-1]
    assert draw_sparkline([1.0, -1e-3, 1e-3, 1.0, 1e-7, 1e-7], 3) == "██▁"
    assert draw_sparkline([1.0, 1.0, 1.0], 3) == "███"
    assert (
        draw_sparkline([1.0, 2.0, 3.0], 3, log=False) == "▁▅█" or draw_sparkline([1.0, 2.0, 3.0], 3, log=False) == "▁▄█"
    )


def test_what_is_not_there_is_blank():
    """NaN is a gap, zero and rounding are the bottom."""
    assert draw_sparkline([math.nan, 1.0, 0.0, 1e-30], 4) == " █▁▁"
    assert (
        draw_sparkline([math.nan, math.inf], 2) == "  "
        and draw_sparkline([], 5) == ""
        and draw_sparkline([0.0, 0.0], 9) == "▁▁"
    )


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.lists(st.floats(), max_size=60), st.integers(1, 30), st.booleans())
def test_any_series_has_a_sparkline(values, width, log):
    assert len(draw_sparkline(values, width, log=log)) == min(width, len(values))


@pytest.mark.parametrize("width", [40, 60, 80, 200])
def test_tables_fit(width):
    """Columns of large rank go first, then text folds at blanks; numbers are never broken."""
    ranked = [Column(letter * 20, rank=rank) for rank, letter in enumerate("xy", 1)]
    columns = (Column("case", right=False, fold=True), Column("kept"), *ranked)
    rows = [("p s[first_option=1,second_option=2,third_option=3]", "1.23e-05", "1", "2")]
    out = Console(width=width)
    with out.capture() as caught:
        out.print(fit_table(columns, rows, width))
    text = caught.get()
    assert all(len(line) <= width for line in text.splitlines()) and "1.23e-05" in text
    assert ("y" * 20 in text) == (width >= 80) and ("x" * 20 in text) == (width >= 60)
    assert "third_option=3" in text.replace("\n", "") and "first_option=1" in text


def test_a_claim_is_shown_as_published(capsys):
    assert main(["claim", "6-gc-planar"]) == 0
    said = capsys.readouterr().out
    (published,) = (c for c in files.read_claims(files.PUBLISHED) if c.id == "6-gc-planar")
    found = f"at the paper's settings: {published.paper.verdict}", f"beyond them: {published.beyond.verdict}"
    for words in (published.claim, published.quote, *found, "why: ", "tried with gauge", "claim 6-gc-planar --run"):
        assert words in said
    row = claim_groups.find_shown_row(published)
    assert row.command in " ".join(said.split()) and row.measured == published.tests[0].measured
    assert main(["claim", "6-gc-planar", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == "6-gc-planar"


def test_claims_are_listed_those_that_carry_the_paper_first(capsys):
    """What abstract and conclusions say, then textbooks, each with verdict and number; the others are counted first."""
    published = [c for p in PLACES for c in files.read_claims(files.PUBLISHED, p.file) or ()]
    groups = claim_groups.group_claims(published)
    main_ones = [c for title in claim_groups.FIRST for c in groups.get(title, ())]
    names = {c.id for c in published} | {f"{title}:" for title in claim_groups.GROUPS}

    def list_names(text):
        return [name for line in text.splitlines() if (name := line.partition(": ")[0]) in names]

    assert main(["claim"]) == 0
    text = capsys.readouterr().out
    said = " ".join(text.split())
    assert list_names(text) == [
        name
        for title in claim_groups.FIRST
        if title in groups
        for name in (f"{title}:", *(c.id for c in groups[title]))
    ]
    for c in main_ones:
        assert c.claim in said and claim_words.describe_verdict(c) in said
        assert all(str(f.verdict).removesuffix(" if") in claim_words.describe_verdict(c) for f in c.findings)
        assert not c.tests or claim_groups.describe_shown(c) in said
    others = len(published) - len(main_ones)
    assert f"{others} more claims: mbsbench claim --all lists them" in said and len(main_ones) < 30
    assert main(["claim", "--all"]) == 0
    every = [name for title, own in groups.items() for name in (f"{title}:", *(c.id for c in own))]
    assert list_names(capsys.readouterr().out) == every and len(every) == len(published) + len(groups)


def test_claims_are_listed_as_json(capsys):
    """All of them, in the same order, with both verdicts."""
    published = {c.id: c for p in PLACES for c in files.read_claims(files.PUBLISHED, p.file) or ()}
    assert main(["claim", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["claims"]
    assert [c["id"] for c in found] == [c.id for c in claim_groups.order_claims(published.values())]
    for c in found:
        own = published[c["id"]]
        assert (c["paper"], c["beyond"]) == tuple(f and str(f.verdict) for f in (own.paper, own.beyond))
        assert c["summary"] == own.summary and c["words"] == claim_words.describe_verdict(own)
        assert c["register"] == own.register


@pytest.mark.slow
def test_the_runs_of_a_claim_alone_are_made_and_judged(tmp_path, capsys):
    """Of the suite's thousands; a second call makes none of them again."""
    folder = tmp_path / "one"
    (own,) = (c for c in read_register().claims if c.id == "1-any-duration")
    made = []
    for _ in range(2):
        assert main(["claim", "1-any-duration", "--run", "--out", str(folder), "--jobs", "1", "--json"]) in (0, 1)
        found = json.loads(capsys.readouterr().out)
        runs = {p.name: p.stat().st_mtime_ns for p in (folder / "runs").iterdir()}
        assert len(runs) == len(found["settings_ids"]) > 0 and found["claim"] == own.claim
        assert "reproduced" in {f["verdict"] for f in (found["paper"], found["beyond"]) if f}
        made.append(runs)
    assert made[0] == made[1]

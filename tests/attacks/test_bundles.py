"""Changes to every field of a bundle: the checker says of each what it must, or the table why no bundle decides."""

import json

import pytest

from mbsbench.harness.results.records import COLUMNS

from .bundles import cut_run
from .cases import TABLE, is_found, judge, list_cases
from .changes import BASES, HEAD, NUMBERS, PROBLEMS, RECORDS, RUNS


@pytest.fixture(scope="module")
def bases(bundles):
    """The lossless bundle of each run by itself."""
    return {name: cut_run(bundles["lossless"], where) for name, where in BASES.items()}


@pytest.mark.sampled(0)
def test_every_field_has_its_row(bundles):
    """A new column, key or number without a row in the table fails here."""
    files = bundles["lossless"]
    unlike = {c.name for c in COLUMNS} ^ set(RECORDS)
    remedy = "declare why no checker recomputes it (unchecked), or give RECORDS of tests/attacks/changes.py a row"
    assert not unlike, f"{sorted(unlike)}: {remedy}"
    problems = [json.loads(raw) for name, raw in files.items() if name.startswith("problems/")]
    assert {key for plain in problems for key in plain} == set(PROBLEMS)
    assert {key for plain in problems for key in plain["numbers"]} == set(NUMBERS)
    assert {key for run in json.loads(files["runs.json"]) for key in run} == set(RUNS)
    assert set(json.loads(files["bundle.json"])) == set(HEAD)
    assert all(row.changes or row.undecided for rows in TABLE.values() for row in rows.values())


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", ["thin", "lossless"])
def test_honest_bundles_agree_and_what_weakens_them_is_said(bundles, tmp_path, kind):
    """Runs that end in every way, and each run by itself."""
    code, text = judge(tmp_path / "b.zip", bundles[kind])
    assert code == 0 and " 0 disagreements" in text
    assert ("that claim success with the states of some steps" in text) == (kind == "thin")
    assert "1 of 10 that start as printed, whose joints nobody judges" in text
    assert "1 of 10 without reactions, whose errors cannot be judged" in text
    for where in BASES.values():
        code, text = judge(tmp_path / "b.zip", cut_run(bundles[kind], where))
        assert code == 0, text


def choose_one_a_field(cases):
    """One change of each field, in turn the first, second, ... of those that it has."""
    by_field = {}
    for case in cases:
        by_field.setdefault(case.field, []).append(case)
    return [own[k % len(own)] for k, own in enumerate(by_field.values())]


@pytest.mark.sampled(0)
@pytest.mark.parametrize("every", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["one a field", "all"])
@pytest.mark.parametrize("part", [*TABLE, "peaks", "series", "scene"])
def test_every_change_that_a_bundle_decides_is_found(bases, tmp_path, part, every):
    """Each by what must be said of it."""
    cases = [case for case in list_cases(bases) if case.part == part]
    cases = cases if every or part == "scene" else choose_one_a_field(cases)
    missed = [
        f"{case.id}: {text}" for case in cases if not (ok := is_found(case, bases, tmp_path))[0] for text in ok[1:]
    ]
    assert cases and not missed, "\n".join(missed)


def test_thinned_successes_without_a_state_are_counted_and_refused_where_all_is_owed(bundles, tmp_path):
    """A bundle may call itself thinned: of all that is no excuse; with --complete, as the ladder asks, of none."""
    files = dict(bundles["thin"])
    runs = [run | {"states": "none", "problem": "", "peaks_s": {}} for run in json.loads(files["runs.json"])]
    parts = ("runs/", "problems/", "references/")
    files = {name: raw for name, raw in files.items() if not name.startswith(parts)}
    files["runs.json"] = json.dumps(runs).encode()
    code, text = judge(tmp_path / "b.zip", files)
    assert code == 1 and "no state of any success" in text and "7 of 10 that claim success without a state" in text
    code, text = judge(tmp_path / "b.zip", files, complete=True)
    assert code == 1 and text.count("evidence") == 8  # each, and all of them


def test_no_words_of_a_bundle_reach_a_terminal_as_they_are(bases, tmp_path):
    """Escape sequences are shown, not obeyed."""
    files = dict(bases["top"])
    files["records.json"] = files["records.json"].replace(b'"section": "', b'"section": "\\u001b[2J')
    code, text = judge(tmp_path / "b.zip", files)
    assert code == 1 and "\x1b" not in text and "\\x1b[2J" in text

"""Verdicts are of the code they speak of: what is refused, in which words, and what is asked for."""

import dataclasses

import pytest
from msgspec.structs import replace

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue.codes import digest_run_code, read_column_digests
from mbsbench.harness.columns.digests import ColumnDigests
from mbsbench.harness.judge.referee import judge as judging
from mbsbench.harness.judge.referee.claims.register import parse_register
from mbsbench.harness.judge.referee.currency import (
    describe_changes,
    describe_older_runs,
    describe_stale_runs,
    digest_code_and_claims,
    find_older_runs,
    find_stale_runs,
)
from mbsbench.harness.results.judgements import files
from mbsbench.harness.results.judgements.claims import CodeDigests
from mbsbench.harness.results.judgements.files import CLAIMS, read_judgement
from mbsbench.tests.factories import make_record
from mbsbench.tests.stale import REMEDY

from .claiming import HEAD, MAP, RUNS, TEST

NOW = CodeDigests({"alpha": "1", "beta": "2"}, {"chain": "3"}, "4", "5", "6", "7", {"a": "7", "b": "8"})


@pytest.mark.published
def test_published_verdicts_are_of_this_code():
    """The remedy is in the words: make the runs concerned anew, or judge again, and publish."""
    outdated = judging.describe_outdated(files.PUBLISHED)
    assert not outdated, f"{outdated}\n{REMEDY}"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, ""),
        ({"solvers": {"alpha": "0", "beta": "2"}}, "code of alpha: mbsbench run referee --resume, then mbsbench judge"),
        ({"solvers": {}}, "code of alpha, beta (all)"),
        ({"problems": {"chain": "0"}}, "problem chain"),
        ({"running": "0"}, "what runs solvers and counts their cost: mbsbench run referee --resume, then"),
        ({"measuring": "0"}, "what measures motions, of every solver: mbsbench remeasure RESULTS, then mbsbench judge"),
        ({"columns": {"a": "7", "b": "9"}}, "the columns b: mbsbench remeasure RESULTS, then mbsbench judge --publish"),
        ({"columns": {"a": "7", "gone": "0"}}, "the columns gone: mbsbench remeasure"),
        ({"columns": {"a": "7"}}, ""),
        ({"runs": "0"}, "register or the suites"),
        ({"judging": "0"}, "rules of judging: mbsbench judge --publish"),
    ],
)
def test_what_changed_is_said_in_a_line_with_the_command(changed, words):
    line = describe_changes(replace(NOW, **changed), NOW, "referee")
    assert words in line and bool(line) is bool(words) and "\n" not in line


def test_runs_of_other_code_are_named_by_their_solvers():
    """One of thirteen is old; those of a plugin's solver are not ours to know."""
    good = [make_record(x, code=digest_run_code(x.problem, x.solver), suite="paper") for x in RUNS]
    assert find_older_runs(good) == ()
    old = dataclasses.replace(good[-1], code="before")
    assert find_older_runs([*good[:-1], old]) == (old,)
    assert find_older_runs([dataclasses.replace(old, solver="somebodys")]) == ()
    words = describe_older_runs((old,), "results/local/x")
    assert f"code of {old.solver}: mbsbench run paper --resume --out results/local/x" in words and "\n" not in words


def test_runs_that_were_measured_by_other_code_are_measured_again():
    """One with fewer columns is current; one column that is measured in another way is named, with the command."""
    here = read_column_digests()
    fewer = ColumnDigests(here.measuring, dict(list(here.columns.items())[1:]))
    other = ColumnDigests(here.measuring, here.columns | {"phi_max": "other"})
    old, lacking, stale, unknown = (
        make_record(x, measured_by=digest)
        for x, digest in zip(RUNS, ("", fewer.digest, other.digest, "nobody knows"), strict=False)
    )
    found = find_stale_runs((old, lacking, stale, unknown), {s.digest: s for s in (here, fewer, other)})
    assert found == {stale: ("phi_max",), unknown: tuple(here.columns)}
    words = describe_stale_runs({stale: ("phi_max",)}, "results/local/x")
    assert words == "1 run in results/local/x was measured by other code (phi_max): mbsbench remeasure results/local/x"


def test_words_of_a_claim_are_no_part_of_the_digest_and_bands_and_runs_are():
    before = digest_code_and_claims(parse_register(MAP + HEAD + TEST), RUNS)
    assert digest_code_and_claims(parse_register(MAP + HEAD.replace("words", "others") + TEST), RUNS) == before
    assert digest_code_and_claims(parse_register(MAP + HEAD + TEST.replace("1.0", "1.1")), RUNS).runs != before.runs
    assert digest_code_and_claims(parse_register(MAP + HEAD + TEST), RUNS[1:]).runs != before.runs


def test_verdicts_of_an_older_version_are_refused_in_a_line(tmp_path):
    for text, schema in (('[{"id": "a", "verdict": "SUPPORTED"}]', 1), ('{"schema": 2, "claims": []}', 2)):
        (tmp_path / "claims.json").write_text(text)
        with pytest.raises(FileError, match=rf"^[^\n]*older version \(schema {schema}, expected 3\)$"):
            read_judgement(CLAIMS, ConfinedPath(tmp_path))

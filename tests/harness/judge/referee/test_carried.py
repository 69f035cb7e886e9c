"""Published results stay those of later code with the same bits, and of no other."""

import pytest
from msgspec.structs import replace

from mbsbench.harness.base.files import FileError, to_json
from mbsbench.harness.catalogue.codes import digest_run_code
from mbsbench.harness.columns.digests import ColumnDigests
from mbsbench.harness.judge.referee import carried
from mbsbench.harness.judge.referee.carried import (
    Generation,
    add_generation,
    bring_forward,
    digest_present_code,
    is_current_or_carried,
    is_measuring_carried,
    read_carried,
)
from mbsbench.harness.results.judgements.claims import CodeDigests

FIRST = Generation({"rattle": "r1"}, {"chain": "c1"}, "m1", "j1", "commit 1")
ALL = {"rattle"}, {"chain"}
SECOND = Generation({"rattle": "r2"}, {"chain": "c1"}, "m1", "", "commit 2")


@pytest.fixture
def published(tmp_path, monkeypatch):
    """Two generations before the present code, in a file of its own."""
    path = tmp_path / "carried.json"
    path.write_text(
        to_json(add_generation(SECOND, digest_present_code(), add_generation(FIRST, SECOND, None, *ALL), *ALL))
    )
    monkeypatch.setattr(carried, "read_carried", lambda: read_carried(path))
    carried.list_equal_generations.cache_clear()
    yield path
    carried.list_equal_generations.cache_clear()


def test_the_present_code_is_its_own():
    assert is_current_or_carried("chain", "rattle", digest_run_code("chain", "rattle"))
    assert digest_present_code().digest_run_code("chain", "rattle") == digest_run_code("chain", "rattle")


def test_an_empty_digest_is_of_no_code():
    """A solver that a catalogue does not have has none, nor has the record of a run by ``mbsbench solve``."""
    assert digest_present_code().digest_run_code("chain", "gone") == ""
    assert not is_current_or_carried("chain", "gone", "") and not is_current_or_carried("chain", "rattle", "")


def test_what_was_published_of_any_earlier_generation_counts(published):
    """Verdicts of the first generation and a picture of the second are both true of the present code."""
    here = digest_present_code()
    for old in (FIRST, SECOND):
        assert is_current_or_carried("chain", "rattle", old.digest_run_code("chain", "rattle"))
        code = bring_forward(CodeDigests(old.solvers, old.problems, old.measuring, "j1", "runs"))
        judging = here.judging if old is FIRST else "j1"  # of the second nobody compared verdicts
        solvers, problems = {"rattle": here.solvers["rattle"]}, {"chain": here.problems["chain"]}
        rest = {"running": here.running, "columns": here.columns}
        assert code == CodeDigests(solvers, problems, here.measuring, judging, "runs", **rest)


def test_other_code_is_not_carried(published):
    """A digest that no run has shown to be equal stays what it is, one part of it too."""
    other = CodeDigests({"rattle": "r1"}, {"chain": "c9"}, "m1", "judging", "runs")
    assert bring_forward(other) == other and not is_current_or_carried("chain", "rattle", "elsewhere")


def test_a_column_that_is_added_leaves_all_that_was_carried(published):
    """The state for which the file was written, with fewer columns, is one of equal bits, as those before it."""
    known, here = read_carried(published), digest_present_code()
    (added, _), *fewer = here.columns.items()
    published.write_text(to_json(replace(known, now=replace(known.now, columns=dict(fewer)))))
    carried.list_equal_generations.cache_clear()
    assert [g.columns.keys() for g in carried.list_equal_generations()[:2]] == [
        here.columns.keys(),
        {*here.columns} - {added},
    ]
    assert len(carried.list_equal_generations()) == 4
    without = CodeDigests({}, {}, here.measuring, "j", "runs", here.running, dict(fewer))
    assert bring_forward(without).columns == here.columns
    assert is_measuring_carried(ColumnDigests(here.measuring, dict(fewer)).digest)
    other = ColumnDigests(here.measuring, {**dict(fewer), added: "other"})
    assert not is_measuring_carried(other.digest) and not is_measuring_carried(other.digest, {other.digest: other})


def test_a_run_measured_with_fewer_columns_is_current_where_its_folder_tells_them():
    """No file of what was carried is needed; one column that was measured in another way is enough for the opposite."""
    here = digest_present_code().measured
    name = "phi_max"
    fewer = ColumnDigests(here.measuring, {k: v for k, v in here.columns.items() if k != name})
    other = ColumnDigests(here.measuring, here.columns | {name: "other"})
    known = {state.digest: state for state in (fewer, other)}
    assert is_measuring_carried(here.digest) and is_measuring_carried("")
    assert is_measuring_carried(fewer.digest, known) and not is_measuring_carried(fewer.digest)
    assert not is_measuring_carried(other.digest, known)
    assert (fewer.list_stale(here), other.list_stale(here)) == ((), (name,))
    assert replace(other, measuring="other").list_stale(here) == tuple(other.columns)


def test_a_change_after_the_last_carry_ends_it(published):
    """The file speaks of the code that was run, not of what came after."""
    known = read_carried(published)
    published.write_text(to_json(replace(known, now=replace(known.now, measuring="changed"))))
    carried.list_equal_generations.cache_clear()
    assert carried.list_equal_generations() == (digest_present_code(),)
    assert not is_current_or_carried("chain", "rattle", FIRST.digest_run_code("chain", "rattle"))


def test_judges_that_changed_judge_runs_that_were_carried(published):
    """A change of judging asks for no run; what was published of the old judges is theirs."""
    known = read_carried(published)
    published.write_text(to_json(replace(known, now=replace(known.now, judging="before"))))
    carried.list_equal_generations.cache_clear()
    assert is_current_or_carried("chain", "rattle", FIRST.digest_run_code("chain", "rattle"))
    assert bring_forward(CodeDigests(FIRST.solvers, FIRST.problems, FIRST.measuring, "j1", "runs")).judging == "j1"
    other = replace(SECOND, judging="j2")
    assert [
        g.judging
        for g in add_generation(other, digest_present_code(), add_generation(FIRST, SECOND, None, *ALL), *ALL).before
    ] == ["", "j2"]


def test_a_chain_begins_anew_where_a_link_is_missing():
    """What was carried to code that nobody compared with this parent says nothing about it."""
    assert add_generation(SECOND, digest_present_code(), add_generation(FIRST, SECOND, None, *ALL), *ALL).before == (
        FIRST,
        SECOND,
    )
    assert add_generation(SECOND, digest_present_code(), add_generation(FIRST, FIRST, None, *ALL), *ALL).before == (
        SECOND,
    )


def test_a_solver_whose_runs_differ_is_left_out_of_all_generations():
    """Its published results are older than its code, whatever was shown of it before."""
    found = add_generation(
        SECOND, digest_present_code(), add_generation(FIRST, SECOND, None, *ALL), {"other"}, {"chain"}
    )
    assert all(not g.solvers and g.problems for g in found.before)
    assert not any(g.includes(CodeDigests({"rattle": "r1"}, {}, "m1", "", "")) for g in found.before)
    assert not any(g.digest_run_code("chain", "rattle") for g in found.before)


def test_a_damaged_file_is_named(tmp_path):
    path = tmp_path / "carried.json"
    path.write_text('{"now": 1}')
    with pytest.raises(FileError, match=r"carried\.json"):
        read_carried(path)
    assert read_carried(tmp_path / "none.json") is None

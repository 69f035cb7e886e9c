"""Bundles that were edited: the ladder removes each, or our own re-run, or the independent checker shows it."""

import json

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.lab.ladder import bundling
from mbsbench.harness.lab.ladder.bundling import check_bundle, read_entry, write_bundle
from mbsbench.harness.lab.ladder.instances import digest_submission
from mbsbench.harness.lab.ladder.ranking import INDEPENDENT, RE_RUN, rank_entries
from mbsbench.harness.lab.ladder.submission import BlindWorker, Submission, run_submission
from mbsbench.tests.covering import every

from .bundles import NEW_DIGESTS, OF_A_RUN, OF_NUMBERS, OLD_DIGESTS, members_of, write_as_it_is, write_edited
from .forger import NAME
from .test_submissions import SHORT, TEXT


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """That of an honest submission."""
    place = tmp_path_factory.mktemp("bundle")
    file, path = place / "honest.py", place / "honest.zip"
    file.write_text(TEXT.format("nothing"))
    with BlindWorker() as blind:
        run_submission(
            Submission(NAME, "dt", str(file), digest_submission(file.read_bytes())),
            "1",
            place / "run",
            kinds=SHORT,
            repeats=1,
            blind=blind,
        )
    write_bundle(place / "run", path)
    return path


def edited(bundle, tmp_path, edit, write=write_edited):
    members, path = members_of(bundle), tmp_path / "edited.zip"
    edit(members)
    write(path, members)
    return path


@pytest.mark.sampled(0)
def test_an_honest_bundle_is_an_entry(bundle, tmp_path):
    """As it was written, and written again with the same digests."""
    for path in (bundle, edited(bundle, tmp_path, lambda m: None)):
        entry = read_entry(path, SHORT)
        (row,) = rank_entries([(entry, INDEPENDENT)])
        assert not row.forged and row.rank == 1 and row.points == 1 and not row.leads
        assert check_bundle(path) == []


@pytest.mark.parametrize("how", OLD_DIGESTS)
def test_an_edit_without_new_digests_is_removed(bundle, tmp_path, how):
    """The manifest says so."""
    entry = read_entry(edited(bundle, tmp_path, OLD_DIGESTS[how], write_as_it_is), SHORT)
    (row,) = rank_entries([(entry, INDEPENDENT)])
    assert row.forged and row.rank == 0


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"PK" + b[2:100]])
def test_what_is_no_bundle_is_removed(bundle, tmp_path, damage):
    """Half a file, no file, the beginning of one."""
    path = tmp_path / "damaged.zip"
    path.write_bytes(damage(bundle.read_bytes()))
    assert read_entry(path, SHORT).forged


@pytest.mark.sampled(4)
@pytest.mark.parametrize("how", NEW_DIGESTS)
def test_runs_that_were_not_drawn_are_removed(bundle, tmp_path, how):
    """Instances follow from the digest of the submission and the seed: anybody draws them again."""
    assert read_entry(edited(bundle, tmp_path, NEW_DIGESTS[how]), SHORT).forged


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", OF_A_RUN)
def test_our_own_run_shows_false_costs_and_errors(bundle, tmp_path, how):
    """An independent entry never leads; where we have run its submission again, what differs removes it."""
    theirs = read_entry(edited(bundle, tmp_path, OF_A_RUN[how]), SHORT)
    rows = rank_entries([(read_entry(bundle, SHORT), RE_RUN), (theirs, INDEPENDENT)])
    assert [(r.label, bool(r.forged)) for r in rows] == [(RE_RUN, False), (INDEPENDENT, True)]
    (alone,) = rank_entries([(theirs, INDEPENDENT)])
    assert not alone.leads


@pytest.mark.sampled(1)
@pytest.mark.parametrize("how", every(OF_NUMBERS, 4))
def test_the_checker_finds_what_is_not_computed(bundle, tmp_path, how):
    """Records, states and references with new digests: a program that shares no code computes them anew."""
    path = edited(bundle, tmp_path, OF_NUMBERS[how])
    assert json.dumps(members_of(path)["records.json"].decode())
    assert check_bundle(path)


def test_nothing_is_ranked_without_the_checker(bundle, tmp_path, monkeypatch, capsys):
    """One line, exit code 2: an installation without it has no means to believe a bundle."""
    monkeypatch.setattr(bundling, "CHECKER", tmp_path / "check_bundle.py")
    (tmp_path / "entry.zip").write_bytes(bundle.read_bytes())
    assert main(["ladder", str(tmp_path)]) == 2
    ended = capsys.readouterr()
    assert "cannot be ranked without the independent checker" in ended.err and ended.err.count("\n") == 1
    assert not (tmp_path / "index.html").exists()


@pytest.mark.parametrize("lossless", [True, False])
def test_an_entry_without_evidence_is_removed(bundle, tmp_path, lossless):
    """Its numbers are consistent and its states left out, whether or not it calls itself lossless."""

    def hide(members):
        members["bundle.json"] = json.dumps(json.loads(members["bundle.json"]) | {"lossless": lossless}).encode()
        nothing = {"states": "none", "problem": "", "peaks_s": {}, "arrays": {}, "reactions": {}, "between": False}
        members["runs.json"] = json.dumps([run | nothing for run in json.loads(members["runs.json"])]).encode()
        for name in [n for n in members if n.startswith(("runs/", "series/", "problems/", "references/"))]:
            del members[name]

    entry = read_entry(edited(bundle, tmp_path, hide), SHORT)
    (row,) = rank_entries([(entry, INDEPENDENT)])
    assert row.rank == 0 and any("evidence" in words for words in row.forged)

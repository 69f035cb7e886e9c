"""One claim: shown as published, and its runs alone made and judged."""

import json

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.referee.claims.register import read_register
from mbsbench.harness.results.judgements import files

CHEAP = "1-any-duration"  # one step a run


def test_a_claim_is_shown_as_published(capsys):
    assert main(["claim", "6-gc-planar"]) == 0
    said = capsys.readouterr().out
    (published,) = (c for c in files.read_claims(files.PUBLISHED) if c.id == "6-gc-planar")
    found = f"at the paper's settings: {published.paper.verdict}", f"beyond them: {published.beyond.verdict}"
    for words in (published.claim, published.quote, *found, "why: ", "tried with gauge", "claim 6-gc-planar --run"):
        assert words in said
    assert main(["claim", "6-gc-planar", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["id"] == "6-gc-planar"


@pytest.mark.slow
def test_the_runs_of_a_claim_alone_are_made_and_judged(tmp_path, capsys):
    """Of the suite's thousands; a second call makes none of them again."""
    folder = tmp_path / "one"
    (own,) = (c for c in read_register().claims if c.id == CHEAP)
    for _ in range(2):
        assert main(["claim", CHEAP, "--run", "--out", str(folder), "--jobs", "1", "--json"]) in (0, 1)
        found = json.loads(capsys.readouterr().out)
        runs = {p.name: p.stat().st_mtime_ns for p in (folder / "runs").iterdir()}
        assert len(runs) == len(found["settings_ids"]) > 0 and found["claim"] == own.claim
        assert "SUPPORTED" in {f["verdict"] for f in (found["paper"], found["beyond"]) if f}
        before = runs if _ == 0 else before
    assert runs == before

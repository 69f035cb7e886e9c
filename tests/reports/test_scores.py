"""Who holds, who drifts, who breaks: counted from the cells, said only where they show it."""

from reports.overview import matrix
from reports.reading import read_run
from reports.scores import broadest, finest, headline, score, verdicts
from tests.reports.conftest import put, record


def answers(folder) -> dict[str, str]:
    run = read_run(folder)
    return {question: answer for _, question, answer in headline(verdicts(run), broadest(run))}


def test_finest_settings_speak_for_a_solver_and_the_rest_are_counted(tmp_path):
    """A coarse step that fails is no breakdown of the fine one, and not hidden either."""
    put(tmp_path, record("aa01", dt_s=0.01, status="diverged", message="too coarse"))
    put(tmp_path, record("aa02", dt_s=0.005))
    (v,) = verdicts(read_run(tmp_path))
    assert (v.finest.held, v.finest.cells) == (1, 1) and not v.breaks_on
    assert (v.everything.held, v.everything.stopped) == (1, 1)
    (part,) = matrix(read_run(tmp_path))
    entry = part.rows[0].entries[0]
    assert entry is not None and entry.head.record.cell == "aa02" and entry.score.cells == 2 and entry.kind == "good"


def test_a_wrong_cell_colours_its_entry_whatever_the_finest_did(tmp_path):
    put(tmp_path, record("aa01", dt_s=0.01, status="wrong", wrong_because='["no"]'))
    put(tmp_path, record("aa02", dt_s=0.005))
    entry = matrix(read_run(tmp_path))[0].rows[0].entries[0]
    assert entry is not None and entry.mark.kind == "good" and entry.kind == "wrong"


def test_questions_are_answered_from_the_numbers(tmp_path):
    """One holds, one drifts, one is wrong, one refuses: each is said where it belongs, and only there."""
    drift = {"energy_mean_first_quarter_J": 1e-4, "energy_mean_last_quarter_J": 9e-4}
    put(tmp_path, record("aa01", "alpha"))
    put(tmp_path, record("bb01", "beta", **drift))
    put(tmp_path, record("cc01", "gamma", "wrong", wrong_because='["it left"]'))
    put(tmp_path, record("dd01", "delta", "refused", message="rank"))
    told = answers(tmp_path)
    assert "alpha and beta" in told["Who holds"] and "On none: delta and gamma" in told["Who holds"]
    assert "beta on 1 of 1" in told["Who drifts"] and "alpha" not in told["Who drifts"]
    breaks = told["Who breaks, and why"]
    assert "gamma on pendulum (wrong: it left)" in breaks and "Refused beforehand: delta pendulum" in breaks
    assert "1 cell claimed success and is wrong" in breaks and "beta" not in breaks


def test_no_breakdown_and_no_drift_are_said_too(tmp_path):
    put(tmp_path, record("aa01", "alpha"))
    told = answers(tmp_path)
    assert told["Who breaks, and why"] == "None at its finest settings."
    assert "swings and comes back everywhere" in told["Who drifts"]


def test_broadest_label_is_that_of_most_pairs(tmp_path):
    """A map of many cells of one solver is no overview."""
    for k in range(9):
        put(tmp_path, record(f"m{k}", label="map", dt_s=0.001 * (k + 1)))
    put(tmp_path, record("aa01", "alpha", label="sound"))
    put(tmp_path, record("bb01", "beta", label="sound"))
    run = read_run(tmp_path)
    assert broadest(run) == "sound"
    head = finest(run.posings[0], "alpha", "sound")
    assert head is not None and head.record.cell == "aa01"


def test_scores_count_every_kind_of_ending(built):
    run = read_run(built[0])
    s = score(run.cells)
    assert (s.held, s.wrong, s.refused) == (3, 1, 1) and s.cells == len(run.cells)
    assert sum(share for _, _, share in s.shares) == 100.0

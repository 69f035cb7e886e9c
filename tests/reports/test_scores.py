"""Who holds, who drifts, who breaks: counted from the runs, said only where they show it."""

import json

from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.scores import finest, score, standings, unpredictable
from mbsbench.reports.model.variants import OTHER_PARAMETERS, broadest, themselves, variant_groups

from .conftest import because, put, record


def test_finest_settings_speak_for_a_solver_and_the_rest_are_counted(tmp_path):
    """A coarse step that fails is no breakdown of the fine one, and not hidden either."""
    put(tmp_path, record("aa01", dt_s=0.01, status="diverged", message="too coarse"))
    put(tmp_path, record("aa02", dt_s=0.005))
    (v,) = standings(read_results(tmp_path))
    assert (v.finest.succeeded, v.finest.runs) == (1, 1) and not v.breaks_on
    assert (v.everything.succeeded, v.everything.stopped) == (1, 1)


def test_each_solver_has_its_own_ending(tmp_path):
    """One succeeds, one drifts, one is wrong, one refuses: each is said where it belongs, and only there."""
    drift = {"energy_mean_first_quarter_J": 1e-4, "energy_mean_last_quarter_J": 9e-4}
    put(tmp_path, record("aa01", "alpha"))
    put(tmp_path, record("bb01", "beta", **drift))
    put(tmp_path, record("cc01", "gamma", "wrong", wrong_because=because("it left"), judged_to_s=0.5))
    put(tmp_path, record("cc02", "gamma", dt_s=0.001, label="work", judged_to_s=0.5))
    put(tmp_path, record("dd01", "delta", "refused", message="rank"))
    results = read_results(tmp_path)
    found = {v.solver: v for v in standings(results)}
    assert {s: [why for _, why in v.breaks_on] for s, v in found.items() if v.breaks_on} == {
        "gamma": ["it left reaches 2 m, more than 1 m; succeeds at dt = 0.001 s"], "delta": ["rank"],
    }  # fmt: skip
    assert unpredictable(results) == "Errors are judged while the motion is predictable: pendulum to 0.5 of 2 s."


def test_broadest_label_is_that_of_most_pairs(tmp_path):
    """A map of many runs of one solver is no overview."""
    for k in range(9):
        put(tmp_path, record(f"m{k}", label="map", dt_s=0.001 * (k + 1)))
    put(tmp_path, record("aa01", "alpha", label="sound"))
    put(tmp_path, record("bb01", "beta", label="sound"))
    results = read_results(tmp_path)
    assert broadest(results) == "sound"
    head = finest(results.variants[0], "alpha", "sound")
    assert head is not None and head.record.run_id == "aa01"


def test_problems_stand_before_their_variants(tmp_path):
    """Frames, units and shorter times are many and say nothing of who holds: they are counted apart."""
    put(tmp_path, record("aa01", "alpha"))
    for k in range(3):
        told = json.dumps({"t_end": 1.0, "yaw": 0.1 * (k + 1)})
        put(tmp_path, record(f"y{k}", label="symmetries", problem_parameters=told, status="wrong"))
        put(tmp_path, record(f"b{k}", f"beta{k}", label="symmetries", problem_parameters='{"t_end": 1.0}'))
    put(tmp_path, record("cc01", problem="other", label="symmetries"))
    results = read_results(tmp_path)
    label = broadest(results)
    assert label == "recommended"
    assert {p.title for p in themselves(results, label)} == {"pendulum", "other"}
    apart = {v.words: len(v.variants) for v in variant_groups(results, label)}
    assert apart == {OTHER_PARAMETERS: 1, "turned about the vertical": 3}
    (v,) = [v for v in standings(results) if v.solver == "alpha"]
    assert v.finest.runs == 1 and not v.breaks_on and v.everything.wrong == 3
    assert broadest(read_results(only(tmp_path, "symmetries"))) == "symmetries"


def only(folder, label):
    """The run without the runs of other labels."""
    for r in read_results(folder).runs:
        if r.record.label != label:
            (folder / "runs" / f"{r.record.run_id}.json").unlink()
    return folder


def test_scores_count_every_kind_of_ending(built):
    results = read_results(built[0])
    s = score(results.runs)
    assert (s.succeeded, s.wrong, s.refused) == (3, 1, 1) and s.runs == len(results.runs)
    assert sum(share for _, _, share in s.shares) == 100.0

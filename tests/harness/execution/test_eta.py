"""The time to go comes from what runs took before, not from the mean of whatever happened to end first."""

import pytest

from mbsbench.harness.execution.eta import Estimate, durations, in_words, schedule_end
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.store import create, write_record
from mbsbench.harness.suites.suite import parse_suite

from ..conftest import PLUGIN


def specs():
    text = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "sleeps"]\ndt = [0.1, 0.2, 0.4]\ncpu_limit = 50'
    return parse_suite(text, "t", "t", plugins=(str(PLUGIN),)).specs


def test_places_take_the_next_in_order():
    """Two places, times 3 2 2 in order beside one that needs 4 more: 4 | 3 + 2 -> then 2 after 4."""
    assert schedule_end([4.0], [3.0, 2.0, 2.0], 2) == 6.0
    assert schedule_end([], [1.0] * 10, 2) == 5.0 and schedule_end([], [], 2) == 0.0
    assert schedule_end([9.0], [1.0], 4) == 9.0


def test_earlier_times_are_scaled_by_how_today_compares():
    """Runs that took 1 and 10 s; the first takes 3 today, so the second is guessed at 30, a long one at its limit."""
    short, long, longest, *_ = specs()
    e = Estimate({short.settings_id: 1.0, long.settings_id: 10.0, longest.settings_id: 40.0})
    assert e.guess(long) == 10.0 and e.estimate_left([], [long, long], 2) == 10.0
    e.learn(short, 3.0)
    assert e.guess(long) == 30.0 and e.guess(longest) == 50.0


def test_unknown_runs_are_guessed_from_their_like():
    """Same problem and solver first; nothing known, nothing said."""
    a, b, c, d, *_ = specs()
    e = Estimate({})
    assert e.guess(a) is None and e.estimate_left([(a, 1.0)], [b], 1) is None
    e.learn(a, 8.0)
    e.learn(d, 2.0)
    assert e.guess(b) == 8.0 and e.estimate_left([(b, 5.0)], [c], 1) == 11.0
    assert e.estimate_left([(b, 500.0)], [], 1) == 0.0


def test_times_of_earlier_runs_are_found(tmp_path):
    """The newest folders; links and other things are none."""
    for name, seconds in (("ci-1", 1.0), ("ci-2", 2.0)):
        write_record(
            create(tmp_path / name),
            RunRecord(
                run_id="x", case="c", problem="p", solver="s", status="success", settings_id="abc", wall_s=seconds
            ),
        )
    (tmp_path / "latest").symlink_to("ci-1")
    (tmp_path / "stray").write_text("")
    assert durations(tmp_path, "ci") == {"abc": 2.0} and durations(tmp_path / "none") == {}


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (59, "59 s"), (61, "1 min 1 s"), (1200, "20 min"), (7300, "2 h 1 min")]
)
def test_times_in_words(seconds, words):
    """As precise as a guess can be."""
    assert in_words(seconds) == words

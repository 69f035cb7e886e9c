"""The time to go comes from what runs took before, and progress is counted in work, not in runs."""

import pytest

from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.store import create_folder, write_record
from mbsbench.harness.run.remaining_time import Expectation, format_duration, read_durations, schedule_end
from mbsbench.tests.factories import PLUGIN, parse_specs


def list_falls():
    text = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "sleeps"]\ndt = [0.1, 0.2, 0.4]\ncpu_limit = 50'
    return parse_specs(text, [PLUGIN])


def test_places_take_the_next_in_order():
    """Two places, times 3 2 2 in order beside one that needs 4 more: 4 | 3 + 2 -> then 2 after 4."""
    assert schedule_end([4.0], [3.0, 2.0, 2.0], 2) == 6.0
    assert schedule_end([], [1.0] * 10, 2) == 5.0 and schedule_end([], [], 2) == 0.0
    assert schedule_end([9.0], [1.0], 4) == 9.0


def test_what_is_left_goes_at_the_pace_of_what_has_ended():
    """Runs expected at 1, 10 and 40 s; after 200 s of runs that were expected at 100, the others take twice as long."""
    short, long, longest, *_ = list_falls()
    e = Expectation({short.settings_id: 100.0, long.settings_id: 10.0, longest.settings_id: 40.0})
    assert e.estimate_run(long) == 10.0 and e.estimate_time_left([], [long, long], 2) == 10.0
    e.note_time(short, 200.0)
    assert e.estimate_run(long) == pytest.approx(20.0, rel=0.02) and e.estimate_run(longest) == pytest.approx(
        80.0, rel=0.02
    )


def test_the_first_short_run_does_not_set_the_pace():
    """A run of 0.1 s that took 0.4 s says nothing on one of a minute."""
    short, long, *_ = list_falls()
    e = Expectation({short.settings_id: 0.1, long.settings_id: 60.0})
    e.note_time(short, 0.4)
    assert e.estimate_run(long) < 75.0


def test_a_late_run_is_never_about_to_end():
    """The last of 58, expected at 2 s: after 40 s it is not "about 0 s" from its end."""
    late, *_ = list_falls()
    e = Expectation({late.settings_id: 2.0})
    assert [e.estimate_remaining(late, since) for since in (1.0, 20.0, 60.0)] == [1.0, 10.0, 30.0]


def test_progress_counts_work():
    """57 of 58 runs are done, of 0.1 s each; the last takes a minute: most of the work is to come."""
    short, long, *_ = list_falls()
    e = Expectation({short.settings_id: 0.1, long.settings_id: 40.0})
    for _ in range(57):
        e.note_time(short, 0.1)
    assert e.compute_done_fraction([], [long]) == pytest.approx(5.7 / 45.7)
    assert (
        e.compute_done_fraction([(long, 20.0)], []) == pytest.approx(25.7 / 45.7)
        and e.compute_done_fraction([], []) == 1.0
    )


def test_times_of_earlier_runs_are_found(tmp_path):
    """The newest folders; links and other things are none."""
    for name, seconds in (("ci-1", 1.0), ("ci-2", 2.0)):
        write_record(
            create_folder(tmp_path / name),
            RunRecord(
                run_id="x", case="c", problem="p", solver="s", status="success", settings_id="abc", wall_s=seconds
            ),
        )
    (tmp_path / "latest").symlink_to("ci-1")
    (tmp_path / "stray").write_text("")
    assert read_durations(tmp_path, "ci") == {"abc": 2.0} and read_durations(tmp_path / "none") == {}


@pytest.mark.parametrize(
    ("seconds", "words"), [(0.4, "0 s"), (59, "59 s"), (61, "1 min 1 s"), (1200, "20 min"), (7300, "2 h 1 min")]
)
def test_times_in_words(seconds, words):
    """As precise as a guess can be."""
    assert format_duration(seconds) == words

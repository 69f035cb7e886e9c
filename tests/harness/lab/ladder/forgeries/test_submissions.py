"""Submissions that forge, each run on a hidden instance: none gains a success or a CPU time that is not its own."""

import pytest

from mbsbench.harness.base.forked_process import ForkedProcess
from mbsbench.harness.lab.ladder.blind import confine_process
from mbsbench.harness.lab.ladder.bundling import Entry
from mbsbench.harness.lab.ladder.instances import InstanceKind, digest_submission
from mbsbench.harness.lab.ladder.ranking import rank_entries
from mbsbench.harness.lab.ladder.submission import BlindWorker, Submission, read_submission, run_submission
from mbsbench.tests.covering import every

from .forger import AWAY, CONDUCT, COSTS, FALSE, NAME, WORK

TEXT = "from mbsbench.tests.harness.lab.ladder.forgeries.forger import make\n\nForger = make({!r}, __name__)\n"
SHORT = (
    InstanceKind(
        "spherical_pendulum", {"mass": 1.0, "half_length": 0.5, "omega_x": 5.0, "omega_z": 3.0}, {"t_end": 0.5}
    ),
)
TICKS = 0.9  # of the work: other processes are accounted in ticks of 10 ms


@pytest.fixture(scope="module")
def blind():
    """One process for all."""
    with BlindWorker() as process:
        yield process


@pytest.fixture(scope="module")
def fenced(tmp_path_factory):
    """Skip where the system keeps nobody in."""
    place = tmp_path_factory.mktemp("fence")
    if (
        ForkedProcess(lambda send: send(str(confine_process(place))), limit=5.0, memory=500.0).wait().sent.strip()
        != "True"
    ):
        pytest.skip("this system cannot keep a submission in (landlock, user namespaces)")


@pytest.fixture
def submit(tmp_path, blind):
    """The record of a forgery, and its row in the ladder."""

    def run(how, repeats=1):
        """Twice where it may keep something for a second process."""
        file = tmp_path / "forgery.py"
        file.write_text(TEXT.format(how))
        submission = Submission(NAME, "dt", str(file), digest_submission(file.read_bytes()))
        records = run_submission(
            submission, "1", tmp_path / "run", kinds=SHORT, steps=(2e-3,), repeats=repeats, blind=blind
        )
        entry = Entry("forgery.zip", NAME, submission.digest, "1", tuple(records))
        (row,) = rank_entries([(entry, "")])
        (record,) = records
        return record, row

    return run


def test_the_honest_motion_is_a_success(submit):
    """That all the others start from."""
    record, row = submit("nothing")
    assert record.status == "success" and row.points == 1, record


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", every(FALSE, 4))
def test_a_false_motion_is_no_success(submit, how):
    """Laws, the reference of the hidden instance, or the contract find it; claimed, it counts less than no answer."""
    record, row = submit(how)
    assert record.status in ("wrong", "inaccurate", "crashed"), record
    assert row.solved == 0 and row.points == (-1 if record.status != "crashed" else 0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("how", every(CONDUCT, 3))
def test_what_is_not_its_own_is_out_of_reach(fenced, submit, how):
    """Names, answers, files, clocks, other processes: the motion that it returns without them is false."""
    record, row = submit(how, repeats=2 if "kept" in how else 1)
    assert record.status not in ("success", "refused") and row.points <= 0, record


@pytest.mark.parametrize("how", every(COSTS, 2))
def test_all_work_is_in_the_cost(submit, how):
    """Wherever it is done, and whatever the submission's clocks say."""
    record, _ = submit(how, repeats=2 if "first" in how else 1)
    assert record.status == "success" and record.cpu_min_s > TICKS * WORK, record


def test_nothing_is_prepared_when_a_file_is_first_looked_at(fenced, tmp_path):
    """Its digest and the seed are known then: what is computed of the instances must not be there when it runs."""
    file = tmp_path / "forgery.py"
    file.write_text(TEXT.format("an answer prepared before the runs"))
    assert read_submission(str(file)).name == NAME
    assert not AWAY.with_suffix(".prepared").exists()


@pytest.mark.sampled(0)
def test_there_are_enough_kinds():
    """The honest count."""
    assert len(FALSE) + len(CONDUCT) + len(COSTS) >= 60

"""What another process changes in a results folder while its suite runs is noticed at the end, and by readers later."""

import json
import shutil

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import stamps, store
from mbsbench.harness.run.pool import LocalPool, PoolError
from mbsbench.tests.covering import few
from mbsbench.tests.factories import run_suite_text

SUITE = """
[[runs]]
problem = "spherical_pendulum"
solver = "rk45_strong_form"
rtol = [1e-4, 1e-5]
parameters = { t_end = 0.1 }
"""


def append(path):
    path.write_bytes(path.read_bytes() + b"x")


def flip(path):
    """Of the same size: one bit of the middle."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def remove(path):
    path.unlink()


def link(path):
    path.rename(path.with_name(".elsewhere"))
    path.symlink_to(".elsewhere")


def later(harm, pattern):
    """A pool that, once all runs are done, does harm to a file of the folder as another process would."""

    class Harmed(LocalPool):
        def run(self, jobs, limit=None):
            super().run(jobs, limit)
            harm(sorted(folders[0].glob(pattern))[0])

    folders = []
    return folders, Harmed


CHANGES = [
    ("series/*", flip, "1 of 2 results"),
    ("series/*", remove, "1 of 2 results"),
    ("series/*", link, "1 of 2 results"),
    ("runs/*.json", flip, "1 of 2 results"),
    ("runs/*.json", remove, "1 of 2 results"),
    ("environment.json", append, "environment.json in"),
    ("environment.json", remove, "environment.json in"),
    ("environment.?*.json", flip, "in .* is gone, or not as written"),
    ("suite.toml", append, "suite.toml in"),
    ("suite.toml", link, "it is a link"),
]
OFTEN = {"series/*": flip, "runs/*.json": remove, "environment.json": append, "suite.toml": link}  # each file, each way


@pytest.mark.parametrize(
    ("pattern", "harm", "said"), few(CHANGES, lambda change: OFTEN.get(change[0], flip) is change[1])
)
def test_a_change_during_a_suite_ends_it_with_an_error(tmp_path, pattern, harm, said):
    """Counted and said; the results of both runs would else be as good as done."""
    folders, pool = later(harm, pattern)
    folders.append(tmp_path / "run")
    with pytest.raises((PoolError, OSError), match=said):
        run_suite_text(tmp_path / "run", SUITE, pool=pool, plugins=())


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A suite that nobody has changed."""
    folder = tmp_path_factory.mktemp("done") / "run"
    run_suite_text(folder, SUITE, plugins=())
    return folder


@pytest.fixture
def copied(done, tmp_path):
    return shutil.copytree(done, tmp_path / "copy")


def test_what_nobody_changed_is_read_without_a_word(copied):
    loaded = store.load(copied)
    assert len(loaded.records) == 2 and not loaded.unreadable


def edit_stamp(folder, **values):
    """The environment with other values, its digest as it was."""
    path = folder / "environment.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **values}))


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("environment.json", lambda f: edit_stamp(f, cpu="another")),
        ("environment.json", lambda f: edit_stamp(f, code="1")),
        ("environment.json", lambda f: (f / "environment.json").write_text("{")),
        ("suite.toml", lambda f: append(f / "suite.toml")),
    ],
)
def test_readers_say_that_the_stamp_does_not_fit(copied, capsys, name, change):
    """Which file, and why; exit code 1. The runs themselves are shown."""
    change(copied)
    loaded = store.load(copied)
    assert [path.name for path in loaded.unreadable] == [name] and len(loaded.records) == 2
    assert main(["show", str(copied)]) == 1
    out = capsys.readouterr()
    assert name in out.out + out.err


def test_run_again_the_folder_is_whole(copied):
    """What was changed is set aside and made anew, what was not is kept."""
    edit_stamp(copied, cpu="another")
    _, watcher = run_suite_text(copied, SUITE, plugins=(), resume=True)
    assert watcher.ran == [] and "environment.json" in watcher.set_aside
    assert not store.load(copied).unreadable and (copied / "set_aside" / "environment.json").exists()


def test_an_older_stamp_without_digests_is_taken_as_it_is(copied):
    path = copied / stamps.NAME
    plain = {k: v for k, v in json.loads(path.read_text()).items() if k not in (stamps.SEAL, stamps.FILES)}
    path.write_text(json.dumps(plain))
    assert not store.load(copied).unreadable

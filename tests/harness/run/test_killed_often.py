"""A long run killed and suspended at random times: nothing is lost, and the table is that of an undisturbed run."""

import contextlib
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import pytest
import threadpoolctl

from mbsbench.cli.keeping import make_series_choice
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.results import environment, store
from mbsbench.harness.results.provisional import is_provisional
from mbsbench.harness.run import origin
from mbsbench.harness.run.runner import Request, run_suite
from mbsbench.tests.factories import PLUGIN, Silent

from ..conftest import TIMED

SEED = 20


def suite_of(specs):
    """That many runs, a fifth of them with other endings than success."""
    other = specs // 5 // 3
    return f"""
name = "killed"
plugins = ["{PLUGIN}"]
[defaults]
cpu_limit = 1.0
[[runs]]
problem = "free_fall"
solver = "sleeps"
dt = [{", ".join(f"{0.1 + k / 1000:.3f}" for k in range(specs - 3 * other))}]
options = {{ seconds = 0.02 }}
[[runs]]
problem = "free_fall"
solver = ["gives_up", "raises", "refuses"]
dt = [{", ".join(f"{0.1 + k / 1000:.3f}" for k in range(other))}]
"""


def start(suite, folder, *more):
    line = (sys.executable, "-m", "mbsbench.cli", "run", str(suite), "--out", str(folder), "--jobs", "2", *more)
    return subprocess.Popen(line, cwd=environment.ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def done(folder):
    return {p.name: p.stat().st_mtime_ns for p in folder.glob("runs/[!.]*.json")}


SUSPENDED = 4.0  # [s] longer than the limit of a run and its grace


def suspend(process):
    """Everything, as a batch system does, for longer than any run may take."""
    found = [psutil.Process(process.pid), *psutil.Process(process.pid).children(recursive=True)]
    for call in ("suspend", "resume"):
        for p in found:
            with contextlib.suppress(psutil.NoSuchProcess):
                getattr(p, call)()
        time.sleep(SUSPENDED if call == "suspend" else 0.0)


@pytest.mark.sampled(0)
@pytest.mark.parametrize(
    ("RUNS", "KILLS", "SUSPENSIONS"),
    [(15, 2, 1), *(pytest.param(*many, marks=pytest.mark.slow) for many in ((30, 2, 1), (100, 20, 5)))],
)
def test_kills_and_suspensions_lose_nothing(tmp_path, RUNS, KILLS, SUSPENSIONS):
    """SIGKILL to the runner, every fourth time to its supervisor too, from its first moments to its last."""
    suite = tmp_path / "killed.toml"
    suite.write_text(suite_of(RUNS))
    rng, folder, kept, again = random.Random(SEED), tmp_path / "run", {}, set()
    for k in range(KILLS):
        process = start(suite, folder, *(("--resume",) if k else ()))
        aim = len(kept) + rng.randrange(0, 2 * (RUNS - len(kept)) // (KILLS - k) + 1)  # about even over the run
        until = time.monotonic() + 60.0
        while len(done(folder)) < min(aim, RUNS - 1) and process.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        time.sleep(rng.uniform(0.0, 0.3))
        if k % (KILLS // SUSPENSIONS) == 0 and process.poll() is None:
            suspend(process)
        if k % 4 == 3 or k == KILLS - 1:
            for child in psutil.Process(process.pid).children() if process.poll() is None else ():
                child.kill()
        process.send_signal(signal.SIGKILL)
        process.communicate()
        time.sleep(0.3)  # the supervisor sees its input end and kills what runs
        now = done(folder)
        time.sleep(0.5)
        assert done(folder) == now  # nobody goes on in the dark
        assert all(now.get(name) == when for name, when in kept.items() if name.removesuffix(".json") not in again)
        kept = now
        again = {r.run_id for r in store.load(folder).records if is_provisional(r)}
    assert not store.load(folder).unreadable
    again = {r.run_id for r in store.load(folder).records if is_provisional(r)}
    out, _ = start(suite, folder, "--resume").communicate(timeout=300)
    assert f"{len(kept) - len(again)} already done" in out or len(kept) == len(again), out
    assert all(done(folder)[name] == when for name, when in kept.items() if name.removesuffix(".json") not in again)
    calm = load_suite(str(suite))
    run_suite(Request(calm, tmp_path / "calm", 2, choose_rows=make_series_choice(calm)), Silent())
    loaded = [store.load(x) for x in (folder, tmp_path / "calm")]
    killed, calm = (store.table(x.records).drop(columns=TIMED) for x in loaded)
    assert len(killed) == RUNS and killed.equals(calm), killed.compare(calm).to_string()
    assert len(pd.read_parquet(folder / "runs.parquet")) == RUNS
    aside = [store.read_record(p) for p in folder.glob("set_aside/*.json")]
    assert {r.ended_by for r in aside} <= {"suspended"}


def test_the_environment_of_a_run_does_not_depend_on_what_else_is_imported(monkeypatch):
    """Libraries of linear algebra that come with another package change no number of ours."""
    before = origin.describe_environment("f", "s", 1, ())
    found = [{**one, "num_threads": 1} for one in threadpoolctl.threadpool_info()]
    other = {
        **found[0],
        "version": "0",
        "filepath": str(Path(np.__file__).parents[1] / "other.libs" / "libopenblas.so"),
    }
    monkeypatch.setattr(threadpoolctl, "threadpool_info", lambda: [*found, other])
    assert environment.digest_environment(
        origin.describe_environment("f", "s", 1, ())
    ) == environment.digest_environment(before)
    monkeypatch.setattr(threadpoolctl, "threadpool_info", lambda: [{**one, "version": "0"} for one in found])
    assert environment.digest_environment(
        origin.describe_environment("f", "s", 1, ())
    ) != environment.digest_environment(before)

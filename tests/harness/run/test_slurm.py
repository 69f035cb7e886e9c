"""The recipe of docs/running.md on a real SLURM: one node, its three daemons started here on ports of their own."""

import os
import re
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from mbsbench import load
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.run.pool import PoolError

pytest.importorskip("dask_jobqueue", reason="needs the extra 'cluster'")
distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
from mbsbench.harness.run.cluster import on_slurm  # noqa: E402

DAEMONS = ("munged", "slurmctld", "slurmd")
UP, DONE = 60.0, 600.0  # [s] for the daemons, for a suite; much less when idle
PAGE = (ROOT / "docs" / "running.md").read_text(encoding="utf-8")
(SMALL,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
(RECIPE,) = (textwrap.dedent(b) for b in re.findall(r"(?:^(?: {4}.*)?\n)+", PAGE, re.MULTILINE) if "on_slurm" in b)
MBSBENCH = Path(sys.executable).with_name("mbsbench")
CONF = """
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={at}/munge.socket
CryptoType=crypto/munge
StateSaveLocation={at}/state
SlurmdSpoolDir={at}/spool
SlurmctldPidFile={at}/slurmctld.pid
SlurmdPidFile={at}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=batch_sched_delay=0,sched_interval=1
SlurmdParameters=config_overrides
MpiDefault=none
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=64000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    """Ports that nobody listens on."""
    with ExitStack() as held:
        taken = [held.enter_context(socket.socket()) for _ in range(count)]
        for one in taken:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in taken]


@pytest.fixture(scope="module")
def slurm(tmp_path_factory):
    """A SLURM of one node with two cores, idle; skipped where it cannot start."""
    missing = [d for d in DAEMONS if not shutil.which(d, path=f"{os.environ['PATH']}:/usr/sbin")]
    if missing or os.geteuid() != 0:
        pytest.skip(
            f"a SLURM needs root and the Debian packages slurm-wlm and munge ({', '.join(missing) or 'no root'})"
        )
    at = tmp_path_factory.mktemp("slurm")
    for part in ("state", "spool"):
        (at / part).mkdir(mode=0o755)
    key, conf, host = at / "munge.key", at / "slurm.conf", socket.gethostname().split(".")[0]
    key.write_bytes(os.urandom(128))
    key.chmod(0o400)
    conf.write_text(CONF.format(host=host, ports=free_ports(2), at=at))
    patch = pytest.MonkeyPatch()
    patch.setenv("SLURM_CONF", str(conf))
    files = {"socket": "socket", "pid-file": "pid", "log-file": "log", "seed-file": "seed"}
    places = [f"--{option}={at / 'munge'}.{suffix}" for option, suffix in files.items()]
    lines = (
        ["munged", "--foreground", "--force", f"--key-file={key}", *places],
        ["slurmctld", "-D", "-f", str(conf)],
        ["slurmd", "-D", "-f", str(conf), "-N", host],
    )
    started = []
    try:
        for line in lines:
            with (at / f"{line[0]}.out").open("wb") as out:
                program = shutil.which(line[0], path=f"{os.environ['PATH']}:/usr/sbin")
                started.append(subprocess.Popen([program, *line[1:]], stdout=out, stderr=out))
            time.sleep(0.5)
        until, state = time.monotonic() + UP, ""
        while time.monotonic() < until and not (state := ask("sinfo", "-h", "-o", "%T")).startswith("idle"):
            time.sleep(0.5)
        if not state.startswith("idle"):
            last = {p.stem: p.read_text(errors="replace")[-300:] for p in at.glob("*.out")}
            pytest.skip(f"SLURM does not start here: its node is {state or 'unknown'!r}; {last}")
        yield at
    finally:
        for process in started[::-1]:
            process.terminate()
        for process in started:
            process.wait(20.0)
        patch.undo()


def ask(*line):
    """The output of a command of SLURM; empty where it fails."""
    done = subprocess.run(line, capture_output=True, text=True, timeout=20.0, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def numbers(records):
    """The columns of a run that do not depend on where it was made."""
    return {r.run_id: (r.status, r.steps, r.energy_drift_max_J) for r in records}


def wait_until_no_job_is_left():
    until = time.monotonic() + UP
    while (left := ask("squeue", "-h", "-o", "%i")) and time.monotonic() < until:
        time.sleep(0.5)
    assert not left


@pytest.mark.slow
def test_the_recipe_of_the_page_runs_its_suite_on_slurm(slurm, tmp_path, monkeypatch):
    """Two jobs of SLURM run the suite; steps are those of a run on this machine, and no job is left."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(MBSBENCH.parent), prepend=os.pathsep)
    Path("small.toml").write_text(SMALL)
    done = subprocess.run([sys.executable, "-c", RECIPE], capture_output=True, text=True, timeout=DONE, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    there = numbers(r.record for r in load("latest").runs)
    assert len(list(Path().glob("slurm-*.out"))) == 2
    subprocess.run([MBSBENCH, "run", "small.toml", "--out", "here"], check=True, capture_output=True, timeout=DONE)
    assert there == numbers(store.load(Path("here")).records) and len(there) == 3, done.stdout
    wait_until_no_job_is_left()


@pytest.mark.slow
def test_runs_of_a_cancelled_job_go_to_another(slurm, tmp_path, monkeypatch):
    """``scancel`` to a job in mid-run: each run has its record, with the numbers of a run on this machine."""
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(SMALL.replace("t_end = 0.2", "t_end = 2.0").replace("0.002, 0.001", "2e-4, 1e-4"))
    with on_slurm() as cluster, distributed.Client(cluster) as client:
        cluster.scale(2)
        client.wait_for_workers(2, timeout=DONE)
        jobs = client.run(os.getenv, "SLURM_JOB_ID")
        line = [MBSBENCH, "run", "small.toml", "--cluster", cluster.scheduler_address, "--out", "there"]
        with subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as command:
            until, busy = time.monotonic() + DONE, []
            while not busy and command.poll() is None and time.monotonic() < until:
                busy = [jobs[worker] for worker, runs in client.processing().items() if runs]
                time.sleep(0.05)
            subprocess.run(["scancel", busy[0]], check=True)
            out, _ = command.communicate(timeout=DONE)
        assert command.returncode == 0, out
        assert busy[0] not in client.run(os.getenv, "SLURM_JOB_ID").values()
    subprocess.run([MBSBENCH, "run", "small.toml", "--out", "here"], check=True, capture_output=True, timeout=DONE)
    there, here = (numbers(store.load(Path(name)).records) for name in ("there", "here"))
    assert there == here and len(there) == 3 and {status for status, *_ in there.values()} == {"success"}
    wait_until_no_job_is_left()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"memory": "900GB"}, "Requested node configuration is not available"),
        ({"queue": "elsewhere"}, "invalid partition specified: elsewhere"),
    ],
)
def test_a_job_that_slurm_refuses_is_one_line(slurm, options, words):
    with pytest.raises(PoolError, match=f"SLURM refuses the job: .*{words}") as error:
        on_slurm(**options)
    assert "\n" not in str(error.value)

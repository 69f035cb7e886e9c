"""The recipe of docs/running.md on a real SLURM: one node, its three daemons started here on ports of their own."""

import os
import shutil
import socket
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from mbsbench.harness.results import store

pytest.importorskip("dask_jobqueue", reason="needs the extra 'cluster'")
distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
from mbsbench.harness.execution.cluster import on_slurm  # noqa: E402

DAEMONS = ("munged", "slurmctld", "slurmd")
UP, JOBS, DONE = 60.0, 240.0, 600.0  # [s] for the daemons, for the jobs to start, for a suite; much less when idle
SMALL = """
name = "small"

[[runs]]
problem = "heavy_top"
parameters = { t_end = 0.2 }
solver = ["gc_weak_form", "rk45_strong_form"]
dt = [0.002, 0.001]
rtol = 1e-8
"""  # that of docs/running.md
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


@pytest.fixture
def slurm(tmp_path_factory, monkeypatch):
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
    monkeypatch.setenv("SLURM_CONF", str(conf))
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


def ask(*line):
    """What a command of SLURM prints; empty where it fails."""
    done = subprocess.run(line, capture_output=True, text=True, timeout=20.0, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


@pytest.mark.slow
def test_the_recipe_runs_a_suite_on_slurm(slurm, tmp_path):
    """Two jobs of SLURM run the suite; steps are those of a run on this machine, and no job is left."""
    (tmp_path / "small.toml").write_text(SMALL)
    cluster = on_slurm(memory="8GB", walltime="02:00:00", log_directory=str(tmp_path / "logs"))
    try:
        cluster.scale(2)
        with distributed.Client(cluster) as client:
            client.wait_for_workers(2, timeout=JOBS)
            jobs = set(client.run(os.getenv, "SLURM_JOB_ID").values())
        assert set(ask("squeue", "-h", "-t", "running", "-o", "%i").split()) == jobs and len(jobs) == 2
        command = [str(Path(sys.executable).with_name("mbsbench")), "run", "small.toml"]
        line = [*command, "--cluster", cluster.scheduler_address, "--out", "on_slurm"]
        done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=DONE, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    finally:
        cluster.close()
    subprocess.run([*command, "--out", "here"], cwd=tmp_path, check=True, capture_output=True, timeout=DONE)
    there, here = ({r.run_id: r for r in store.load(tmp_path / name).records} for name in ("on_slurm", "here"))
    assert there.keys() == here.keys() and len(there) == 3
    assert [(r.status, r.steps, r.energy_drift_max_J) for r in there.values()] == [
        (here[k].status, here[k].steps, here[k].energy_drift_max_J) for k in there
    ]
    until = time.monotonic() + UP
    while (left := ask("squeue", "-h", "-o", "%i")) and time.monotonic() < until:
        time.sleep(0.5)
    assert not left

"""An engine in a process of its own: the same motion as here, its CPU time, its last words, and its end with ours."""

import os
import subprocess
import sys
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest

from mbsbench import make_problem
from mbsbench.harness.base.clock import cpu_seconds, list_descendants
from mbsbench.harness.catalogue.options import option
from mbsbench.harness.mechanics.types import Status, StepControl
from mbsbench.solvers.engines.export import process, protocol

PENDULUM = '''
import os, signal, sys
import numpy as np

class Model:
    """One hinge: phi'' = -k sin(phi - phi_0), semi-implicit Euler."""

    def __init__(self, data):
        (limb,), g = data["limbs"], np.array(data["gravity"])
        if limb["kind"] != "HINGE":
            raise ValueError(f"a {limb['kind']}, not a hinge")
        s, m, R = np.array(limb["s_child"]), limb["mass"], np.array(limb["R_0"])
        self.axis, self.g, self.m, self.s, self.R = np.array(limb["axis"]), R.T @ g, m, s, R
        self.J = self.axis @ np.array(limb["inertia"]) @ self.axis + m * np.cross(self.axis, s) @ np.cross(self.axis, s)
        self.q, self.u = np.array(data["start"]), np.array(data["start_velocity"])
        self.notes, self.stopped, self.fault = ["a pendulum"], "", data["options"]["fault"]

    def torque(self, q):
        a = self.axis
        turned = self.g * np.cos(q) - np.cross(a, self.g) * np.sin(q) + a * (a @ self.g) * (1 - np.cos(q))
        return self.m * np.cross(-self.s, turned) @ a

    def describe_start(self):
        load = np.array([self.torque(self.q[0])])
        J = self.J * (1.0 + 1e-8 * (self.fault == "inertia"))
        return {"mass_matrix": np.array([[J]]), "rest_forces": load, "forces": load, "potential": None,
                "kinetic": 0.5 * self.J * self.u[0] ** 2, "constraints": []}

    def advance(self, steps, dt):
        if self.fault == "death":
            print("out of marbles", file=sys.stderr, flush=True)
            os.abort()
        if self.fault == "limit":
            os.kill(os.getpid(), signal.SIGXCPU)
        print("engines talk")
        rows = []
        for k in range(steps):
            if self.fault == "stop" and k == 3:
                self.stopped = "no further"
                break
            self.u = self.u + dt * self.torque(self.q[0]) / self.J
            self.q = self.q + dt * self.u
            rows.append([*self.q, *self.u])
        return np.array(rows)
'''


@dataclass(frozen=True)
class Pendulum(protocol.Adapter):
    """That of the text above."""

    fault: str = option("none", "what goes wrong", choices=("none", "death", "stop", "inertia"))

    name, inside, package, wheel = "pendulum", "pendulum", "pendulum", "pendulum"


@pytest.fixture
def apart(tmp_path, monkeypatch):
    """An environment with this Python, and the engine's file beside ``serve.py``."""
    (tmp_path / "pendulum.py").write_text(PENDULUM)
    (tmp_path / "serve.py").write_text((process.INSIDE / "serve.py").read_text())
    python = tmp_path / "engines" / "pendulum" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    python.chmod(0o755)
    monkeypatch.setattr(process, "INSIDE", tmp_path)
    monkeypatch.setattr(process, "ENVIRONMENTS", tmp_path / "engines")
    yield
    for one in list(process._processes.values()):
        one.close()
    process._processes.clear()


PROBLEM = "simple_pendulum", {"t_end": 1.0}


def test_it_moves_the_model_it_was_given(apart):
    """First order to the exact motion; what the engine prints is not in the way."""
    problem = make_problem(*PROBLEM)
    errors = []
    for dt in (2e-3, 1e-3):
        t = Pendulum().solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS, t.message
        errors.append(np.max(np.abs(t.states.r - problem.reference().states(t.t).r)))
    assert errors[1] == pytest.approx(0.5 * errors[0], rel=0.1)
    assert t.notes == ("1 bodies as a tree of 1 velocities", "a pendulum", "in a process of its own")


@pytest.mark.sampled(0)
def test_cpu_time_is_that_of_its_process(apart):
    """Stepping takes a hundred times what sending rows takes here; set-up is the start of an interpreter."""
    problem, here = make_problem(*PROBLEM), cpu_seconds()
    t = Pendulum().solve(problem, StepControl(dt=2e-5))
    assert t.cpu_time > 0.2 and t.setup_time > 0.02
    assert cpu_seconds() - here - t.setup_time < t.cpu_time


def test_the_limit_is_on_its_time_too(apart):
    t = Pendulum().solve(make_problem(*PROBLEM), StepControl(dt=1e-5, cpu_limit=0.5))
    assert t.status is Status.STALLED and "CPU limit" in t.message and t.counters["steps"] > 0


def test_a_dying_engine_leaves_its_last_words(apart, capfd):
    problem = make_problem(*PROBLEM)
    t = Pendulum("death").solve(problem, StepControl(dt=1e-3))
    assert t.status is Status.CRASHED and t.counters["steps"] == 0
    assert t.message.endswith("the process of pendulum was ended by SIGABRT: out of marbles")
    assert "out of marbles" in capfd.readouterr().err
    assert Pendulum().solve(problem, StepControl(dt=1e-3)).status is Status.SUCCESS  # the next has a new one


def test_a_limit_of_the_system_in_its_process_is_no_crash(apart):
    t = Pendulum("limit").solve(make_problem(*PROBLEM), StepControl(dt=1e-3))
    assert t.status is Status.STALLED and t.message.endswith("the CPU limit was reached in the process of pendulum")


def test_a_stop_keeps_the_steps_before(apart):
    t = Pendulum("stop").solve(make_problem(*PROBLEM), StepControl(dt=1e-3))
    assert t.status is Status.DIVERGED and t.counters["steps"] == 3 and t.message.endswith("no further")


def test_refusals_are_one_line(apart):
    said = Pendulum().refuses(make_problem("heavy_top"), StepControl(dt=1e-3))
    assert said == "pendulum does not take the model: a BALL, not a hinge"
    said = Pendulum("inertia").refuses(make_problem(*PROBLEM), StepControl(dt=1e-3))
    assert said is not None and "its mass matrix differs by 1e-08" in said


def test_an_older_model_is_not_stepped_for_a_newer_one(apart):
    problem, control = make_problem(*PROBLEM), StepControl(dt=1e-3)
    old, new = (protocol.Model(Pendulum(), replace(problem, t_end=end), control) for end in (1.0, 2.0))
    new.advance(1, 1e-3)
    with pytest.raises(ValueError, match="model 1 was replaced by model 2"):
        old.advance(1, 1e-3)


def test_it_ends_with_its_parent(apart, tmp_path):
    """Even where the parent has no time to say so."""
    asleep = f"""
import pathlib, time
from mbsbench.solvers.engines.export import process
process.INSIDE = pathlib.Path({str(tmp_path)!r})
one = process.Process("pendulum", pathlib.Path({str(tmp_path / "engines/pendulum/bin/python")!r}))
print(one.process.pid, flush=True)
time.sleep(60)
"""
    parent = subprocess.Popen([sys.executable, "-c", asleep], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    assert pid in list_descendants(os.getpid())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    until = time.monotonic() + 10.0
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < until:
        time.sleep(0.01)
    assert not os.path.exists(f"/proc/{pid}")

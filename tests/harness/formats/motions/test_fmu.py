"""FMUs are judged like files of any other code: three of our problems, built by pythonfmu3 (FMI 3.0, co-simulation).

The public Reference-FMUs hold no mechanisms.
"""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench import StepControl, make_problem
from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.formats.motions.judge import FileSettings, judge_file

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("fmpy") is None or importlib.util.find_spec("pythonfmu3") is None,
    reason="fmpy is an optional extra: formats; pythonfmu3 builds what is judged",
)

SLAVE = '''
import numpy as np
from pythonfmu3 import DefaultExperiment, Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

class {name}(Fmi3Slave):
    """One rigid body about a fixed point or free: r, quaternion, Omega by the classical Runge-Kutta method."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.author, self.default_experiment = "tests", DefaultExperiment(step_size={step})
        self.y = np.array({start})
        self.J, self.torque, self.s = np.array({J}), np.array({torque}), np.array({s})
        self.time = 0.0
        clock = {{"causality": Fmi3Causality.independent, "variability": Fmi3Variability.continuous}}
        self.register_variable(Float64("time", **clock))
        for k, name in enumerate({names}):
            self.register_variable(Float64(name, causality=Fmi3Causality.output, getter=lambda k=k: self.values()[k]))

    def turn(self, q, a):
        w, x = q[0], q[1:]
        return a + 2.0 * np.cross(x, np.cross(x, a) + w * a)

    def values(self):
        q, Omega = self.y[:4] / np.linalg.norm(self.y[:4]), self.y[4:]
        return [float(x) for x in (*self.turn(q, self.s), *q, *self.turn(q, np.cross(Omega, self.s)), *Omega)]

    def rates(self, y):
        q, Omega = y[:4], y[4:]
        q_dot = 0.5 * np.array([-q[1:] @ Omega, *(q[0] * Omega + np.cross(q[1:], Omega))])
        weight = self.turn(q * [1, -1, -1, -1], self.torque)
        load = np.cross(self.s, weight) - np.cross(Omega, self.J @ Omega)
        return np.array([*q_dot, *np.linalg.solve(self.J, load)])

    def do_step(self, current_time, step_size):
        h, y = step_size, self.y
        k1 = self.rates(y)
        k2 = self.rates(y + h / 2 * k1)
        k3 = self.rates(y + h / 2 * k2)
        k4 = self.rates(y + h * k3)
        self.y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        {after}
        return True
'''
PLAIN = ("x", "y", "z", "q0", "q1", "q2", "q3", "vx", "vy", "vz", "wx", "wy", "wz")
MODELICA = ("pos[1]", "pos[2]", "pos[3]", *PLAIN[3:])
CASES = {"heavy_top": PLAIN, "spherical_pendulum": PLAIN, "torque_free_body": MODELICA}


def built(folder: Path, name: str, after: str = "pass", names=None) -> Path:
    """The FMU of a problem with one body, from what ``export`` prints."""
    from pythonfmu3.builder import FmuBuilder

    problem = make_problem(name, {"t_end": 0.2})
    s, start = problem.system, problem.initial
    arm = -s.joint_s_i[0] if s.nj else np.zeros(3)
    J = s.inertia[0] + s.mass[0] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    q = Rotation.from_matrix(start.R[0]).as_quat(scalar_first=True)
    text = SLAVE.format(
        name="Body",
        step=problem.dt,
        start=[*map(float, (*q, *start.Omega[0]))],
        J=J.tolist(),
        s=arm.tolist(),
        torque=(s.mass[0] * s.gravity).tolist(),
        names=names or CASES[name],
        after=after,
    )
    script = folder / "body.py"
    script.write_text(text)
    return Path(FmuBuilder.build_FMU(str(script), dest=str(folder)))


@pytest.mark.parametrize("name", CASES)
def test_an_fmu_is_judged_like_a_file(tmp_path, name, capsys):
    """It runs at its own communication step; the classical method of order 4 is right to 1e-6 m."""
    columns = [] if CASES[name] is PLAIN else ["--columns", "x=pos[1],y=pos[2],z=pos[3]"]
    path = built(tmp_path, name)
    code = main(["referee", name, str(path), "--t-end", "0.2", "--json", *columns])
    record = json.loads(capsys.readouterr().out)
    assert code == 0 and record["status"] == "success", record["message"]
    assert record["position_error_max_m"] < 1e-6


def test_the_communication_step_is_that_of_dt(tmp_path):
    """Half the step, a sixteenth of the error: the method is of order four."""
    path, problem = built(tmp_path, "heavy_top"), make_problem("heavy_top", {"t_end": 0.2})
    settings = [FileSettings("rk4"), *(FileSettings("rk4", control=StepControl(dt=dt)) for dt in (0.004, 0.002))]
    own, *coarse = (judge_file(problem, path, one, None) for one in settings)
    errors = [r.position_error_max_m for r in coarse]
    assert own.dt_s == make_problem("heavy_top").dt
    assert 12.0 < errors[0] / errors[1] < 20.0


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ("import os; os._exit(3)", "its process exited with code 3"),
        ("raise ArithmeticError", "fmi3DoStep"),
    ],
)
def test_an_fmu_that_fails_is_reported_in_one_line(tmp_path, after, words):
    """It may end the process that it runs in, which is not ours."""
    path, problem = built(tmp_path, "heavy_top", after), make_problem("heavy_top", {"t_end": 0.2})
    with pytest.raises(FileError) as error:
        judge_file(problem, path, FileSettings("x"), None)
    assert words in str(error.value) and "\n" not in str(error.value) and ".fmu" in str(error.value)


def test_outputs_that_are_no_motion_are_named(tmp_path):
    path = built(tmp_path, "heavy_top", names=tuple(f"out_{k}" for k in range(13)))
    with pytest.raises(FileError, match=r"no positions of the body.*its columns: time, out_0"):
        judge_file(make_problem("heavy_top", {"t_end": 0.2}), path, FileSettings("x"), None)

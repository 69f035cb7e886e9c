"""A motion is not wrong because parts of a mechanism's file are omitted."""

import numpy as np
import pytest

from mbsbench import make_problem
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue import registry
from mbsbench.harness.formats.motions.conventions import Reading
from mbsbench.harness.formats.motions.judge import FileSettings, judge_file
from mbsbench.harness.reference.computation import find_reference

pytest.importorskip("mujoco")

LEG = """<mujoco><worldbody><body pos="0 0 1"><joint name="hip" type="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" contype="0" conaffinity="0"/>
</body></worldbody>{more}</mujoco>"""
SERVO = '<actuator><position joint="hip" kp="10"/></actuator>'


@pytest.fixture(autouse=True)
def own_catalogue(monkeypatch):
    for known in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
        monkeypatch.setattr(registry, known, type(getattr(registry, known))())


@pytest.mark.parametrize("more", ["", SERVO], ids=["passive", "servo"])
def test_a_motion_under_actuators_is_not_judged(tmp_path, more):
    """The servo may be why it gains energy; without one it is wrong. The passive motion is a success in both."""
    (tmp_path / "leg.xml").write_text(LEG.format(more=more))
    problem = make_problem(str(tmp_path / "leg.xml"), t_end=0.2)
    t, exact = np.linspace(0.0, 0.2, 201), find_reference(make_problem(problem.name, t_end=0.4))
    motions = {}
    for name, factor in (("passive", 1.0), ("driven", 1.5)):  # one and a half times as fast after the start
        s = exact.states(factor * t)
        rows = np.column_stack((t, s.r[:, 0], s.R[:, 0].reshape(-1, 9)))
        motions[name] = tmp_path / f"{name}.csv"
        names = ",".join(f"R{i}{j}" for i in "123" for j in "123")
        np.savetxt(motions[name], rows, fmt="%.12g", delimiter=",", header=f"t,x,y,z,{names}", comments="")
    given = FileSettings("other", Reading())
    assert judge_file(problem, motions["passive"], given, None).status == "success"
    rows = np.loadtxt(motions["passive"], delimiter=",", skiprows=1)
    rows[100:, 1] += 0.05 * np.linspace(0.0, 1.0, len(rows) - 100)  # the hip opens, which no servo does
    motions["open"] = tmp_path / "open.csv"
    np.savetxt(motions["open"], rows, fmt="%.12g", delimiter=",", header=f"t,x,y,z,{names}", comments="")
    assert judge_file(problem, motions["open"], given, None).status == "wrong"
    if more:
        with pytest.raises(FileError, match=r"not judged: .* omitted: actuators \(1\), which may be why"):
            judge_file(problem, motions["driven"], given, None)
    else:
        assert judge_file(problem, motions["driven"], given, None).status == "wrong"

"""Mutated models, URDF, MJCF and SDFormat: read, or refused in one line that a user can act on."""

import sys

import numpy as np
import pytest

from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.results.environment import ROOT

from ..harness.formats.mechanisms.test_sdformat import FRAMES, LOOP
from .fuzzing import COUNT, Tally, mutate

ROBOT = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -.5"/><mass value="2"/>
<inertia ixx=".2" iyy=".2" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0 .1 -.3" rpy=".1 0 0"/><mass value="1"/>
<inertia ixx=".1" iyy=".1" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping=".1"/></joint>
<joint name="b" type="continuous"><parent link="arm"/><child link="fore"/><origin xyz="0 0 -1"/><axis xyz="1 0 0"/>
</joint>
</robot>"""
MODELS = {
    "tree.sdf": FRAMES,
    "loop.sdf": LOOP,
    "robot.urdf": ROBOT,
    "chain.xml": (ROOT / "results" / "published" / "fuzz" / "exudyn-2.xml").read_text(encoding="utf-8"),
}


@pytest.mark.parametrize("name", MODELS)
def test_mutated_models_are_read_or_refused(tmp_path, name):
    """ValueError of one line, or a mechanism that can be assembled."""
    if not name.endswith(".sdf"):
        pytest.importorskip("mujoco", reason="MuJoCo reads URDF and MJCF")
    tally, path = Tally(f"models, {name}"), tmp_path / name
    path.write_text(MODELS[name])
    mechanism_files.read_mechanism(path)  # as it is; and what readers import late is there for all

    def read() -> int:
        try:
            mechanism_files.read_mechanism(path)
        except ValueError as error:
            sys.stdout.write(
                str(error).splitlines()[0] if str(error) else "Traceback (most recent call last): no words"
            )
            return 2
        return 0

    least = -(-COUNT // len(MODELS))
    for seed in range(least):
        random = np.random.default_rng([seed, len(name)])
        path.write_bytes(mutate(MODELS[name].encode(), random, numbers=0.7))
        tally.run(f"seed {seed}", read)
    tally.close(least)
    assert set(tally.codes) <= {0, 2}

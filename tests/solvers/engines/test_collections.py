"""Files of collections are compared with another code as far as readers read them: ``docs/compare_collections.py``."""

import dataclasses
import importlib.util
import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import mbsbench
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.formats.mechanisms.mechanism import CompiledMechanism

from .test_mechanism_files import LOOPS, SPRUNG, TREE, written
from .test_public_bodies import JOIN, PARALLELOGRAM, WORLD
from .test_public_files import BAR, ROBOT

sys.path.insert(0, str(Path(mbsbench.__file__).parent / "docs"))
import compare_collections

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None or importlib.util.find_spec("pinocchio") is None,
    reason="mujoco and pinocchio are optional extras: make test-engines",
)

FINGER = f"""<mujoco><option density="{{density}}"/><worldbody><body name="a" gravcomp=".5">
<joint name="pan" axis="0 0 1" armature=".1" frictionloss=".2"/>{BAR}<body name="b" pos="1 0 0">
<joint name="tilt" type="ball" stiffness="3" damping=".2" armature=".3"/>{BAR}<site name="tip" pos="1 0 0"/>
<geom size=".1" contype="1"/></body></body><geom name="floor" type="plane" size="9 9 1" pos="0 0 .05"/>
<site name="wall"/><site name="over" pos="0 1 0"/></worldbody>
<tendon><spatial stiffness="5" damping="1" springlength=".1"><site site="tip"/><site site="over"/><site site="wall"/>
</spatial></tendon><actuator><position joint="pan" kp="7" ctrlrange="1 2"/></actuator></mujoco>"""
ELBOW = ROBOT.replace('lower="0" upper="0"', 'lower="-1" upper="1"').replace(
    "</joint>", '<dynamics damping=".3"/></joint>'
)


def compare(path):
    return compare_collections.compare_file(path)


@pytest.mark.parametrize("text", [TREE, SPRUNG.replace("gravity", 'timestep=".001" gravity'), LOOPS])
def test_what_is_read_whole_agrees(tmp_path, text):
    """Two texts of the same laws, from the file on: trees, springs, loops with springs between them."""
    found = compare(written(tmp_path, text))
    assert found["difference"] < compare_collections.SAME, found
    assert found["kind"].startswith("agrees")


def test_a_redundant_loop_agrees(tmp_path):
    """Three rows of the parallelogram's closing pin are redundant; both sides keep the rank."""
    found = compare(written(tmp_path, WORLD.format(PARALLELOGRAM, JOIN)))
    assert (found["kind"], found["difference"] < 1e-11) == ("agrees", True), found


@pytest.mark.parametrize(("angle", "left_out"), [(0.01, 1), (0.5, 0)])
def test_a_start_near_a_singular_pose_is_left_out(tmp_path, angle, left_out):
    """A parallelogram [deg from flat], whose rows lose their rank when it is flat; random states are compared."""
    text = f"""<body name="crank" euler="0 {angle} 0"><joint axis="0 1 0"/>{BAR}
    <body name="rod" pos="1 0 0" euler="0 {-angle} 0"><joint axis="0 1 0"/>{BAR}</body></body>
    <body name="rocker" pos="2 0 0" euler="0 {angle} 0"><joint axis="0 1 0"/>{BAR}</body>"""
    join = '<equality><connect body1="rod" body2="rocker" anchor="2 0 0"/></equality>'
    found = compare(written(tmp_path, WORLD.format(text, join)))
    assert (found["kind"], found["left_out"]) == ("agrees", left_out), found


def test_a_loop_that_cannot_move_is_not_compared(tmp_path):
    """Three bars of 1 m between pins 3 m apart: no other state is closed."""
    text = f"""<body name="crank"><joint axis="0 1 0"/>{BAR}<body name="rod" pos="1 0 0"><joint axis="0 1 0"/>{BAR}
    </body></body><body name="rocker" pos="3 0 1e-6"><joint axis="0 1 0"/>{BAR}</body>"""
    join = '<equality><connect body1="rod" body2="rocker" anchor="1 0 0"/></equality>'
    found = compare(written(tmp_path, WORLD.format(text, join)))
    assert (found["kind"], found["words"][:27]) == ("not compared", "its loops are not closed, o"), found


def test_parts_that_are_named_are_taken_away_on_the_other_side(tmp_path):
    """Everything of the file but gravity and inertia is named; without it both fall alike."""
    found = compare(written(tmp_path, FINGER.format(density="1.2")))
    assert (found["kind"], found["difference"] < 1e-11) == ("agrees without", True), found
    assert len(found["omitted"]) == 9


@pytest.mark.parametrize("kind", ["other dampers of joints", "armatures of axes that move", "fluid", "actuators"])
def test_a_part_that_is_not_named_is_a_difference(tmp_path, monkeypatch, kind):
    """Each kind that acts in the file, dropped without a word, is found."""
    read = mechanism_files.read_mechanism

    def read_in_silence(path):
        found = read(path)
        return dataclasses.replace(found, omitted={k: n for k, n in found.omitted.items() if k != kind})

    monkeypatch.setattr(compare_collections, "read_mechanism", read_in_silence)
    found = compare(written(tmp_path, FINGER.format(density="1.2")))
    assert (found["kind"], found["difference"] > 1e-6) == ("differs", True), found


@pytest.mark.parametrize("text", [TREE, LOOPS])
@pytest.mark.parametrize("change", ["mass", "place"])
def test_a_wrong_mass_or_place_is_a_difference(tmp_path, monkeypatch, text, change):
    """A thousandth of a mass, or of a metre in the place of a joint."""
    made = CompiledMechanism.system

    def system(self, qpos=None):
        found = made(self, qpos)
        if change == "mass":
            return dataclasses.replace(found, mass=found.mass * np.linspace(1.0, 1.001, found.nb))
        return dataclasses.replace(found, joint_s_i=found.joint_s_i + 1e-3)

    path = written(tmp_path, text)
    assert compare(path)["kind"].startswith("agrees")
    monkeypatch.setattr(CompiledMechanism, "system", system)
    assert compare(path)["kind"] == "differs"


def test_a_urdf_agrees_with_pinocchio(tmp_path):
    """With damping of its joints, and with a joint that equal limits lock."""
    free = ROBOT.replace('lower="0" upper="0"', "")  # named as free by the reader
    blank = ROBOT.replace('ixx="0.001"', 'ixx="0.001\n"')  # a blank to XML, for which Pinocchio drops the inertial
    for k, text in enumerate((ELBOW, ROBOT, free, blank)):
        found = compare(written(tmp_path, text, f"{k}.urdf"))
        assert (found["kind"], found["difference"] < 1e-12) == ("agrees", True), found


def test_a_mesh_that_is_not_there_is_replaced(tmp_path):
    """Its body has mass and inertia as numbers; MuJoCo alone refuses the file."""
    look = f'<geom type="mesh" mesh="m"/>{BAR}'
    text = f"""<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody>
    <body><joint axis="0 1 0"/>{look}</body></worldbody></mujoco>"""
    assert compare(written(tmp_path, text))["kind"] == "agrees"


def test_a_crash_costs_its_own_file_alone(tmp_path, monkeypatch):
    """Each file is compared in a process of its own; what ends it is the file's outcome, and so is a limit."""
    path = written(tmp_path, ROBOT)
    monkeypatch.setattr(compare_collections, "compare_file", lambda path: os.kill(os.getpid(), signal.SIGSEGV))
    assert compare_collections.run_apart(path) == {"kind": "failed", "words": "ended by SIGSEGV"}
    monkeypatch.setattr(compare_collections, "compare_file", lambda path: time.sleep(60.0))
    monkeypatch.setattr(compare_collections, "LIMIT", 0.05)
    assert compare_collections.run_apart(path) == {"kind": "failed", "words": "timed out after 0.05 s"}


def test_collections_become_counts(tmp_path, monkeypatch):
    """One line for each file, which an interrupted comparison keeps; its kind, and the reason of a refusal."""
    folder = tmp_path / "models"
    folder.mkdir()
    for name, text in (("a.urdf", ROBOT), ("b.urdf", "<robot/>"), ("tree.xml", TREE), ("notes.xml", "<notes/>")):
        written(folder, text, name)
    one = {"name": "who/what", "commit": "1" * 40, "folder": str(folder)}
    log = tmp_path / "log.jsonl"
    outcomes = compare_collections.compare_collections([one], log)
    assert [(o.file, o.kind) for o in outcomes] == [("a.urdf", "agrees"), ("b.urdf", "refused"), ("tree.xml", "agrees")]
    monkeypatch.setattr(compare_collections, "run_apart", lambda path: pytest.fail(f"{path} is read again"))
    assert compare_collections.compare_collections([one], log) == outcomes
    data = compare_collections.summarise([one], outcomes)
    rows = {row["format"]: row["counts"] for row in data["collections"]}
    assert rows == {"MJCF": {"agrees": 1}, "URDF": {"agrees": 1, "refused": 1}}
    assert data["differ"] == data["open"] == {} and data["largest difference"] < 1e-11


def test_the_page_shows_the_published_comparison():
    """Made by docs/compare_collections.py; no file that is read differs in silence."""
    page = compare_collections.PAGE.read_text(encoding="utf-8")
    assert compare_collections.TABLES.findall(page) == [compare_collections.format_tables()]
    assert json.loads(compare_collections.PUBLISHED.read_text(encoding="utf-8"))["differ"] == {}

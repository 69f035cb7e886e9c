"""Engines in the kit: the examples in the documentation pass where their engine is right and fail where it is wrong."""

import importlib.util

import numpy as np
import pytest

from mbsbench import kit
from mbsbench.harness.results.environment import ROOT

from .environments import import_engine

pytestmark = pytest.mark.engine
LINES = 24  # of a user's function
TREES = ("free_fall", "spin_symmetric", "spin_asymmetric", "pendulum", "ball_pendulum")
LOOPS = ("four_bar", "four_bar_turned")
FIRST_ORDER = (*LOOPS, "slider_crank", "slider_crank_turned", "driven_hinge")


def example(engine):
    """The function in docs/examples, or a skip where the engine is not installed, here or for itself."""
    import_engine(engine)
    path = ROOT / "docs" / "examples" / f"kit_{engine}.py"
    assert len(path.read_text(encoding="utf-8").partition("\ndef ")[2].splitlines()) - 1 <= LINES
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return getattr(module, f"{engine}_motion")


def fails(law, case, motion, **settings):
    with pytest.raises(kit.EngineFailure, match=f"{case}: {law}: off by"):
        kit.check(case, motion, **settings)


@pytest.mark.parametrize("case", kit.CASES)
def test_mujoco_passes(case):
    """Order 4 on trees, 1 where soft loops or a torque that is constant over a step leave no more."""
    kit.check(
        case,
        example("mujoco"),
        order=1 if case in (*LOOPS, "slider_crank", "slider_crank_turned", "driven_hinge") else 4,
    )


def test_mujoco_fails_where_it_is_wrong():
    motion = example("mujoco")
    fails("energy", "top", lambda case: motion(case, "EULER"))
    fails("closure", "four_bar", lambda case: motion(case, tight=False))


@pytest.mark.parametrize("case", [*TREES, "spin_products", *LOOPS])
def test_pinocchio_passes(case):
    kit.check(case, example("pinocchio"))


def test_pinocchio_fails_where_it_is_wrong():
    motion, signs = example("pinocchio"), np.array([[1, -1, 1], [-1, 1, 1], [1, 1, 1]])
    fails("energy", "top", motion)
    fails("error", "damped_hinge", motion)  # it has no springs
    fails("error", "spin_products", lambda case: motion(case, lambda inertia: signs * inertia))


@pytest.fixture
def bullet(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return example("pybullet")


@pytest.mark.parametrize("case", TREES)
def test_pybullet_passes(case, bullet):
    kit.check(case, bullet, precision="float32")


def test_pybullet_fails_where_it_is_wrong(bullet):
    """The top is beyond its method of first order; a file is read in 32 bits."""
    fails("energy", "top", bullet, precision="float32")
    with pytest.raises(kit.EngineFailure, match="top: start: R is off by"):
        kit.check("top", bullet)

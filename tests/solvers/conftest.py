"""Code of mechanisms without what takes long to compile, for tests that do not look at it."""

import pytest

from mbsbench.solvers.formulations.joint_coordinates import code


@pytest.fixture
def without_whole_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Code that lacks all stages of a step as one function, which takes seconds to compile."""
    own = code._digest_generator()
    monkeypatch.setattr(code, "SMALL", 0)
    monkeypatch.setattr(code, "_digest_generator", lambda: f"{own} without steps")  # kept under a key of its own

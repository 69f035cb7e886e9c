"""Draw hidden instances: problems whose numbers and presentation nobody knows before a submission is fixed.

They follow from the digest of the submission and a public seed: anybody can draw them again, and a submission that is
changed to fit them gets others.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...mechanics.presentation import SPACE_AXES

WITHIN = 0.01  # relative change of masses, lengths and starts
UNITS = 1.0  # decades by which units are changed, up or down
STEPS = {"dt": (8e-3, 4e-3, 2e-3), "rtol": (1e-4, 1e-6, 1e-8)}  # settings of the ladder: steps [s] or tolerances


@dataclass(frozen=True)
class InstanceKind:
    """A problem of the catalogue, with the parameters whose values are changed and those that are fixed."""

    problem: str
    changed: Mapping[str, float]  # values that are changed by up to ``WITHIN``, by parameter
    fixed: Mapping[str, Any] = field(default_factory=dict)  # values that replace defaults, by parameter


KINDS = (
    InstanceKind(
        "spherical_pendulum", {"mass": 1.0, "half_length": 0.5, "omega_x": 5.0, "omega_z": 3.0}, {"t_end": 10.0}
    ),
    InstanceKind("heavy_top", {"mass": 5.0, "length": 0.1, "theta0": 20.0, "spin": 50.0}, {"t_end": 2.0}),
    InstanceKind("torque_free_body", {}, {"inertia_factors": (1.0, 2.0, 3.0), "omega": (0.3, 3.0, 0.2), "t_end": 20.0}),
    InstanceKind("four_bar_grid", {"mass": 1.0, "length": 1.0, "rate": 2.0}, {"rows": 1, "columns": 1, "t_end": 5.0}),
    InstanceKind(
        "random_mechanism",
        {"mass": 1.0, "size": 1.0, "speed": 1.0},
        {"bodies": 3, "loops": 0, "springs": 1, "loads": 0, "t_end": 5.0},
    ),
)


@dataclass(frozen=True)
class Instance:
    """A problem, with all its parameters that differ from the defaults."""

    problem: str
    parameters: Mapping[str, Any]


def digest_submission(content: bytes) -> str:
    """Return the digest of a submission: the sha256 of ``content``, in hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def draw_instances(submission: str, seed: str, kinds: tuple[InstanceKind, ...] = KINDS) -> tuple[Instance, ...]:
    """Draw one instance of each kind for the digest of a ``submission`` and a public ``seed``."""
    return tuple(_draw_instance(kind, f"{submission} {seed} {k}") for k, kind in enumerate(kinds))


def _draw_instance(kind: InstanceKind, text: str) -> Instance:
    """Draw an instance of a kind, as the text determines: changed numbers, a random presentation, a perturbed start."""
    random = np.random.default_rng(list(hashlib.sha256(text.encode()).digest()))

    def perturb_value(value: float) -> float:
        """Return the value, changed at random by up to ``WITHIN`` of it."""
        return float(value * (1.0 + WITHIN * random.uniform(-1.0, 1.0)))

    def draw_unit() -> float:
        """Return a random factor of a unit, up to ``UNITS`` decades."""
        return float(10.0 ** (UNITS * random.uniform(-1.0, 1.0)))

    changed = {name: perturb_value(value) for name, value in kind.changed.items()}
    presented = {
        "rotation": tuple(float(x) for x in random.uniform(-2.0, 2.0, 3)),
        "mirror": str(random.choice(list(SPACE_AXES))),
        "renumber": int(random.integers(1, 2**31)),
        "unit_length": draw_unit(),
        "unit_mass": draw_unit(),
        "unit_time": draw_unit(),
        "perturb": WITHIN,
        "seed": int(random.integers(1, 2**31)),
    }
    more = {"mechanism_seed": int(random.integers(1, 2**31))} if kind.problem == "random_mechanism" else {}
    return Instance(kind.problem, {**kind.fixed, **changed, **presented, **more})

"""Hidden instances: problems whose numbers and presentation nobody knows before a submission is fixed.

They are drawn from the digest of the submission and a public seed: anybody can draw them again, and a submission that
is changed to fit them gets others.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..mechanics.presentation import SPACE_AXES

WITHIN = 0.01  # relative change of masses, lengths and starts
UNITS = 1.0  # decades that units are changed by, up or down
STEPS = {"dt": (8e-3, 4e-3, 2e-3), "rtol": (1e-4, 1e-6, 1e-8)}


@dataclass(frozen=True)
class Kind:
    """A problem of the catalogue, with the parameters whose values are changed."""

    problem: str
    changed: Mapping[str, float]
    fixed: Mapping[str, Any] = field(default_factory=dict)


KINDS = (
    Kind("spherical_pendulum", {"mass": 1.0, "half_length": 0.5, "omega_x": 5.0, "omega_z": 3.0}, {"t_end": 10.0}),
    Kind("heavy_top", {"mass": 5.0, "length": 0.1, "theta0": 20.0, "spin": 50.0}, {"t_end": 2.0}),
    Kind("torque_free_body", {}, {"inertia_factors": (1.0, 2.0, 3.0), "omega": (0.3, 3.0, 0.2), "t_end": 20.0}),
    Kind("four_bar_grid", {"mass": 1.0, "length": 1.0, "rate": 2.0}, {"rows": 1, "columns": 1, "t_end": 5.0}),
    Kind("random_mechanism", {"mass": 1.0, "size": 1.0, "speed": 1.0},
         {"bodies": 3, "loops": 0, "springs": 1, "loads": 0, "t_end": 5.0}),
)  # fmt: skip


@dataclass(frozen=True)
class Instance:
    """A problem's name and all the parameters of it that differ from the defaults."""

    problem: str
    parameters: Mapping[str, Any]


def digest_of(content: bytes) -> str:
    """The digest of a submission."""
    return hashlib.sha256(content).hexdigest()


def draw_instances(submission: str, seed: str, kinds: tuple[Kind, ...] = KINDS) -> tuple[Instance, ...]:
    """One instance of each kind for the digest of a ``submission`` and a public ``seed``."""
    return tuple(_draw(kind, f"{submission} {seed} {k}") for k, kind in enumerate(kinds))


def _draw(kind: Kind, text: str) -> Instance:
    random = np.random.default_rng(list(hashlib.sha256(text.encode()).digest()))

    def near(value: float) -> float:
        return float(value * (1.0 + WITHIN * random.uniform(-1.0, 1.0)))

    def unit() -> float:
        return float(10.0 ** (UNITS * random.uniform(-1.0, 1.0)))

    changed = {name: near(value) for name, value in kind.changed.items()}
    presented = {
        "rotation": tuple(float(x) for x in random.uniform(-2.0, 2.0, 3)),
        "mirror": str(random.choice(list(SPACE_AXES))),
        "renumber": int(random.integers(1, 2**31)),
        "unit_length": unit(), "unit_mass": unit(), "unit_time": unit(),
        "perturb": WITHIN, "seed": int(random.integers(1, 2**31)),
    }  # fmt: skip
    more = {"mechanism_seed": int(random.integers(1, 2**31))} if kind.problem == "random_mechanism" else {}
    return Instance(kind.problem, {**kind.fixed, **changed, **presented, **more})

"""Define a row of a history: one run of one results folder."""

from msgspec.structs import fields

from ..base.shapes import Shape

NAN = float("nan")


class Row(Shape, frozen=True):
    """The numbers of one run in a history; NaN where a quantity does not exist."""

    commit: str  # '+dirty' when the checkout had changes
    time: str  # UTC, ISO 8601: when the run was started
    results: str
    suite: str
    settings_id: str
    case: str
    label: str
    problem: str
    solver: str
    status: str
    gate: str = ""  # the worst state of the gate's findings on the run; empty if not judged
    energy_drift_max_J: float = NAN
    energy_scale_J: float = NAN
    position_error_max_m: float = NAN
    position_error_judged_m: float = NAN
    orientation_error_max_rad: float = NAN
    phi_max: float = NAN
    phi_dot_max: float = NAN
    steps: float = NAN
    cpu_min_s: float = NAN
    cpu_ratio: float = NAN  # cpu_min_s relative to the oldest success of this run on the same processor
    processor: str = ""


METRICS = tuple(f.name for f in fields(Row) if f.type is float)

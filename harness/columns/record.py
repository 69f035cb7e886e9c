"""Join the columns of all topics to those of a run's record; fields of the last class come first."""

from dataclasses import dataclass

from .declared.constraints import ConstraintColumns
from .declared.cost import CostColumns
from .declared.ending import EndingColumns
from .declared.energy import EnergyColumns
from .declared.errors import ErrorColumns
from .declared.origin import OriginColumns
from .declared.settings import SettingColumns
from .declared.way_back import WayBackColumns
from .declared.work import WorkColumns


@dataclass(frozen=True, repr=False)
class Columns(
    OriginColumns,
    CostColumns,
    WorkColumns,
    WayBackColumns,
    ErrorColumns,
    ConstraintColumns,
    EnergyColumns,
    EndingColumns,
    SettingColumns,
):
    """The columns of a run's record; NaN or an empty string if a quantity does not exist."""

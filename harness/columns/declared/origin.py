"""Columns of where a run is from and where its files are: paths in the results folder, code, commit, machine, time."""

from dataclasses import dataclass

from ..declaring import column

SCHEMA = 3  # raise it when a column changes its meaning or is removed; not for a new column with a default


@dataclass(frozen=True, repr=False)
class OriginColumns:
    """The files of a run, relative to the results folder, and its origin."""

    series: str = column("the run's series file, empty if there is none", "")
    series_sha256: str = column("sha256 of the series file", "")
    series_rows: int = column("rows in it; fewer than steps + 1 when thinned", 0)
    stderr: str = column("what the run wrote to standard error, empty if nothing", "")
    code: str = column(
        "digest of what shapes its motion and its cost: solver, problem, what runs them, plugins, locked packages", ""
    )
    measured_by: str = column(
        "digest of the code that measured it; columns.json has that of each column; empty if part of code", ""
    )
    commit: str = column("commit of the checkout, '+dirty' if it had changes", "")
    environment: str = column("its machine and packages: environment.<this>.json of the results folder", "")
    finished: str = column("UTC time the run ended, ISO 8601", "")
    schema: int = column("version of these columns", SCHEMA)

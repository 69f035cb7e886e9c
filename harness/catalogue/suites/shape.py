"""Define the keys of a suite file.

::

    name = "example"
    description = "one line"
    include = ["ci"]            # suites beside this file or of the catalogue: their runs and plugins come first
    total_limit = 900.0         # [s] for all runs together: running ones are then ended (unfinished), others left out

    [defaults]                  # any key of a group, for this file only
    cpu_limit = 60.0           # [s] per run
    repeats = 3                 # of each solve, for its cost
    min_time = 0.2              # [s] CPU time for which a solve of less than 20 ms is repeated

    [[runs]]
    label = "recommended"
    problem = "spherical_pendulum"              # or a list
    parameters = { omega_z = [0.0, 0.1] }       # a list is a product; of a tuple-valued parameter give a list of lists
    # parameters = [{ yaw = 0.7 }, { mirror = "X" }]    # a list of tables: one after the other; options likewise
    solver = ["gc_weak_form", "rk45_strong_form"]
    options = { "alpha, beta" = [0.0, 5.0] }    # two keys with the same value
    dt = [0.02, 0.01]           # with rtol: dt is for solvers controlled by it, rtol and max_step for the others
    rtol = 1e-8
    # rtol = { from = 0.1, to = 1e-5, per_decade = 20 }         # a sweep, to three digits; options likewise
"""

from typing import Annotated, Any

from msgspec import Meta

from ...base.shapes import Shape

Names = str | Annotated[tuple[str, ...], Meta(min_length=1)]
Tables = dict[str, Any] | Annotated[tuple[dict[str, Any], ...], Meta(min_length=1)]
LONGEST = 1e7  # [s] four months
Seconds = Annotated[float, Meta(gt=0.0, le=LONGEST, description=f"a finite number > 0, at most {LONGEST:g}")]
Megabytes = Annotated[float, Meta(gt=0.0, le=1e9, description="a finite number > 0, at most 1e+09")]
Repeats = Annotated[int, Meta(ge=1, le=10**6, description="a whole number > 0, at most 1e+06")]
Title = Annotated[str, Meta(pattern=r"^[\w-]+$", description="letters, digits, - and _")]


class Defaults(Shape, frozen=True, kw_only=True):
    """Keys that groups share; steps and tolerances are numbers or text, or lists of them."""

    label: str | None = None
    problem: Names | None = None
    parameters: Tables | None = None
    solver: Names | None = None
    options: Tables | None = None
    dt: Any = None
    rtol: Any = None
    max_step: Any = None
    max_steps: Any = None
    cpu_limit: Seconds | None = None
    memory: Megabytes | None = None
    repeats: Repeats | None = None
    min_time: Seconds | None = None


class Group(Defaults, frozen=True, kw_only=True):
    """A ``[[runs]]`` table."""

    def select(self, *keys: str) -> dict[str, Any]:
        """Return those of the named keys that the group gives, with their values."""
        return {k: v for k in keys if (v := getattr(self, k)) is not None}


class SuiteFile(Shape, frozen=True, kw_only=True):
    """The content of a suite file."""

    name: Title | None = None
    description: str = ""
    include: tuple[Annotated[str, Meta(min_length=1)], ...] = ()
    total_limit: Seconds | None = None
    plugins: tuple[str, ...] = ()
    defaults: Defaults = Defaults()
    runs: tuple[Group, ...] = ()

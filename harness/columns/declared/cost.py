"""Columns of what a run cost: CPU time, wall time and memory, as the run's processes count them."""

from dataclasses import dataclass

from ..declaring import column


@dataclass(frozen=True, repr=False)
class CostColumns:
    """The cost of a run."""

    repeats: int = column("times the solve was run and its cost counts; the motion is that of the first", 0)
    cpu_min_s: float = column(
        "CPU time of the call without set-up, least of the repeats; in a loop, of groups of them that take 0.1 ms",
        order=375,
        tables={"show": "CPU [s]"},
        rank=3,
        better="less",
    )
    cpu_q1_s: float = column("lower quartile of the repeats, of three the least; NaN if older than this column")
    cpu_median_s: float = column(
        "CPU time of the integration alone, median of the repeats",
        head="CPU",
        unit="s",
        show="format_cpu_time",
        latex="CPU [s]",
        order=380,
        tables=("problem", "runs"),
        better="less",
    )
    cpu_q3_s: float = column("upper quartile of the repeats, of three the largest; NaN if older than this column")
    cpu_max_s: float = column("largest of the repeats")
    cpu_call_s: float = column(
        "CPU time of the first call as a whole, with all processes that took part: set-up included, code_s left out"
    )
    setup_s: float = column(
        "CPU time of compilation, whenever it happens, and of import, refuses and preparation before the first step; "
        "not part of that of the integration",
        head="Set-up",
        unit="s",
        order=400,
        better="less",
    )
    code_s: float = column(
        "CPU time of making and loading code in the run's process, repeats included: part of cpu_process_s and, in "
        "the first call, of setup_s; no other CPU time contains it"
    )
    cpu_import_s: float = column("CPU time of importing the plugin, part of setup_s")
    cpu_refuses_s: float = column("CPU time of asking the solver whether it refuses, part of setup_s")
    cpu_process_s: float = column(
        "CPU time of the run's process and of all that it started, as the system counted it from outside"
    )
    wall_s: float = column("wall time of the whole run: process, set-up, solve, measuring")
    measure_s: float = column("wall time of measuring alone")
    peak_memory_MB: float = column(
        "largest resident memory of the run's process; over its limit, of all that it started, too",
        head="Memory",
        unit="MB",
        key="memory",
        order=410,
        better="less",
    )

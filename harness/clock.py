"""CPU time of this process, as fine under the sandbox's limits as without them."""

import resource


def cpu_seconds() -> float:
    """User and system time of all threads [s].

    Not ``time.process_time``: once a process has a limit on its CPU time (RLIMIT_CPU, as every run), Linux moves that
    clock by ticks of 4 ms, and most runs of one body take less.
    """
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime

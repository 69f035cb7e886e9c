"""The arithmetic of tests: pinned as that of runs, or with --native that of this processor.

Loaded by pytest before other plugins, some of which load NumPy, which reads the environment once.
"""

import sys

from mbsbench.harness import machine

if "--native" in sys.argv:
    machine.unpin()


def pytest_addoption(parser):
    parser.addoption("--native", action="store_true", help="leave kernels and SIMD features as this processor has them")


def pytest_report_header(config):
    return f"arithmetic: {'; '.join(machine.find_deviations()) or 'pinned'}"

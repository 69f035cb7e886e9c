"""The arithmetic of tests: pinned as that of runs, or with --native that of this processor.

Loaded by pytest before other plugins, some of which load NumPy, which reads the environment once.
"""

import os
import shlex
import sys

import pytest

from mbsbench.harness.base import machine

if "--native" in (*shlex.split(os.environ.get("PYTEST_ADDOPTS", "")), *sys.argv):
    machine.unpin_arithmetic()


def pytest_addoption(parser):
    parser.addoption("--native", action="store_true", help="leave kernels and SIMD features as this processor has them")


def pytest_configure(config):
    """Refuse what comes too late, from a file or from ``pytest.main``, and would be without effect."""
    if config.getoption("native") and os.environ.get(machine.NATIVE) != "1":
        raise pytest.UsageError("give --native to the command pytest or in PYTEST_ADDOPTS, or set MBSBENCH_NATIVE=1")


def pytest_report_header(config):
    return f"arithmetic: {'; '.join(machine.find_deviations()) or 'pinned'}"

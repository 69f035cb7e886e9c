"""For all tests: one thread for linear algebra, set before numpy is loaded."""

import os

from mbsbench.harness.results.environment import THREADS

os.environ.update(THREADS)

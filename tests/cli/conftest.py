"""The misbehaving solvers and the command as a process, as in the tests of the harness."""

from ..harness.conftest import begun_here as begun_here
from ..harness.conftest import catalogue as catalogue
from ..harness.conftest import command as command
from ..harness.conftest import run_text as run_text

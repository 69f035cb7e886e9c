"""The stages of an explicit step (compiled), for all methods that have a pair's tableau."""

from ....harness.base import tableaux
from ..compiled.entries import compile_inline

evaluate_stages = compile_inline(tableaux.evaluate_stages)

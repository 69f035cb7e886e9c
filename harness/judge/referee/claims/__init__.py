"""Try the paper's claims, given as data, over maps of settings.

The entry points are ``judging.judge_claims``, which judges a register, and ``measures.evaluate(metric, record,
series, arguments)``, which measures one number of one run.
"""

from . import equations, metrics  # register their measures

__all__ = ["equations", "metrics"]

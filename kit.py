"""``mbsbench.kit``: an engine's own tests step its model of our problems and get pass or fail.

``kit.check(case, motion, order=..., precision=...)`` for each of ``kit.CASES``; docs/engines.md says how.
"""

from .harness.kit.cases import CASES
from .harness.kit.model import Model
from .harness.kit.verdict import EngineFailure, Passed, check

__all__ = ["CASES", "EngineFailure", "Model", "Passed", "check"]

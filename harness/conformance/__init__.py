"""Requirements on solvers and problems (``check``), and the assessment of a solver (``try``): findings with numbers."""

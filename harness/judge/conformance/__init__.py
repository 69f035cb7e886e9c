"""Test requirements on solvers and problems (``check``), and assess a solver (``try``), in findings with numbers."""

"""The expressions that solvers evaluate, from declarations of joints and forces: rows, their slopes, pushes."""

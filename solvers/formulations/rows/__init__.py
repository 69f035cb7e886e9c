"""From declarations of joints and forces to what solvers evaluate: rows, their slopes, pushes, as expressions."""

"""Other engines on our problems, beside our solvers in one process: what a step costs there, and what it is worth."""

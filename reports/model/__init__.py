"""What pages and figures know: a results folder sorted into problems, solvers and settings."""

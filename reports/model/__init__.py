"""Model a results folder for pages and figures, sorted into problems, solvers and settings."""

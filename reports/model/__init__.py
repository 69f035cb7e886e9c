"""The model of pages and figures: a results folder sorted into problems, solvers and settings."""

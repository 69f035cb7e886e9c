"""Solvers side by side in one process: other people's engines beside ours."""

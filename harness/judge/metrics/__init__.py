"""Measures of a trajectory: its errors, how it keeps the laws, and the status that follows."""

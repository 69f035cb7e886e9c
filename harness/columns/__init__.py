"""Columns: each number of a run declared once, with its function, unit and meaning; records and pages follow."""

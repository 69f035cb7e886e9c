"""Define the types of judgements of claims and of runs, and their files.

Missing numbers are NaN, and null in files. Words are made where they are shown, never stored or parsed.
"""

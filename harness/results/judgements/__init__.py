"""Judgements of claims and of runs, typed from where they are made to where they are shown, and their files.

Numbers that do not exist are NaN, in files null. Words are made where they are shown, never stored or parsed.
"""

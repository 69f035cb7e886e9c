"""What the referee finds, typed from where it is found to where it is shown: of claims, of runs, and their files.

Numbers that do not exist are NaN, in files null. Words are made where they are shown, never stored or parsed.
"""

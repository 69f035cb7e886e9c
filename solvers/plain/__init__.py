"""Methods as their sources print them: one file each, in plain NumPy, to be read beside the source.

They are the definition of the compiled methods and the oracle of their tests: slow, and with no choices but those that
the source leaves open.
"""

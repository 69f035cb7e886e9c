"""Methods as their sources print them: one file each, in plain NumPy, to be read beside the source.

They define the compiled methods and are the oracle of their tests: slow, and with no options but those that the source
leaves open.
"""

"""Try the paper's claims, given as data, over maps of settings.

The entry points are ``count.judge``, which judges a register from records, and ``evidence.evaluate(metric, record,
series, arguments)``, which measures one number of one run.
"""

"""The paper's claims as data, each tried over a map of settings. The doors: ``verdicts.judge`` judges a register from
records; ``evidence.evaluate(metric, record, series, arguments)`` measures one number of one run.
"""

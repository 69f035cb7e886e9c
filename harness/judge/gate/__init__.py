"""Define thresholds on the runs of a short suite, and check whether results keep them."""

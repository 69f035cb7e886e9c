"""The columns of a run's record, by topic: a class for each, in which a field is a column."""

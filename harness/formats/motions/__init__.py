"""Judge motions of other programs: read tables and FMUs, recognise their columns, judge them like runs."""

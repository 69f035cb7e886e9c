"""Judge motions computed by any other code: read tables, recognise and check their columns, judge them like runs."""

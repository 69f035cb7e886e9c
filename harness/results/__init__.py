"""Results on disk: records, series, where they come from, and how two folders of them compare."""

"""Store results on disk: records, series and their origin; and compare two folders of them."""

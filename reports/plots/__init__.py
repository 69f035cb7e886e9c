"""Draw curves with one look, in the browser and on paper."""

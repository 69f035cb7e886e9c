"""How curves are drawn: one look, in the browser and on paper."""

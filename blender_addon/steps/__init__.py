"""The steps of the sidebar in the order of work: each holds its panel, its settings and what its buttons do."""

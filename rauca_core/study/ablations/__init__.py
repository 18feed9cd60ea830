"""Ablations: variants of the optimization, all measured on the same held-out views, beside what the paper printed."""

"""Step 1: which vehicle, and what of it is paint."""

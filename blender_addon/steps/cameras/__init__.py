"""Step 3: the cameras around the vehicle, drawn in the viewport."""

"""Step 6: put a camouflage on the vehicle, and see what detectors found."""

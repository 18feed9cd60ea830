"""Looking after data sets: check them, look at them, hand them to other tools. NumPy and Pillow only."""

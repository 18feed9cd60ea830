"""Step 2: the weather in the viewport, and the weathers in which every view is rendered."""

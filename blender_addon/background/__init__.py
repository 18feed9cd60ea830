"""Long work beside Blender's window: a child process, read by a thread, looked after by a timer.

`process`, `job`, `endings`, `thumbnail` and `curve` know nothing of Blender; `watch` and `pictures` are its side, and
only Blender's own thread ever runs them. A job belongs to no scene: loading a file or undoing leaves it alone.
"""

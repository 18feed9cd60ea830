"""The neural renderer's speed against its error, against other renderers and against Blender.

``rauca bench render`` runs it; `bench.py` is the order of events.
"""

"""What a frame costs and how far it is from the converged one: ``rauca bench dataset``.

`inside.py` and what it imports run in a process with Blender; the rest reads what they found.
"""

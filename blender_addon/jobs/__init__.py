"""Rendering a data set in worker processes that may die at any moment.

No Blender here: a supervisor hands pieces of work to workers, each a Blender of its own, and keeps the ledger.
"""

"""A procedural town: every location stands in a district of its own, built from the data set's seed when it is entered.

`districts.py` says what each kind of district is made of, `layout.py` where its street runs and where the vehicle
stands, `town.py` shows one district at a time; the other modules build one kind of thing each.
"""

from .town import Town

__all__ = ["Town"]

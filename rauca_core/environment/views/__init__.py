"""New cameras in rendered places: frames composed in milliseconds from a few that Cycles rendered there.

A place in one weather is static and its geometry known exactly. So a new view of the vehicle is rasterized, and what
surrounds it is warped from the views that there are (`splat`, `gather`); what mirrors is approximated by the nearest
of them.
"""

from .compose import Composed, View, compose
from .densify import densify
from .drawn import Views, ring_between
from .place import Place

__all__ = ["Composed", "Place", "View", "Views", "compose", "densify", "ring_between"]

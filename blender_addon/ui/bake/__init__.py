"""Step 7: carry the camouflage to another UV layout."""

from .panel import RAUCA_PT_bake
from .properties import RaucaBake
from .state import state

CLASSES = (RaucaBake, RAUCA_PT_bake)

__all__ = ["CLASSES", "RaucaBake", "state"]

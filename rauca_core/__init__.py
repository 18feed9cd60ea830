"""rauca: measure and harden vehicle detectors against adversarial camouflage.

Data flows one way: contract -> geometry -> render -> environment -> attack -> evaluate.
"""

from .version import __version__

__all__ = ["__version__"]

"""rauca: measure and harden vehicle detectors against adversarial camouflage.

Data flows one way: contract -> geometry -> render -> environment -> attack -> evaluate.
"""

__version__ = "0.1.0"

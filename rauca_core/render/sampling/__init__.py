"""How a visible sample reads the UV map: our own lookup and those of the literature."""

from .sampler import Sampler

__all__ = ["Sampler"]

"""rauca for Blender: multi-weather datasets of a vehicle, and camouflages on it."""

from __future__ import annotations


def register() -> None:
    """Add the panels and operators to Blender."""
    from .registration import register as add

    add()


def unregister() -> None:
    """Remove them."""
    from .registration import unregister as remove

    remove()

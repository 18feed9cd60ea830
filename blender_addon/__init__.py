"""rauca for Blender: multi-weather data sets of a vehicle, and camouflages on it."""

from __future__ import annotations


def register() -> None:
    """Add the panels and operators to Blender."""
    from . import registration

    registration.register()


def unregister() -> None:
    """Remove them."""
    from . import registration

    registration.unregister()

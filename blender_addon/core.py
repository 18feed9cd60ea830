"""The contract and the geometry room, wherever they lie.

The built extension carries a copy of both inside itself; a checkout or an installed wheel has them in its own package.
Every module of the add-on imports them from here.
"""

from __future__ import annotations

try:
    from .rauca_core import contract, geometry  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from .rauca_core.contract import (  # type: ignore[import-untyped,import-not-found,unused-ignore]
        assets,
        colour,
        files,
        instances,
        recolour,
        seeding,
        semantics,
    )
except ImportError:
    from rauca_core import contract, geometry
    from rauca_core.contract import assets, colour, files, instances, recolour, seeding, semantics

__all__ = ["assets", "colour", "contract", "files", "geometry", "instances", "recolour", "seeding", "semantics"]

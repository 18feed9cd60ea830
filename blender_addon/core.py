"""The contract and the geometry room, wherever they lie.

The built extension carries a copy of both inside itself; a checkout or an installed wheel has them in its own package.
Every module of the add-on imports them from here.
"""

from __future__ import annotations

try:
    from .rauca_core import contract, geometry  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from .rauca_core.contract import (  # type: ignore[import-untyped,import-not-found,unused-ignore]
        assets,
        color,
        files,
        reading,
        schema,
        seeding,
        semantics,
    )
    from .rauca_core.geometry import bake  # type: ignore[import-untyped,import-not-found,unused-ignore]
except ImportError:
    from rauca_core import contract, geometry
    from rauca_core.contract import assets, color, files, reading, schema, seeding, semantics
    from rauca_core.geometry import bake

__all__ = [
    "assets",
    "bake",
    "color",
    "contract",
    "files",
    "geometry",
    "reading",
    "schema",
    "seeding",
    "semantics",
]

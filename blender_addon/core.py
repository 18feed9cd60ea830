"""The contract, wherever it lies.

The built extension carries a copy of `rauca_core.contract` inside itself; a checkout or an installed wheel has it as
its own package. Every module of the add-on imports the contract from here.
"""

from __future__ import annotations

try:
    from .rauca_core import contract  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from .rauca_core.contract import assets, colour, files, seeding  # type: ignore[import-untyped,import-not-found,unused-ignore]
except ImportError:
    from rauca_core import contract
    from rauca_core.contract import assets, colour, files, seeding

__all__ = ["assets", "colour", "contract", "files", "seeding"]

# ruff: noqa: F401 - handed on
"""What the add-on has of the core, wherever it lies: contract, geometry, and the part of the runtime without torch.

The built extension carries a copy inside itself; a checkout or an installed wheel has it in a package of its own. Every
module of the add-on imports from here.
"""

from __future__ import annotations

try:
    from .rauca_core import contract, geometry  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from .rauca_core.contract import (  # type: ignore[import-untyped,import-not-found,unused-ignore]  # fmt: skip
        assets,
        clips,
        color,
        files,
        reading,
        schema,
        seeding,
        semantics,
        system,
        viewpoints,
    )
    from .rauca_core.geometry import bake  # type: ignore[import-untyped,import-not-found,unused-ignore]
    from .rauca_core.runtime import child_process, folder_lock  # type: ignore[import-untyped,import-not-found,unused-ignore]  # fmt: skip
except ModuleNotFoundError as missing:
    if missing.name != f"{__package__}.rauca_core":  # a package that the copy needs, such as NumPy: say so
        raise
    from rauca_core import contract, geometry
    from rauca_core.contract import assets, clips, color, files, reading, schema, seeding, semantics, system, viewpoints
    from rauca_core.geometry import bake
    from rauca_core.runtime import child_process, folder_lock

"""``rauca methods``: what `rauca optimize --method` can be, and in what a rival's two forms differ."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from .console import output


def methods(
    name: Annotated[str | None, typer.Argument(help="a method; all of them if left out")] = None,
) -> None:
    """Print in what each method's published form (--as published) differs from its adapted one, from the settings."""
    from rauca_core.attack.methods import METHODS, differences, method_named

    chosen = list(METHODS) if name is None else [name]
    for one in chosen:
        method = method_named(one)
        known = f"published: as its {method.known} says" if method.known else "one form only"
        table = Table("setting", "published", "adapted", title=f"{one}: {known}")
        for setting, (published, adapted) in differences(one).items():
            table.add_row(setting, str(published), str(adapted))
        output().print(table if table.row_count else f"{one}: {known}; published and adapted are the same")
        if method.stand_ins:
            output().print(f"otherwise in both: {method.stand_ins}")

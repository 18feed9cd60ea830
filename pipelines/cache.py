"""``rauca cache``: what is kept for this user, by kind and size, and pruning it."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from rauca_core.contract import RaucaError

from .console import console, output

cache_app = typer.Typer(help="What is kept for this user, and what studies share.", invoke_without_command=True)
DAY_S, GB = 24 * 3600, 1e9


@cache_app.callback()
def show(context: typer.Context) -> None:
    """List the user's cache by kind and size."""
    if context.invoked_subcommand is not None:
        return
    from rauca_core.study.makers import KINDS
    from rauca_core.study.store import kept_in, user_cache

    kept, what = kept_in(user_cache()), {name: kind.what for name, kind in KINDS.items()}
    what |= {"weights": "fetched weights of detectors", "studies": "studies without a folder"}
    table = Table("kind", "what", "number", "MB", title=str(user_cache()))
    for kind in dict.fromkeys(one.kind for one in kept):
        some = [one for one in kept if one.kind == kind]
        table.add_row(kind, what.get(kind, ""), str(len(some)), f"{sum(one.size for one in some) / 1e6:.1f}")
    table.add_section()
    table.add_row("all", "", str(len(kept)), f"{sum(one.size for one in kept) / 1e6:.1f}")
    output().print(table)


@cache_app.command()
def prune(
    kind: Annotated[str | None, typer.Option(help="only this one; without it all but fetched weights")] = None,
    older_than: Annotated[float | None, typer.Option(min=0, help="only what was not used for so many days")] = None,
    max_size: Annotated[float | None, typer.Option(min=0, help="the longest unused, until so many GB are left")] = None,
) -> None:
    """Remove what is kept: all of it, or what the options say."""
    from rauca_core.study.store import kept_in, prune, user_cache

    cache = user_cache()
    known = {one.kind for one in kept_in(cache)}
    if kind is not None and kind not in known:
        raise RaucaError(f"--kind {kind}: none is kept; there are {', '.join(sorted(known)) or 'no kinds at all'}")
    size = None if max_size is None else round(max_size * GB)
    gone = prune(cache, kind, (older_than or 0) * DAY_S, size)
    console.print(f"removed: {len(gone)}, {sum(one.size for one in gone) / 1e6:.1f} MB", highlight=False)

"""What the user sees while long work runs."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from rauca_core.contract import Progress, RaucaError

console = Console(stderr=True)


@contextlib.contextmanager
def progress_bar(title: str) -> Iterator[Callable[[Progress], None]]:
    """A progress bar with an estimate of the time left; yields the function that moves it.

    Without a terminal (logs, CI) a line is printed at the start and at the end only.

    Raises:
        RaucaError: in place of a KeyboardInterrupt inside.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("[dim]{task.fields[last]}"),
    )
    with Bar(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=None, last="")
        seen: list[Progress] = []

        def move(progress: Progress) -> None:
            bar.update(task, completed=progress.done, total=progress.total, last=progress.last)
            seen[:] = [progress]

        if not console.is_terminal:
            console.print(f"{title} ...")
        try:
            yield move
        except KeyboardInterrupt:
            # Here, since typer would end the program without a word.
            raise RaucaError("interrupted; what was finished is kept, run the same command to go on") from None
        if not console.is_terminal and seen:
            console.print(f"{title}: {seen[0].done} of {seen[0].total}")

"""What is wrong with a data set: where, what, what to do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

RENDER_AGAIN = "check with --remove-damaged and run the same `rauca dataset make` again"
MAKE_AGAIN = "make the data set again in another folder"
OTHER_SCENE = (
    "take it out of the scene, or give it its own `rauca_category`, and make the data set again in another folder"
)

Report = Callable[[str, str], None]
"""Takes a file's name and what is wrong with it."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes:
        file: path below the data set's folder.
        what: is wrong with it.
        remedy: what to do about it.
        again: folder below the data set's that `rauca dataset make` makes again once it is gone; "" if none.
    """

    file: str
    what: str
    remedy: str
    again: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.what}; {self.remedy}"

"""A part of a data set's frames, named by a file: some of a plan too large to be rendered whole."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from .core import contract


def named_frames(path: Path | None, planned: Collection[str]) -> frozenset[str]:
    """The frame ids listed in ``path``, one per line, or all that are ``planned`` without a file.

    Raises:
        RaucaError: the file cannot be read, names no frame, or one that is not planned.
    """
    if path is None:
        return frozenset(planned)
    try:
        named = frozenset(path.read_text(encoding="utf-8").split())
    except (OSError, UnicodeDecodeError) as error:
        raise contract.RaucaError(f"{path}: cannot be read ({error}); give a text file of frame ids") from None
    if not named or not named <= frozenset(planned):
        stranger = min(named.difference(planned), default="no frame at all")
        raise contract.RaucaError(f"{path}: names {stranger}, which the data set does not plan; one id per line")
    return named

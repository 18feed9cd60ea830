"""A part of a data set's frames, of a plan too large to be rendered whole: balanced, or named by a file."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

from .core import contract


def chosen_frames(plan: contract.Plan, options: argparse.Namespace) -> frozenset[str]:
    """Ids of the frames that ``make_dataset``'s ``--only`` or ``--frames`` choose; all of them without.

    Raises:
        RaucaError: as of :func:`named_frames`.
    """
    if options.frames:
        return frozenset(contract.balanced_frames(plan, options.frames))
    return named_frames(options.only, {frame_id for frame_id, *_ in plan.frame_ids()})


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

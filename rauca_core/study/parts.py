"""What each detector of a study had to do with the attacks.

A camouflage works best on the detectors that it was optimized against, and better on their relatives than on others.
So what was attacked, its relatives and what took no part are never averaged together.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from .detectors import is_own, lineage_of

TOOK_NO_PART, RELATIVE, ATTACKED = "took no part", "family of an attacked one", "attacked"
PARTS = (TOOK_NO_PART, RELATIVE, ATTACKED)
OWN = "this project's own"
"""Those that were not attacked and have learnt on this project's own images: they are no evidence of how others do."""


def parts_of(detectors: Sequence[str], attacked: Collection[str]) -> dict[str, list[str]]:
    """Part -> the detectors that had it: each stands in one of :data:`PARTS`, in that order, or else in :data:`OWN`.

    Args:
        attacked: names of what any camouflage was optimized against, measured or not.

    >>> parts_of(["yolov3-tiny", "yolov4-tiny", "mobilenet-ssd"], ["yolov3-tiny"])
    {'took no part': ['mobilenet-ssd'], 'family of an attacked one': ['yolov4-tiny'], 'attacked': ['yolov3-tiny']}
    """
    met = set(map(lineage_of, attacked))
    strangers = [name for name in detectors if lineage_of(name) not in met]
    parts = {
        TOOK_NO_PART: [name for name in strangers if not is_own(name)],
        RELATIVE: [name for name in detectors if lineage_of(name) in met and name not in attacked],
        ATTACKED: [name for name in detectors if name in attacked],
        OWN: [name for name in strangers if is_own(name)],
    }
    return {part: names for part, names in parts.items() if names}


def attacked_by(parts: Mapping[str, Sequence[str]], against: Collection[str]) -> list[str]:
    """What counts as attacked for one paint: what it was optimized against itself; all of it where it attacked nothing.

    Args:
        against: names that the paint was optimized against.
    """
    return [name for name in parts.get(ATTACKED, ()) if not against or name in against]


def leading(parts: dict[str, list[str]]) -> tuple[str, list[str]]:
    """The part that a claim rests on where there is one figure to tell: the first, farthest from the attacks.

    >>> leading(parts_of(["yolov3-tiny", "yolov4-tiny"], ["yolov3-tiny"]))
    ('family of an attacked one', ['yolov4-tiny'])
    """
    return next(iter(parts.items()))

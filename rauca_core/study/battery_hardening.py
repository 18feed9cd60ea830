"""Harden a detector on a battery's attack views: never on the views or camouflages that the battery judges it by."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Unpack

from ..runtime.folder_lock import alone_in
from ..training.settings import HardenSettings
from .assess import EFFORTS
from .battery import LATEST, load_battery
from .engine import Means, open_engine
from .harden import link_weights, recipe_of
from .interpolated import Interpolation, interpolated
from .store import user_cache
from .views import HeldOut


def harden_on_battery(
    detector: str,
    out: Path | str,
    *,
    battery: str = LATEST,
    budget: str = "quick",
    vehicles: Sequence[str] = (),
    settings: HardenSettings | None = None,
    interpolation: Interpolation | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Path:
    """Fine-tune a detector on camouflages made against it round by round.

    Args:
        detector: a name or file, of a kind that can be trained.
        out: where the weights are linked to.
        battery, budget, vehicles: as of :func:`~rauca_core.study.assess.assess`; they say what is trained on.
        interpolation: how much of what was learnt is kept, and how that is decided.
        command: what was typed, for the weights' card.

    Returns:
        The weights, which `load_detector` takes.

    Raises:
        RaucaError: the detector cannot be trained; a mistake, before anything is rendered.
    """
    out, frozen, chosen = Path(out), load_battery(battery), settings or HardenSettings.make(map_size=512)
    means.setdefault("threads", chosen.threads)
    engine = open_engine(user_cache(), [], **means)
    frames = EFFORTS[budget].frames
    with alone_in(out):
        shown = [choice for _, choice in frozen.choices(vehicles)]
        data = engine.make(*(frozen.attack_views(choice, frames) for choice in shown))
        learnt = recipe_of(engine, detector, data, data, [], chosen, out, command)
        keeping = interpolation or Interpolation()
        (folder,) = engine.make(interpolated(detector, learnt, shown[0], data, keeping, HeldOut()))
        return link_weights(folder, out)

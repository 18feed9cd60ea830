"""Harden the detector that was assessed, and assess what comes of it on the same battery."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..runtime.folder_lock import alone_in
from ..training.settings import HardenSettings
from .assess import EFFORTS, assess
from .assessment import Assessment
from .battery import LATEST, load_battery
from .engine import open_engine
from .harden import link_weights, recipe_of
from .store import user_cache
from .study import Study

MEANS = ("device", "threads", "blender", "render_device", "executor", "on_progress")


def assess_hardened(
    detector: str, out: Path | str, settings: HardenSettings | None = None, **asked: Any
) -> tuple[Path, Assessment, Study]:
    """Harden a detector on the battery's attack views, never on the views or camouflages that it is judged by.

    Args:
        detector: a name or file, of a kind that can be trained.
        out: for the weights and the assessment.
        asked: as of :func:`~rauca_core.study.assess.assess`.

    Returns:
        The hardened weights, their assessment, and the study behind it.

    Raises:
        RaucaError: the detector cannot be trained; as of ``assess``.
    """
    out, command = Path(out), asked.get("command", "")
    engine = open_engine(user_cache(), [], **{name: asked[name] for name in MEANS if name in asked})
    battery, effort = load_battery(asked.get("battery", LATEST)), EFFORTS[asked.get("budget", "quick")]
    views = [battery.attack_views(choice, effort.frames) for _, choice in battery.choices(asked.get("vehicles", ()))]
    with alone_in(out):
        data = engine.make(*views)
        chosen = settings or HardenSettings.make(map_size=512)
        (folder,) = engine.make(recipe_of(engine, detector, data, data, [], chosen, out, command))
        weights = link_weights(folder, out)
    found, study = assess(str(weights), out / "assessed", **asked)
    return weights, found, study

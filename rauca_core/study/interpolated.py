"""How much of what a hardened detector learnt is kept: a step of a study, decided in rendered validation places.

The training's own frames are too few and too alike for that: other objects stand beside the vehicle in a tenth of
them. Nor may the places that it is judged in decide. So views of a town of its own are rendered, one in each place, in
the weathers that the detector learnt in, of the vehicle in its own paint. As a step of its own it costs no training:
another agreement takes the same learnt weights back anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..contract import Dataset, Progress, RaucaError, read_plan
from ..contract.towns import VALIDATION
from ..detect.agreement import Agreement
from ..detect.synth.card import read_any_card
from ..runtime.cpu_time import counted_in
from ..runtime.devices import find_device
from ..training.hardenable import origin_of
from ..training.interpolation import MOST_LOOKS, Pictures, go_back
from . import recipes
from .artifact import Artifact
from .candidates import VehicleChoice
from .detecting import image_tensor, pictures_in
from .job import Job
from .views import HeldOut, weather_views


@dataclass(frozen=True)
class Interpolation:
    """How much is kept.

    Attributes:
        agreement: share of the objects beside the vehicle on which the result is to agree with the detector as it was,
            see `training.interpolation`; 0 keeps the weights as they learnt, and renders nothing.
        places: that are rendered to decide it, a view of each.
    """

    agreement: float = 0.97
    places: int = 192

    def __post_init__(self) -> None:
        if not 0 <= self.agreement <= 1:
            raise RaucaError(f"--agreement {self.agreement}: give a share from 0 to 1")
        if self.places < 1:
            raise RaucaError(f"--agreement-places {self.places}: give 1 or more")


def interpolated(
    detector: str,
    hardened: Artifact,
    vehicle: VehicleChoice,
    data: Sequence[Path],
    chosen: Interpolation,
    like: HeldOut,
) -> Artifact:
    """The detector that is to be kept of a hardening; ``hardened`` itself where all of it is.

    Args:
        detector: that was hardened.
        vehicle: that the places show.
        data: that it learnt on, for its weathers.
        like: how views are made, but for how many and where.
    """
    if not chosen.agreement:
        return hardened
    weathers = {weather.name: weather for folder in data for weather in read_plan(folder).weathers}
    town = VALIDATION["share of a hardening that is kept"]
    sets = {"validation": tuple(weathers.values())}
    views = weather_views(vehicle, sets, like.one_a_place(chosen.places, town))["validation"]
    return recipes.interpolated(detector, hardened, views, chosen.agreement)


def run_interpolation(job: Job) -> None:
    """Take what a hardening learnt back as far as the views ask for, and save the detector of it."""
    (hardened, views), options, device = job.inputs, job.artifact.options, find_device(job.machine.device)
    origin = origin_of(options["detector"])
    wanted, looked = set(options["frames"]), 0  # one in which the vehicle is hidden was not rendered
    shown = pictures_in(views, [frame.id for frame in Dataset(views).frames() if frame.id in wanted])

    def tell(share: float, agreement: Agreement) -> None:
        nonlocal looked
        looked += 1
        said = f"{agreement.agreed} of {agreement.objects} other objects as before"
        job.report(Progress(looked, MOST_LOOKS, f"{share:.0%} of what was learnt: {said}"))

    with counted_in(job.folder) as spent:
        images = [image_tensor(path, frame).to(device) for path, frame in zip(shown.paths, shown.frames, strict=True)]
        vehicles = [None if frame.box_xyxy is None else np.array(frame.box_xyxy) for frame in shown.frames]
        pictures = Pictures(origin.detector().to(device), images, vehicles)
        learnt = origin.hardened_in(hardened)
        network, card = origin.network(learnt)[0].to(device), read_any_card(learnt.with_suffix(".json"))[0]
        before = origin.network()[0].to(device).state_dict()
        agreement = job.artifact.settings["agreement"]
        share, found = go_back(network, before, origin.detecting, pictures, agreement, tell)
        told = {**card.hardened, "share_of_weights": share, "agreed": found.agreed, "objects": found.objects}
        minutes = round(card.cpu_minutes + spent(), 2)
    origin.save(origin.hardened_in(job.folder), network, replace(card, cpu_minutes=minutes, hardened=told))

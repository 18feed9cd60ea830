"""A data set from Python: opened, made as ``rauca dataset make`` does, its new cameras drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from .. import contract
from ..contract import MakeDataset, Plan, Quality, Ring, Scenery, VehicleSource, balanced_frames
from ..runtime.blender import run_blender
from .job import OnProgress, quiet
from .views import weathers_named

if TYPE_CHECKING:
    from ..environment.views import Views


class Dataset(contract.Dataset):
    """A data set folder opened for reading: its plan, its finished frames, new cameras in its places."""

    def views(self, n: int, ring: Ring | None = None, jitter: Ring | None = None, seed: int = 0) -> Views:
        """``n`` frames of new cameras in the rendered places, each composed from rendered ones when it is asked for.

        View i is a function of the data set, the ring, the seed and i. They are to learn from: evaluation refuses them.

        Args:
            ring: of the new cameras; by default one that fills the space between the data set's own.
            jitter: a ring whose jitters are taken in place of those of ``ring``.
            seed: names the jitter.

        Raises:
            RaucaError: no light maps, no finished frames, frames that are composed themselves, n below 1, or a ring of
                fewer cameras than the views need.
        """
        from ..environment.views import Views

        return Views(self, n, ring, jitter, seed)


def make_dataset(
    out: Path | str,
    vehicle: str | Path = "sedan",
    weathers: str = "demo",
    *,
    azimuths: int | Sequence[float] = 8,
    elevations: Sequence[float] = (10.0, 25.0),
    distances: Sequence[float] = (6.0, 10.0),
    locations: int = 1,
    jitter: Ring | None = None,
    size: int = 320,
    samples: int = 8,
    light: bool = True,
    finish: str = "own",
    seed: int = 0,
    frames: int | None = None,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    scene: Path | None = None,
    workers: int = 1,
    render_device: str = "cpu",
    blender: Path | None = None,
    on_progress: OnProgress = quiet,
) -> Dataset:
    """Render a data set of a vehicle: every view in every weather; run again to go on where it stopped.

    Args:
        vehicle: a shipped name, a vehicle folder, or an .obj, .glb or .blend.
        weathers: a preset's name, or a .json file.
        azimuths, elevations: of the cameras, degrees; a whole number of azimuths spreads them evenly.
        distances: of the cameras, metres.
        locations: places in the town.
        jitter: a ring whose jitters and field of view are taken; none, and 60 degrees, if left out.
        size: frames are square, pixels.
        samples: Cycles samples per pixel before denoising.
        light: render the light maps that an optimization needs.
        frames: a balanced part of so many; all of them if left out.
        paint_mask, paint_material: where the paint of a vehicle file is.
        scene: a .blend of yours instead of the town.
        workers: Blender processes at once.
        render_device: of Cycles: cpu, gpu or auto.

    Raises:
        RaucaError: a mistake, another data set in the folder, or frames that could not be rendered.
    """
    out = Path(out)
    around = [index * 360.0 / azimuths for index in range(azimuths)] if isinstance(azimuths, int) else azimuths
    ring = Ring(tuple(map(float, around)), tuple(map(float, elevations)), tuple(map(float, distances)))
    if jitter is not None:
        seen = ("azimuths_deg", "elevations_deg", "distances_m")
        ring = replace(jitter, **{name: getattr(ring, name) for name in seen})
    plan = Plan.of(
        weathers_named(weathers), ring, name=out.name, size=size, quality=Quality(samples), light=light, seed=seed,
        locations=locations, scenery=Scenery.of_file(scene) if scene else Scenery(), finish=finish,
    )  # fmt: skip
    plan.check("make_dataset")
    source = VehicleSource(str(vehicle), paint_mask, paint_material)
    chosen = None if frames is None else tuple(balanced_frames(plan, frames))
    job = MakeDataset(out, plan, source, scene, chosen, workers=workers, device=render_device)
    report: Callable[..., None] = partial(on_progress, "rendering data set")
    run_blender(job, report, blender)
    return Dataset(out)

"""The main job on one screen: data sets -> optimize -> re-render -> measure, on one vehicle and by three detectors.

``rauca demo`` runs it; run again to resume. In its folder lie ``study.json`` and what `evaluate` describes, and links
to what was made on the way: ``train``, ``held-out``, ``rauca`` and ``random``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack

from ..attack import FEW_STEPS, make_settings, read_history, settings_of
from ..contract import Dataset, Plan, Progress, Quality, RaucaError, Ring, load_camouflage
from ..contract.towns import TEST, TRAINING
from ..detect import fetch
from ..runtime.folder_lock import alone_in
from . import recipes
from .artifact import Artifact, plain_label
from .candidates import RANDOM, VehicleChoice, find_vehicles, read_vehicle_choice
from .detectors import detectors_for
from .engine import Engine, Means, open_engine
from .judging import Judges, Place, judge
from .makers import CAMOUFLAGE
from .store import link
from .study import FILE_NAME, Study, save_study
from .views import weathers_named

WHITE_BOX = "yolov3-tiny"
BLACK_BOX = ("yolov4-tiny", "yolov2-tiny")
SEED = 1  # of the optimization and of the random paint
RANDOM_CELL = 8  # texels; finer noise averages to grey at these distances and would be a weaker rival
MAP_SIZE, SUBSAMPLES = 1024, 12  # texels of a side; of the neural renderer, per pixel and axis
OURS = "ours"  # what the optimized camouflage is called

TRAIN = Ring((0.0, 90.0, 180.0, 270.0), (6.0, 20.0), (7.0,), 45.0, 6.0, 0.3, 0.3)
HELD_OUT = Ring((20.0, 110.0, 200.0, 290.0), (6.0, 20.0), (6.0, 8.0), 10.0, 5.0, 0.1, 0.3)


@dataclass(frozen=True)
class DemoScale:
    """How much the demo renders and optimizes; the default fits two cores and ten minutes, with the installation.

    Attributes:
        size, samples: frames are square, pixels; Cycles samples per pixel.
        train, held_out: cameras and locations; the held-out views are in another town, from other cameras.
    """

    size: int = 320
    samples: int = 4
    train: Ring = TRAIN
    train_locations: int = 2
    held_out: Ring = HELD_OUT
    steps: int = 200
    batch: int = 4


def demo(
    out: Path | str,
    vehicle: str = "sedan",
    *,
    paint_mask: Path | None = None,
    paint_material: str | None = None,
    scale: DemoScale | None = None,
    command: str = "",
    **means: Unpack[Means],
) -> Study:
    """Run or resume the demo.

    Args:
        vehicle: a shipped one's name, a vehicle folder, or an .obj, .glb or .blend.
        paint_mask, paint_material: where the paint of such a file is.
    """
    out, size = Path(out), scale or DemoScale()
    engine, names = open_engine(out / "store", **means), (WHITE_BOX, *BLACK_BOX)
    with alone_in(out):
        for number, name in enumerate(names):
            engine.on_progress("fetching weights", Progress(number, len(names), name))
            fetch(name)
        body = engine_vehicle(engine, vehicle, paint_mask, paint_material)
        assert body.place is not None
        choice = read_vehicle_choice(body.place)
        choice = replace(choice, category=choice.target)
        detectors = detectors_for(names, [choice.category], engine.machine)
        wanted = {
            **FEW_STEPS, "map_size": MAP_SIZE, "samples": SUBSAMPLES, "steps": size.steps, "batch": size.batch,
            "seed": SEED, "checkpoint_every": 50,
        }  # fmt: skip
        settings = make_settings(**settings_of("ours", **wanted, target=choice.target))
        train = _views(body, size, "train")
        held_out = _views(body, size, "held-out")
        folders = engine.make_named(
            {
                "train": train,
                "held-out": held_out,
                RANDOM: recipes.random_paint(body, MAP_SIZE, SEED, RANDOM_CELL),
                OURS: recipes.paint(train, settings, detectors[choice.category][:1]),
            }
        )
        for name, folder in folders.items():
            link(out / name, folder)
        paints = {name: folders[name] / CAMOUFLAGE for name in (RANDOM, OURS)}
        place = Place("held-out views", choice, held_out)
        study = judge(engine, out, [place], {choice: paints}, Judges(detectors), command)
        link(out / "renders", out / choice.name / plain_label(place.name) / "renders")
        study = replace(study, notes=_notes(out, folders, engine))
        save_study(out / FILE_NAME, command, study.entries, study.notes)
    return study


def engine_vehicle(
    engine: Engine, vehicle: str, paint_mask: Path | None = None, paint_material: str | None = None
) -> Artifact:
    """A vehicle by a shipped name, its folder, or a file that Blender reads first."""
    if Path(vehicle).is_file():
        (folder,) = engine.make(recipes.vehicle_file(Path(vehicle), paint_mask, paint_material))
        return recipes.vehicle_in(folder)
    if paint_mask or paint_material:
        raise RaucaError(f"--vehicle {vehicle} brings its own paint; drop the paint option")
    return recipes.vehicle_in(find_vehicles([vehicle])[0].folder)


def views_plan(vehicle: VehicleChoice, size: DemoScale, label: str) -> Plan:
    """Of the frames to optimize on, ``train``, with light maps, or of those to judge on, in another town."""
    training = label == "train"
    ring, locations = (size.train, size.train_locations) if training else (size.held_out, 1)
    town = (TRAINING if training else TEST)["demo"]
    return Plan.of(
        weathers_named("demo"), ring, name=label, vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id, size=size.size,
        quality=Quality(size.samples), light=training, locations=locations, seed=town,
    )  # fmt: skip


def _views(body: Artifact, size: DemoScale, label: str) -> Artifact:
    assert body.place is not None
    plan = views_plan(read_vehicle_choice(body.place), size, label)
    return recipes.data_set(label, plan, body, [frame.id for frame in plan.frames()])


def _notes(out: Path, folders: Mapping[str, Path], engine: Engine) -> dict[str, Any]:
    """What the report tells beside the numbers."""
    history, run = read_history(folders[OURS]), out.as_posix()
    made = load_camouflage(folders[OURS] / CAMOUFLAGE)[0].made
    dataset, trained = Dataset(folders["held-out"]), Dataset(folders["train"])
    plan = dataset.plan
    return {
        "title": f"Camouflage on the {plan.vehicle_name}",
        "histories": {OURS: {term: [row[term] for row in history] for term in ("attack", "score")}},
        "settings": {
            "vehicle": plan.vehicle_name,
            "Blender": plan.blender,
            "training frames": f"{len(trained.frames())} at {plan.size} px, {plan.quality.samples} samples",
            "held-out frames": f"{len(dataset.frames())}, another town and other cameras, rendered by Cycles",
            "weathers": ", ".join(weather.name for weather in plan.weathers),
            **{name: value for name, value in made.items() if isinstance(value, str | int | float)},
        },
        "commands": [
            f"rauca report {run}",
            f"rauca bench agreement {run}/train --camouflage {run}/rauca/camouflage.json",
        ],
        "timings_s": engine.seconds,
    }

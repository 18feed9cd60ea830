"""``rauca ablate``: from what the user types to a checked request; mistakes are told before anything is rendered."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rauca_core.contract import RaucaError

from .console import console
from .dataset_commands import Blender

if TYPE_CHECKING:
    from rauca_core.detect import Detector
    from rauca_core.study.ablations import Experiment, Variant
    from rauca_core.study.contestants import VehicleChoice

WHITE_BOX = "yolov3-tiny"
Data = Annotated[
    Path | None,
    typer.Option(
        help="folder that ablations share: training sets, views, optimized camouflages; OUT/../data if left out"
    ),
]


def ablate(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="baselines, renderer, dataset, beta, augmentation, environment, views, limit, sampling or paint",
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for the table; run again to resume")],
    data: Data = None,
    quick: Annotated[bool, typer.Option("--quick", help="few variants, frames and steps: minutes, not hours")] = False,
    seeds: Annotated[
        int | None, typer.Option(min=1, help="camouflages per variant; as many as fit two hours if left out")
    ] = None,
    variants: Annotated[str | None, typer.Option(help="keys of some variants only, comma separated")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="of every optimization")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="frames per step")] = None,
    lr: Annotated[float | None, typer.Option(help="Adam's learning rate, on sRGB values")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="of every training set")] = None,
    held_out: Annotated[int | None, typer.Option(min=2, help="frames to measure on, per weather set")] = None,
    weathers: Annotated[str | None, typer.Option(help="seen, unseen, both, or a preset's name or .json file")] = None,
    size: Annotated[int | None, typer.Option(min=64, help="frames are square, pixels")] = None,
    samples: Annotated[int | None, typer.Option(min=1, help="Cycles samples per pixel before denoising")] = None,
    map_size: Annotated[int | None, typer.Option(min=64, help="side of the UV map, texels")] = None,
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or a vehicle folder")] = "sedan",
    attack: Annotated[
        list[str] | None, typer.Option(help="detector to optimize against; repeat for several; yolov3-tiny if left out")
    ] = None,
    detectors: Annotated[
        str | None, typer.Option(help="to measure with, comma separated; all that are ready and not this project's own")
    ] = None,
    resamples: Annotated[int, typer.Option(min=1, help="of the bootstrap behind the intervals")] = 1000,
    threads: Annotated[int | None, typer.Option(help="of torch; its own choice by default")] = None,
    device: Annotated[str, typer.Option(help="of the detectors that measure")] = "cpu",
    blender: Blender = None,
) -> None:
    """Optimize variants, measure all on the same held-out views, and hold the paper's orderings against them."""
    from rauca_core.detect import load_detector
    from rauca_core.study.ablations import DEFAULT, QUICK, experiment_named
    from rauca_core.study.contestants import find_vehicles
    from rauca_core.study.measure import check_detectors

    from .ablate import Ablation, run_ablation
    from .ablate_workspace import Workspace

    experiment = experiment_named(name)
    given: dict[str, Any] = {
        "steps": steps, "batch": batch, "lr": lr, "frames": frames, "held_out": held_out, "pixels": size,
        "samples": samples, "map_size": map_size, "seeds": seeds, "weathers": _weathers(weathers),
        "detectors": _split(detectors),
    }  # fmt: skip
    sizes = replace(QUICK if quick else DEFAULT, **{k: v for k, v in given.items() if v is not None})
    found = find_vehicles([vehicle])[0]
    attacked = {one: load_detector(one) for one in attack or [WHITE_BOX]}
    check_detectors(list(attacked.values()), found.category)
    measuring = _measuring(sizes.detectors, found, device)
    request = Ablation(
        command=shlex.join(["rauca", *sys.argv[1:]]),
        experiment=experiment,
        variants=_variants(experiment, variants, quick),
        seeds=sizes.seeds or experiment.seeds,
        sizes=sizes,
        out=out,
        workspace=Workspace(data or out.parent / "data", found, sizes, blender),
        attacked=attacked,
        detectors=measuring,
        threads=threads,
        resamples=resamples,
        device=device,
    )
    console.print(f"ablation: {run_ablation(request)}", highlight=False, soft_wrap=True)


def _split(given: str | None) -> tuple[str, ...] | None:
    return tuple(dict.fromkeys(part for part in given.split(",") if part)) if given else None


def _weathers(given: str | None) -> tuple[str, ...] | None:
    from .evaluate_command import weather_sets

    return None if given is None else tuple(weather_sets(_split(given) or (), has_datasets=False))


def _variants(experiment: Experiment, given: str | None, quick: bool) -> Sequence[Variant]:
    if given:
        return [experiment.variant(key) for key in _split(given) or ()]
    return [variant for variant in experiment.variants if variant.quick or not quick]


def _measuring(names: Sequence[str] | None, vehicle: VehicleChoice, device: str) -> list[Detector]:
    """Detectors by name; without names all that are here, know the vehicle's class, and did not learn from us."""
    from rauca_core.detect import find_class, load_detector
    from rauca_core.detect.weights import ready_names
    from rauca_core.study.families import is_own
    from rauca_core.study.measure import check_detectors

    if names:
        found = [load_detector(name, device=device) for name in names]
    else:
        ready = [load_detector(name, device=device) for name in ready_names() if not is_own(name)]
        found = [detector for detector in ready if find_class(detector.class_names, vehicle.category) is not None]
    if not found:
        raise RaucaError("--detectors: none is ready; get weights with `rauca weights fetch --all`")
    check_detectors(found, vehicle.category)
    return found

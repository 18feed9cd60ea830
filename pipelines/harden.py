"""``rauca harden``: fine-tune a detector on camouflages, measure what it gained, and print the table."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

import rauca_core as rauca

from .console import command_line, console
from .options import Blender, Device, RenderDevice, Seed, Slurm, Threads, means_of
from .tables import print_table

training_option = partial(typer.Option, rich_help_panel="The training")
attack_option = partial(typer.Option, rich_help_panel="The attacks that it is trained on")
judging_option = partial(typer.Option, rich_help_panel="What it is judged by")
Held = Annotated[
    list[str],
    typer.Option("--held-out", help="camouflage .json, or LABEL=FILE, to judge by; never trained on; repeat for more"),
]
Data = Annotated[
    list[Path], typer.Option("--data", help="data set with light maps to train on, all of one size; repeat for more")
]
Views = Annotated[
    list[Path] | None, judging_option("--views", help="rendered views to judge on; new ones are rendered without")
]


def harden(
    detector: Annotated[
        str,
        typer.Argument(
            help="frcnn-synth, yolov3-tiny ..., an .onnx of YOLO or YOLOX, a framework's model, or hardened weights"
        ),
    ],
    held_out: Held,
    data: Data,
    out: Annotated[Path, typer.Option(help="folder for the weights, report and all on the way; run again to go on")],
    camouflage: Annotated[list[Path] | None, typer.Option(help="camouflage .json to train on; repeat for more")] = None,
    rounds: Annotated[int, training_option(help="of attack and fine-tuning")] = 1,
    steps: Annotated[int, training_option(help="of fine-tuning in each round")] = 320,
    attack_steps: Annotated[int, attack_option(help="of the attacks that open the first round; 0 for none")] = 100,
    attack_growth: Annotated[
        float, attack_option(help="share of these by which each further round's are longer")
    ] = 0.0,
    attack_restarts: Annotated[int, attack_option(help="attacks in each round; all of them are trained on")] = 1,
    attack_method: Annotated[
        list[str] | None, attack_option(help="of these attacks, ours without; several take turns")
    ] = None,
    attack_patch_cm: Annotated[
        list[float] | None, attack_option(help="smallest patch of those by ours, 5 without; several take turns")
    ] = None,
    attack_lr: Annotated[float, attack_option(help="of these attacks, on sRGB values")] = 0.03,
    budgets: Annotated[
        str, judging_option(help="of the attacks on the result, in multiples of all attacks of the rounds; or none")
    ] = "1,3,10",
    restarts: Annotated[int, judging_option(min=1, help="of each attack on the result")] = 2,
    held_out_method: Annotated[
        list[str] | None, judging_option(help="judge by a camouflage of this method, too; never trained on")
    ] = None,
    held_out_vehicle: Annotated[
        list[Path] | None, judging_option(help="data set of a vehicle to judge on, too; never trained on")
    ] = None,
    inner_step: Annotated[
        float, training_option(help="how far an attack inside every training step moves the paint; 0 for none")
    ] = 0.5,
    beside: Annotated[
        int,
        training_option(help="camouflages for each vehicle that learn beside the detector, step by step; 0 for none"),
    ] = 2,
    agreement: Annotated[
        float, training_option(help="with the detector as it was, on other objects; 0 keeps the weights as they learnt")
    ] = 0.97,
    agreement_places: Annotated[
        int, training_option(min=1, help="new places that decide how much of what was learnt is kept")
    ] = 192,
    share: Annotated[float, training_option(help="of training frames that wear a camouflage")] = 0.5,
    batch: Annotated[int, training_option(help="images per step of fine-tuning")] = 8,
    lr: Annotated[
        float | None, training_option(help="AdamW's learning rate; from the detector's own by default")
    ] = None,
    map_size: Annotated[int, training_option(help="side of the UV maps that frames are composed with, texels")] = 1024,
    samples: Annotated[int, training_option(help="subsamples per pixel and axis of the neural renderer")] = 12,
    precision: Annotated[str, training_option(help="of training and attacks: float32 or bfloat16")] = "float32",
    every: Annotated[int, training_option(help="steps between tests and checkpoints")] = 60,
    views: Views = None,
    weathers: Annotated[str, judging_option(help="of new views: seen, unseen, both, or a preset")] = "seen",
    frames: Annotated[int, judging_option(min=1, help="new views per weather set")] = 48,
    other_places: Annotated[
        int, judging_option(min=0, help="a new view in each of so many more places, to compare other objects there")
    ] = 48,
    seed: Seed = 0,
    threads: Threads = None,
    device: Device = "cpu",
    slurm: Slurm = None,
    blender: Blender = None,
    render_device: RenderDevice = "cpu",
) -> None:
    """Fine-tune a detector on camouflages, fresh ones among them, and measure before and after on held-out ones."""
    from rauca_core.report import write_hardening
    from rauca_core.report.hardening_page import gains_table, sentences
    from rauca_core.study.harden_measures import Measures
    from rauca_core.study.interpolated import Interpolation
    from rauca_core.study.views import HeldOut
    from rauca_core.training.settings import HardenSettings

    settings = HardenSettings.make(
        rounds=rounds, steps=steps, attack_steps=attack_steps, attack_growth=attack_growth,
        attack_restarts=attack_restarts, attack_methods=attack_method or None,
        attack_patches=attack_patch_cm or None, attack_lr=attack_lr, inner_step=inner_step, beside=beside,
        share=share, batch=batch, lr=lr, map_size=map_size, samples=samples, precision=precision,
        every=every, seed=seed, threads=threads,
    )  # fmt: skip
    times = _times(budgets)
    methods, vehicles = tuple(held_out_method or ()), tuple(held_out_vehicle or ())
    measures = Measures(times, restarts, methods, vehicles, other_places)
    with means_of(device, slurm, blender, render_device, threads) as means:
        found = rauca.harden(
            detector, data, held_out, out, camouflages=camouflage or (), settings=settings,
            interpolation=Interpolation(agreement, agreement_places), measures=measures, views=views or (),
            weathers=[weathers], held_out_views=HeldOut(frames),
            command=command_line(short=True), **means,
        )  # fmt: skip
    for path in write_hardening(found, out / "report.html"):
        console.print(f"report: {path}", highlight=False, soft_wrap=True)
    for gains in found.gains:
        print_table(gains_table(gains, found))
        results = gains.entry.results
        said = f"{len(results.frames)} held-out views; in brackets: 95 % interval over {results.places}"
        console.print(said, highlight=False, soft_wrap=True)
    for line in sentences(found):
        console.print(line, highlight=False, soft_wrap=True)
    console.print(f"weights: {found.weights}", highlight=False, soft_wrap=True)


def _times(text: str) -> tuple[int, ...]:
    """``1,3,10`` or ``none``; raises :class:`RaucaError` for anything else."""
    try:
        return () if text == "none" else tuple(int(part) for part in text.split(","))
    except ValueError:
        raise rauca.RaucaError(f"--budgets {text}: give whole numbers such as 1,3,10, or none") from None

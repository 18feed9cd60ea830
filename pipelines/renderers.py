"""The neural renderer against Cycles on a data set: coverage everywhere, color on a share of frames rendered anew."""

from __future__ import annotations

from pathlib import Path

from pipelines.evaluate import render_camouflages
from rauca_core.contract import Dataset, RenderCamouflages, load_camouflage
from rauca_core.study.agreement import Agreement, measure_agreement, save_agreement

AGREEMENT = "agreement.json"
# One frame in so many is rendered anew in the camouflage; unfiltered and with many samples, since a denoised render
# of few is further from the truth than the prediction it would judge.
EVERY, SAMPLES = 24, 128


def reference_job(dataset: Path, camouflage: Path, out: Path) -> RenderCamouflages:
    """Renders a share of the data set's frames in a camouflage, as the truth that predictions are held against."""
    frames = tuple(frame.id for frame in Dataset(dataset).frames()[::EVERY])
    return RenderCamouflages(dataset, out, (camouflage,), frames, SAMPLES, denoise=False)


def compare_renderers(dataset: Path, camouflage: Path, out: Path, blender: Path | None = None) -> Agreement:
    """Render a share of the data set's frames in a camouflage, compare, write ``out/agreement.json``."""
    renders = out / "agreement"
    render_camouflages(reference_job(dataset, camouflage, renders), blender, "rendering the reference")
    agreement = measure_agreement(Dataset(dataset), camouflage, renders / load_camouflage(camouflage)[0].name)
    save_agreement(out / AGREEMENT, agreement)
    return agreement

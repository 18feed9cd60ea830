"""The neural renderer against Cycles on a data set: coverage everywhere, color on a share of frames rendered anew."""

from __future__ import annotations

from pathlib import Path

from pipelines.evaluate import render_camouflages
from rauca_core.contract import Dataset, load_camouflage
from rauca_core.study.agreement import Agreement, measure_agreement, save_agreement

AGREEMENT = "agreement.json"
# One frame in so many is rendered anew in the camouflage; unfiltered and with many samples, since a denoised render
# of few is further from the truth than the prediction it would judge.
REFERENCE = ("--every", "24", "--samples", "128", "--no-denoise")


def compare_renderers(dataset: Path, camouflage: Path, out: Path, blender: Path | None = None) -> Agreement:
    """Render a share of the data set's frames in a camouflage, compare, write ``out/agreement.json``."""
    renders = out / "agreement"
    render_camouflages(dataset, [camouflage], renders, blender, REFERENCE, "rendering the reference")
    agreement = measure_agreement(Dataset(dataset), camouflage, renders / load_camouflage(camouflage)[0].name)
    save_agreement(out / AGREEMENT, agreement)
    return agreement

"""The rival: as few samples per render as give the error of our frames."""

from __future__ import annotations

import math

import numpy as np

from .results import MAPS, SINGLE, Entry


def naive_samples(entries: list[Entry]) -> int:
    """Samples of one denoised render whose PSNR equals that of the default light maps, in one kind of weather.

    Between measured counts the PSNR goes with the logarithm of the samples; rounded down, in the rival's favor.
    Outside of them the nearest count is taken.

    Args:
        entries: of one kind of weather; the first of light maps is the default.
    """
    ours = next(entry for entry in entries if entry.what == MAPS)
    rival = sorted(
        (entry.samples, entry.psnr_db) for entry in entries if entry.what == SINGLE and entry.axis == "samples"
    )
    counts, psnrs = zip(*rival, strict=True)
    rising = np.maximum.accumulate(psnrs)
    return max(1, math.floor(2 ** float(np.interp(ours.psnr_db, rising, np.log2(counts))) + 1e-6))

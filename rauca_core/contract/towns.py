"""Which towns are trained in, chosen in and judged in: a town is the seed of a data set, and no seed has two uses.

What is optimized or trained sees training towns; what is chosen, such as a rate or a part of a method, is chosen by
validation towns; what is claimed is measured in test towns. A seed that is named nowhere here is anybody's to train in:
`rauca dataset make` takes 0, and the shipped extractor and detectors were trained in towns below 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

TRAINING: Mapping[str, int] = MappingProxyType(
    {
        "demo": 1,
        "ablations": 1,
        "bench environment": 11,
        "bench optimize": 21,
        "library of the batteries": 31_000,
        "attacks of the batteries": 31_500,
    }
)
VALIDATION: Mapping[str, int] = MappingProxyType({"ablations": 10_000, "share of a hardening that is kept": 10_001})
TEST: Mapping[str, int] = MappingProxyType(
    {
        "demo": 2,
        "bench environment": 12,
        "held-out views": 20_000,
        "crops on the E-Tron": 20_501,
        "patches on the E-Tron": 20_500,
        "whole frames on the E-Tron": 20_503,
        "the headline of the documentation": 20_504,
        "all methods on the E-Tron": 20_505,
        "number of frames on the sedan": 20_506,
        "other objects": 20_507,
        "the published cameras on the sedan": 20_508,
        "light of the environment on the sedan": 20_509,
        "beside the vehicle, of hardened detectors": 20_510,
        "crops on the sedan": 20_502,
        "held-out clips": 20_004,
        "batteries, street-seen": 31_600,
        "batteries, street-unseen": 31_601,
        "batteries, high": 31_602,
        "plain cars of detectors check": 31_700,
    }
)

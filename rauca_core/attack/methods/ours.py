"""Ours: what this project adds to RAUCA-final to reach detectors and views that took no part."""

from ..naturalness import Naturalness
from .method import Method

OURS = Method(
    name="ours",
    source="this project",
    weathers="enhanced",
    settings={
        # Small scores push as hard as large ones: Eq. 6 lets go of a frame long before average precision does.
        "objective": "log-score",
        # Finer patches are no longer seen as such from 5 m on, and fit the frames at hand rather than new ones.
        "natural": Naturalness(feature_cm=5.0),
        "lr": 0.03,
        "decay": 0.03,
    },
    assumed=(
        "Exact light stands for the environment feature extractor; `--light ours` estimates it from the picture.",
    ),
)

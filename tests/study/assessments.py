"""A small assessment, for tests of what is made of one."""

from __future__ import annotations

from rauca_core.study.assessment import Assessed, Assessment, Defended, Score
from rauca_core.study.mistakes import Mistakes
from rauca_core.study.weak_spots import Cell, Range, WorstTenth

DETECTOR = Assessed("mine", "onnx", "0" * 64, True, "", 12.5)


def assessment(white_box: Score | None = None) -> Assessment:
    def score(ap: float) -> Score:
        return Score(ap, ap - 0.1, ap + 0.1, ap, 24)

    return Assessment(
        DETECTOR, "assess-1", "quick", ("sedan",), 0.25, score(0.9), score(0.7), score(0.4), white_box, "it has no gradient",
        {"ours-ssd": score(0.4)}, {"normal": Cell(45.0, 8.0, "noon", 0.5, 0.3, ("f1", "f2"))},
        {"normal": WorstTenth(0.1, 0.0, ("f2",))}, {"normal": Mistakes(24, found=20, missed=4)},
        {"normal": Range(16.0, beyond=True, never=False)}, {"jpeg": Defended(score(0.9), score(0.8), score(0.5), None, None)}, {"rendering": 60.5},
        {"clean": (0.9, 0.8), "random": (0.7, 0.7), "transfer": (0.4, 0.3)},
    )  # fmt: skip

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
        detector=DETECTOR,
        battery="assess-1",
        budget="quick",
        vehicles=("sedan",),
        threshold=0.25,
        clean=score(0.9),
        random=score(0.7),
        transfer=score(0.4),
        white_box=white_box,
        white_box_note="it has no gradient",
        transfer_by_camouflage={"ours-ssd": score(0.4)},
        worst_cell={"normal": Cell(45.0, 8.0, "noon", 0.5, 0.3, ("f1", "f2"))},
        worst_tenth={"normal": WorstTenth(0.1, 0.0, ("f2",))},
        errors={"normal": Mistakes(24, found=20, missed=4)},
        range_m={"normal": Range(16.0, beyond=True, never=False)},
        defences={"jpeg": Defended(score(0.9), score(0.8), score(0.5), None, None)},
        seconds={"rendering": 60.5},
        without_place={"clean": (0.9, 0.88), "random": (0.7, 0.7), "transfer": (0.4, 0.38)},
    )

"""``rauca.assess``: a detector in, whatever holds it, and out what there is to say of its robustness."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from ..contract import RaucaError
from ..detect import Detector, load_detector
from ..study import assess as assessing
from ..study.artifact import digest_of
from ..study.assessment import Assessment, Condition, load_assessment
from ..study.store import user_cache
from ..study.study import data_frame
from .assessment_page import write_assessment
from .assessment_tables import paints_of, shown_range
from .study_page import Study


@dataclass(frozen=True)
class Robustness:
    """What an assessment found.

    Attributes:
        assessment: every figure; on disk, ``assess.json``.
        study: the detections behind them.
    """

    assessment: Assessment
    study: Study

    @property
    def headline(self) -> str:
        """The result in one line."""
        return self.assessment.headline

    def table(self) -> Any:
        """A row per paint, and one for the mean of the library's camouflages.

        Returns:
            A `pandas.DataFrame` where pandas is installed, else a list of dicts with the same names: ``paint``, ``ap``
            (AP@0.5, 0 to 1), ``low`` and ``high`` (its 95 % interval), ``recall`` at the deployed score, ``frames``,
            and ``found_up_to_m`` (text; the distance from which on the vehicle is missed more often than found).
        """
        ranges = {name: shown_range(one) for name, one in self.assessment.range_m.items()}
        return data_frame(
            [
                {
                    "paint": paint, "ap": score.ap, "low": score.low, "high": score.high, "recall": score.recall,
                    "frames": score.frames, "found_up_to_m": ranges.get(paint, ""),
                }
                for paint, (score, _) in paints_of(self.assessment).items()
            ]
        )  # fmt: skip

    def report(self, path: Path | str = "report.html", before: Path | str | None = None, latex: bool = False) -> Path:
        """Write the assessment as one self-contained page, and its numbers beside it as CSV and JSON (LaTeX if asked).

        Args:
            before: ``assess.json`` of an earlier assessment, to say what changed.

        Returns:
            The page's path.

        Raises:
            RaucaError: images or detections that are missing, or ``before`` is of another battery.
        """
        earlier = None if before is None else load_assessment(Path(before))
        return write_assessment(self.assessment, self.study, Path(path), earlier, latex)[0]

    def passes(self, *conditions: str) -> bool:
        """Whether all conditions such as ``transfer_ap=0.5`` are met, as ``rauca assess --fail-below`` asks.

        Raises:
            RaucaError: one that cannot be read; the message lists the figures.
        """
        return all(Condition.parse(one).failure(self.assessment) is None for one in conditions)


def assess(
    model: str | Path | Detector | nn.Module | Callable[[Tensor], Any],
    names: Sequence[str] | None = None,
    classes: Mapping[str, str] | None = None,
    budget: str = "quick",
    out: Path | str | None = None,
    **options: Any,
) -> Robustness:
    """Say how robust a detector is under the frozen battery: plain, random, in camouflages made for others and for it.

    Args:
        model: a name or file, a model in memory, a function from images to detections, or a loaded detector.
        names: of the network's classes in its order, where it holds none.
        classes: from the detector's own class names to COCO's, such as ``{"vehicle.car": "car"}``.
        budget: ``quick``, ``standard`` or ``overnight``.
        out: folder of the assessment; one in the user's cache if left out, the same for the same question.
        options: see :func:`rauca_core.study.assess.assess`: battery, vehicles, white_box, defences, device ...

    Raises:
        RaucaError: a mistake, before anything is rendered; another process at work in ``out``.
    """
    device = options.get("device", "cpu")
    # What has a name goes by it: tasks of a cluster load it by that.
    named = isinstance(model, str | Path) and not (names or classes)
    detector = str(model) if named else _loaded(model, names, classes, device)
    if out is None:
        known = _loaded(model, names, classes, device) if isinstance(detector, str) else detector
        asked = {"budget": budget, **{name: _told(options[name]) for name in sorted(_ASKED & set(options))}}
        out = user_cache() / "assessments" / digest_of([known.fingerprint, asked])
    found, study = assessing.assess(detector, out, budget=budget, **options)
    return Robustness(found, Study._of(study))


_ASKED = {"battery", "vehicles", "white_box", "defences", "threshold", "pictures", "clips"}


def _told(option: Any) -> Any:
    """An option as JSON takes it."""
    if isinstance(option, assessing.Driving):
        return asdict(option)
    return (
        [str(one) if isinstance(one, Path) else one for one in option] if isinstance(option, list | tuple) else option
    )


def _loaded(model: Any, names: Sequence[str] | None, classes: Mapping[str, str] | None, device: str) -> Detector:
    if not hasattr(model, "fingerprint"):
        return load_detector(model, device=device, names=names, classes=classes)
    if names or classes:
        raise RaucaError("assess: a loaded detector has its class names; give names and classes to load_detector")
    detector: Detector = model
    return detector

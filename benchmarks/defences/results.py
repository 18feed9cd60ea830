"""What was found, for JSON, the terminal and the page."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.tables import Grid


@dataclass(frozen=True)
class Outcome:
    """One defence on one paint.

    Attributes:
        cpu_ms: of the defence, per image.
        altered: share of the image's pixels that move by more than 16 of 255 levels in a channel.
        altered_on_vehicle: the same inside the vehicle's box.
        ap, score: detector -> AP@0.5, and mean best car score on the vehicle.
    """

    defence: str
    fingerprint: str
    paint: str
    cpu_ms: float
    altered: float
    altered_on_vehicle: float
    ap: dict[str, float]
    score: dict[str, float]


@dataclass(frozen=True)
class Results:
    """``white_box`` is the detector that the patch was optimized against; it covers ``patch_share`` of a box."""

    images: int
    size: tuple[int, int]
    white_box: str
    patch_share: float
    patch_steps: int
    outcomes: tuple[Outcome, ...]

    @property
    def paints(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(outcome.paint for outcome in self.outcomes))

    @property
    def defences(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(outcome.defence for outcome in self.outcomes))

    def of(self, defence: str, paint: str) -> Outcome:
        return next(o for o in self.outcomes if (o.defence, o.paint) == (defence, paint))


def grids(results: Results) -> list[Grid]:
    """Cost and alteration by defence; AP and car score by paint, defence and detector."""
    height, width = results.size
    cost: list[tuple[str, ...]] = []
    for defence in results.defences:
        found = [results.of(defence, paint) for paint in results.paints]
        cells = [f"{100 * o.altered:.1f} % / {100 * o.altered_on_vehicle:.1f} %" for o in found]
        cost.append((defence, f"{sum(o.cpu_ms for o in found) / len(found):.1f}", *cells))
    title = f"CPU ms per {width}x{height} image; pixels moved by > 16 levels: whole image / vehicle's box"
    tables: list[Grid] = [(title, ("defence", "ms", *results.paints), cost)]
    detectors, share = tuple(results.outcomes[0].ap), f"{100 * results.patch_share:.0f} %"
    for label, attribute in (("AP@0.5 of class car", "ap"), ("Mean car score on the vehicle", "score")):
        headers = ("defence", *(f"{paint}, {name}" for paint in results.paints for name in detectors))
        rows = [_row(results, defence, attribute, detectors) for defence in results.defences]
        tables.append(
            (
                f"{label}, {results.images} views (patch over {share} of the box, optimized on {results.white_box})",
                headers,
                rows,
            )
        )
    return tables


def _row(results: Results, defence: str, attribute: str, detectors: tuple[str, ...]) -> tuple[str, ...]:
    found = [getattr(results.of(defence, paint), attribute) for paint in results.paints]
    return (defence, *(f"{values[name]:.3f}" for values in found for name in detectors))

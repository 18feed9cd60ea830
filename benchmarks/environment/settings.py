"""How much is measured: enough to judge by in an hour on two cores, or a quick look."""

from __future__ import annotations

from dataclasses import dataclass

CLEAR, LOW, FOG, NIGHT = "sun90-fog0", "sun30-fog0", "sun30-fog90", "sun-90-fog0"
UNSEEN = (
    "noon-overcast",
    "morning-broken-clouds",
    "afternoon-haze",
    "ground-fog-at-sunrise",
    "wet-after-shower",
    "wet-night",
)


@dataclass(frozen=True)
class Settings:
    """One run's extent. Frames are of the sedan unless another vehicle is named.

    Attributes:
        size: of the square frames that extractors see, pixels: small, for the published one's sake.
        exact_size: of the frames on which exact maps are judged; the default of ``rauca dataset make``.
        samples: of Cycles per pixel in data sets; the default of ``rauca dataset make``.
        seen, unseen: weathers of the presets ``base``, on which extractors train, and ``unseen``.
        shown: the four weathers of the figure.
        locations, azimuths: of the training set; its cameras stand at both ``distances_m``.
        distances_m: near and far.
        test_azimuths: cameras of the test set, in another town, at each distance.
        uv_size: of the UV maps, texels.
        reference_samples: of each of two raw renders that stand for the truth.
        budgets: samples per pixel of the curve of error against seconds.
        ours_epochs, published_epochs: of training on the sedan; both see the same frames.
        widths: of the published U-Net.
        timed_frames: frames of the epochs that are timed.
        vehicles: unseen ones, to fine-tune on.
        vehicle_locations, vehicle_azimuths: of their training sets.
        most_epochs: where waiting for convergence ends.
    """

    size: int = 128
    exact_size: int = 320
    samples: int = 8
    seen: tuple[str, ...] = (CLEAR, LOW, FOG, NIGHT, "sun30-fog50", "sun-30-fog50")
    unseen: tuple[str, ...] = UNSEEN
    shown: tuple[str, ...] = (CLEAR, LOW, FOG, NIGHT)
    locations: int = 2
    azimuths: int = 3
    distances_m: tuple[float, float] = (5.5, 12.0)
    test_azimuths: int = 1
    uv_size: int = 1024
    reference_samples: int = 128
    budgets: tuple[int, ...] = (1, 2, 4, 8, 32)
    ours_epochs: int = 60
    published_epochs: int = 8
    widths: tuple[int, ...] = (64, 128, 256, 512, 1024)
    timed_frames: int = 2
    vehicles: tuple[str, ...] = ("suv", "van", "boat_detailed", "aeroplane")
    vehicle_locations: int = 3
    vehicle_azimuths: int = 3
    most_epochs: int = 60


FULL = Settings()
QUICK = Settings(
    size=96,
    exact_size=160,
    seen=(CLEAR, NIGHT),
    unseen=("noon-overcast",),
    shown=(CLEAR, NIGHT, "noon-overcast"),
    azimuths=2,
    uv_size=512,
    reference_samples=48,
    budgets=(2, 8),
    ours_epochs=15,
    published_epochs=2,
    timed_frames=1,
    vehicles=("suv",),
    vehicle_locations=2,
    vehicle_azimuths=1,
    most_epochs=20,
)

"""What the settings of steps 1 to 4 are on the headless job's command line."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..core import contract


def dataset_arguments(context: bpy.types.Context, out: Path, vehicle: Path) -> list[str]:
    """The arguments of ``make_dataset`` that render what the panels show.

    Args:
        out: folder of the dataset.
        vehicle: folder of the saved vehicle.
    """
    steps = context.scene.rauca
    settings = steps.dataset
    arguments = [
        *("--out", str(out), "--vehicle", str(vehicle)),
        *("--weathers", str(steps.weather.preset_file(context)), "--locations", str(settings.locations)),
        *ring_arguments(steps.cameras.ring(context)),
        *("--size", str(settings.size), "--samples", str(settings.samples), "--seed", str(settings.seed)),
        *("--workers", str(settings.workers), "--denoise" if settings.denoise else "--no-denoise"),
        "--light" if settings.light else "--no-light",
        "--json-progress",
    ]
    if settings.part:
        arguments += ["--frames", str(settings.part)]
    return [*arguments, "--retry-quarantined"] if settings.retry else arguments


def ring_arguments(ring: contract.Ring) -> list[str]:
    """A ring in the job's words; numbers keep every digit."""

    def listed(values: tuple[float, ...]) -> str:
        return ",".join(repr(float(value)) for value in values)

    # In one word with "=", as a list that begins with a minus would be taken for an option.
    return [
        f"--azimuths={listed(ring.azimuths_deg)}",
        f"--elevations={listed(ring.elevations_deg)}",
        f"--distances={listed(ring.distances_m)}",
        f"--jitter-azimuth={ring.jitter_azimuth_deg!r}",
        f"--jitter-elevation={ring.jitter_elevation_deg!r}",
        f"--jitter-distance={ring.jitter_distance!r}",
        f"--jitter-aim={ring.jitter_aim_m!r}",
        f"--jitter-roll={ring.jitter_roll_deg!r}",
        f"--fov={ring.fov_deg!r}",
    ]

"""Unwrapping in another process: xatlas lets nothing else in its own process run, and takes seconds."""

from __future__ import annotations

import shutil
from pathlib import Path

from ..child import child_command
from ..core import contract
from ..scene.images import read_image_blender
from .endings import ending
from .folders import job_folder
from .process import BackgroundProcess


class UnwrapChild:
    """A vehicle being unwrapped; :meth:`close` it in the end."""

    def __init__(self, vehicle: contract.Vehicle) -> None:
        """Start; raises :class:`RaucaError` when the program cannot be started or there is no room."""
        self._folder: Path = job_folder()
        try:
            vehicle.save(self._folder / "before")
            job = self._folder / "job.json"
            contract.save_job(job, contract.UnwrapVehicle(self._folder / "before", self._folder / "after"))
            self._process = BackgroundProcess(child_command(job), lambda line: None)
        except (OSError, contract.RaucaError) as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise contract.RaucaError(f"Unwrapping cannot start: {error}") from None

    def ended(self) -> bool:
        """Whether :meth:`result` is there."""
        return self._process.code() is not None

    def result(self) -> contract.Vehicle:
        """The vehicle with its new atlas; its last note tells how it was made.

        Raises:
            RaucaError: it cannot be unwrapped, or the process died.
        """
        if code := self._process.code():
            how = ending(code, self._process.complaints())
            raise contract.RaucaError(how.text.format(**how.values))
        return contract.load_vehicle(self._folder / "after", read_image_blender)

    def close(self) -> None:
        """End it, if it still works, and remove its files."""
        self._process.kill()
        shutil.rmtree(self._folder, ignore_errors=True)

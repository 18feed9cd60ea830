"""What the renders of a folder show, so that a resumed study knows whether they are still the ones it needs."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..contract import Plan, RaucaError, load_camouflage
from ..contract.files import file_digest, write_json
from ..contract.schema import read_json
from ..runtime.images import is_whole

FILE_NAME = "rendered.json"


@dataclass(frozen=True)
class RenderRecord:
    """The views' plan and each camouflage's UV map, by hash.

    It only saves the start of Blender, which keeps a record of its own and renders again what has changed.
    """

    plan: str
    uv_maps: dict[str, str]

    @staticmethod
    def of(plan: Plan, camouflages: Sequence[Path]) -> RenderRecord:
        """Describe renders of ``plan`` in ``camouflages`` (JSON paths)."""
        text = json.dumps(replace(plan, blender="").to_json(), sort_keys=True)
        read = [load_camouflage(path) for path in camouflages]
        uv_maps = {record.name: file_digest(image) for record, image in read}
        return RenderRecord(hashlib.sha256(text.encode()).hexdigest(), uv_maps)

    def holds(self, folder: Path, frames: Sequence[str]) -> bool:
        """True when ``folder`` was recorded to hold these renders, and all their images are there."""
        try:
            found = read_json(folder / FILE_NAME)
            recorded = found.nested("uv_maps")
            if found.text("plan") != self.plan or any(recorded.text(n) != uv for n, uv in self.uv_maps.items()):
                return False
        except RaucaError:
            return False
        return all((folder / name / f"{frame}.png").is_file() for name in self.uv_maps for frame in frames)

    def save(self, folder: Path) -> None:
        """Record that ``folder`` now holds these renders."""
        write_json(folder / FILE_NAME, self.__dict__)

    @staticmethod
    def forget(folder: Path) -> None:
        """To be called before anything is rendered: a killed run must not leave a record that no longer holds."""
        (folder / FILE_NAME).unlink(missing_ok=True)


def discard_damaged(folder: Path, frames: Sequence[str]) -> None:
    """Remove renders of a camouflage that a disk has damaged since: what is missing is rendered again."""
    for path in (folder / f"{frame}.png" for frame in frames):
        if path.is_file() and not is_whole(path):
            path.unlink()

"""What ablations share: training sets, held-out views, optimized camouflages and their renders, each made once.

Folder, run again to resume; names end in a digest of what was asked for, so that nothing is taken for something else::

    sets/<name>-<frames>-<digest>/            training sets; -<n> of them: a part, its frames linked
    taps/                                     of the neural renderer
    efe/<training set>-<digest>/              the published extractor, trained on it
    runs/<variant>-<digest>/                  optimizations, with camouflage.json when finished; two ablations whose
                                              variants are the same share one, under the name that came first
    views/<weathers>-<frames>-<digest>/       held-out views, in the vehicle's reference paint
    paints/<name>-<digest>.json, .png         camouflages by the content of their UV map
    renders/<views>/<name>-<digest>/          the views in camouflage
    detections/<views>/                       what detectors found in any of them
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipelines.console import console, progress_bar
from pipelines.evaluate import render_camouflages
from rauca_core.attack.optimizer import CHECKPOINTS
from rauca_core.contract import (
    Dataset,
    MakeDataset,
    Plan,
    Progress,
    RenderCamouflages,
    VehicleSource,
    balanced_frames,
    find_preset,
    frame_states,
    load_camouflage,
    load_vehicle,
)
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import atomic_folder, file_digest, open_to_append, write_bytes
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.checkpoint_files import POINTER
from rauca_core.runtime.images import read_image
from rauca_core.study.ablations.sizes import Sizes
from rauca_core.study.ablations.training_sets import chosen_frames, training_set
from rauca_core.study.contestants import Contestant, VehicleChoice, check_vehicle, keep_copy
from rauca_core.study.renders import discard_damaged
from rauca_core.training.extractor_fit import fit_published

PRESETS = {"seen": "enhanced", "unseen": "unseen"}


@dataclass(frozen=True)
class HeldOutViews:
    """Frames to measure on: those of ``folder``'s data set that ``ids`` names."""

    weathers: str
    folder: Path
    ids: tuple[str, ...]

    @property
    def dataset(self) -> Dataset:
        return Dataset(self.folder)


class Workspace:
    """The shared folder, for one vehicle at one size.

    Attributes:
        folder: holds everything.
        vehicle: that all camouflages are for.
    """

    def __init__(self, folder: Path, vehicle: VehicleChoice, sizes: Sizes, blender: Path | None = None) -> None:
        self.folder, self.vehicle = folder, vehicle
        self._sizes, self._blender = sizes, blender
        self._positions = load_vehicle(vehicle.folder, read_image).positions

    def training(self, name: str, share: float = 1.0) -> Path:
        """The training set of that name, or a balanced part of it."""
        wanted = training_set(name)
        plan = wanted.plan(self.vehicle.name, self.vehicle.atlas_id, self._positions, self._sizes)
        ids = chosen_frames(plan, self._sizes)
        folder = self.folder / "sets" / f"{name}-{len(ids)}-{_digest(plan.to_json(), ids)}"
        title = f"rendering training set, {name}"
        self._make(folder, plan, ids, title)
        part = chosen_frames(plan, self._sizes, share)
        return folder if len(part) == len(ids) else linked_part(folder, part)

    def views(self, weathers: str) -> HeldOutViews:
        """Held-out views of a weather set, ``seen``, ``unseen`` or a preset's name or file."""
        preset = PRESETS.get(weathers, weathers)
        held_out = self._sizes.views.fitted(self._positions)
        found = find_preset(preset, assets_folder() / "weathers")
        plan = held_out.plan(self.vehicle.name, self.vehicle.atlas_id, found)
        ids = tuple(balanced_frames(plan, held_out.frames))
        name = Path(weathers).stem
        folder = self.folder / "views" / f"{name}-{len(ids)}-{_digest(plan.to_json(), ids)}"
        self._make(folder, plan, ids, f"rendering held-out views, {name} weathers")
        return HeldOutViews(name, folder, ids)

    def run(self, name: str, asked: Mapping[str, Any], work: Callable[[Path, bool], object]) -> Path:
        """An optimization's camouflage, made unless it is there.

        Args:
            asked: all that it depends on, as JSON.
            work: optimizes into a folder; told whether to resume there.
        """
        runs, digest = self.folder / "runs", _digest(asked)
        with alone(runs / digest):
            folder = _named(runs, name, digest)
            product = folder / "camouflage.json"
            if not product.is_file():
                work(folder, (folder / CHECKPOINTS / POINTER).is_file())
        return product

    def published_extractor(self, training: Path) -> Path:
        """Weights of the published extractor, trained on a training set unless they are there."""
        sizes = self._sizes
        folder = self.folder / "efe" / f"{training.name}-{_digest(sizes.extractor_epochs)}"
        with alone(folder), progress_bar("training the published extractor") as move:
            return fit_published(
                training,
                folder,
                sizes.extractor_epochs,
                on_epoch=lambda told: move(Progress(told.epoch, told.epochs, f"error {told.error:.4f}")),
            )

    def renders(self, views: HeldOutViews, camouflages: Mapping[str, Path]) -> dict[str, Path]:
        """Label -> folder of the views in that camouflage, rendered by Cycles where they are missing."""
        out = self.folder / "renders" / views.folder.name
        paints = {label: self.paint(path) for label, path in camouflages.items()}
        folders = {label: out / path.stem for label, path in paints.items()}
        frames = [frame.id for frame in views.dataset.frames() if frame.id in set(views.ids)]
        with alone(out):
            for folder in folders.values():
                discard_damaged(folder, frames)
            missing = {
                paints[label].stem: paints[label]
                for label, folder in folders.items()
                if not all((folder / f"{frame}.png").is_file() for frame in frames)
            }
            if missing:
                title = f"re-rendering {len(missing)} camouflages, {views.weathers} weathers"
                job = RenderCamouflages(views.folder, out, tuple(missing.values()), tuple(views.ids))
                render_camouflages(job, self._blender, title)
        return folders

    def paint(self, path: Path) -> Path:
        """A copy under a name that says which map it is: renders of other maps never lie in its folder."""
        record, image = load_camouflage(path)
        kept = _named(self.folder / "paints", record.name.replace(" ", "-"), file_digest(image)[:10], ".json")
        return keep_copy(Contestant(kept.stem, path, record), kept.parent)

    def _make(self, folder: Path, plan: Plan, ids: Sequence[str], title: str) -> None:
        """Render the frames of a plan that are missing; a finished frame is never rendered again."""
        with alone(folder):
            check_vehicle(folder, self.vehicle, "--data")
            states = frame_states(folder) if (folder / "dataset.json").is_file() else {}
            if all(states.get(frame) in ("done", "occluded") for frame in ids):
                return
            job = MakeDataset(folder, plan, VehicleSource(str(self.vehicle.folder)), frames=tuple(ids))
            with progress_bar(title) as move:
                run_blender(job, move, self._blender)


def linked_part(dataset: Path, ids: Sequence[str]) -> Path:
    """Some frames of a finished data set as a data set of their own, beside it; files are linked where the disk can."""
    folder = dataset.with_name(f"{dataset.name}-{len(ids)}")
    if folder.is_dir():
        return folder
    with atomic_folder(folder) as made:
        shutil.copytree(dataset / "vehicle", made / "vehicle")
        shutil.copy2(dataset / "dataset.json", made)
        for frame in ids:
            if (dataset / "frames" / frame).is_dir():  # frames that hide the vehicle were left out
                shutil.copytree(dataset / "frames" / frame, made / "frames" / frame, copy_function=_link)
    return folder


def pour(source: Path, target: Path) -> None:
    """Add the detections kept in one folder to those in another; both know an image by its content."""
    for path in sorted(source.glob("*.jsonl")) if source.is_dir() else ():
        here = target / path.name
        known = set(here.read_bytes().splitlines()) if here.is_file() else set()
        lines = [line for line in path.read_bytes().splitlines() if line not in known]
        if lines:
            before = here.read_bytes() if here.is_file() else b""
            write_bytes(here, before + b"".join(line + b"\n" for line in lines))


@contextlib.contextmanager
def alone(product: Path) -> Iterator[None]:
    """Hold a lock on a product while it is made: two ablations that share a folder make each thing once."""
    try:
        import fcntl
    except ImportError:  # Windows: one ablation at a time
        yield
        return
    product.parent.mkdir(parents=True, exist_ok=True)
    with os.fdopen(open_to_append(product.parent / f".{product.name}.lock"), "r+b") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            console.print(f"{product.name}: another process makes it, waiting", highlight=False)
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _named(folder: Path, name: str, digest: str, suffix: str = "") -> Path:
    """What a digest names in a folder, whoever named it first: variants of two ablations may be the same."""
    return min(folder.glob(f"*-{digest}{suffix}"), default=folder / f"{name}-{digest}{suffix}")


def _link(source: str, target: str) -> None:
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _digest(*asked: Any) -> str:
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:10]

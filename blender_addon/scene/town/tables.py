"""What the town is made of: the tables of ``assets/town/``, each of which says what its numbers are."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...core import assets
from ..massing import MeshParts, pick, shifted

Albedo = tuple[float, float, float]


def _table(name: str) -> dict[str, Any]:
    return tomllib.loads((assets.assets_folder() / "town" / f"{name}.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class District:
    """What a kind of district is made of, metres."""

    name: str
    shapes: tuple[str, ...]
    road: str
    pavement: str
    apron: str
    road_half_m: float
    pavement_m: float
    lanes: int
    lines: str
    front_m: tuple[float, float]
    clear_m: float
    sides: tuple[str, ...]
    walls: tuple[str, ...]
    trees: tuple[str, ...]
    tree_every_m: float
    lamp_every_m: float
    lamp_height_m: float
    furniture: tuple[str, ...]
    parked: tuple[str, ...]
    skyline_m: tuple[float, float]


@dataclass(frozen=True)
class Surface:
    """An opaque surface."""

    albedo: Albedo
    shows_as: str
    roughness: float = 0.9
    contrast: float = 0.2
    noise_per_m: float = 1.5
    porosity: float = 0.7
    joints: tuple[float, float, float] = (0.0, 0.0, 0.0)
    joint_shade: float = 0.6
    metallic: float = 0.0
    glow: float = 0.0


@dataclass(frozen=True)
class Glazing:
    """Windows: a unit square of the UVs is one pane with its frame; the integers below it tell panes apart."""

    frame: Albedo
    frame_share: float
    bars: int
    lit_share: float
    curtained: float


@dataclass(frozen=True)
class Solids:
    """Something made of plain solids, which are methods of :class:`MeshParts` with a material or color and sizes."""

    solids: list[list[Any]] = field(default_factory=list)
    colors: dict[str, list[str]] = field(default_factory=dict)
    load_m: tuple[float, float] | None = None

    def build(self, parts: MeshParts, rng: np.random.Generator) -> None:
        """Add the solids, in drawn colors."""
        top = rng.uniform(*self.load_m) if self.load_m else 0.0
        colors = {name: pick(rng, materials) for name, materials in self.colors.items()}
        for solid, material, *sizes in self.solids:
            if solid == "load":
                low, high = sizes
                _load(parts, colors[material], low, high, top)
            else:
                getattr(parts, solid)(colors.get(material, material), *sizes)


def _load(parts: MeshParts, material: str, low: list[float], high: list[float], top: float) -> None:
    """A box up to ``top`` between railings, from (x, y, z) to (x, y)."""
    parts.box(material, low, (*high, top))
    rails = np.array([[low[0] - 0.01, low[1] - 0.015, z] for z in (low[2], top - 0.1)])
    parts.boxes("chrome", rails, shifted(rails, high[0] - low[0] + 0.02, high[1] - low[1] + 0.03, 0.1))


@dataclass(frozen=True)
class Furniture(Solids):
    """A small thing on the pavement."""

    room_m: float = 0.0
    where: str = "middle"
    run: int = 1


@dataclass(frozen=True)
class Parked(Solids):
    """A parked vehicle and the room it takes, metres."""

    length_m: float = 0.0
    width_m: float = 0.0


@dataclass(frozen=True)
class Tree:
    """A kind of tree."""

    leaves: tuple[str, ...]
    trunk_m: tuple[float, float]
    crown_m: tuple[float, float]
    clumps: int
    sprays: int


DISTRICTS = tuple(District(name, **row) for name, row in _table("districts").items())
SURFACES = {name: Surface(**row) for name, row in _table("surfaces")["surfaces"].items()}
GLAZINGS = {name: Glazing(**row) for name, row in _table("surfaces")["glazings"].items()}
TREES = {name: Tree(**row) for name, row in _table("trees").items()}
FURNITURE = {name: Furniture(**row) for name, row in _table("furniture").items()}
PARKED = {name: Parked(**row) for name, row in _table("parked").items()}

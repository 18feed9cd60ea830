"""What the town is made of, as data of ``assets/town/``: districts, surfaces, furniture and parked vehicles."""

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
    """What a kind of district is made of; lengths are metres, sideways ones from the street's middle line.

    Attributes:
        shapes: courses its street may take: straight, bend, crossing.
        road, pavement, apron: ground materials; the apron is what lies between pavement and houses, and behind them.
        road_half_m: from the middle line to the kerb.
        pavement_m: 0 leaves out kerb and pavement.
        lanes: per direction.
        lines: how the road is marked: city, country, bays (parking bays along both sides) or none.
        front_m: least and largest distance of the fronts.
        clear_m: least distance of fronts beside the vehicle, where cameras stand.
        sides: what may stand along a side of the street, two of them drawn: row, houses, towers,
            slabs, halls, containers, park, fields.
        walls: wall materials.
        trees: kinds of tree; tree_every_m: their spacing along the street; 0 plants none there.
        lamp_every_m, lamp_height_m: street lamps.
        furniture: small things on the pavement.
        parked: COCO classes of what is parked; never ``car``, of which an image has one.
        skyline_m: least and largest height of what closes the horizon.
    """

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
    """An opaque surface.

    Attributes:
        albedo: linear, in the middle of what it varies over.
        shows_as: semantic class.
        roughness, metallic: of the Principled BSDF.
        contrast, noise_per_m: the albedo varies by +-contrast with noise of that frequency.
        porosity: how much it darkens when wet, see ``wetness.wet``.
        joints: width and height (metres) of its stones, boards or sheets, and how wide the joints between them are;
            0 wide: no stones. They follow the UVs.
        joint_shade: the joints' albedo as a fraction of the surface's.
        glow: radiance after dark.
    """

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
    """Windows: a unit square of the UVs is one pane with its frame; the integers below it tell panes apart.

    Attributes:
        frame: linear albedo of the frame.
        frame_share: its width as a share of the pane.
        bars: mullions across: 0 none, 1 one upright and one level.
        lit_share: share of panes lit after dark.
        curtained: share of panes with curtains.
    """

    frame: Albedo
    frame_share: float
    bars: int
    lit_share: float
    curtained: float


@dataclass(frozen=True)
class Solids:
    """Something made of plain solids.

    Attributes:
        solids: each the name of a method of :class:`MeshParts`, a material or a color's name, and sizes.
        colors: the materials that each color is drawn from.
        load_m: least and largest height of the load, which is drawn.
    """

    solids: list[list[Any]] = field(default_factory=list)
    colors: dict[str, list[str]] = field(default_factory=dict)
    load_m: tuple[float, float] | None = None

    def build(self, parts: MeshParts, rng: np.random.Generator) -> None:
        """Add the solids, in drawn colors."""
        top = rng.uniform(*self.load_m) if self.load_m else 0.0
        colors = {name: pick(rng, materials) for name, materials in self.colors.items()}
        for solid, material, *sizes in self.solids:
            if solid == "load":
                _load(parts, colors[material], *sizes, top)
            else:
                getattr(parts, solid)(colors.get(material, material), *sizes)


def _load(parts: MeshParts, material: str, low: list[float], high: list[float], top: float) -> None:
    """A box up to ``top`` between railings, from (x, y, z) to (x, y)."""
    parts.box(material, low, (*high, top))
    rails = np.array([[low[0] - 0.01, low[1] - 0.015, z] for z in (low[2], top - 0.1)])
    parts.boxes("chrome", rails, shifted(rails, high[0] - low[0] + 0.02, high[1] - low[1] + 0.03, 0.1))


@dataclass(frozen=True)
class Furniture(Solids):
    """A small thing on the pavement.

    Attributes:
        room_m: radius that it needs.
        where: across the pavement: kerb, middle or wall.
        run: how many stand in a row.
    """

    room_m: float = 0.0
    where: str = "middle"
    run: int = 1


@dataclass(frozen=True)
class Parked(Solids):
    """A parked vehicle and the room it takes, metres."""

    length_m: float = 0.0
    width_m: float = 0.0


DISTRICTS = tuple(District(name, **row) for name, row in _table("districts").items())
SURFACES = {name: Surface(**row) for name, row in _table("surfaces")["surfaces"].items()}
GLAZINGS = {name: Glazing(**row) for name, row in _table("surfaces")["glazings"].items()}
FURNITURE = {name: Furniture(**row) for name, row in _table("furniture").items()}
PARKED = {name: Parked(**row) for name, row in _table("parked").items()}

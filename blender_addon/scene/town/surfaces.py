"""The town's surfaces, as data: what each is made of and which semantic class it shows as."""

from __future__ import annotations

from dataclasses import dataclass, replace

Albedo = tuple[float, float, float]


@dataclass(frozen=True)
class Surface:
    """An opaque surface.

    Attributes:
        albedo: linear, in the middle of what it varies over.
        shows_as: semantic class.
        roughness: of the Principled BSDF.
        contrast, noise_per_m: the albedo varies by +-contrast with noise of that frequency.
        porosity: how much it darkens when wet, see ``wetness.wet``.
        joints: width and height (metres) of its stones, boards or sheets, and how wide the joints between them are;
            0 wide: no stones. They follow the UVs.
        joint_shade: the joints' albedo as a fraction of the surface's.
        metallic: of the Principled BSDF.
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


def _plaster(red: float, green: float, blue: float) -> Surface:
    return Surface((red, green, blue), "building", contrast=0.12, noise_per_m=0.5, porosity=0.6)


def _brick(red: float, green: float, blue: float) -> Surface:
    return Surface((red, green, blue), "building", porosity=0.6, joints=(0.24, 0.08, 0.012), joint_shade=1.7)


def _sheet(red: float, green: float, blue: float, shows_as: str = "building") -> Surface:
    return Surface((red, green, blue), shows_as, 0.45, 0.1, 0.3, 0.0, (0.3, 60.0, 0.05), 0.7)


def _roof(red: float, green: float, blue: float) -> Surface:
    return Surface((red, green, blue), "building", 0.8, 0.25, 0.8, 0.5, (0.3, 0.35, 0.03), 0.6)


def _leaves(red: float, green: float, blue: float) -> Surface:
    return Surface((red, green, blue), "vegetation", 0.6, 0.55, 1.6, 0.2)


def _enamel(red: float, green: float, blue: float) -> Surface:
    return Surface((red, green, blue), "other_vehicle", 0.25, 0.03, 0.5, 0.0)


_ASPHALT = Surface((0.060, 0.060, 0.063), "road", 0.85, 0.35, 6.0, 1.0)
_PLASTIC = Surface((0.05, 0.05, 0.05), "other", 0.5, 0.1, 2.0, 0.0)

SURFACES: dict[str, Surface] = {
    "asphalt": _ASPHALT,
    "asphalt patch": replace(_ASPHALT, albedo=(0.032, 0.032, 0.034), contrast=0.2),
    "asphalt old patch": replace(_ASPHALT, albedo=(0.095, 0.094, 0.092), contrast=0.2),
    "setts": Surface((0.105, 0.100, 0.095), "road", 0.8, 0.35, 4.0, 0.7, (0.2, 0.14, 0.022), 0.45),
    "worn concrete": Surface((0.21, 0.205, 0.19), "road", 0.9, 0.3, 0.7, 0.7, (5.0, 5.0, 0.03), 0.5),
    "iron": Surface((0.045, 0.042, 0.040), "road", 0.55, 0.3, 12.0, 0.0),
    "marking": Surface((0.55, 0.55, 0.53), "marking", 0.7, 0.25, 3.0, 0.3),
    "marking yellow": Surface((0.55, 0.36, 0.06), "marking", 0.7, 0.25, 3.0, 0.3),
    "kerb": Surface((0.30, 0.30, 0.29), "kerb", 0.9, 0.15, 1.0, 0.7, (1.0, 9.0, 0.012), 0.5),
    "paving": Surface((0.24, 0.23, 0.22), "pavement", 0.9, 0.22, 2.0, 0.7, (0.5, 0.5, 0.014), 0.55),
    "flagstones": Surface((0.20, 0.185, 0.165), "pavement", 0.85, 0.3, 1.6, 0.7, (0.8, 0.5, 0.016), 0.5),
    "granite": Surface((0.30, 0.295, 0.29), "pavement", 0.6, 0.15, 3.0, 0.5, (1.2, 0.6, 0.01), 0.6),
    "gravel": Surface((0.22, 0.20, 0.17), "terrain", 1.0, 0.4, 9.0, 0.8),
    "lawn": Surface((0.050, 0.088, 0.022), "terrain", 1.0, 0.45, 0.8, 0.4),
    "meadow": Surface((0.085, 0.100, 0.030), "terrain", 1.0, 0.55, 0.35, 0.5),
    "wheat": Surface((0.30, 0.22, 0.085), "terrain", 1.0, 0.25, 0.5, 0.4, (90.0, 0.9, 0.18), 0.6),
    "soil": Surface((0.11, 0.075, 0.050), "terrain", 1.0, 0.3, 1.2, 1.0, (90.0, 0.7, 0.2), 0.6),
    "plaster cream": _plaster(0.58, 0.50, 0.36),
    "plaster ochre": _plaster(0.52, 0.33, 0.13),
    "plaster rose": _plaster(0.50, 0.27, 0.20),
    "plaster grey": _plaster(0.42, 0.42, 0.41),
    "panel mint": _plaster(0.33, 0.44, 0.37),
    "panel peach": _plaster(0.58, 0.37, 0.25),
    "brick red": _brick(0.27, 0.090, 0.055),
    "brick brown": _brick(0.17, 0.095, 0.062),
    "sandstone": Surface((0.42, 0.32, 0.19), "building", porosity=0.7, joints=(0.9, 0.45, 0.02)),
    "concrete": Surface((0.31, 0.30, 0.285), "building", contrast=0.25, joints=(3.0, 1.5, 0.03)),
    "granite wall": Surface((0.17, 0.165, 0.165), "building", 0.4, 0.2, 4.0, 0.4, (1.2, 0.8, 0.02)),
    "weatherboard": Surface((0.56, 0.57, 0.55), "building", 0.6, 0.06, 1.0, 0.3, (60.0, 0.18, 0.025), 0.5),
    "steel blue": _sheet(0.06, 0.15, 0.32),
    "steel grey": _sheet(0.36, 0.38, 0.39),
    "steel green": _sheet(0.10, 0.21, 0.15),
    "container red": _sheet(0.30, 0.055, 0.035, "other"),
    "container blue": _sheet(0.035, 0.09, 0.22, "other"),
    "container ochre": _sheet(0.42, 0.22, 0.05, "other"),
    "container white": _sheet(0.50, 0.50, 0.48, "other"),
    "tiles red": _roof(0.23, 0.075, 0.042),
    "tiles brown": _roof(0.12, 0.065, 0.045),
    "slate": _roof(0.065, 0.068, 0.075),
    "flat roof": Surface((0.13, 0.13, 0.13), "building"),
    "trim": Surface((0.60, 0.59, 0.56), "building", 0.7, 0.08, 1.0, 0.4),
    "galvanised fin": Surface((0.42, 0.43, 0.44), "building", 0.35, 0.05, 1.0, 0.0),
    "balcony": Surface((0.34, 0.38, 0.42), "building", 0.5, 0.1, 1.0, 0.2),
    "trim dark": Surface((0.06, 0.06, 0.065), "building", 0.4, 0.08, 1.0, 0.0),
    "door green": Surface((0.03, 0.10, 0.06), "building", 0.4, 0.1, 1.0, 0.0),
    "door brown": Surface((0.13, 0.06, 0.03), "building", 0.4, 0.1, 1.0, 0.0),
    "door white": Surface((0.52, 0.52, 0.51), "building", 0.4, 0.05, 1.0, 0.0, (60.0, 0.5, 0.03), 0.6),
    "awning red": Surface((0.40, 0.05, 0.04), "building", 0.8, 0.1, 1.0, 0.3),
    "awning green": Surface((0.05, 0.22, 0.10), "building", 0.8, 0.1, 1.0, 0.3),
    "shop sign": Surface((0.10, 0.16, 0.34), "building", 0.4, 0.1, 0.7, 0.0, glow=0.25),
    "bark": Surface((0.075, 0.055, 0.038), "vegetation", 1.0, 0.3, 5.0, 0.5),
    "leaves": _leaves(0.050, 0.090, 0.020),
    "leaves dark": _leaves(0.032, 0.068, 0.020),
    "leaves light": _leaves(0.095, 0.120, 0.026),
    "needles": _leaves(0.022, 0.052, 0.024),
    "hedge": _leaves(0.040, 0.075, 0.020),
    "galvanised": Surface((0.30, 0.31, 0.32), "pole", 0.5, 0.1, 1.0, 0.0),
    "cast iron": Surface((0.03, 0.034, 0.034), "pole", 0.45, 0.1, 1.0, 0.0),
    "lamp head": Surface((0.55, 0.52, 0.45), "pole", 0.4, 0.0, 1.0, 0.0, glow=9.0),
    "wood": Surface((0.22, 0.12, 0.06), "other", 0.8, 0.3, 3.0, 0.5),
    "picket": Surface((0.52, 0.52, 0.50), "other", 0.7, 0.1, 2.0, 0.4),
    "planter": Surface((0.26, 0.25, 0.24), "other"),
    "plastic black": _PLASTIC,
    "plastic green": replace(_PLASTIC, albedo=(0.03, 0.12, 0.06)),
    "plastic orange": replace(_PLASTIC, albedo=(0.60, 0.13, 0.02)),
    "post red": replace(_PLASTIC, albedo=(0.42, 0.03, 0.025), roughness=0.35),
    "post yellow": replace(_PLASTIC, albedo=(0.62, 0.38, 0.02), roughness=0.35),
    "sign red": replace(_PLASTIC, albedo=(0.48, 0.02, 0.02), roughness=0.4),
    "sign blue": replace(_PLASTIC, albedo=(0.02, 0.09, 0.36), roughness=0.4),
    "sign white": replace(_PLASTIC, albedo=(0.66, 0.66, 0.64), roughness=0.4),
    "enamel white": _enamel(0.62, 0.62, 0.60),
    "enamel red": _enamel(0.42, 0.03, 0.025),
    "enamel blue": _enamel(0.03, 0.10, 0.34),
    "enamel green": _enamel(0.05, 0.20, 0.08),
    "enamel yellow": _enamel(0.62, 0.40, 0.04),
    "enamel black": _enamel(0.02, 0.02, 0.022),
    "tarpaulin": Surface((0.16, 0.20, 0.26), "other_vehicle", 0.7, 0.12, 0.8, 0.0),
    "chassis": Surface((0.035, 0.035, 0.037), "other_vehicle", 0.6, 0.1, 1.0, 0.0),
    "chrome": Surface((0.55, 0.56, 0.57), "other_vehicle", 0.2, 0.0, 1.0, 0.0, metallic=1.0),
    "vehicle glass": Surface((0.015, 0.017, 0.019), "other_vehicle", 0.05, 0.0, 1.0, 0.0),
    "plastic trim": Surface((0.03, 0.03, 0.032), "other_vehicle", 0.5, 0.05, 1.0, 0.0),
    "vehicle tyre": Surface((0.022, 0.022, 0.022), "other_vehicle", 0.9, 0.1, 4.0, 0.0),
    "tail lamp": Surface((0.40, 0.015, 0.01), "other_vehicle", 0.3, 0.0, 1.0, 0.0),
    "head lamp": Surface((0.60, 0.60, 0.58), "other_vehicle", 0.15, 0.0, 1.0, 0.0),
}


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


GLAZINGS: dict[str, Glazing] = {
    "window white": Glazing((0.60, 0.60, 0.58), 0.07, 1, 0.38, 0.45),
    "window dark": Glazing((0.05, 0.05, 0.055), 0.06, 0, 0.38, 0.35),
    "window wood": Glazing((0.16, 0.08, 0.04), 0.08, 1, 0.35, 0.4),
    "shop window": Glazing((0.07, 0.07, 0.075), 0.03, 0, 0.75, 0.0),
    "curtain wall": Glazing((0.25, 0.26, 0.27), 0.02, 0, 0.3, 0.12),
    "ribbon window": Glazing((0.20, 0.21, 0.22), 0.05, 0, 0.2, 0.0),
}

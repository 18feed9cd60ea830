"""What the procedural vehicles are made of."""

from __future__ import annotations

from ..contract import Material

PAINT = Material("paint", "paint", (0.26, 0.26, 0.26), roughness=0.35, coat=0.6)
GLASS = Material("glass", "glass", (0.012, 0.014, 0.018), roughness=0.04)
GAP = Material("gap", "trim", (0.004, 0.004, 0.004), roughness=0.8)
TYRE = Material("tyre", "tyre", (0.012, 0.012, 0.012), roughness=0.8)
DARK = Material("dark", "other", (0.012, 0.012, 0.014), roughness=0.5)
STEEL = Material("steel", "rim", (0.62, 0.63, 0.65), roughness=0.2, metallic=1.0)

CAR = [
    PAINT,
    GLASS,
    Material("trim", "trim", (0.018, 0.018, 0.020), roughness=0.5),
    GAP,
    Material("underbody", "other", (0.006, 0.006, 0.006), roughness=0.9),
    TYRE,
    Material("rim", "rim", (0.55, 0.56, 0.58), roughness=0.25, metallic=0.9),
    Material("dark", "other", (0.008, 0.008, 0.008), roughness=0.6),
    Material("disc", "other", (0.20, 0.20, 0.20), roughness=0.35, metallic=0.8),
    Material("headlamp", "headlamp", (0.80, 0.83, 0.87), roughness=0.08, coat=0.5),
    Material("taillamp", "taillamp", (0.36, 0.006, 0.010), roughness=0.12, coat=0.5),
    Material("chrome", "rim", (0.70, 0.70, 0.72), roughness=0.12, metallic=1.0),
    Material("mirror", "trim", (0.03, 0.03, 0.032), roughness=0.25),
    Material("grille", "trim", (0.010, 0.010, 0.011), roughness=0.35),
    Material("lens", "other", (0.20, 0.21, 0.22), roughness=0.06, coat=0.5),
    Material("reverse", "other", (0.55, 0.50, 0.50), roughness=0.10, coat=0.5),
    Material("reflector", "other", (0.30, 0.005, 0.008), roughness=0.15),
    Material("plate", "plate", (0.75, 0.75, 0.72), roughness=0.45),
    Material("ink", "other", (0.01, 0.01, 0.012), roughness=0.5),
]

SHAPE = [
    PAINT,
    Material("bare", "other", (0.05, 0.05, 0.05), roughness=0.8),
]

BOAT = [
    PAINT,
    GLASS,
    Material("deck", "other", (0.33, 0.25, 0.16), roughness=0.7),
    Material("rubber", "trim", (0.018, 0.018, 0.020), roughness=0.6),
    DARK,
    STEEL,
    Material("wood", "other", (0.16, 0.09, 0.045), roughness=0.7),
    Material("engine", "trim", (0.022, 0.022, 0.024), roughness=0.3, coat=0.4),
    Material("seat", "other", (0.40, 0.38, 0.35), roughness=0.6),
]

AEROPLANE = [
    PAINT,
    GLASS,
    GAP,
    DARK,
    STEEL,
    TYRE,
]

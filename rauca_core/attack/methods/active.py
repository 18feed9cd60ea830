"""ACTIVE: a triplanar pattern in the background's colors, against any class, under strong augmentation."""

from .method import Method

ACTIVE = Method(
    name="active",
    source="Suryanto, Kim, Larasati, Kang, Le, Hong, Yang, Oh, Kim: ACTIVE, ICCV 2023",
    weathers="single",
    settings={
        "paint": "pattern",
        "pattern_side": 64,
        "tile_m": 1.0,
        "shift": 0.5,
        "objective": "stealth",
        "augmentation": "active",
        "smooth": "pattern",
        "beta": 0.25,
        "prior": "background",
        "gamma": 0.25,
    },
    assumed=(
        "Triplanar mapping is exact, and exact light stands for its neural texture renderer. Both favor it.",
        "A tile is a metre wide and the background has four dominant colors; the paper's main text gives neither.",
        "The pattern is shifted by up to half a tile once per step, not per picture; its scale is not varied.",
        "The difference of two colors is the mean over their channels; pictures move by up to a tenth of their side.",
        "One vehicle; published is five at once.",
    ),
)

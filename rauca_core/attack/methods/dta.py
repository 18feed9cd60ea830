"""DTA: one small pattern, repeated all over, against the vehicle's confidence."""

from .method import Method

DTA = Method(
    name="dta",
    source="Suryanto, Kim, Kang, Larasati, Yun, Le, Yang, Oh, Kim: DTA, CVPR 2022",
    weathers="single",
    settings={
        "paint": "pattern",
        "pattern_side": 16,
        "tile_m": 0.5,
        "objective": "confidence",
        "roa": False,
        "smooth": "pattern",
        "beta": 0.0,
    },
    assumed=(
        "The repeated pattern is projected exactly, along three axes, where published is an approximate projection per "
        "view; exact light stands for its transformation network. Both favor it.",
        "Its 16 x 16 texels on half a metre are our choice; the loss is -log(1 - confidence), as in ACTIVE.",
        "No smoothness: ACTIVE names its mosaic look as what it set out to mend.",
        "Of the vehicle's class only boxes that touch the vehicle count: our frames show other cars, the published "
        "ones do not.",
    ),
)

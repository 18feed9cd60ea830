"""The kinds of district, as data."""

from __future__ import annotations

from dataclasses import dataclass


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


OLD_TOWN = District(
    name="old town",
    shapes=("straight", "bend", "crossing"),
    road="setts",
    pavement="flagstones",
    apron="flagstones",
    road_half_m=3.8,
    pavement_m=2.4,
    lanes=1,
    lines="none",
    front_m=(6.6, 7.4),
    clear_m=12.5,
    sides=("row", "row"),
    walls=("plaster cream", "plaster ochre", "plaster rose", "plaster grey", "brick red", "sandstone"),
    trees=("round", "small"),
    tree_every_m=0.0,
    lamp_every_m=17.0,
    lamp_height_m=4.2,
    furniture=("bollard", "bench", "bin", "sign", "planter", "bicycle stand"),
    parked=("bicycle", "motorcycle", "bicycle", "truck"),
    skyline_m=(10.0, 22.0),
)

SUBURB = District(
    name="suburb",
    shapes=("straight", "bend", "crossing"),
    road="asphalt",
    pavement="paving",
    apron="lawn",
    road_half_m=3.6,
    pavement_m=1.9,
    lanes=1,
    lines="city",
    front_m=(13.0, 17.0),
    clear_m=13.0,
    sides=("houses", "houses", "park"),
    walls=("plaster cream", "plaster grey", "brick red", "brick brown", "weatherboard"),
    trees=("round", "tall", "conifer", "small"),
    tree_every_m=16.0,
    lamp_every_m=26.0,
    lamp_height_m=5.5,
    furniture=("wheelie bin", "sign", "hydrant", "post box"),
    parked=("bicycle", "motorcycle", "truck"),
    skyline_m=(5.0, 9.0),
)

BUSINESS = District(
    name="business quarter",
    shapes=("straight", "crossing"),
    road="asphalt",
    pavement="paving",
    apron="granite",
    road_half_m=7.0,
    pavement_m=4.5,
    lanes=2,
    lines="city",
    front_m=(14.5, 18.0),
    clear_m=14.5,
    sides=("towers", "towers", "slabs"),
    walls=("concrete", "granite wall", "plaster grey", "sandstone"),
    trees=("round", "small"),
    tree_every_m=14.0,
    lamp_every_m=22.0,
    lamp_height_m=8.5,
    furniture=("bollard", "bench", "bin", "sign", "planter", "shelter"),
    parked=("bus", "truck", "motorcycle", "bicycle"),
    skyline_m=(25.0, 80.0),
)

YARD = District(
    name="industrial yard",
    shapes=("straight", "crossing"),
    road="worn concrete",
    pavement="asphalt",
    apron="worn concrete",
    road_half_m=9.0,
    pavement_m=0.0,
    lanes=1,
    lines="bays",
    front_m=(19.0, 26.0),
    clear_m=19.0,
    sides=("halls", "halls", "containers"),
    walls=("steel blue", "steel grey", "steel green", "concrete", "brick brown"),
    trees=("tall", "small"),
    tree_every_m=0.0,
    lamp_every_m=32.0,
    lamp_height_m=10.0,
    furniture=("pallet", "cone", "barrier", "skip"),
    parked=("truck", "truck", "truck", "bus"),
    skyline_m=(8.0, 24.0),
)

COUNTRY = District(
    name="country road",
    shapes=("straight", "bend", "bend"),
    road="asphalt",
    pavement="gravel",
    apron="meadow",
    road_half_m=3.4,
    pavement_m=0.0,
    lanes=1,
    lines="country",
    front_m=(24.0, 40.0),
    clear_m=20.0,
    sides=("fields", "fields", "park"),
    walls=("brick red", "weatherboard", "plaster cream"),
    trees=("round", "tall", "conifer", "bush"),
    tree_every_m=24.0,
    lamp_every_m=45.0,
    lamp_height_m=6.0,
    furniture=("delineator", "sign"),
    parked=("truck", "motorcycle"),
    skyline_m=(4.0, 7.0),
)

ESTATE = District(
    name="housing estate",
    shapes=("straight", "bend", "crossing"),
    road="asphalt",
    pavement="paving",
    apron="lawn",
    road_half_m=5.2,
    pavement_m=2.4,
    lanes=1,
    lines="bays",
    front_m=(15.0, 22.0),
    clear_m=15.0,
    sides=("slabs", "slabs", "park"),
    walls=("concrete", "plaster cream", "plaster grey", "panel mint", "panel peach"),
    trees=("round", "tall", "small"),
    tree_every_m=15.0,
    lamp_every_m=24.0,
    lamp_height_m=6.5,
    furniture=("bench", "bin", "sign", "bicycle stand", "skip"),
    parked=("bus", "motorcycle", "bicycle", "truck"),
    skyline_m=(14.0, 40.0),
)

DISTRICTS = (OLD_TOWN, SUBURB, BUSINESS, YARD, COUNTRY, ESTATE)

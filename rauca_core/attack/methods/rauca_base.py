"""RAUCA-base, of the conference version: facets through Neural Renderer, lit like the frame, in several weathers."""

from .method import Method

RAUCA_BASE = Method(
    name="rauca-base",
    source="Zhou, Lyu, He, Li: RAUCA, ICML 2024",
    weathers="base",
    settings={
        "paint": "facets",
        "limit": "clamp",
        "samples": 2,
        "pixel_filter": "box",
        "roa": False,
        "smooth": "picture",
        "beta": 0.01,
    },
    assumed=(
        "Facets are optimized: the journal version says that no UV map takes part in NRP.",
        "Exact light stands for the environment feature extractor, as in every method that learns its light.",
    ),
)

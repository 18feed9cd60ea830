"""FCA: facets all over the body, a detection loss of three terms, Neural Renderer's own light."""

from .method import Method

PICTURE_SIDE = 640  # pixels, of the published pictures: their smoothness is a sum over pixels, ours a mean

FCA = Method(
    name="fca",
    source="Wang, Jiang, Sun, Zhou, Gong, Zhang, Yao, Chen: FCA, AAAI 2022",
    weathers="single",
    settings={
        "paint": "facets",
        "limit": "tanh",
        "objective": "three-terms",
        "light": "none",
        "samples": 2,
        "pixel_filter": "box",
        "roa": False,
        "smooth": "picture",
        "beta": 1e-4 * PICTURE_SIDE**2,
    },
    assumed=(
        "The boxes assigned to the vehicle are the nine that overlap it most, as many as YOLOv3 assigns anchors; other "
        "detectors have no anchors to match.",
        "Objectness and class enter as probabilities, to be made small; the public code's cross-entropy pulls the "
        "objectness of assigned boxes up, which cannot be meant.",
        "The weights, 0.05 overlap, 1 objectness and 0.5 class, are those of the public code.",
    ),
)

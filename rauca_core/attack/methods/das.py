"""DAS: scatter the model's attention, spare people's; some panels are painted, over a seed picture."""

from .method import Method

PICTURE_SIDE = 224  # pixels, of the published pictures: their smoothness is a sum over pixels, ours a mean

DAS = Method(
    name="das",
    source="Wang, Liu, Yin, Liu, Tang, Liu: Dual Attention Suppression Attack, CVPR 2021",
    weathers="single",
    settings={
        "paint": "facets",
        "cover": "panels",
        "start": "seed",
        "limit": "tanh",
        "objective": "attention",
        "light": "none",
        "samples": 2,
        "pixel_filter": "box",
        "roa": False,
        "smooth": "picture",
        "beta": 1e-4 * PICTURE_SIDE**2,
        "prior": "seed",
        "gamma": 4e-4,
    },
    assumed=(
        "Attention is Grad-CAM of the white-box detector, at the last layer that its heads share, for the log-odds of "
        "max H_d, channels weighted by the sum of their slopes; published is the last stage of an ImageNet classifier, "
        "for one of seven vehicle classes, channels weighted by the mean.",
        "Channel weights take no gradient, as in the public code, so the loss need not fall: on the demo's frames "
        "it doubled in 60 steps while max H_d halved. Differentiated whole, it fell to a third and max H_d stayed.",
        "The painted panels are bonnet, roof and doors, found by geometry; published is a list of one car's faces.",
        "The seed picture is a smiling face drawn by this project, upright on each panel.",
        "Distance from the seed is measured in sRGB values, four times the published 1e-4 of values before tanh, which "
        "is the same for small changes of mid grey.",
    ),
)

"""The ablations, one declaration each."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

from ...attack.methods import FEW_STEPS, method_named
from ...contract import RaucaError
from .experiment import OURS, PAPER, Claim, Experiment, Variant

# What "the rendered picture" smoothing and two subsamples per pixel stand for: Neural Renderer, as published.
_NEURAL_RENDERER = {"samples": 2, "pixel_filter": "box"}
_FACETS = {**_NEURAL_RENDERER, "paint": "facets", "smooth": "picture", "beta": 0.01}


def _chain(*best_to_worst: str, by: str = PAPER) -> tuple[Claim, ...]:
    """A claim for each neighboring pair."""
    return tuple(Claim((a,), (b,), by) for a, b in pairwise(best_to_worst))


def _rival(name: str, row: str, quick: bool = True) -> Variant:
    """A method of the literature, on the weathers that its authors would use."""
    return Variant(name, row, method=name, training=method_named(name).weathers, paper_row=row, quick=quick)


BASELINES = Experiment(
    "baselines",
    "Methods of the literature",
    "Which method hides the vehicle best, each trained on the weathers its authors would use?",
    (
        _rival("das", "DAS", quick=False),
        _rival("fca", "FCA"),
        _rival("dta", "DTA", quick=False),
        _rival("active", "ACTIVE", quick=False),
        _rival("rauca-base", "RAUCA-base", quick=False),
        _rival("rauca-final", "RAUCA-final"),
        Variant("ours", "ours", method="ours", training=method_named("ours").weathers),
    ),
    (
        *_chain("rauca-final", "rauca-base", "active", "dta", "fca", "das", "normal"),
        Claim(("rauca-final",), ("random",)),
        Claim(("ours",), ("rauca-final",), OURS),
    ),
    "detectors",
    notes=("What each paper leaves open, and was assumed here, stands in docs/methods.md.",),
)

RENDERER = Experiment(
    "renderer",
    "Neural renderers",
    "What does it bring to light the paint like the frame, to optimize the UV map itself, and to filter it exactly?",
    (
        Variant("nr-direct", "NR-direct", {**_FACETS, "light": "none"}, paper_row="NR-direct"),
        Variant("nrp", "NRP", _FACETS, paper_row="NRP"),
        Variant(
            "e2e-algorithm-1", "E2E, Algorithm 1", {**_NEURAL_RENDERER, "sampler": "tensor-traversal"}, quick=False
        ),
        Variant(
            "e2e-algorithm-2",
            "E2E-NRP, Algorithm 2",
            {**_NEURAL_RENDERER, "sampler": "uv-traversal"},
            paper_row="E2E-NRP",
        ),
        Variant("e2e-taps", "E2E, our taps"),
    ),
    (
        *_chain("e2e-algorithm-2", "nrp", "nr-direct"),
        Claim(("e2e-algorithm-2",), ("e2e-algorithm-1",)),
        Claim(("e2e-taps",), ("e2e-algorithm-2",), OURS),
        Claim(("e2e-taps",), ("nrp",), OURS),
    ),
    "ablation-renderer",
    notes=(
        "Exact light stands for the environment feature extractor in all but NR-direct.",
        "As in the paper, NR and NRP are smoothed on the rendered picture, since they have no UV map.",
    ),
)

DATASET = Experiment(
    "dataset",
    "Training data",
    "What do more weathers and more cameras bring?",
    (
        Variant("single", "Single weather", training="single", paper_row="Single-weather Dataset"),
        Variant("base", "Base multi-weather", training="base", paper_row="Base multi-weather Dataset"),
        Variant("enhanced", "Enhanced multi-weather", training="enhanced", paper_row="Enhanced multi-weather Dataset"),
    ),
    _chain("enhanced", "base", "single"),
    "ablation-dataset",
    seeds=2,
    notes=("All three have as many frames: single and base see them from fixed cameras in clearcoat paint.",),
)


def _beta(value: str, quick: bool) -> Variant:
    return Variant(f"beta-{value}", f"β = {value}", {"beta": float(value)}, paper_row=f"β={value}", quick=quick)


_BETAS = tuple(
    _beta(value, quick=value in ("100", "0.01", "0")) for value in ("100", "10", "1", "0.1", "0.01", "0.001", "0")
)
BETA = Experiment(
    "beta",
    "Smoothness",
    "How much weight should the smoothness loss of Eq. 7 have?",
    _BETAS,
    (
        Claim(tuple(v.key for v in _BETAS[:-1]), ("beta-0",)),
        Claim(("beta-0.01",), ("beta-0",)),
        Claim(("beta-0.1", "beta-0.01", "beta-0.001"), ("beta-100",)),
    ),
    "ablation-beta",
)

AUGMENTATION = Experiment(
    "augmentation",
    "Random output augmentation",
    "Does moving, scaling and relighting the rendered picture help on views that were not trained on?",
    (
        Variant("without-roa", "Without ROA", {"roa": False}, paper_row="Without ROA"),
        Variant("with-roa", "With ROA", paper_row="With ROA"),
        Variant("zoomed", "With ROA, mirrored, nearer and farther", {"augmentation": "zoomed"}, quick=False),
        Variant("ours", "ours, with ROA", {"augmentation": "rauca"}, method="ours", quick=False),
        Variant("ours-zoomed", "ours, mirrored, nearer and farther", method="ours", quick=False),
    ),
    (
        *_chain("with-roa", "without-roa"),
        Claim(("zoomed",), ("with-roa",), OURS),
        Claim(("ours-zoomed",), ("ours",), OURS),
    ),
    "ablation-augmentation",
)

ENVIRONMENT = Experiment(
    "environment",
    "Light of the environment",
    "How much does it matter where the light on the paint comes from?",
    (
        Variant("none", "None", {"light": "none"}),
        Variant("transfer", "Affine color transfer", {"light": "transfer"}, quick=False),
        Variant("published", "Published EFE", {"light": "published"}),
        Variant("ours", "Our extractor", {"light": "ours"}, quick=False),
        Variant("exact", "Exact maps"),
    ),
    (
        *_chain("published", "none"),
        Claim(("ours",), ("none",), OURS),
        Claim(("ours",), ("transfer",), OURS),
        Claim(("exact",), ("published",), OURS),
        Claim(("exact",), ("ours",), OURS),
    ),
    notes=(
        "The paper compares NR with NRP instead, where the renderer changes along with the light; see `renderer`.",
        "The published extractor is trained on the same frames, narrower and for a shorter time than in the paper.",
    ),
)

_SHARES = ((1 / 16, False), (1 / 8, True), (1 / 4, False), (1 / 2, False), (1.0, True))
VIEWS = Experiment(
    "views",
    "Number of views",
    "At as many steps, how many views (places, cameras and weathers) does a camouflage need?",
    tuple(
        Variant(f"share-{round(1 / share):02d}th", f"1/{round(1 / share)} of the views", share=share, quick=quick)
        if share < 1
        else Variant("all", "All views", quick=quick)
        for share, quick in _SHARES
    ),
    (
        *_chain("all", "share-02th", "share-04th", "share-08th", "share-16th", by=OURS),
        Claim(("all",), ("share-08th", "share-16th"), OURS),
    ),
)


def _limit(name: str, lr: float, quick: bool) -> Variant:
    return Variant(f"{name}-{lr:g}", f"{name}, rate {lr:g}", {"limit": name, "lr": lr}, quick=quick)


_RATES = (0.005, 0.02, 0.08)  # the middle one is every other ablation's, too
LIMIT = Experiment(
    "limit",
    "Keeping texels in range",
    "Which parametrization of the UV map, at which learning rate?",
    tuple(_limit(name, lr, quick=lr == 0.02) for name in ("project", "clamp", "tanh") for lr in _RATES),
    tuple(Claim(("project-0.02",), tuple(f"{name}-{lr:g}" for lr in _RATES), OURS) for name in ("clamp", "tanh")),
    notes=("The paper clamps, and names a learning rate of 0.01.",),
)

SAMPLING = Experiment(
    "sampling",
    "Resting frames",
    "Does it help to leave out, for some epochs, frames in which the vehicle is no longer found?",
    (
        Variant("rest-0", "All frames in every epoch"),
        Variant("rest-3", "Quiet frames rest 3 epochs", {"rest": 3}),
        Variant("ours", "ours, all frames in every epoch", {"rest": 0}, method="ours", quick=False),
        Variant("ours-rest-3", "ours, quiet frames rest 3 epochs", {"rest": 3}, method="ours", quick=False),
    ),
    (Claim(("rest-3",), ("rest-0",), OURS), Claim(("ours-rest-3",), ("ours",), OURS)),
    seeds=2,
)


def _pattern(tile_m: float, objective: str = "", quick: bool = False) -> Variant:
    """Ours with a repeated pattern of texels of 3 cm in place of its patches."""
    chosen = {"paint": "pattern", "pattern_side": round(tile_m * 32), "tile_m": tile_m, "smooth": "pattern"}
    key, title = f"pattern-{tile_m:g}m", f"repeated pattern, {tile_m:g} m"
    if objective:
        key, title, chosen["objective"] = f"{key}-{objective}", f"{title}, {objective}", objective
    return Variant(key, title, {**chosen, "natural": None}, method="ours", quick=quick)


PAINT = Experiment(
    "paint",
    "Freedom of the paint",
    "Which paint carries over to new views and detectors: patches, or a pattern that repeats, and of what size?",
    (
        Variant("texels", "ours: free texels", method="ours", quick=False),
        Variant("patches", "ours: patches of 5 cm", FEW_STEPS, method="ours"),
        Variant(
            "patches-confidence",
            "ours, confidence",
            {**FEW_STEPS, "objective": "confidence"},
            method="ours",
            quick=False,
        ),
        _pattern(0.5, quick=True),
        _pattern(1.0),
        _pattern(2.0),
        _pattern(0.5, "confidence"),
    ),
    (
        Claim(("pattern-0.5m",), ("patches",), OURS),
        Claim(("pattern-1m",), ("patches",), OURS),
        Claim(("pattern-2m",), ("patches",), OURS),
        Claim(("texels",), ("patches",), OURS),
        Claim(("patches",), ("patches-confidence",), OURS),
        Claim(("pattern-0.5m",), ("pattern-0.5m-confidence",), OURS),
    ),
    notes=("Confidence is the loss of DTA and ACTIVE; the others have the logarithm of Eq. 6's score.",),
)

EXPERIMENTS: Mapping[str, Experiment] = {
    experiment.name: experiment
    for experiment in (BASELINES, RENDERER, DATASET, BETA, AUGMENTATION, ENVIRONMENT, VIEWS, LIMIT, SAMPLING, PAINT)
}


def experiment_named(name: str) -> Experiment:
    """The experiment of that name; raises :class:`RaucaError` listing all when there is none."""
    if name not in EXPERIMENTS:
        raise RaucaError(f"ablation: no {name!r}; choose one of {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]

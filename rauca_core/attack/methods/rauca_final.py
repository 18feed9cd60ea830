"""RAUCA-final, the paper: the UV map itself, Eq. 4 to 8, under random output augmentation, in better weathers."""

from .method import Method

RAUCA_FINAL = Method(
    name="rauca-final",
    source="Zhou, Lyu, He, Li: Toward Robust and Accurate Adversarial Camouflage Generation, 2025",
    weathers="enhanced",
    settings={"limit": "clamp"},
    assumed=(
        "This project's taps stand for Algorithm 2, which `--sampler uv-traversal --samples 2` brings back.",
        "Exact light stands for the environment feature extractor; `--light ours` estimates it from the picture.",
        "Ground-truth boxes move with the augmentation; in the public code they stay.",
    ),
)

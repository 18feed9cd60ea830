"""How much of what a detector learnt is kept: weights on the straight line between it as it was and as it learnt.

On the way back along that line a detector soon says of everything but the vehicle what it said before, and loses what
it learnt of camouflage only later (WiSE-FT; Wortsman et al., Robust fine-tuning of zero-shot models, CVPR 2022). That
holds for camouflages that do not know it; against an attack that does, much may be lost at once. So nothing is given
back that need not be: the largest share is taken of which pictures of new places do not show that it agrees too little
with the detector as it was. An agreement that misses by less than its standard error shows nothing, as in the
one-standard-error rule (Breiman et al., Classification and Regression Trees, 1984).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from ..detect.agreement import SEEN, Agreement, agreement_of
from ..detect.found import Found
from ..detect.interface import Detector

SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
"""Of what was learnt, largest first; with less than half of it there is little left of a hardening."""
MOST_LOOKS = 4  # that it takes to find the right one of them


def mixed(before: Mapping[str, Tensor], after: Mapping[str, Tensor], share: float) -> dict[str, Tensor]:
    """Weights ``(1 - share) * before + share * after``; whole numbers, such as counts, are the later ones."""
    return {
        name: torch.lerp(before[name].to(late), late, share) if late.is_floating_point() else late
        for name, late in after.items()
    }


class Pictures:
    """Pictures in which a detector is compared with one as it was."""

    def __init__(
        self, before: Detector, images: Sequence[Tensor], vehicles: Sequence[NDArray[np.float64] | None]
    ) -> None:
        """Look at the pictures with the detector as it was.

        Args:
            images: (3, H, W) sRGB in [0, 1], on the device that detectors lie on.
            vehicles: boxes (4,) xyxy of the vehicle in each, pixels: what lies in them does not count. None where it
                is not to be seen.
        """
        self._images, self._vehicles = images, vehicles
        self._was = self._found(before)

    def agreements(self, detector: Detector) -> list[Agreement]:
        """On the objects beside the vehicle in each."""
        pairs = zip(self._was, self._found(detector), self._vehicles, strict=True)
        return [agreement_of([pair]) for pair in pairs]

    def _found(self, detector: Detector) -> list[Found]:
        """What a detector finds in each."""
        seen = [detector.detect(image[None], SEEN)[0] for image in self._images]
        return [
            Found(
                one.boxes.double().cpu().numpy(),
                one.scores.double().cpu().numpy(),
                tuple(detector.class_names[label] for label in one.labels.tolist()),
            )
            for one in seen
        ]


def go_back(
    network: nn.Module,
    before: Mapping[str, Tensor],
    detecting: Callable[[nn.Module], Detector],
    pictures: Pictures,
    wanted: float,
    on_look: Callable[[float, Agreement], None] = lambda share, found: None,
) -> tuple[float, Agreement]:
    """Take a network that learnt back towards what it was, no farther than is needed.

    Args:
        network: has the chosen weights afterwards, in evaluation mode.
        before: its weights before it learnt.
        detecting: makes a detector of it.
        wanted: share of the objects beside the vehicles that it is to agree on with the detector as it was, but for a
            standard error.
        on_look: called with each share that was looked at, and its agreement.

    Returns:
        The share of what was learnt that it keeps, and the agreement with it.
    """
    after = {name: tensor.clone() for name, tensor in network.state_dict().items()}

    def agreements(share: float) -> list[Agreement]:
        network.load_state_dict(mixed(before, after, share))
        each = pictures.agreements(detecting(network.eval()))
        on_look(share, sum(each, Agreement()))
        return each

    share, found = largest_share(agreements, wanted)
    network.load_state_dict(mixed(before, after, share))
    return share, found


def largest_share(agreements: Callable[[float], Sequence[Agreement]], wanted: float) -> tuple[float, Agreement]:
    """The largest of :data:`SHARES` that is not shown to agree on less than ``wanted``, else the smallest.

    Agreement is taken to grow as the share falls, so that half of the shares are not looked at.

    Args:
        agreements: of a share, in each picture.

    Returns:
        The share, and its agreement in all pictures.
    """
    seen: dict[float, Sequence[Agreement]] = {}

    def enough(share: float) -> bool:
        seen[share] = agreements(share)
        found = sum(seen[share], Agreement()).share
        return found is None or found + standard_error(seen[share]) >= wanted

    low, high = 0, len(SHARES) - 1  # the answer is one of these and those between
    while low < high:
        middle = (low + high) // 2 if low else 0  # all of it first: most need no more
        if enough(SHARES[middle]):
            high = middle
        else:
            low = middle + 1
    share = SHARES[low]
    return share, sum(seen[share] if share in seen else agreements(share), Agreement())


def standard_error(agreements: Sequence[Agreement]) -> float:
    """Of the share of all objects that agree, over pictures drawn at random: of a ratio, to first order (Cochran,
    Sampling Techniques, 1977, on ratios). Objects in fewer than two pictures say nothing, and it is infinite."""
    each = np.array([(one.agreed, one.objects) for one in agreements if one.objects], np.float64).reshape(-1, 2)
    count, (agreed, objects) = len(each), each.sum(0)
    if count < 2:
        return math.inf
    residuals = each[:, 0] - agreed / objects * each[:, 1]
    return float(np.sqrt(count / (count - 1) * np.square(residuals).sum()) / objects)

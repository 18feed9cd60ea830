"""All readers under test, by name."""

from __future__ import annotations

from . import contract_targets, detect_targets, weights_targets
from .target import Target

READERS: dict[str, Target] = {
    target.name: target for module in (contract_targets, weights_targets, detect_targets) for target in module.TARGETS
}

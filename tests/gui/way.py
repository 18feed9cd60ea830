"""A stranger's way through the order of work: how many clicks and how long, as the test drives it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from .screen import Screen


@dataclass
class Way:
    """Notes what each part of the way took; what is done between :meth:`note` and :meth:`begin` is not on it."""

    screen: Screen
    parts: list[tuple[str, int, float]] = field(default_factory=list)  # name, clicks, seconds
    _clicks: int = 0
    _since: float = 0.0

    def begin(self) -> None:
        """Clicks and time count from here on."""
        self._clicks, self._since = self.screen.clicks, time.monotonic()

    def note(self, name: str) -> None:
        """End a part and begin the next; the mouse's search for a button is in its time."""
        self.parts.append((name, self.screen.clicks - self._clicks, time.monotonic() - self._since))
        self.begin()

    def __str__(self) -> str:
        told = [f"{name}: {clicks} clicks, {seconds:.0f} s" for name, clicks, seconds in self.parts]
        clicks, seconds = (sum(part[i] for part in self.parts) for i in (1, 2))
        return "; ".join([*told, f"in all {clicks} clicks, {seconds / 60:.1f} min, panels' headers left out"])

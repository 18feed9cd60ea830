"""An empty wheel for the Pythons that xatlas has no wheel for, so that Blender does not refuse them.

Blender installs an extension only when its own Python is among those that the carried wheels name. The add-on needs
none of them: without xatlas it unwraps by Blender's own means, and says so. Distributions build Blender with these.
"""

from __future__ import annotations

import base64
import hashlib
import zipfile
from pathlib import Path

NAME, VERSION, TAG = "rauca_other_pythons", "1", "py312.py314-none-any"
EPOCH = (1980, 1, 1, 0, 0, 0)  # the zip's own: the same bytes every time


def write_other_pythons_wheel(folder: Path) -> Path:
    """Write the wheel into ``folder``; returns its path."""
    inside = f"{NAME}-{VERSION}.dist-info"
    files = {
        f"{inside}/METADATA": f"Metadata-Version: 2.1\nName: {NAME}\nVersion: {VERSION}\nSummary: Holds nothing\n",
        f"{inside}/WHEEL": "Wheel-Version: 1.0\nGenerator: rauca\nRoot-Is-Purelib: true\n"
        "Tag: py312-none-any\nTag: py314-none-any\n",
    }
    record = "".join(f"{name},{_sum(text)},{len(text)}\n" for name, text in files.items())
    files[f"{inside}/RECORD"] = f"{record}{inside}/RECORD,,\n"
    path = folder / f"{NAME}-{VERSION}-{TAG}.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        for name, text in files.items():
            wheel.writestr(zipfile.ZipInfo(name, EPOCH), text)
    return path


def _sum(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return "sha256=" + base64.urlsafe_b64encode(digest).rstrip(b"=").decode()

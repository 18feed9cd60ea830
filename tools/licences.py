"""The licences of every dependency and of every weight, written into the page on licences.

``python tools/licences.py docs/licences.md`` reads ``pyproject.toml``, the installed packages' own metadata, the
registry of detectors and the cards of shipped weights. Run it in an environment that has all extras.
"""

from __future__ import annotations

import importlib.metadata as installed
import json
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from benchmarks.harness import fill_between  # noqa: E402
from rauca_core.contract import RaucaError  # noqa: E402
from rauca_core.contract.assets import assets_folder  # noqa: E402
from rauca_core.detect import SOURCES, Source  # noqa: E402

BEGIN, END = "<!-- licences: written by tools/licences.py -->", "<!-- end of licences -->"
DEVICE_LIBRARIES = ("nvidia-", "cuda-", "triton", "intel-")  # which of them come depends on the machine's torch

BEGINNING = 1500  # characters of a licence's text; further down come those of what a package bundles

# How packages spell the licence that they have, as a pattern, and what it is called here; the first match counts.
SPELLINGS = (
    (r"Mozilla Public License 2\.0|^MPL", "MPL-2.0"),
    (r"Python Software Foundation|^License agreement for matplotlib|^PSF", "PSF-2.0"),
    (r"Apache", "Apache-2.0"),
    (r"^(The )?MIT|MIT License", "MIT"),
    (r"^ISC|ISC License", "ISC"),
    (r"FreeBSD|BSD[- ]2|2-Clause", "BSD-2-Clause"),
    (r"BSD[- ]3|3-Clause|Modified BSD|Neither the name", "BSD-3-Clause"),
    (r"BSD|Redistribution and use in source and binary forms", "BSD"),
    (r"GPL-3\.0|GNU General Public License v3", "GPL-3.0"),
)


def declared() -> dict[str, list[Requirement]]:
    """What ``pyproject.toml`` asks for, by extra; always under ``""``."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = {"": project["dependencies"], **project["optional-dependencies"]}
    # A package that different Pythons ask for in different versions is one.
    named = {extra: {(asked := Requirement(text)).name: asked for text in texts} for extra, texts in groups.items()}
    return {extra: list(packages.values()) for extra, packages in named.items()}


def brought_along(asked: Sequence[Requirement]) -> list[str]:
    """Packages that the ones asked for need in turn and that are installed here, without libraries of a device."""
    first = {canonicalize_name(package.name) for package in asked}
    seen, waiting = set(first), list(asked)
    while waiting:
        for needed in _needs(waiting.pop()):
            name = canonicalize_name(needed.name)
            if name not in seen and not name.startswith(DEVICE_LIBRARIES):
                seen.add(name)
                waiting.append(needed)
    return sorted(seen - first)


def _needs(package: Requirement) -> Iterator[Requirement]:
    for text in installed.requires(package.name) or ():
        needed = Requirement(text)
        wanted = needed.marker is None or any(needed.marker.evaluate({"extra": e}) for e in ("", *package.extras))
        if wanted and is_installed(needed.name):
            yield needed


def is_installed(name: str) -> bool:
    try:
        installed.distribution(name)
    except installed.PackageNotFoundError:
        return False
    return True


def licence_of(package: str) -> str:
    """The licence that an installed package states: its expression, else its classifiers, its text or its file.

    Raises:
        RaucaError: it is not installed, or what it states is not known here.
    """
    if not is_installed(package):
        raise RaucaError(f"licences: {package} is not installed; install rauca with all its extras, then run it again")
    about = installed.metadata(package)
    if expression := about.get_all("License-Expression"):
        return str(expression[0])
    stated = str(*(about.get_all("License") or [""])[:1]).strip()
    if re.fullmatch(r"[\w.+-]+( (AND|OR) [\w.+-]+)+", stated):
        return stated
    classifiers = [c for c in about.get_all("Classifier") or () if c.startswith("License ::")]
    brief = [stated] if "\n" not in stated else []
    for text in (*brief, *classifiers, stated[:BEGINNING], *_licence_files(package)):
        if licence := recognize(text):
            return licence
    raise RaucaError(f"licences: {package} states none that is known; look at it and add its spelling to SPELLINGS")


def recognize(text: str) -> str:
    """The licence in a line or a whole text; empty when it is none of :data:`SPELLINGS`."""
    return next((name for pattern, name in SPELLINGS if re.search(pattern, text.strip())), "")


def _licence_files(package: str) -> Iterator[str]:
    for path in installed.files(package) or ():
        if re.fullmatch(r"(LICEN[CS]E|COPYING)(\.\w+)?", path.name) and ".dist-info" in str(path):
            yield path.read_text()[:BEGINNING]


def page_tables() -> str:
    groups = declared()
    asked = [
        (f"`{package.name}`", licence_of(package.name), f"extra `{extra}`" if extra else "always")
        for extra, packages in groups.items()
        for package in sorted(packages, key=str)
    ]
    detectors = [(f"`{s.name}`", s.family, s.trained_on, s.licence, _origin(s)) for s in SOURCES.values()]
    tables = {
        "Dependencies": _table(("package", "licence", "needed"), asked),
        "Brought along by these": _table(("licence", "packages"), _by_licence(groups)),
        "Detectors": _table(("name", "family", "trained on", "licence", "from"), detectors),
        "Weights that rauca ships": _table(("file", "licence"), sorted(shipped().items())),
    }
    return "\n".join(f"### {title}\n\n{table}" for title, table in tables.items())


def _by_licence(groups: Mapping[str, Sequence[Requirement]]) -> list[tuple[str, str]]:
    found: dict[str, list[str]] = {}
    for name in brought_along([package for packages in groups.values() for package in packages]):
        found.setdefault(licence_of(name), []).append(f"`{name}`")
    return [(licence, ", ".join(names)) for licence, names in sorted(found.items())]


def _origin(source: Source) -> str:
    if source.files:
        return "; ".join(dict.fromkeys(file.origin for file in source.files))
    return "shipped" if source.family == "synth" else f"`{source.how.split(', ')[0]}`"


def shipped() -> Mapping[str, str]:
    """Weights below ``assets/`` and the licence on the card of each; rauca's own where a card names none."""
    files = sorted(assets_folder().rglob("*.safetensors"))
    cards = {file.name: json.loads(file.with_suffix(".json").read_text()) for file in files}
    return {f"`{name}`": str(card.get("licence", "Apache-2.0")) for name, card in cards.items()}


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("error: give the page to write, docs/licences.md")
    try:
        fill_between(Path(sys.argv[1]), BEGIN, END, page_tables())
    except RaucaError as error:
        sys.exit(f"error: {error}")

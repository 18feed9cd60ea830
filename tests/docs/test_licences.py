"""The page on licences lists every dependency, every detector and every weight that is shipped."""

from __future__ import annotations

import re
from pathlib import Path

from rauca_core.detect import SOURCES
from tools.licences import brought_along, declared, is_installed, licence_of, recognize, shipped

PAGE = Path(__file__).resolve().parents[2] / "docs" / "licences.md"
MAY_BE_USED = r"(Apache-2\.0|BSD|MIT|ISC|MPL-2\.0|PSF-2\.0|CNRI-Python|Unlicense|CC0|Zlib|HPND|0BSD|BSL-1\.0)"


def rows() -> dict[str, list[str]]:
    """The page's table rows by their first cell."""
    lines = (re.split(r"\s*\|\s*", line.strip("| \n")) for line in PAGE.read_text().splitlines() if line[:1] == "|")
    return {first.strip("`"): rest for first, *rest in lines}


def test_every_dependency_is_listed_with_its_licence() -> None:
    for extra, packages in declared().items():
        for package in packages:
            licence, needed = rows()[package.name]
            assert licence
            assert needed == (f"extra `{extra}`" if extra else "always")


def test_licences_on_the_page_are_those_of_the_packages_installed() -> None:
    listed = rows()
    here = [p.name for packages in declared().values() for p in packages if is_installed(p.name)]
    assert len(here) > 10
    assert not {name: licence_of(name) for name in here if listed[name][0] != licence_of(name)}


def test_what_dependencies_bring_along_may_be_used() -> None:
    """Newer releases bring other packages than the page knows; none may bring an obligation that it does not name."""
    asked = [p for packages in declared().values() for p in packages if is_installed(p.name)]
    along = brought_along(asked)
    assert "numpy" not in along
    assert len(along) > 20
    assert not {n: licence_of(n) for n in along if not re.search(MAY_BE_USED, licence_of(n))}


def test_every_detector_is_listed() -> None:
    for name, source in SOURCES.items():
        family, trained_on, licence, origin = rows()[name]
        assert (family, trained_on, licence) == (source.family, source.trained_on, source.licence)
        assert origin


def test_every_shipped_weight_is_listed() -> None:
    assert len(shipped()) >= 3
    for name, licence in shipped().items():
        assert rows()[name.strip("`")] == [licence]


def test_spellings() -> None:
    assert recognize("The MIT License (MIT)") == "MIT"
    assert recognize("License :: OSI Approved :: Apache Software License") == "Apache-2.0"
    assert recognize("FreeBSD") == "BSD-2-Clause"
    assert recognize("all rights reserved") == ""

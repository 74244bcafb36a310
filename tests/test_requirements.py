"""What pyproject.toml allows is what the requirements files install, and so what the
tests have run on.
"""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
EXTRAS = PROJECT["project"]["optional-dependencies"]
GROUPS = PROJECT["dependency-groups"]
# with files of their own
BROWSERS, WASM = ([Requirement(r) for r in GROUPS.pop(name)] for name in ("browsers", "wasm"))
DECLARED = [
    Requirement(r)
    for part in (PROJECT["project"]["dependencies"], *EXTRAS.values(), *GROUPS.values())
    for r in part
    if isinstance(r, str) and not r.startswith("stimlib[")  # or it includes another one
]
INNER = {  # what the code of stimlib writes where it uses inner parts of another package
    "jax": r"jax\.extend",
    "soundfile": r"\bextra_info\b",
    "jack-client": r"\bjack\._[a-z]",
    "sounddevice": r"\bsd\._[A-Za-z]",
}


def pinned(name, python="3.11.7"):
    """The releases that a file installs on this Python, by canonical name, each with
    its number of hashes.
    """
    text = (ROOT / name).read_text().replace("\\\n", " ")
    found = {}
    for line in (line for line in text.splitlines() if not line.startswith("#")):
        requirement, *hashes = line.split(" --hash=sha256:")
        r = Requirement(requirement)
        place = {
            **default_environment(),
            "python_version": python.rpartition(".")[0],
            "python_full_version": python,
        }
        if r.marker is None or r.marker.evaluate(place):
            (one,) = r.specifier
            assert one.operator == "==" and all(
                re.fullmatch(r"[0-9a-f]{64} *", h) for h in hashes
            ), line
            assert canonicalize_name(r.name) not in found, f"{r.name} twice for Python {python}"
            found[canonicalize_name(r.name)] = (Version(one.version), len(hashes))
    return found


def test_lower_bounds_are_what_test_lowest_installs():
    pins = pinned("requirements-lowest.txt")
    for r in DECLARED:
        (bound,) = (s.version for s in r.specifier if s.operator == ">=")
        assert pins[canonicalize_name(r.name)][0] == Version(bound), r


@pytest.mark.parametrize(
    ("file", "python", "declared"),
    [
        *[
            ("requirements.txt", python, DECLARED)
            for python in ("3.11.2", "3.11.7", "3.12.1", "3.13.0")
        ],
        ("requirements-newest.txt", "3.13.0", DECLARED),
        ("requirements-browsers.txt", "3.11.7", BROWSERS),
        ("requirements-wasm.txt", "3.11.7", WASM),
    ],
)
def test_what_is_installed_is_allowed(file, python, declared):
    pins = pinned(file, python)
    for r in declared:
        assert r.specifier.contains(pins[canonicalize_name(r.name)][0]), r


@pytest.mark.parametrize(
    "file",
    [
        "requirements.txt",
        "requirements-lowest.txt",
        "requirements-newest.txt",
        "requirements-browsers.txt",
        "requirements-wasm.txt",
    ],
)
def test_every_release_has_hashes_and_no_file_names_a_server(file):
    assert all(hashes >= 1 for _, hashes in pinned(file).values())
    assert not re.search(
        r"https?:|--(extra-)?index-url|--find-links|--trusted-host", (ROOT / file).read_text()
    )


def test_only_tested_releases_where_inner_parts_are_used():
    """Found in the code, so that a new use asks for a bound: the first untested release
    is excluded.
    """
    code = "".join(p.read_text("utf-8") for p in (ROOT / "stimlib").rglob("*.py"))
    pins = pinned("requirements-newest.txt", "3.13.0")
    for r in DECLARED:
        name = canonicalize_name(r.name)
        if name in INNER:
            assert re.search(INNER[name], code), f"{name}: its bound has no reason any more"
            major, minor = pins[name][0].release[:2]
            assert not r.specifier.contains(f"{major}.{minor + 1}"), r
    assert INNER.keys() <= {canonicalize_name(r.name) for r in DECLARED}


def test_the_build_needs_nothing_else():
    assert set(PROJECT["build-system"]["requires"]) <= {
        r for r in GROUPS["dev"] if isinstance(r, str)
    }

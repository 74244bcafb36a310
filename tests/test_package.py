"""What is handed out: the files beside the code say the same as the code."""

import re
import tomllib
from pathlib import Path

import stimlib

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_version_and_licence_are_said_once():
    """In each file that says them, as the code and the LICENSE say them."""
    cited = dict(re.findall(r"^([a-z-]+): (\S.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE))
    assert cited["version"] == re.search(r"^## (\S+?),? ", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert cited["version"] == stimlib.__version__
    assert cited["license"] == PROJECT["license"] == "BSD-3-Clause"
    text = (ROOT / "LICENSE").read_text()
    assert text.startswith("BSD 3-Clause License\n") and f"(c) 2026, {PROJECT['authors'][0]['name']}\n" in text

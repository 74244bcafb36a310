"""Parts of the page in node, which runs them without a browser."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
LIVE = HERE.parents[1] / "stimlib" / "live"


def told(*words):
    """What a program prints as JSON."""
    if shutil.which("node") is None:
        pytest.skip("needs node, which runs a part of a page without a browser")
    done = subprocess.run(["node", *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)

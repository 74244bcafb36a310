"""What is handed out: the files beside the code say the same as the code, and what is
built of them works alone.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import stimlib

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_version_and_licence_are_said_once():
    """In each file that says them, as the code and the LICENSE say them."""
    cited = dict(
        re.findall(r"^([a-z-]+): (\S.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    )
    newest = re.search(r"^## \[(\S+)\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert cited["version"] == newest[1] == stimlib.__version__
    assert cited["license"] == PROJECT["license"] == "BSD-3-Clause"
    text = (ROOT / "LICENSE").read_text()
    assert (
        text.startswith("BSD 3-Clause License\n")
        and f"(c) 2026, {PROJECT['authors'][0]['name']}\n" in text
    )


USE = """
import numpy as np, stimlib
from stimlib import Input, Scene
print(stimlib.__file__)
scene = Scene({"y": 2 * Input("x")})
print(stimlib.render(scene, {"x": np.arange(3.0)}, 1000, target="python")["y"].tolist())
print(*stimlib.scenes.squeeze().outputs)
"""


def said(*words, cwd, **environment):
    done = subprocess.run(
        [sys.executable, *words],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout.split("\n")


@pytest.mark.stress
def test_a_wheel_of_the_source_distribution_works_alone(tmp_path):
    """Both by the hooks that pip calls; nothing is fetched."""
    pytest.importorskip("setuptools", reason="the build backend is not in this environment")
    left_out = shutil.ignore_patterns(
        ".*", "*.egg-info", "__pycache__", "_build", "build", "dist", "demo", "corpus"
    )
    shutil.copytree(ROOT, tmp_path / "copy", ignore=left_out)
    build = (
        "import sys; from setuptools import build_meta; getattr(build_meta,"
        " sys.argv[1])(sys.argv[2])"
    )
    said("-c", build, "build_sdist", str(tmp_path), cwd=tmp_path / "copy")
    shutil.rmtree(tmp_path / "copy")
    name = f"stimlib-{stimlib.__version__}"
    said("-m", "tarfile", "-e", f"{name}.tar.gz", cwd=tmp_path)
    for file in (
        "Makefile",
        "requirements.txt",
        "tests/conftest.py",
        "docs/index.rst",
        "examples/first_stimulus.py",
        "LICENSE",
    ):
        assert (tmp_path / name / file).is_file(), file
    said("-c", build, "build_wheel", str(tmp_path), cwd=tmp_path / name)
    site = tmp_path / "site"
    shutil.unpack_archive(tmp_path / f"{name}-py3-none-any.whl", site, "zip")
    assert {p.name for p in site.iterdir()} == {"stimlib", f"{name}.dist-info"}
    for file in ("live/page/index.html", "live/web/page.c", "live/web/math.h", "export/runtime.h"):
        assert (site / "stimlib" / file).exists(), file
    assert (site / "stimlib" / "py.typed").exists() and (
        site / f"{name}.dist-info" / "licenses" / "LICENSE"
    ).exists()
    assert (
        "stimlib = stimlib.__main__:main"
        in (site / f"{name}.dist-info" / "entry_points.txt").read_text()
    )
    used = said("-c", USE, cwd=tmp_path, PYTHONPATH=str(site))
    assert used == [str(site / "stimlib" / "__init__.py"), "[0.0, 2.0, 4.0]", "force1 force2", ""]


def test_links_of_the_project_files_are_there():
    """Relative links to files that are in the repository, not to what is built."""
    for name in ("README", "CONTRIBUTING", "SECURITY", "CODE_OF_CONDUCT"):
        links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", (ROOT / f"{name}.md").read_text("utf-8"))
        for link in [t for t in links if not t.startswith("http")]:
            assert (ROOT / link).exists() and "docs/gallery" not in link, (name, link)

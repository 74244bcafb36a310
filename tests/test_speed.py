"""What measures: that both sides do the same work, that the limit does what it counts,
and that every script is named.
"""

import importlib
import platform
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import stimlib

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "benchmarks"))
peak, timing, short = map(importlib.import_module, ("peak", "timing", "short"))
from noise_chain import FS, WAYS, Peer, stages  # noqa: E402

sys.path.remove(str(ROOT / "benchmarks"))  # it has modules with the names of folders of tests
SPEEDS = [
    short.Speed("white noise", 3.0, "numpy PCG64", 9.0, 3.25, 0.5),
    short.Speed("one sample a call", 1234.5),
]


@pytest.mark.parametrize("way", WAYS)
def test_the_peer_does_the_same_work(way):
    """The same samples in chunks through each stage: states are carried on, poles and
    taps are ours.
    """
    x, made, peer = np.random.default_rng(1).standard_normal(3 * 4096), stages(), Peer(4096, way)
    for stage, part in (("pink filter", peer.pink), ("differentiator", peer.fir)):
        ours = stimlib.compile(made[stage].scene, FS).process(x[None])[0]
        theirs = np.concatenate([part(chunk).copy() for chunk in x.reshape(3, -1)])
        assert np.abs(theirs - ours).max() < 1e-9 * np.abs(ours).max(), stage
    chain = stimlib.compile(made["noise chain"].scene, FS).process(np.empty((0, 1 << 16)))
    chunks = [peer.fir(peer.pink(peer.white())).std() for _ in range(8)]
    assert np.mean(chunks[1:]) == pytest.approx(chain.std(), rel=0.02)


def test_the_limit_does_as_many_operations_as_it_counts(monkeypatch):
    """Each turn, 12 vectors become 0.999 times themselves plus 0.001, towards 1: their
    sum tells the number of turns.
    """
    for lanes in peak.LANES:
        monkeypatch.setattr(peak, "_width", lambda lanes=lanes: lanes)
        for count, turns in ((12 * lanes * 100, 100), (12 * lanes * 100 + 1, 101)):
            assert peak.peak(count)() == pytest.approx(12 + 78 * 0.999**turns, rel=1e-12)


def test_the_short_table_has_what_each_figure_has_and_is_drawn(tmp_path):
    assert [r["what"] for s in SPEEDS for r in short.rows_of(s)] == [
        "white noise",
        "white noise: numpy PCG64",
        "white noise: ratio: numpy PCG64 / stimlib",
        "white noise: share of the limit",
        "one sample a call",
    ]
    short.picture(SPEEDS, tmp_path / "speed.svg")
    drawn = (tmp_path / "speed.svg").read_text("utf-8")
    assert "3.2 times as long" in drawn and "one sample a call" in drawn


def test_the_machine_is_named_where_linux_does_not_name_it(monkeypatch):
    monkeypatch.setattr(timing, "Path", lambda name: Path("/not/there"))
    for named in ("a processor", ""):
        monkeypatch.setattr(platform, "processor", lambda named=named: named)
        assert timing.machine().startswith(f"{named or platform.machine()}; Python 3.")


def test_make_bench_runs_every_script_that_records_and_the_readme_tells_of_all():
    texts = {p.stem: p.read_text("utf-8") for p in (ROOT / "benchmarks").glob("*.py")}
    scripts = {name for name, text in texts.items() if 'if __name__ == "__main__"' in text}
    run = re.search(r"^BENCHMARKS := (.*)$", (ROOT / "Makefile").read_text(), re.M)
    told = re.findall(
        r"^\| `(\w+)\.py`", (ROOT / "benchmarks" / "README.md").read_text("utf-8"), re.M
    )
    assert scripts == set(told)
    assert {name for name in scripts if "--record" in texts[name]} == set(run[1].split())

"""What the cache runs is what stimlib wrote: damage, strangers, and threads and
processes at once.
"""

import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from laws import STRESS
from refusals import refused, warned
from test_cache import finish, give_runtime, run, runtime_entry, start

from stimlib.errors import SinkError
from stimlib.system import cache_folder
from stimlib.system.limits import limits
from stimlib.targets.llvm import cache

RUN = """
import hashlib, os, sys, threading
def run(number=0):
    import numpy as np
    import stimlib
    x, z = stimlib.Input("x"), stimlib.Input("z")
    from stimlib.blocks import tanh
    outputs = {"y": tanh(x + z)}
    if number % 2:
        outputs["w"] = tanh(x + float(number))
    scene = stimlib.Scene(outputs)
    y = stimlib.compile(scene, 1000).process(np.random.default_rng(1).standard_normal((2, 200)))
    return hashlib.sha256(y[0].tobytes()).hexdigest()
"""
ONE = RUN + "os.umask(0)\nprint(run())\n"
MADE = """
import os, shutil, sys
from pathlib import Path
from stimlib.targets.llvm.cache import folder
os.umask(0)
shutil.copy(sys.argv[1], folder())
(folder() / Path(sys.argv[1]).name).chmod(0o600)
"""
THREADS = (
    RUN
    + """
barrier, found = threading.Barrier(6), []
def work(number):
    barrier.wait()
    try:
        found.append(run(number))
    except BaseException as e:
        found.append(repr(e))
threads = [threading.Thread(target=work, args=(k,)) for k in range(6)]
for t in threads: t.start()
for t in threads: t.join()
print(*sorted(set(found)))
"""
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A cache in a folder where everybody may make files, by a process that keeps
    nothing from anybody; its samples.
    """
    shared = tmp_path_factory.mktemp("shared")
    shared.chmod(0o1777)
    out, err = run(["-c", MADE + ONE, runtime_entry()], shared / "deep" / "cache")
    assert err == ""
    return out, shared / "deep" / "cache"


@pytest.fixture
def folder(made, tmp_path):
    return Path(shutil.copytree(made[1], tmp_path / "cache"))


@pytest.fixture
def anew(monkeypatch):
    """This process chooses its folder again."""
    monkeypatch.setattr(cache_folder, "_folder", None)
    return lambda path: monkeypatch.setenv("STIMLIB_CACHE", str(path))


def entry(folder, stem):
    (found,) = folder.glob(f"{stem}_*")
    return found


def of(place):
    """What an entry says that it is made of."""
    return json.loads(place.read_bytes().partition(b"\n")[0])["of"]


# Strangers ----------------------------------------------------------------------------
def test_nobody_else_gets_at_it_whatever_the_umask(made):
    for path in (made[1].parent, made[1], *made[1].rglob("*")):
        assert not stat.S_IMODE(path.stat().st_mode) & 0o077, path


def give_away(path, to):
    """To a mode, or to somebody else."""
    if to != "a stranger":
        path.chmod(to)
    elif os.geteuid():
        pytest.skip("only root can give a folder away")
    else:
        os.chown(path, 65534, 65534)


@pytest.mark.parametrize(
    ("to", "words"),
    [
        (0o777, "others may write to it.*chmod go-w"),
        (0o770, "others may write"),
        ("a stranger", "belongs to user"),
    ],
)
def test_a_folder_that_is_not_private_is_not_used(folder, anew, to, words):
    give_away(folder, to)
    anew(folder)
    place = warned(RuntimeWarning, f"{words}.*set STIMLIB_CACHE", cache.folder)
    assert place != folder and not stat.S_IMODE(place.stat().st_mode) & 0o077


def test_a_folder_that_others_may_replace_is_not_used(tmp_path, anew, monkeypatch):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    anew(tmp_path / "open" / "cache")
    assert warned(
        RuntimeWarning, "everybody may replace the contents of .*open", cache.folder
    ).name.startswith("stimlib-tmp-")
    monkeypatch.setattr(cache_folder, "_folder", None)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    refused(SinkError, "nor can a temporary one .*; set STIMLIB_CACHE", cache.folder)


@pytest.mark.parametrize("to", [0o777, 0o770, "a stranger", "a link"])
def test_an_entry_of_a_stranger_is_not_run(folder, to):
    place = entry(folder, "Tanh")
    made_of = of(place)
    assert cache._sound(place, made_of)
    if to == "a link":
        place.symlink_to(place.rename(folder / "planted"))
    else:
        give_away(place, to)
    assert not cache._sound(place, made_of)


# Damage -------------------------------------------------------------------------------
def test_every_flipped_bit_is_seen(folder, monkeypatch):
    monkeypatch.setattr(limits, "sidecar_bytes", 100.0)  # which an entry is none of
    rng = np.random.default_rng(0)
    for stem in ("Tanh", "runtime"):
        place = entry(folder, stem)
        good, made_of = place.read_bytes(), of(place)
        head = good.index(b"\n") + 1
        for k in [*range(0, head, 1 if STRESS else 7), *rng.integers(head, len(good), 60)]:
            data = bytearray(good)
            data[k] ^= 1 << rng.integers(8)
            place.write_bytes(data)
            assert not cache._sound(place, made_of), k
        place.write_bytes(good)
        assert cache._sound(place, made_of)
        assert not cache._sound(place, f"{made_of}0"), "an entry of another text"


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)


def halve(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def other_name(path):
    """Sums that fit do not make code that fits."""
    line, _, code = path.read_bytes().partition(b"\n")
    head = json.loads(line) | {"names": ["nothing"]}
    del head["sha256"]
    sums = cache._sum(json.dumps(head).encode() + code)
    path.write_bytes(json.dumps(head | {"sha256": sums}).encode() + b"\n" + code)


DAMAGE = {
    "a bit": flip,
    "half an entry": halve,
    "an empty entry": lambda path: path.write_bytes(b""),
    "sums of something else": lambda path: path.write_bytes(b"[1]\n"),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
    "other functions": other_name,
}


# the others are not sound either, and go the way of the first
HEALED = ("a bit", "a pipe", "other functions")
FORKS = (
    RUN
    + """
import stimlib.targets.llvm.engine
for folder in sys.argv[1:]:
    pid = os.fork()
    if not pid:
        os.environ["STIMLIB_CACHE"] = folder
        print(run(), flush=True)
        os._exit(0)
    os.waitpid(pid, 0)
"""
)


def test_what_is_damaged_is_compiled_again(made, tmp_path):
    folders = {}
    for k, (what, change) in enumerate(DAMAGE.items()):
        folder = Path(shutil.copytree(made[1], tmp_path / str(k)))
        place = entry(folder, "Tanh")
        made_of = of(place)
        change(place)
        assert what.startswith("other") or not cache._sound(place, made_of), what
        if STRESS or what in HEALED:
            folders[what] = folder
    out, err = run(["-c", FORKS, *folders.values()], made[1])
    assert out.split() == [made[0]] * len(folders) and err == ""
    for what, folder in folders.items():
        assert cache._sound(entry(folder, "Tanh"), made_of), what
        assert {p.name for p in folder.iterdir()} == {p.name for p in made[1].iterdir()}


# At once ------------------------------------------------------------------------------
def test_processes_that_meet_a_damaged_entry_at_once(made, folder):
    flip(entry(folder, "Tanh"))
    assert {finish(p) for p in [start(["-c", ONE], folder) for _ in range(2)]} == {(made[0], "")}
    assert {p.name for p in folder.iterdir()} == {p.name for p in made[1].iterdir()}


def test_threads_that_compile_at_once(made, tmp_path):
    """Into a new cache, and from a full one."""
    folder = give_runtime(tmp_path / "cache")
    for _ in range(2):
        assert run(["-c", THREADS], folder) == (made[0], "")


SINKS = """
import threading
import stimlib
from stimlib.devices.null import NullSink
barrier, errors = threading.Barrier(2), []
def work(k):
    x = stimlib.Input("x", "m")
    scene = stimlib.Scene({"y": stimlib.blocks.velocity(x) if k else 2.0 * x})
    barrier.wait()
    try:
        with NullSink(scene, 50.0, clocked=False, motion={"x": lambda t: 0.0 * t}) as sink:
            sink.open(1000)
            sink.start(seconds=0.5)
            sink.wait()
        assert sink.report().produced == 500
    except BaseException as e:
        errors.append(e)
threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
for t in threads: t.start()
for t in threads: t.join()
print(errors)
"""


def test_sinks_that_open_at_once():
    said = subprocess.run([sys.executable, "-c", SINKS], capture_output=True, text=True)
    assert (said.stdout, said.stderr) == ("[]\n", "")

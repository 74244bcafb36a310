"""What the cache runs is what stimlib wrote: damage, strangers, and threads and
processes at once.
"""

import json
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from laws import STRESS
from test_cache import finish, give_runtime, run, runtime_entry, start

from stimlib.system import cache_folder
from stimlib.targets.numba import cache

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
from stimlib.targets.numba.cache import folder
os.umask(0)
shutil.copytree(sys.argv[1], folder() / Path(sys.argv[1]).name)
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


def text_of(folder, stem="Tanh"):
    place = entry(folder, stem)
    return (place / f"{place.name}.py").read_text()


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
    with pytest.warns(RuntimeWarning, match=f"{words}.*set STIMLIB_CACHE"):
        place = cache.folder()
    assert place != folder and not stat.S_IMODE(place.stat().st_mode) & 0o077


def test_a_folder_that_others_may_replace_is_not_used(tmp_path, anew):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    anew(tmp_path / "open" / "cache")
    with pytest.warns(RuntimeWarning, match="everybody may replace the contents of .*open"):
        assert cache.folder().name.startswith("stimlib-tmp-")


@pytest.mark.parametrize("to", [0o777, 0o770, "a stranger", "a link"])
def test_an_entry_of_a_stranger_is_not_run(folder, to):
    place, text = entry(folder, "Tanh"), text_of(folder)
    assert cache._sound(place, text)
    if to == "a link":
        place.symlink_to(place.rename(folder / "planted"))
    else:
        give_away(place, to)
    assert not cache._sound(place, text)


# Damage -------------------------------------------------------------------------------
def test_every_flipped_bit_is_seen(folder):
    rng = np.random.default_rng(0)
    for stem in ("Tanh", "runtime"):
        place, text = entry(folder, stem), text_of(folder, stem)
        for path in sorted(p for p in place.rglob("*") if p.is_file()):
            good = path.read_bytes()
            for _ in range(60 if STRESS else 8):
                data = bytearray(good)
                data[rng.integers(len(data))] ^= 1 << rng.integers(8)
                path.write_bytes(data)
                assert not cache._sound(place, text), path
            path.write_bytes(good)
        assert cache._sound(place, text)
        assert not cache._sound(place, text + "\n"), "an entry of another text"


def flip(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 16
    path.write_bytes(data)


def halve(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def of_text(path):
    sums = json.loads(path.read_text())
    return json.dumps({name: s for name, s in sums.items() if name.endswith(".py")})


DAMAGE = {
    "bits of the code": ("*.nbc", flip),
    "bits of the index": ("*.nbi", flip),
    "half the code": ("*.nbc", halve),
    "half the index": ("*.nbi", halve),
    "half a text": ("*.py", halve),
    "an empty text": ("*.py", lambda path: path.write_bytes(b"")),
    "no sums": (cache.SUMS, os.unlink),
    "sums of something else": (cache.SUMS, lambda path: path.write_text("[1]")),
    "a folder for a file": (cache.SUMS, lambda path: (path.unlink(), path.mkdir())),
    "no index": ("*.nbi", os.unlink),
    "sums of the text alone": (cache.SUMS, lambda path: path.write_text(of_text(path))),
    "a pipe for the code": ("*.nbc", lambda path: (path.unlink(), os.mkfifo(path))),
}


HEALED = ("bits of the code", "a folder for a file")  # whatever is not sound goes the same way
FORKS = (
    RUN
    + """
import stimlib.targets.numba.engine
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
    for k, (what, (pattern, change)) in enumerate(DAMAGE.items()):
        folder = Path(shutil.copytree(made[1], tmp_path / str(k)))
        text = text_of(folder)
        change(next(entry(folder, "Tanh").rglob(pattern)))
        assert not cache._sound(entry(folder, "Tanh"), text), what
        if STRESS or what in HEALED:
            folders[what] = folder
    out, err = run(["-c", FORKS, *folders.values()], made[1])
    assert out.split() == [made[0]] * len(folders) and err == ""
    for what, folder in folders.items():
        assert cache._sound(entry(folder, "Tanh"), text_of(folder)), what
        assert not list(folder.rglob("*.tmp"))


def test_an_entry_that_cannot_be_loaded_is_compiled_again(made, folder):
    """Sums that fit do not make code that fits."""
    place = entry(folder, "Tanh")
    code = next(place.rglob("*.nbc"))
    code.write_bytes(b"not a pickle")
    sums = json.loads((place / cache.SUMS).read_text())
    sums[str(code.relative_to(place))] = cache._sum(b"not a pickle")
    (place / cache.SUMS).write_text(json.dumps(sums))
    assert run(["-c", ONE], folder) == (made[0], "")


def test_what_a_killed_process_left_is_removed_after_a_day(folder, tmp_path):
    name, old, outside = f"Tanh_{'0a' * 10}", time.time() - 2 * 86400, tmp_path / "outside"
    names = {k: f"{name}.{k}.tmp" for k in ("old_one1", "new_one1", "written1", "stranger", "abc")}
    names |= {"other": "mine.tmp", "entry": f"Tanh_{'0b' * 10}"}
    made = {k: folder / n for k, n in names.items()}
    for place in (*made.values(), outside):
        (place / "__pycache__").mkdir(parents=True)
        (place / "__pycache__" / "a.nbi").write_text("cut")
    made |= {k: folder / f"{name}.{k}.tmp" for k in ("link_to1", "a_file_1")}
    made["link_to1"].symlink_to(outside)
    made["a_file_1"].write_text("mine")
    (made["old_one1"] / "link").symlink_to(outside)
    if os.geteuid():
        shutil.rmtree(made.pop("stranger"))  # only root can give a folder away
    else:
        os.chown(made["stranger"], 65534, 65534)
    for k, place in made.items():
        for path in (place, *place.rglob("*")):
            if k != "new_one1" and (k, path.name) != ("written1", "a.nbi"):
                os.utime(path, (old, old), follow_symlinks=False)
    (part := folder / "part").mkdir()
    (part / "a.nbc").write_text("code")
    cache._publish(part, folder / f"Tanh_{'0c' * 10}")
    assert [k for k, place in made.items() if not os.path.lexists(place)] == ["old_one1"]
    assert (outside / "__pycache__" / "a.nbi").exists()
    assert (folder / f"Tanh_{'0c' * 10}" / "a.nbc").exists()


# At once ------------------------------------------------------------------------------
def test_processes_that_meet_a_damaged_entry_at_once(made, folder):
    flip(next(entry(folder, "Tanh").rglob("*.nbc")))
    assert {finish(p) for p in [start(["-c", ONE], folder) for _ in range(2)]} == {(made[0], "")}
    assert not list(folder.rglob("*.tmp"))


def test_threads_that_compile_at_once(made, tmp_path):
    """Into a new cache, and from a full one; beside it, numba's own folder stays
    empty.
    """
    folder, own = give_runtime(tmp_path / "cache"), tmp_path / "numba"
    for _ in range(2):
        assert run(["-c", THREADS], folder, NUMBA_CACHE_DIR=str(own)) == (made[0], "")
    assert not own.exists()


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

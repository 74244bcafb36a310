"""The cache of compiled segments, with real processes and real folders; and steps that
must not compile.
"""

import ctypes
import fcntl
import inspect
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import nullcontext, suppress
from pathlib import Path
from unittest import mock

import llvmlite
import pytest
from refusals import warned

from stimlib import Input, Scene
from stimlib.blocks import envelope, friction, oscillator
from stimlib.cli.app import friendly
from stimlib.core import maths
from stimlib.core.program import design_of, program_of
from stimlib.core.steps import source
from stimlib.system import cache_folder
from stimlib.targets.llvm import (
    cache as caches,
    engine,
    instructions,
    kernels,
    known,
    lanes,
    machine,
    rows,
    values,
    vectors,
    walk,
)
from stimlib.targets.llvm.cache import _salt as salt
from stimlib.targets.llvm.segments import made

ROOT = Path(__file__).parent.parent

SMALL = """
import hashlib, sys
import numpy as np
import stimlib
x = stimlib.Input("x")
proc = stimlib.compile(stimlib.Scene({"y": x + 2.0 * x}), 1000)
y = proc.process(np.sin(np.arange(500.0))[None])
print(hashlib.sha256(y.tobytes()).hexdigest())
"""


def start(words, cache, *paths, stdin=None, cwd=None, **more):
    """Python with a cache of its own; ``more`` goes into its environment."""
    path = os.pathsep.join(map(str, (*paths, ROOT)))
    words = [sys.executable, *map(str, words)]
    own = {"STIMLIB_CACHE": str(cache), "PYTHONPATH": path, "PYTHONWARNINGS": "default"}
    env = os.environ | own | {"PYTHONDONTWRITEBYTECODE": "1"} | more
    return subprocess.Popen(words, env=env, stdin=stdin, stdout=-1, stderr=-1, text=True, cwd=cwd)


def finish(process):
    """What it prints, and what it logs or warns of."""
    out, err = process.communicate()
    assert process.returncode == 0, err[-4000:]
    return out.strip(), err


def run(words, cache, *paths, **more):
    return finish(start(words, cache, *paths, **more))


def runtime_entry():
    """Where this process's cache has the runtime, which takes longest to compile."""
    return caches.folder() / engine.runtime().name


def give_runtime(folder):
    """A new cache folder with the runtime and nothing else."""
    folder.mkdir(mode=0o700)
    shutil.copy(runtime_entry(), folder)
    return folder


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    """What the small scene gives, and a cache folder that has it."""
    folder = give_runtime(tmp_path_factory.mktemp("wanted") / "cache")
    return run(["-c", SMALL], folder)[0], folder


@pytest.fixture(scope="module")
def cache(wanted, tmp_path_factory):
    return shutil.copytree(wanted[1], tmp_path_factory.mktemp("warm") / "cache")


# Folders ------------------------------------------------------------------------------
LOGS = """import logging
logging.basicConfig(level=logging.DEBUG, format='%(name)s %(levelname)s %(message)s')
"""


def test_processes_that_start_at_once_compile_each_entry_once(wanted, tmp_path):
    new = give_runtime(tmp_path / "new")
    text = LOGS + SMALL.replace("proc =", "print(flush=True), sys.stdin.read(1)\nproc =")
    processes = [start(["-c", text], new, stdin=subprocess.PIPE) for _ in range(2)]
    for process in processes:
        process.stdout.readline()  # until it stands before its first compilation
    for process in processes:
        process.stdin.close()
        process.stdin = None
    ends = [finish(p) for p in processes]
    assert {y for y, _ in ends} == {wanted[0]}
    compiled = re.findall(r"cache miss: (\w+)", ends[0][1] + ends[1][1])
    assert sorted(compiled) == sorted({p.name for p in new.iterdir()} - {runtime_entry().name})


def test_what_an_empty_cache_compiles_is_said_once_before(tmp_path, monkeypatch, capsys):
    """The words come before the text runs, which is what takes long; of a block class
    there are none.
    """
    monkeypatch.setenv("STIMLIB_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr(cache_folder, "_folder", None)
    seen = "import sys; print('running', file=sys.stderr)"
    with friendly():
        caches.load("x = 1", "Add")
        assert capsys.readouterr().err == ""
        caches.load(seen, "runtime")
        caches.load(seen, "pump")
    said = capsys.readouterr().err.splitlines()
    assert said == ["compiling for this machine, once: about two seconds", "running", "running"]
    caches.load(f"{seen} # again", "pump")
    assert capsys.readouterr().err == "running\n", "nobody is told outside of a command"


def test_the_log_tells_hits_misses_and_times(wanted, tmp_path):
    cache = shutil.copytree(wanted[1], tmp_path / "cache")
    (lost,) = cache.glob("Guard_*")
    lost.unlink()
    told = run(["-c", LOGS + SMALL], cache)[1]
    of_cache = "stimlib.targets.llvm.cache"
    assert f"{of_cache} DEBUG cache hit: runtime_" in told
    assert re.search(rf"{of_cache} INFO cache miss: {lost.name} compiled in \d", told)
    assert re.search(r"stimlib.run.processor DEBUG Processor\(.*\): \d+ rows, ready in \d", told)
    before = {p: p.stat().st_mtime_ns for p in cache.rglob("*") if p.is_file()}
    assert run(["-c", SMALL], cache) == (wanted[0], ""), "nor says a word where nobody listens"
    after = {p: p.stat().st_mtime_ns for p in cache.rglob("*") if p.is_file()}
    assert after == before, "a second process compiles nothing"


def test_an_entry_is_named_by_all_that_is_compiled_into_it(monkeypatch):
    monkeypatch.setattr(caches, "_sum", bytes.decode)  # the text that is hashed
    usual = salt.__wrapped__()
    modules = {(Path(caches.__file__).parent / f"{name}.py").resolve() for name in caches.PARTS}
    assert {
        Path(m.__file__) for m in (walk, values, known, kernels, vectors, lanes, instructions, rows)
    } | {Path(inspect.getfile(c)) for c in walk.Writer.__mro__[:-1]} <= modules
    for path in (*modules, Path(maths.__file__)):
        assert path.read_text() in usual
    for cls in rows.OPERATIONS:
        assert source(cls.step) in usual
    assert llvmlite.__version__ in usual
    for name, other in (("FEATURES", ["+mmx"]), ("CHOICES", {})):
        with monkeypatch.context() as m:
            m.setattr(machine, name, other)
            assert salt.__wrapped__() != usual, name


def instructions_of(block, ours):
    """The machine code of a block's segment, as text."""
    program = program_of(Scene({"y": block}))
    design = design_of(program, 8000, 20.0)
    (k,) = (i for i, q in enumerate(program.instances) if type(q.block) is type(block))
    module = machine.optimised(made(engine._Table(program, design).form((k,))).llvm, ours)
    with machine.choices() if ours else nullcontext():
        return machine._target_machine().emit_assembly(module)


@pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64"), reason="LLVM decides otherwise there"
)
@pytest.mark.parametrize(
    ("option", "other", "block"),
    [
        ("disable-select-optimize", "true", envelope(Input("x"))),
        pytest.param(
            "mispredict-default-rate",
            90,
            friction(Input("x", "m"), Input("n", "N")),
            marks=pytest.mark.stress,
        ),
        pytest.param(
            "unswitch-threshold",
            50,
            oscillator(Input("f", "Hz"), "triangle"),
            marks=pytest.mark.stress,
        ),
    ],
)
def test_segments_are_compiled_with_options_of_llvm_and_nothing_else_is(
    option, other, block, monkeypatch
):
    ours = instructions_of(block, True)
    with pytest.raises(KeyError), machine.choices():
        raise KeyError
    assert instructions_of(block, False) != ours, "LLVM keeps our options"
    monkeypatch.setitem(machine.CHOICES, option, (other, machine.CHOICES[option][1]))
    assert instructions_of(block, True) != ours, "LLVM does not know it"


FLOATS = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)
TWICE = """
from stimlib.targets.llvm.values import exported
@exported("f8", "f8")
def twice(x):
    return 2.0 * x
"""


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """A text compiled into a folder by this process, which chooses its folder anew;
    ``fill`` is called in between.
    """

    def load(folder, fill=lambda: None):
        monkeypatch.setattr(cache_folder, "_folder", None)
        monkeypatch.setenv("STIMLIB_CACHE", str(folder))
        caches.folder()
        fill()
        return FLOATS(caches.load(f"# {tmp_path}{TWICE}", "twice").addresses["twice"])(21.0)

    return load


@pytest.mark.parametrize("gone", [False, True])
def test_a_folder_that_cannot_be_made_or_goes_away_is_a_warning(twice, tmp_path, gone):
    (tmp_path / "file").write_text("in the way")
    folder = tmp_path / "cache" if gone else tmp_path / "file" / "cache"
    says = "cannot be written.*No such file" if gone else "cannot be written.*STIMLIB_CACHE"
    assert (
        warned(RuntimeWarning, says, twice, folder, folder.rmdir if gone else lambda: None) == 42.0
    )


@pytest.mark.parametrize(
    ("options", "filled", "says"),
    [
        ("ro,size=64k", 0, "Read-only"),
        ("size=8k", 0, "No space"),
        ("size=128k", 131072, "No space"),  # for the entry
    ],
)
def test_a_full_or_read_only_folder_is_a_warning(twice, mounted, options, filled, says):
    folder = mounted(options)

    def fill():
        with suppress(OSError):
            (folder / "others").write_bytes(b"0" * filled)

    assert warned(RuntimeWarning, says, twice, folder, fill) == 42.0
    assert not list(folder.glob("twice_*"))


def test_who_compiles_an_entry_is_waited_for_not_for_ever(twice, tmp_path, monkeypatch):
    text = f"# {tmp_path}{TWICE}"
    lock = tmp_path / "cache" / f"twice_{caches._sum((text + salt()).encode())[:20]}.lock"
    lock.parent.mkdir(mode=0o700)
    monkeypatch.setattr(caches, "WAIT", 0.1)
    waits = mock.patch.object(caches.time, "sleep", wraps=time.sleep)
    with lock.open("w") as held, waits as slept:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert twice(lock.parent) == 42.0 and slept.called
        # who has no lock does not remove its file
        assert {p.name for p in lock.parent.iterdir()} == {lock.stem, lock.name}


FORKS = """
import ctypes, faulthandler, logging, os, random, sys, threading
from pathlib import Path
from unittest import mock
from stimlib.targets.llvm import cache
log = logging.getLogger(cache.__name__)
log.setLevel("INFO")
log.addHandler(logging.StreamHandler(sys.stdout))
ends = (
    "import os; died = os.path.exists('died'); open('died', 'w').close();"
    " died or os.kill(os.getpid(), 9)"
)
waits = "import threading; open('begun', 'w').close(); threading.Event().wait(0.5)"
twice, begun = sys.argv[1], Path("begun")
texts = {"ends": ends + twice} | {f"entry{k}": twice for k in range(5)}
slow = threading.Thread(target=cache.load, args=(waits + twice, "slow"))
slow.start()
while not begun.exists():
    pass
children = []
for k in range(4):  # while a thread compiles
    if not (pid := os.fork()):
        faulthandler.dump_traceback_later(100, exit=True)
        stems = random.Random(k).sample(sorted(texts), len(texts))
        threads = [threading.Thread(target=cache.load, args=(texts[stem], stem)) for stem in stems]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        twice = cache.load(waits + twice, "slow").addresses["twice"]
        assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(twice)(21.0) == 42.0
        os._exit(0)
    children.append(pid)
print(sorted(os.waitpid(pid, 0)[1] for pid in children))
slow.join()
"""


def test_forks_and_threads_in_any_order_compile_each_entry_once(tmp_path):
    """A child is made while a thread of its parent compiles; one child is killed while
    it compiles, others wait for it.
    """
    out, _ = run(["-c", FORKS, TWICE], tmp_path / "cache", cwd=tmp_path)
    compiled = sorted(re.findall(r"cache miss: (\w+)_\w{20} compiled", out))
    assert compiled == ["ends", *(f"entry{k}" for k in range(5)), "slow"], out
    assert "[0, 0, 0, 9]" in out
    left = [p.name for p in (tmp_path / "cache").iterdir()]
    assert all(re.fullmatch(r"(ends|entry\d|slow)_\w{20}", name) for name in left), "no lock"


def test_an_entry_is_loaded_while_other_threads_wait(monkeypatch):
    def load(*given):
        thread = threading.Thread(
            target=lambda: free.append(cache_folder.lock.acquire(blocking=False))
        )
        thread.start()
        thread.join()

    free = []
    monkeypatch.setattr(caches, "_loaded", {})
    monkeypatch.setattr(caches, "_load", load)
    for _ in range(2):
        caches.load(TWICE, "twice")
    assert free == [False], "once"


LAZY = """
import os, signal, sys, threading
import numpy as np
import stimlib
def used():
    x = stimlib.Input("x", "kg*m/s^2/m")
    proc = stimlib.compile(stimlib.Scene({"y": x * 2.0}), 1000, sys.argv[2])
    os.write(1, b"%g\\n" % proc.process(np.ones((1, 1)))[0, 0])
other = threading.Thread(target=used)
other.start()
while sys.argv[1] not in sys.modules:
    pass
if not (pid := os.fork()):
    signal.alarm(40)
    try:
        used()
        os._exit(0)
    finally:
        os._exit(1)
sys.exit(os.waitpid(pid, 0)[1] != 0)
"""


@pytest.mark.parametrize(
    ("module", "target"),
    [
        ("pint", "llvm"),  # while it is imported, by a thread that has no twin in the child
        pytest.param("llvmlite.binding", "llvm", marks=pytest.mark.stress),
        pytest.param("stimlib.targets.llvm.engine", "llvm", marks=pytest.mark.stress),
        ("stimlib.targets.python", "python"),
    ],
)
def test_a_fork_while_a_thread_renders_for_the_first_time_renders(module, target, tmp_path):
    (tmp_path / "lazy.py").write_text(LAZY)
    words = [sys.executable, "-W", "ignore", "lazy.py", module, target]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "2\n2\n", "")


# Blocks of users ----------------------------------------------------------------------
MODULE = """
from dataclasses import dataclass
from typing import NamedTuple
from stimlib.core.graph import Block
from stimlib.core.maths import fma, where
{top}

FACTOR = {factor}

def helper(x):
    return {helper}

class GainParams(NamedTuple):
    {params}

class GainState(NamedTuple):
    last: float

@dataclass(frozen=True, eq=False)
class Gain(Block):
    x: Block
    gain: float = 2.0
    def design(self, fs):
        return GainParams(*(self.gain, 7.0)[: len(GainParams._fields)]), GainState(0.0)
    @staticmethod
    def step(p, s, x):
        return {step}, GainState(x)
"""
DEFAULT = {"top": "", "factor": "3.0", "helper": "x + 1.0", "step": "p.gain * FACTOR * helper(x)"}
DEFAULT |= {"params": "gain: float"}

USER = """
import numpy as np, sys
import stimlib
import mine
for target in ("llvm", "python"):
    proc = stimlib.compile(stimlib.Scene({"y": mine.Gain(stimlib.Input("x"))}), 1000, target)
    print(*proc.process(np.array([[1.0, 2.0]]))[0])
"""


EDITS = """
import json, os, runpy, sys
import stimlib.targets.llvm.engine
for text in json.load(open("texts.json")):
    open("mine.py", "w").write(text)
    if not (pid := os.fork()):  # a process of its own, without the time to start one
        runpy.run_path("user.py")
        sys.stdout.flush()
        os._exit(0)
    os.waitpid(pid, 0)
"""


def test_an_edit_is_never_served_stale(tmp_path, cache):
    """Step, helper, helper of a helper, constant: each edit is seen by the next
    process, with one cache.
    """
    (tmp_path / "user.py").write_text(USER)
    edits = [
        ({}, [12, 18]),
        ({"step": "p.gain * FACTOR * helper(x) + s.last"}, [12, 19]),
        ({"helper": "x + 2.0"}, [18, 24]),
        ({"helper": "other(x)", "top": "def other(x):\n    return x * 10.0"}, [60, 120]),
        ({"helper": "other(x)", "top": "DEEP = 4.0\ndef other(x):\n    return x * DEEP"}, [24, 48]),
        ({"helper": "other(x)", "top": "DEEP = 8.0\ndef other(x):\n    return x * DEEP"}, [48, 96]),
    ]
    pair = "class Pair(NamedTuple):\n    a: float\n    b: float = "
    edits += [
        ({"helper": "x * Pair(x).b", "top": f"{pair}{b}"}, [6 * b, 12 * b]) for b in (2.0, 3.0)
    ]
    pair = "class Pair(NamedTuple):\n    %s: float\n    %s: float"
    edits += [
        ({"helper": "Pair(x, 2.0).b", "top": pair % tuple(names)}, wanted)
        for names, wanted in (("ab", [12, 12]), ("ba", [6, 12]))
    ]
    default = "def other(x, {}k=4.0):\n    return x * k\nother.__{}__ = {}"  # of one text
    edits += [
        ({"helper": "other(x)", "top": default.format(*how)}, [6 * v, 12 * v])
        for v in (5.0, 8.0)
        for how in (("", "defaults", (v,)), ("*, ", "kwdefaults", {"k": v}))
    ]
    names = "gain: float", "more: float"
    edits += [
        ({"params": "\n    ".join(order)}, [6 * gain, 9 * gain])
        for order, gain in ((names, 2.0), (names[::-1], 7.0))
    ]
    texts = [MODULE.format(**(DEFAULT | edit)) for edit, _ in edits]
    (tmp_path / "texts.json").write_text(json.dumps(texts))
    out, _ = run(["-c", EDITS], cache, tmp_path, cwd=tmp_path)
    assert out.split("\n") == [
        f"{float(one)} {float(two)}" for _, (one, two) in edits for _ in range(2)
    ]


def test_a_script_and_a_notebook_cell_define_blocks(tmp_path, cache):
    """Blocks of ``__main__``, of a cell whose text only linecache knows, and a cell
    that is run again with other text.
    """
    body = MODULE.format(**DEFAULT) + USER.replace("import mine\n", "").replace("mine.", "")
    (tmp_path / "script.py").write_text(body)
    assert run([tmp_path / "script.py"], cache)[0].split() == ["12.0", "18.0"] * 2
    cells = """
import linecache, sys
def cell(text, n):
    name = f"<ipython-input-{n}>"
    linecache.cache[name] = (len(text), None, text.splitlines(True), name)
    exec(compile(text, name, "exec"), globals())
first = open(sys.argv[1]).read()
cell(first, 1)
cell(first.replace("x + 1.0", "x + 2.0"), 2)
cell(first.replace("FACTOR = 3.0", "FACTOR = 4.0"), 3)
"""
    out, _ = run(["-c", cells, tmp_path / "script.py"], cache)
    assert out.split() == ["12.0", "18.0"] * 2 + ["18.0", "24.0"] * 2 + ["16.0", "24.0"] * 2


# of tuples, helper and constant: names that the generated text uses as well
TAKEN = [
    ("P", "S", "at", "n"),
    ("namedtuple", "carray", "block", "C"),
    ("W", "A", "segment", "as_u8"),
    ("GainParams", "GainState", "native", "SEGMENT"),
    ("GainParams", "GainState", "njit", "x0"),
    ("GainParams", "GainState", "y", "FACTOR"),
]
EACH = """
import importlib, sys
import numpy as np
import stimlib
for case in sys.argv[1:]:
    try:
        mine = importlib.import_module(case)
        for target in ("llvm", "python"):
            scene = stimlib.Scene({"y": mine.Gain(stimlib.Input("x"))})
            y = stimlib.compile(scene, 1000, target).process(np.array([[1.0, 2.0]]))
            print(case, target, *y[0])
    except Exception as e:
        print(case, e)
"""


def test_users_choose_their_names_freely(tmp_path, cache):
    """Also where a step and its helper, from two modules, mean two numbers by one."""
    names = "GainParams", "GainState", "helper", "FACTOR"
    texts = {"far": "FACTOR = 7.0\ndef far(x):\n    return x * FACTOR\n"}
    for case, new in enumerate(TAKEN):
        text = MODULE.format(**DEFAULT | {"step": "p.gain * FACTOR * helper(x) + 0.0 * s.last"})
        for name, other in zip(names, new, strict=True):
            text = re.sub(rf"\b{name}\b", other, text)
        texts[f"mine_{case}"] = text
    two = {"top": "from far import far", "step": "p.gain * FACTOR * far(x)"}
    texts["two"] = MODULE.format(**DEFAULT | two)
    texts["lost"] = f"exec({MODULE.format(**DEFAULT)!r}, globals())"
    for name, text in texts.items():
        (tmp_path / f"{name}.py").write_text(text)
    cases = [f"mine_{k}" for k in range(len(TAKEN))]
    out, _ = run(["-c", EACH, *cases, "two", "lost"], cache, tmp_path)
    *said, lost = out.splitlines()
    assert said == [
        f"{case} {target} {'42.0 84.0' if case == 'two' else '12.0 18.0'}"
        for case in [*cases, "two"]
        for target in ("llvm", "python")
    ]
    assert re.search("Gain.step.*source text is not available.*a notebook cell", lost)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="every user has a home here")
def test_a_user_without_a_home_has_a_cache(monkeypatch):
    """As in a container that runs as a number."""
    for name in ("STIMLIB_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", mock.Mock(side_effect=KeyError))
    assert cache_folder.chosen() == Path(tempfile.gettempdir(), f"stimlib-{os.getuid()}")

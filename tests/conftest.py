"""Settings of all tests: examples are the same on every run, and take the time they
take; `make stress` tries more; JACK.
"""

import ast
import ctypes
import functools
import gc
import importlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from importlib.metadata import version
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# or pytest puts modules in place of functions of the same name, such as touch_screen
import stimlib.blocks
import stimlib.plate
import stimlib.scenes
import stimlib.soft  # noqa: F401
from stimlib.system import cache_folder

# a home that cannot be written, as in a container: the cache of a user without a home
try:
    cache_folder.private(cache_folder.chosen())
except OSError:
    os.environ["STIMLIB_CACHE"] = os.path.join(tempfile.gettempdir(), f"stimlib-{os.getuid()}")

# most of the time goes into XLA's and LLVM's work on code that is run but a few times
if not os.environ.get("STIMLIB_STRESS"):
    flags = (
        "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true"
        " --xla_cpu_parallel_codegen_split_count=1"
    )
    if version("jaxlib").split(".")[:2] == ["0", "10"]:  # later ones end at a flag they do not know
        flags += " --xla_cpu_use_fusion_emitters=false"
    os.environ.setdefault("XLA_FLAGS", flags)
EXAMPLES = 100 if os.environ.get("STIMLIB_STRESS") else 40
settings.register_profile(
    "stimlib",
    max_examples=EXAMPLES,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
settings.load_profile("stimlib")


# Servers: those of tests are on this machine, and no proxy of ours leads to them.
known = os.environ.get("no_proxy") or os.environ.get("NO_PROXY")
for name in ("no_proxy", "NO_PROXY"):
    os.environ[name] = f"{known},127.0.0.1,localhost" if known else "127.0.0.1,localhost"

# Pictures: in the style of matplotlib, not of whoever runs the tests.
os.environ["MATPLOTLIBRC"] = os.devnull
os.environ.pop("MPLBACKEND", None)  # such as that of a notebook, which is not here

# Signals: a shell's background jobs and nohup ignore some, and what is started here
# would inherit that and never end.
for number, usual in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGTERM, signal.SIG_DFL),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)


# what Rich, typer, pytest and Python read, on GitHub too
TERMINAL = (
    "COLUMNS LINES TERMINAL_WIDTH NO_COLOR FORCE_COLOR CLICOLOR CLICOLOR_FORCE PY_COLORS"
    " PYTHON_COLORS GITHUB_ACTIONS TTY_COMPATIBLE TTY_INTERACTIVE"
).split()


# Python's collector of garbage is off until a worker has collected its tests: it took a
# fifth of that.  The process that only gathers the workers' reports leaves it off.
gc.disable()


def pytest_sessionstart():
    """No terminal of the surroundings: its colours and width are not in what is
    printed. pytest itself has read them by now.
    """
    for name in TERMINAL:
        os.environ.pop(name, None)


def pytest_collection_finish(session):
    grouped = [item for item in session.items if item.get_closest_marker("xdist_group")]
    if session.config.getoption("loadgroup", False) and not all(
        "@" in item.nodeid for item in grouped
    ):
        raise pytest.UsageError("pytest-xdist groups no tests with this pytest: see pyproject.toml")
    gc.freeze()  # ten thousand tests that no garbage collection need look at: 7 % of the time
    gc.set_threshold(7000)  # of 700, looking at JAX's objects again and again was 5 % of the time
    gc.enable()


def pytest_sessionfinish():
    gc.collect()
    gc.freeze()  # pytest would collect five times more, in each worker: some 10 s


def pytest_runtest_setup(item):
    """The interpreter makes 128 samples of a report again, not up to 512: that was
    half of the time of all tests that verify.
    """
    if (verify := sys.modules.get("stimlib.checks.verification")) and not os.environ.get(
        "STIMLIB_STRESS"
    ):
        verify.STRETCH = 128


# Threads ------------------------------------------------------------------------------
BEGUN: dict[threading.Thread, str] = {}


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """At the end of a file the threads of its sinks have ended; fixtures may keep them
    until then.
    """
    for thread in threading.enumerate():
        if thread.name in ("stimlib sink", "stimlib markers"):
            BEGUN.setdefault(thread, item.nodeid)
    result = yield
    if nextitem is None or nextitem.path != item.path:
        end = time.monotonic() + 60.0  # of all: tests that failed may have left many
        for thread in BEGUN:
            thread.join(max(0.0, end - time.monotonic()))
        left = [f"{thread.name} of {test}" for thread, test in BEGUN.items() if thread.is_alive()]
        BEGUN.clear()
        assert not left, f"a sink was not closed: {left}"
    return result


# Time ---------------------------------------------------------------------------------
def pytest_terminal_summary(terminalreporter):
    """Where the minutes of a long run went: who adds a test sees what it costs all
    others.
    """
    spent: Counter[str] = Counter()
    tests: Counter[str] = Counter()
    for report in (
        r for reports in terminalreporter.stats.values() for r in reports if hasattr(r, "duration")
    ):
        file = report.nodeid.partition("::")[0]
        spent[file] += report.duration
        tests[file] += report.when == "call"
    if (whole := sum(spent.values())) < 120:
        return
    terminalreporter.section("minutes of all workers together")
    for file, seconds in spent.most_common(16):
        terminalreporter.write_line(
            f"{seconds / 60:6.2f} {seconds / whole:6.1%} {tests[file]:5d} tests  {file}"
        )
    terminalreporter.write_line(f"{whole / 60:6.2f} 100.0% {sum(tests.values()):5d} tests")


# A small disk -------------------------------------------------------------------------
@pytest.fixture(scope="module")
def bench(request):
    """The benchmark that BENCH of a module names, imported as its command does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
        yield importlib.import_module(request.module.BENCH)
    del sys.modules[request.module.BENCH], sys.modules["bench"]


@pytest.fixture
def mounted(tmp_path):
    """A file system of its own, of so many bytes."""
    folder = tmp_path / "mounted"

    def mount(options):
        folder.mkdir()
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"{options},mode=700", "none", folder],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            folder.rmdir()
            pytest.skip(f"needs the right to mount: {done.stderr.strip()}")
        return folder

    yield mount
    if folder.exists():
        subprocess.run(["umount", str(folder)], check=True)


# JACK ---------------------------------------------------------------------------------
# JACK's sockets in /dev/shm are named after the client alone: clients of one name that
# open at the same time on two servers of a machine get each other's socket, and both
# servers refuse.  So a run has a /dev/shm of its own where that is permitted, and all
# tests of JACK are done by one worker.
def pytest_configure(config):
    for marker in (
        "jack: needs a JACK server",
        "systems: in an emulation of Windows or macOS",
        "stress: more of what another test tries too; make stress alone",
        "longer: reads STRESS, to try more in make stress; given by conftest.py alone",
    ):
        config.addinivalue_line("markers", marker)


@functools.cache
def longer(path):
    """Return the names at the top of a file that depend on STRESS: what reads it, in
    its body or decorators, and what reads that.  What a helper of another file tries
    more is an argument of it, or has a mark (``mostly``).
    """
    reads: dict[str, set] = {}
    text = path.read_text(encoding="utf-8")
    for node in ast.parse(text if "STRESS" in text else "").body:
        inside = list(ast.walk(node))
        words = {getattr(n, kind, None) for n in inside for kind in ("id", "arg", "attr", "value")}
        sets = [n for n in inside if isinstance(n, ast.Assign | ast.AugAssign | ast.AnnAssign)]
        left = [t for n in sets for t in getattr(n, "targets", None) or [n.target]]
        made = {n.id for t in left for n in ast.walk(t) if isinstance(n, ast.Name)}
        for name in {node.name} if hasattr(node, "name") else made:
            reads.setdefault(name, set()).update(words)
    found, more = set(), {"STRESS", "STIMLIB_STRESS"}
    while more:
        found |= more
        more = {name for name, words in reads.items() if words & found} - found
    return found


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config, items):
    if not os.environ.get("STIMLIB_STRESS"):
        config.hook.pytest_deselected(
            items=[item for item in items if item.get_closest_marker("stress")]
        )
        items[:] = [item for item in items if not item.get_closest_marker("stress")]
    else:
        for item in items:
            if item.nodeid.split("::")[1].partition("[")[0] in longer(item.path):
                item.add_marker("longer")
    if marked := [item for item in items if item.get_closest_marker("jack")]:
        from devices.servers import no_jack

        missing = no_jack()
        for item in marked:
            item.add_marker(pytest.mark.xdist_group("jack"))
            if missing:
                item.add_marker(
                    pytest.mark.skip(
                        reason=f"needs a JACK server: {missing} (tests/devices/install.sh)"
                    )
                )
        if not missing:
            own_shared_memory()
    if not os.environ.get("STIMLIB_STRESS"):
        # each file is done by one worker, which alone pays what it imports and compiles
        for item in items:
            if not item.get_closest_marker("xdist_group"):
                item.add_marker(
                    pytest.mark.xdist_group(item.path.relative_to(config.rootpath).as_posix())
                )
        items[:] = dealt(items)
    if seed := os.environ.get("STIMLIB_ORDER"):
        items[:] = shuffled(items, seed)


WAITING = (
    "jack",
    "tests/devices/test_sinks.py",
    "tests/devices/test_portaudio.py",
    "tests/live/test_asking.py",
    "browser",
)


def dealt(items):
    """First the laws, which compile what many others use; those that wait for real time
    one by one among those that compute.
    """
    units: dict[str, list] = {}
    for item in items:
        units.setdefault(item.get_closest_marker("xdist_group").args[0], []).append(item)
    computing = sorted(
        units.keys() - set(WAITING),
        key=lambda name: (name != "tests/test_laws.py", list(units).index(name)),
    )
    turn = {name: k / len(computing) for k, name in enumerate(computing)} | {
        name: 0.08 * k for k, name in enumerate(WAITING)
    }
    return [item for name in sorted(units, key=turn.__getitem__) for item in units[name]]


def shuffled(items, seed):
    """Files in a random order, and the tests within each; a file stays together, as the
    fixtures of a module need.
    """
    files, chance = {}, random.Random(seed)
    for item in items:
        files.setdefault(item.path, []).append(item)
    return [
        item
        for path in chance.sample(list(files), len(files))
        for item in chance.sample(files[path], len(files[path]))
    ]


def own_shared_memory():
    """An empty /dev/shm and semaphores for this thread and its children; False where
    that is not permitted (as to most users).
    """
    # CLONE_NEWNS | CLONE_NEWIPC, MS_REC | MS_PRIVATE
    new_namespaces, private = 0x00020000 | 0x08000000, 0x4000 | 0x40000
    libc = ctypes.CDLL(None)
    if not hasattr(libc, "unshare") or libc.unshare(new_namespaces):
        return False
    return not (
        libc.mount(b"none", b"/", None, private, None)
        or libc.mount(b"tmpfs", b"/dev/shm", b"tmpfs", 0, None)
    )


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """A JACK server that refuses a client, as may happen where others use JACK too:
    once more with a new one, and told.
    """
    try:
        return (yield)
    except Exception as e:
        if not pyfuncitem.get_closest_marker("jack") or "takes no client" not in str(e):
            raise
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn(
                f"{pyfuncitem.nodeid} was done again with a new server: {e}",
                pytest.PytestWarning,
                stacklevel=2,
            )
        given = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
        if "server" in given:
            given["server"].renew()
        if "tmp_path" in given:
            given["tmp_path"] = given["tmp_path"] / "again"
            given["tmp_path"].mkdir()
        pyfuncitem.obj(**given)
        return True

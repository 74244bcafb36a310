"""What the device tests share: a log that remembers, the reference, and audio servers
on private names.
"""

from __future__ import annotations

import builtins
import fcntl
import os
import shutil
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from waiting import ENDS_TOO, until as until

import stimlib
from stimlib import SinkError, blocks
from stimlib.run.safety import protect, to_device
from stimlib.system import cache_folder


class Seen:
    """A log that keeps what it is told."""

    def __init__(self):
        self.x, self.frames, self.events, self.end = [], [], [], None

    def motion(self, x):
        self.x.append(x)

    def delivered(self, frames):
        self.frames.append(frames)

    def event(self, at, kind, **data):
        self.events.append((at, kind, data))

    def close(self, report):
        self.end = report


def begun(sink, seconds=None, *, fs=8000, channels=None, block=None):
    """Open this sink and start it; the sink, to be closed by ``with``."""
    sink.open(fs, channels, block)
    sink.start(seconds)
    return sink


def played(sink, seconds=None, *, patience=None, **how):
    """Play these seconds with this sink, or wait so long, and close it; the sink."""
    with begun(sink, seconds, **how):
        sink.wait(patience)
    return sink


def textured(outputs=2, scale=1.0):
    """A scene for every sample rate: springs, and noise with the speed of the
    motion.
    """
    forces = {}
    for i in range(1, outputs + 1):
        x = stimlib.Input(f"x{i}", "m")
        noise = blocks.enabled(blocks.pink_noise(1.0, seed=5, stream=i, f_low=10.0), by=x)
        forces[f"force{i}"] = (
            blocks.spring(x, stimlib.Param("k", 2000.0, "N/m"))
            + 5.0 * blocks.velocity(x, 50.0) * stimlib.constant(scale, "N*s/m") * noise
        )
    return stimlib.Scene(forces)


def replayed(scene, safety, x, fs, events=(), channels=None, params=None, seed=0):
    """What a device should have got, from the processor alone: motion as processed
    (n_inputs, n) and the changes told.
    """
    proc = stimlib.compile(protect(scene, safety), fs, seed=seed)
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    proc.process(np.zeros((len(proc.inputs), 0)))
    parts, i = [], 0
    for at, kind, e in events:
        if kind == "set":
            parts.append(proc.process(np.ascontiguousarray(x[:, i:at])))
            i = at
            proc.set(e["name"], e["value"], ramp=e["ramp"] / fs)
    parts.append(proc.process(np.ascontiguousarray(x[:, i:])))
    channels = range(len(proc.outputs)) if channels is None else channels
    return to_device(np.concatenate(parts, axis=1), safety.scales(proc.outputs), channels)


def offline(scene, safety, motion, fs, n, events=(), channels=None, **more):
    """``replayed`` for a motion given as functions of time."""
    t = np.arange(n) / fs
    x = np.stack([motion[name](t) for name in scene.inputs]) if scene.inputs else np.empty((0, n))
    return replayed(scene, safety, x, fs, events, channels, **more)


def kept(events, n):
    """Which of n produced samples were delivered."""
    out = np.ones(n, bool)
    for at, kind, e in events:
        if kind == "lost":
            out[at : at + e["frames"]] = False
    return out


# What real time does to a session is no fault of a fade: a device plays silence for a
# block that it did not get, and a client that records may come late itself.  The sink
# tells its losses with their sample, the recorder has JACK's time of each frame, and
# only steps between frames that neither has lost are judged.  A client that was called
# in time and ended late is known to the server alone: it reports an xrun, and another
# client does not get that block.
def outside(events, kind):
    """Frames before the samples ("rise") or after them ("fall"): of steps of 1/n, which
    test_pump.py hears.
    """
    return next((e["frames"] for _, k, e in events if k == kind), 0)


def largest_step(frames, events):
    """Between delivered frames that follow each other, from silence on; a rise before
    them has led to the first.
    """
    lost = sum(e["frames"] for _, kind, e in events if kind == "lost")
    index = np.flatnonzero(kept(events, len(frames) + lost))
    first = np.abs(frames[0]).max() * (index[0] == 0) / (outside(events, "rise") or 1)
    return max(float(first), _between_neighbours(frames, index)[0])


def _between_neighbours(frames, index):
    """Largest step between frames whose indices follow each other, and the largest
    between the others.
    """
    steps = np.abs(np.diff(frames, axis=0)).max(axis=1, initial=0)
    near = np.diff(index) == 1
    return float(steps[near].max(initial=0)), float(steps[~near].max(initial=0))


def faded(frames, events, fade=160):
    """A steady full scale, as logged, came and went in steps of at most 1 %."""
    there = kept(events, len(frames) + sum(e["frames"] for _, kind, e in events if kind == "lost"))
    assert largest_step(frames, events) <= 0.01
    assert not there[-1] or not frames[-1].any() or outside(events, "fall") == fade
    assert frames.max() == 1.0 or not there[fade:-fade].any()


def captured_fades(frames, index, events, xruns):
    """The same of a capture, by the sample of the session at whose time each frame was;
    False where frames are missing in a fade.

    Such a capture is to be done again.
    """
    there = kept(events, max(int(index[-1]) + 1, 1))
    known = np.where(index >= 0, there[np.maximum(index, 0)], True)
    near, far = _between_neighbours(frames[known], index[known])
    assert near <= 0.01 or xruns
    if max(near, far) > 0.01:
        return False
    assert frames.max() == 1.0 and not frames[-1].any()
    return True


def until_judged(take, takes=8):
    """Do a take again until it can be judged."""
    for _ in range(takes):
        if take():
            return
    unjudged(f"frames were missing in a fade in each of {takes} captures")


def unjudged(why):
    """The end of a test that real time has spoiled again and again: a fault, but where
    far more wants to run than can.
    """
    load = os.getloadavg()[0] / (os.cpu_count() or 1)
    if load > 2.0:
        pytest.skip(
            f"{why}, and {load:.1f} jobs wait for each core: nothing can be judged here now"
        )
    pytest.fail(why)


def without(monkeypatch, package, error):
    """Importing a package fails."""
    real = builtins.__import__

    def none(name, *rest, **more):
        if name == package:
            raise error
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", none)


# JACK ---------------------------------------------------------------------------------
needs_jack = pytest.mark.jack
"""Skip where there is no JACK; see ``conftest.py`` for what else it does.  For a whole
file: ``pytestmark = needs_jack``.
"""


def no_jack():
    """What a JACK server is missing, or None."""
    try:
        import jack  # noqa: F401

        return None if shutil.which("jackd") else "the command jackd"
    except (ImportError, OSError) as e:
        return str(e)


class Jackd:
    """A JACK server without hardware, on a name of its own; ended by its process id.

    JACK knows 8 servers on a machine, and one that was killed keeps its place until
    another of its name comes.  So names are used again, and a lock on a file says which
    are in use: one place for the whole machine, whatever TMPDIR says.  Where another
    program has the process id of a server that was killed, JACK takes that server for
    alive, and its name is left out.
    """

    alive: ClassVar[set[str]] = set()

    def __init__(self, rate=8000, block=64, captures=8, playbacks=24, options=()):
        self._told = (rate, block, captures, playbacks, options)
        self._room()
        self.name, self._lock = self._free_name()
        self.rate, self.block = rate, block
        self._out = tempfile.TemporaryFile("w+")
        text = (
            f"jackd -n {self.name} -r -p 128 {' '.join(options)} -d dummy -r {rate} -p {block} -C"
            f" {captures} -P {playbacks}"
        )
        env = os.environ | {"JACK_NO_AUDIO_RESERVATION": "1"}
        # by the server too: one that outlives a killed test run keeps its name to
        # itself
        held = (self._lock.fileno(),)
        self.process = subprocess.Popen(
            [*ENDS_TOO, *text.split()],
            stdout=self._out,
            stderr=subprocess.STDOUT,
            env=env,
            pass_fds=held,
        )

    @property
    def log(self):
        """What it has said."""
        self._out.seek(0)
        return self._out.read()

    def __enter__(self):
        import jack

        jack.set_error_function(lambda text: None)
        for _ in range(200):
            try:
                jack.Client("probe", no_start_server=True, servername=self.name).close()
                if self.process.poll() is not None:
                    break  # what answers is another's server
                return self
            except jack.JackOpenError:
                if self.process.poll() is not None:
                    break
                time.sleep(0.05)
        said = f"jackd does not start ({self.process.poll()}): {self.log}"
        self.__exit__()
        if "already active" not in said:
            raise RuntimeError(said)
        self.alive.add(self.name)
        self.__init__(*self._told)
        return self.__enter__()

    def __exit__(self, *_):
        _end(self.process)
        self._out.close()
        self._lock.close()

    def renew(self):
        """Another server in its place."""
        self.__exit__()
        self.__init__(*self._told)
        self.__enter__()

    @staticmethod
    def _room(need=48, seconds=20):
        """A server shares some 40 MiB of memory; containers may have few, and are
        killed for want of them.
        """
        end = time.monotonic() + seconds
        while Path("/dev/shm").is_dir():
            free = os.statvfs("/dev/shm").f_bavail * os.statvfs("/dev/shm").f_frsize >> 20
            if free >= need:
                return
            if time.monotonic() > end:
                pytest.skip(
                    f"a JACK server shares 40 MiB of memory, and /dev/shm has only {free} MiB left"
                )
            time.sleep(0.2)

    @staticmethod
    def _free_name():
        folder = Path("/dev/shm" if Path("/dev/shm").is_dir() else "/tmp")
        for _ in range(600):
            for k in range(6):
                name = f"stimlib_test_{os.getuid()}_{k}"  # each user has files of their own
                if name in Jackd.alive:
                    continue
                lock = open(folder / f"{name}.lock", "w")
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return name, lock
                except OSError:
                    lock.close()
            time.sleep(0.1)
        raise RuntimeError("6 JACK servers are in use already")


def Capture(server, channels, size, name="capture"):
    """A second client that records what arrives at its ports ``NAME:in_1`` .."""

    # a server under load may still be busy with the last client of this name
    from stimlib.devices import jack_loopback

    for attempt in range(5):
        try:
            return jack_loopback.Capture(server, channels, size, name)
        except SinkError:
            if attempt == 4:
                raise
            time.sleep(0.5)


def aligned(captured, expected):
    """Captured frames from where the expected begin, cut to their length: both start at
    the first sound.

    An error names the first frame that differs.
    """
    first, start = (int(np.flatnonzero(a.any(axis=1))[0]) for a in (expected, captured))
    got = captured[start - first :][: len(expected)] if start >= first else captured[:0]
    assert got.shape == expected.shape, f"{len(got)} frames of {len(expected)} were captured"
    return got


class Pulse:
    """A PulseAudio server with one null sink, private to a folder; ended by its process
    id.
    """

    def __init__(self, folder):
        run = folder / "run"
        run.mkdir(mode=0o700)
        (folder / "null.pa").write_text(
            "load-module module-native-protocol-unix\nload-module module-null-sink sink_name=null"
            " rate=8000 channels=1 format=float32le\nset-default-sink null\n"
        )
        (folder / "client.conf").write_text("autospawn = no\n")
        self.environment = {
            "STIMLIB_CACHE": str(cache_folder.chosen()),  # not that of the new HOME
            "XDG_RUNTIME_DIR": str(run),
            "HOME": str(folder),
            "JACK_NO_START_SERVER": "1",
            "PULSE_CLIENTCONFIG": str(folder / "client.conf"),  # PULSE_SERVER ends at a space
        }
        self._run = partial(
            subprocess.Popen, env=os.environ | self.environment, stderr=subprocess.DEVNULL
        )
        options = ["--exit-idle-time=-1", "--daemonize=no", "--use-pid-file=no", "--disallow-exit"]
        self._server = self._run(
            [*ENDS_TOO, "pulseaudio", "-n", "-F", str(folder / "null.pa"), *options],
            stdout=subprocess.DEVNULL,
        )

    def __enter__(self):
        for _ in range(100):
            if self._run(["pactl", "info"], stdout=subprocess.DEVNULL).wait(10) == 0:
                return self
            time.sleep(0.05)
        self.__exit__()
        raise RuntimeError("pulseaudio does not start")

    def remove_the_sink(self):
        assert (
            self._run(
                ["pactl", "unload-module", "module-null-sink"], stdout=subprocess.DEVNULL
            ).wait(10)
            == 0
        )

    def __exit__(self, *_):
        _end(self._server)


def _end(process):
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

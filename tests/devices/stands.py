"""Every sink with somebody at its other end: what makes it, and what its device got."""

import os
import sys
import time
import types
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from devices.servers import Jackd, Seen, aligned, needs_jack, offline, textured

import stimlib
from stimlib import blocks
from stimlib.devices import ControlLoop, NidaqSink, NullSink
from stimlib.motion.generators import minimum_jerk
from stimlib.run.safety import Safety
from stimlib.system import cache_folder

FS = 8000
STEADY = stimlib.Scene({"y": stimlib.Param("level", 1.0) * 1})
FAILS = blocks.sqrt(1 - stimlib.constant(2.0, "1/s") * blocks.elapsed())  # after half a second
HAND = {"x1": minimum_jerk(0.02), "x2": minimum_jerk(0.01)}


# NI-DAQ -------------------------------------------------------------------------------
class DaqError(Exception):
    pass


class Task:
    """An output task whose buffer empties at the sample rate, as in NI's documentation:
    a write waits for room, and an empty buffer ends a task that may not repeat.
    """

    made = None

    def __init__(self):
        Task.made, self.written, self.closed, self.began = self, [], False, None
        self.unplugged = False
        self.ao_channels = types.SimpleNamespace(add_ao_voltage_chan=self.channel)
        self.timing = types.SimpleNamespace(cfg_samp_clk_timing=self.clock, samp_clk_rate=0.0)
        self.out_stream = types.SimpleNamespace(regen_mode=None, task=self)

    def channel(self, name, min_val, max_val):
        if name.startswith("Nothing"):
            raise DaqError("Device identifier is invalid.")
        first, _, last = name.partition("ao")[2].partition(":")
        self.number_of_channels = int(last or first) - int(first) + 1
        self.limits = min_val, max_val

    def clock(self, rate, sample_mode, samps_per_chan):
        assert sample_mode == "continuous"
        self.size, self.timing.samp_clk_rate = samps_per_chan, min(rate, 50_000.0)

    def start(self):
        assert self.filled() == self.size
        self.began = time.monotonic()

    def filled(self):
        return sum(y.shape[1] for y in self.written)

    def generated(self):
        if self.began is None:
            return 0
        return int((time.monotonic() - self.began) * self.timing.samp_clk_rate)

    def close(self):
        self.closed = True


class Writer:
    def __init__(self, stream, auto_start):
        self.task = stream.task
        assert stream.regen_mode == "never" and not auto_start

    def write_many_sample(self, y, timeout):
        task, end = self.task, time.monotonic() + timeout
        assert y.dtype == np.float64 and y.flags.c_contiguous and np.abs(y).max() <= task.limits[1]
        if task.unplugged:
            raise DaqError("The generation has stopped to prevent the regeneration of old samples.")
        while task.filled() + y.shape[1] - task.generated() > task.size:
            if time.monotonic() > end:
                raise DaqError("timeout")
            time.sleep(0.001)
        task.written.append(y.copy())


def nidaqmx(monkeypatch):
    """A package nidaqmx with one device; its local system."""
    names = ("nidaqmx", "nidaqmx.constants", "nidaqmx.stream_writers", "nidaqmx.system")
    ni, constants, writers, system = (types.ModuleType(name) for name in names)
    ni.Task, ni.errors = Task, types.SimpleNamespace(DaqError=DaqError)
    constants.AcquisitionType = types.SimpleNamespace(CONTINUOUS="continuous")
    constants.RegenerationMode = types.SimpleNamespace(DONT_ALLOW_REGENERATION="never")
    writers.AnalogMultiChannelWriter = Writer
    device = types.SimpleNamespace(name="Dev1", product_type="USB-6211")
    local = types.SimpleNamespace(devices=[device])
    system.System = types.SimpleNamespace(local=lambda: local)
    for module in (ni, constants, writers, system):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return local


# PortAudio ----------------------------------------------------------------------------
def needs_portaudio():
    try:
        import sounddevice  # noqa: F401

        missing = None
    except (ImportError, OSError) as e:
        missing = str(e)
    if not missing and not Path("/usr/share/alsa/alsa.conf").exists():
        missing = "ALSA's configuration (libasound2-data)"
    return pytest.mark.skipif(
        missing is not None, reason=f"needs PortAudio: {missing} (tests/devices/install.sh)"
    )


def alsa(folder):
    """Environment in which ALSA has a device "stimfile" that writes what it gets into a
    file, without a clock.
    """
    (folder / ".asoundrc").write_text(
        f'pcm.stimfile {{ type file file "{folder / "out.raw"}" format "raw" slave.pcm "null" '
        'hint { show on description "stimfile" } }\n'
    )
    return {
        "STIMLIB_CACHE": str(cache_folder.chosen()),  # not that of the new HOME
        "HOME": str(folder),  # ALSA_CONFIG_PATH ends at a space
        "JACK_DEFAULT_SERVER": "stimlib_none",
    }


@contextmanager
def portaudio(environment):
    """PortAudio in this process, started in this environment."""
    import sounddevice

    kept = dict(os.environ)
    sounddevice._terminate()
    os.environ.update({"JACK_NO_START_SERVER": "1"} | environment)
    try:
        sounddevice._initialize()
        yield sounddevice
    finally:
        sounddevice._terminate()
        os.environ.clear()
        os.environ.update(kept)
        sounddevice._initialize()


def from_file(folder, channels):
    """What "stimfile" got, (n, channels)."""
    frames = np.fromfile(folder / "out.raw", np.float32)
    return frames[: len(frames) // channels * channels].reshape(-1, channels)


# All ----------------------------------------------------------------------------------
class Stand:
    """Makes sinks of one kind; ``heard`` gives what the device got of the last one, as
    parts of full scale, (n, channels), or None where only the log knows; ``skips``: the
    device goes on while a block is late, and its sink tells the pump how much it lost.
    """

    def __init__(self, kind, make, heard=lambda: None, skips=True):
        self.kind, self._make, self.heard, self.skips = kind, make, heard, skips

    def make(self, scene, safety=1.0, **options):
        return self._make(scene, safety, **{"realtime": False} | options)


@contextmanager
def _null(folder, monkeypatch):
    yield Stand("null", NullSink)


@contextmanager
def _loop(folder, monkeypatch):
    written = []

    def make(scene, safety, **options):
        written.clear()
        return ControlLoop(scene, safety, None, written.append, watchdog=10.0, **options)

    yield Stand("control loop", make, lambda: np.concatenate(written, axis=1).T)


@contextmanager
def _nidaq(folder, monkeypatch):
    nidaqmx(monkeypatch)

    def make(scene, safety, **options):
        name = f"Dev1/ao0:{len(scene.outputs) - 1}"
        return NidaqSink(scene, safety, **{"name": name, "volts": 5.0} | options)

    def heard():
        return np.concatenate(Task.made.written, axis=1).T / 5.0

    yield Stand("nidaq", make, heard, skips=False)  # an empty buffer ends the task


@contextmanager
def _jack(folder, monkeypatch):
    from stimlib.devices.jack import JackSink

    names = iter(range(1000))
    with Jackd(FS, 64) as server:
        told = {"server": server.name, "connect": None}

        def make(scene, safety, **options):
            return JackSink(scene, safety, **told | {"name": f"stand{next(names)}"} | options)

        yield Stand("jack", make)


@contextmanager
def _portaudio(folder, monkeypatch):
    from stimlib.devices.portaudio import PortAudioSink

    told, last = {"name": "stimfile", "clocked": False}, []

    def make(scene, safety, **options):
        last[:] = [PortAudioSink(scene, safety, **told | options)]
        return last[0]

    with portaudio(alsa(folder)):
        # a file waits
        yield Stand("portaudio", make, lambda: from_file(folder, last[0].channels), skips=False)


STANDS = [
    pytest.param(_null, id="null"),
    pytest.param(_loop, id="control"),
    pytest.param(_nidaq, id="nidaq"),
    pytest.param(_jack, id="jack", marks=needs_jack),
    pytest.param(_portaudio, id="portaudio", marks=needs_portaudio()),
]


@pytest.fixture(params=STANDS)
def stand(request, tmp_path, monkeypatch):
    """Each kind of sink, with somebody at its other end."""
    with request.param(tmp_path, monkeypatch) as made:
        yield made


def textured_sink(make, channels, **options):
    """A sink of the textured scene with one or two outputs, and its log."""
    scene, log = textured(min(channels, 2)), Seen()
    motion = {name: HAND[name] for name in scene.inputs}
    return make(scene, 50.0, motion=motion, seed=7, log=log, **options), log


def is_exact(frames, s, log, seconds):
    """Captured frames are the offline render, from their first sound on."""
    fs, outputs, safety = s.rate, len(s.scene.outputs), Safety(50.0)
    hands = {name: HAND[name] for name in s.scene.inputs}
    expected = offline(s.scene, safety, hands, fs, round(seconds * fs), log.events, s.map, seed=7)
    got, head = aligned(frames, expected), safety.samples(fs)
    assert np.array_equal(got, expected)
    plain = (stimlib.render(s.scene, hands, fs, seconds, seed=7).y / 50.0).astype(np.float32).T
    assert np.array_equal(got[head:-head, :outputs], plain[head:-head])
    assert np.abs(plain).max() > 0.3

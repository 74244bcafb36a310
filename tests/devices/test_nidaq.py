"""The calls of the NI-DAQ sink, against a stand-in that does what nidaqmx documents."""

import sys
import threading
import time
import types

import numpy as np
import pytest
from devices.servers import begun

from stimlib import BadValue, Scene, SinkError, constant
from stimlib.devices import NidaqSink, devices

STEADY = Scene({"force": constant(2.0, "N")})


class DaqError(Exception):
    pass


class Task:
    """An output task whose buffer empties at the sample rate, as in NI's documentation:
    a write waits for room, and an empty buffer ends a task that may not repeat.
    """

    made = None

    def __init__(self):
        Task.made, self.written, self.closed, self.began = self, [], False, None
        self.lock, self.unplugged = threading.Lock(), False
        self.ao_channels = types.SimpleNamespace(add_ao_voltage_chan=self.channel)
        self.timing = types.SimpleNamespace(cfg_samp_clk_timing=self.clock, samp_clk_rate=0.0)
        self.out_stream = types.SimpleNamespace(regen_mode=None, task=self)

    def channel(self, name, min_val, max_val):
        if name.startswith("Nothing"):
            raise DaqError("Device identifier is invalid.")
        first, _, last = name.partition("ao")[2].partition(":")
        self.number_of_channels, self.limits = (
            int(last or first) - int(first) + 1,
            (min_val, max_val),
        )

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
        if task.unplugged or (task.began and task.generated() > task.filled() + 2000):
            raise DaqError("The generation has stopped to prevent the regeneration of old samples.")
        while task.filled() + y.shape[1] - task.generated() > task.size:
            if time.monotonic() > end:
                raise DaqError("timeout")
            time.sleep(0.001)
        task.written.append(y.copy())


@pytest.fixture(autouse=True)
def nidaqmx(monkeypatch):
    ni = types.ModuleType("nidaqmx")
    ni.Task, ni.errors = Task, types.SimpleNamespace(DaqError=DaqError)
    constants, writers, system = (
        types.ModuleType(f"nidaqmx.{name}") for name in ("constants", "stream_writers", "system")
    )
    constants.AcquisitionType = types.SimpleNamespace(CONTINUOUS="continuous")
    constants.RegenerationMode = types.SimpleNamespace(DONT_ALLOW_REGENERATION="never")
    writers.AnalogMultiChannelWriter = Writer
    local = types.SimpleNamespace(
        devices=[types.SimpleNamespace(name="Dev1", product_type="USB-6211")]
    )
    system.System = types.SimpleNamespace(local=lambda: local)
    for module in (ni, constants, writers, system):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return local


def test_the_samples_leave_as_volts_in_order():
    sink = NidaqSink(STEADY, 4.0, name="Dev1/ao0:1", volts=5.0, realtime=False)
    with begun(sink, 0.3, fs=2000, channels=["force", None], block=20):
        sink.wait()
    y, task = np.concatenate(Task.made.written, axis=1), Task.made
    assert task.limits == (-5.0, 5.0) and task.closed and task.size == 80
    assert (y[1] == 0).all() and y[0].max() == 2.5  # 2 N of 4 N, at 5 V
    steady = np.flatnonzero(y[0] == 2.5)
    assert (np.diff(steady) == 1).all() and 600 <= len(steady) <= 602
    assert np.abs(np.diff(y[0])).max() < 0.05 and y[0, 0] == y[0, -1] == 0
    assert (sink.report().lost, sink.report().latency) == (0, 0.04)


def test_a_device_that_stops_is_told():
    sink = NidaqSink(STEADY, 4.0, realtime=False)
    with begun(sink, 5.0, fs=2000):
        time.sleep(0.2)
        Task.made.unplugged = True
        with pytest.raises(SinkError, match="nidaq: the device ended: The generation has stopped"):
            sink.wait(3.0)
        sink.error = None
    assert Task.made.closed


@pytest.mark.parametrize(
    ("how", "fs", "says"),
    [
        ({"name": "Nothing/ao0"}, 2000, "Nothing/ao0 cannot be opened: Device identifier"),
        ({"name": "Dev1/ao0:1"}, 2000, "has 2 outputs, not 1"),
        ({}, 100_000, "plays at 50000 Hz, not 100000 Hz"),
    ],
)
def test_what_the_device_does_not_have_is_refused(how, fs, says):
    with pytest.raises(SinkError, match=says):
        NidaqSink(STEADY, 4.0, realtime=False, **how).open(fs)
    assert Task.made.closed


def test_volts_are_what_a_device_has():
    with pytest.raises(BadValue, match="volts = 11 must be above 0, at most 10"):
        NidaqSink(STEADY, 4.0, volts=11)


def test_devices_lists_it_or_says_what_is_missing(monkeypatch, nidaqmx):
    def row():
        return next(d for d in devices("stimlib_none") if d.sink == "nidaq")

    assert (row().ready, row().what, row().how) == (
        True,
        "Dev1 (USB-6211)",
        "--sink nidaq --device Dev1/ao0",
    )
    nidaqmx.devices.clear()
    assert (row().ready, row().what) == (False, "NI-DAQmx finds no device")
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    assert not row().ready and "install NI-DAQmx" in row().how


def test_blocks_are_10_ms_by_default_and_volts_above_0():
    sink = NidaqSink(STEADY, 4.0, realtime=False)
    with begun(sink, 0.1, fs=2000):
        sink.wait()
    assert sink.block == 20 and {y.shape for y in Task.made.written} == {(1, 20)}
    for volts in (0.0, -1.0, 10.5):
        with pytest.raises(BadValue, match="volts"):
            NidaqSink(STEADY, 4.0, volts=volts)
    assert NidaqSink(STEADY, 4.0, volts=10.0).volts == 10.0

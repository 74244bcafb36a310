"""A sink for the analogue outputs of National Instruments devices, over nidaqmx.

It has not been tried on hardware: the calls are tested against a mock that follows the
package's documentation.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from ..errors import BadValue, SinkError, counted, said_as
from .drivers import nidaqmx
from .sink import Sink

AHEAD = 4  # blocks in the device's buffer


class NidaqSink(Sink):
    """A sink for the analogue outputs of a National Instruments device.

    Parameters
    ----------
    scene, safety, **options
        See ``Sink``.  ``block`` of ``open`` is the number of samples that are written
        at once, by default 10 ms of them and at most 50 ms; four blocks lie in the
        device's buffer.
    name : str
        Outputs as NI-DAQmx names them, such as ``"Dev1/ao0"`` or ``"Dev1/ao0:1"``, one
        for each channel.
    volts : float
        Voltage at 1.0, at most the device's largest.

    Notes
    -----
    The samples are paced by the device's own clock and never repeated.  Where a block
    comes too late the driver ends the task, and the session ends with a ``SinkError``:
    the outputs stay at the last voltage until the device is reset, so give the
    amplifier an enable line that falls with the program.

    Not tried on hardware.

    Examples
    --------
    ``NidaqSink(scene, 5.0, name="Dev1/ao0:1", volts=5.0)``
    """

    device = "nidaq"
    queue = AHEAD + 1

    def __init__(
        self, scene, safety=None, *, name: str = "Dev1/ao0", volts: float = 10.0, **options: Any
    ):
        if not 0 < volts <= 10:
            raise BadValue(f"NidaqSink: volts = {volts} must be above 0, at most 10")
        super().__init__(scene, safety, **options)
        self.name, self.volts = name, volts

    def _open(self) -> None:
        ni = nidaqmx()
        constants, writers = (
            import_module(f"nidaqmx.{part}") for part in ("constants", "stream_writers")
        )
        self.block = n = self.block or max(1, round(0.01 * self.rate))
        self._frames = self.make_frames()
        with said_as(SinkError, f"nidaq: {self.name} cannot be opened", ni.errors.DaqError):
            self._task = task = ni.Task()
            task.ao_channels.add_ao_voltage_chan(self.name, min_val=-self.volts, max_val=self.volts)
            task.timing.cfg_samp_clk_timing(
                self.rate,
                sample_mode=constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=AHEAD * n,
            )
            task.out_stream.regen_mode = constants.RegenerationMode.DONT_ALLOW_REGENERATION
            if task.number_of_channels != self.channels:
                raise SinkError(
                    f"nidaq: {self.name} has {counted(task.number_of_channels, 'output')}, not"
                    f" {self.channels}"
                )
            if abs(task.timing.samp_clk_rate / self.rate - 1) > 1e-6:
                raise SinkError(
                    f"nidaq: {self.name} plays at {task.timing.samp_clk_rate:g} Hz, not"
                    f" {self.rate:g} Hz"
                )
            self._writer = writers.AnalogMultiChannelWriter(task.out_stream, auto_start=False)
            for _ in range(AHEAD):
                self._writer.write_many_sample(np.zeros((self.channels, n)), timeout=1.0)
            task.start()
        self.start_loop(self._loop)

    def _loop(self) -> None:
        try:
            while not self.closing:
                self.pump.block(self.block or 1)
                # it waits for room in the buffer
                self._writer.write_many_sample(self.volts * self._frames.astype(float), timeout=1.0)
        except Exception as e:
            self.device_lost(f"the device ended: {e}. No fade-out was possible")

    def _close(self) -> None:
        super()._close()
        if task := getattr(self, "_task", None):
            task.close()

    def _latency(self) -> float:
        return AHEAD * (self.block or 0) / self.rate

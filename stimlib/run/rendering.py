"""Offline use of a processor: a scene driven by a motion."""

from __future__ import annotations

import json
import os
import warnings
import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ..above import above
from ..core.program import Program, program_of, rate, warn_beyond
from ..core.scene import Scene
from ..errors import BadValue, Count, FaultError, need, outside, public
from ..motion.source import Motion, frames_of, sources_of, warn_fast
from ..system.limits import limits
from ..system.packages import package
from .arguments import explain
from .driver import rows_of, samples, walk
from .processor import Processor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LEFT = 8
LARGEST_LEFT = 2**16  # words of a state: a processor also has those of its last seeds
_LEFT: dict[Any, tuple[Any, Any, Any]] = {}  # by scene, rate and target; see _leave


def fault_text(name: str, at: int, fs: float, then: str) -> str:
    """Return the message about a fault: what happened, its effect, where to look."""
    remedy = "look for a division by 0, a root or logarithm below 0, or a loop of gains that grows"
    return f"output {name} was not finite at sample {at} ({at / fs:g} s): {then}; {remedy}"


@public
def stream(
    scene: Scene | Processor,
    motion: Motion | None = None,
    fs: float | None = None,
    seconds: float | None = None,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    target: str = "llvm",
    on_fault: Literal["warn", "raise", "ignore"] = "warn",
    block: Count = 8192,
) -> Iterator[np.ndarray]:
    """Drive a scene with a motion, block after block, in constant memory.

    Parameters
    ----------
    scene : Scene or Processor
        A processor goes on from where it is, with its own rate, parameters, seed and
        target; time 0 of the motion is its next sample.
    motion : dict of str to callable or ndarray, optional
        For every input a pure function of time (array of s -> array in the input's
        unit) or float64 samples at fs. A scene without inputs needs none.
    fs, seconds, params, seed, target, on_fault
        As for ``render``; what becomes of a fault comes with the last block.
    block : int
        Samples per block; the samples do not depend on it.

    Yields
    ------
    ndarray, shape (n_outputs, n)
        Yours to keep.  ``stimlib.run.driver.walk`` gives the same samples in one array
        that it uses again.

    Warns
    -----
    RuntimeWarning
        As ``render``.

    Raises
    ------
    BadValue, UnknownName
        Inputs missing or surplus, too short, or endless; fs missing, or given for a
        processor, which has one.
    FaultError
        As ``render``.

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x")})
    >>> parts = list(stimlib.stream(scene, {"x": np.arange(100.0)}, fs=1000, block=30))
    >>> np.array_equal(np.hstack(parts)[0], 2 * np.arange(100.0))
    True
    """
    if not isinstance(scene, Processor):
        proc = _driven(scene, fs, params, seed, target, on_fault)
    elif fs is None and not params and not seed:
        proc = scene
    else:
        raise BadValue(
            "stream: a Processor has its own fs, params and seed: give a Scene with them, or the"
            " Processor without"
        )
    frames, sources = _plan(proc, motion, seconds)
    warn_beyond(proc.program, proc.fs, frames)
    warn_fast(sources, proc.scene, frames / proc.fs, proc.fs)

    def parts() -> Iterator[np.ndarray]:
        for _, y in walk(proc, rows_of(sources, proc.fs), frames, block=block):
            yield y.copy()
        _tell(proc.fault, proc.fs, on_fault)

    return parts()


def _driven(
    scene: Any,
    fs: float | None,
    params: Mapping[str, float] | None,
    seed: int,
    target: str,
    on_fault: str,
) -> Processor:
    """Return a processor at sample 0, with its parameters set."""
    _, proc, code = _LEFT.pop((id(scene), rate(fs), repr(target)), (None, None, None))
    if proc is None or proc.program is not program_of(scene) or code != _code(proc.program):
        # which says what is wrong with fs
        proc = Processor(scene, fs, target, seed)  # type: ignore[arg-type]
    else:
        proc.scene = scene
        proc.reset(seed)
    if not isinstance(params, Mapping | None):
        raise BadValue(
            f"params must map names of parameters to values, got {type(params).__name__}"
        )
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    return proc


def _code(program: Program) -> list[Any]:
    """Return the functions that a processor is made from, and their code.

    An editor that reloads, or a notebook, may exchange either in a class.
    """
    blocks = [q.block for q in program.instances]
    found = [f for b in blocks for f in (type(b).design, b.definition.step, b.definition.tile) if f]
    return [(f, f.__code__) for f in found]


def _leave(proc: Processor) -> None:
    """Leave a processor to the next render of its scene, while the scene exists.

    Not one that is large, or of an author's blocks, which may call what is exchanged.
    """
    if proc._changes or proc._size > LARGEST_LEFT:
        return
    key = id(proc.scene), proc.fs, repr(proc.target)
    gone = weakref.ref(proc.scene, lambda _: _LEFT.pop(key, None))
    proc.scene = None  # type: ignore[assignment]  # or the scene would never end
    _LEFT[key] = gone, proc, _code(proc.program)
    for oldest in list(_LEFT)[:-MOST_LEFT]:
        _LEFT.pop(oldest, None)


def _tell(fault: tuple[str, int] | None, fs: float, on_fault: str) -> None:
    if fault is None or on_fault == "ignore":
        return
    text = fault_text(*fault, fs, "from there on it is not the scene's but a fade to 0")
    if on_fault == "raise":
        raise FaultError(text)
    warnings.warn(text, RuntimeWarning, stacklevel=outside())


def _plan(
    proc: Processor, motion: Motion | None, seconds: float | None
) -> tuple[int, dict[str, Any]]:
    """Return the number of samples and the checked motion.

    By default the length is that of the shortest recording.
    """
    sources = sources_of(motion, proc.inputs, 0)
    if seconds is not None:
        frames = frames_of(seconds, proc.fs)
        return frames, sources_of(sources, proc.inputs, frames)
    lengths = [len(s) for s in sources.values() if not callable(s)]
    if not lengths:
        what = "motion given as functions of time" if sources else "a scene without inputs"
        raise BadValue(f"{what} has no end; give the number of seconds to render")
    return min(lengths), sources


@dataclass(frozen=True, eq=False)
class Rendering:
    """The samples of a scene, with everything needed to compute them again."""

    scene: Scene
    fs: float
    seed: int
    params: dict[str, float]
    y: np.ndarray
    """Samples, shape (n_outputs, n), in the outputs' units."""
    outputs: tuple[str, ...]
    fault: tuple[str, int] | None = None
    """Output and sample of the first value that was not finite."""
    motion: dict[str, Any] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        need("rendering", [name], self.outputs, "output")
        return self.y[self.outputs.index(name)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        y = np.asarray(self.y, dtype)
        return y.copy() if copy else y

    @property
    def t(self) -> np.ndarray:
        """Time of each sample in s."""
        return np.arange(self.y.shape[1]) / self.fs

    def __repr__(self):
        fault = "" if self.fault is None else ", FAULT: {} from sample {} on".format(*self.fault)
        return (
            f"Rendering({', '.join(self.outputs)}: {self.y.shape[1] / self.fs:g} s at {self.fs:g}"
            f" Hz{fault})"
        )

    # Looking at it, and taking it elsewhere -------------------------------------------
    def _repr_html_(self) -> str:
        return above("Rendering._repr_html_")(self)

    def plot(self) -> Figure:
        """Plot each signal over time, and each output in detail.

        The details are a close-up of its vibration, its course over position, and its
        spectrum.

        Returns
        -------
        matplotlib.figure.Figure
            Yours to change and to save.  A notebook shows it once pyplot was imported,
            and the rendering itself always.

        Examples
        --------
        >>> import numpy as np, stimlib
        >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
        >>> fig = stimlib.render(scene, {"x": np.arange(100.0)}, fs=1000).plot()
        >>> fig.axes[0].get_ylabel()
        'x'
        """
        return above("Rendering.plot")(self)

    def save(self, path: str | os.PathLike[str], **options: Any) -> Any:
        """Save the samples to a sound file, with a sidecar to reproduce it.

        Parameters
        ----------
        path : path
            .wav, .rf64, .w64, .caf or .flac; the sidecar is ``path`` + ".json".
        **options
            format, subtype, full_scale, progress and overwrite of
            ``stimlib.files.audio.write``.

        Returns
        -------
        stimlib.files.sidecar.FileReport

        Raises
        ------
        BadValue, UnitError, SinkError
            As ``stimlib.files.audio.write``.
        FaultError
            An output was not finite; no file is written.

        Examples
        --------
        >>> import numpy as np, stimlib, tempfile
        >>> scene = stimlib.Scene({"y": 2 * stimlib.Input("x", "m")})
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     stimlib.render(scene, {"x": np.arange(100.0)}, fs=1000).save(
        ...         folder + "/y.wav"
        ...     ).peak
        {'y': 198.0}
        """
        return above("Rendering.save")(path, self, **options)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each output."""
        return {name: str(block.dim) for name, block in self.scene.outputs.items()}

    def to_xarray(self) -> Any:
        """Return the outputs as a Dataset over time, with units; needs xarray.

        Returns
        -------
        xarray.Dataset
            A copy of each output, shape (n,), over ``time`` in s; attributes say the
            unit, fs in Hz, seed, parameters (as JSON) and the scene's hash.

        Raises
        ------
        MissingPackage
            xarray is not installed.

        Examples
        --------
        ``stimlib.render(scene, motion,
        fs=8000).to_xarray()["force"].sel(time=slice(0.1, 0.2)).plot()``
        """
        xarray = package("xarray", "to_xarray")
        outputs = {
            name: ("time", self[name].copy(), {"units": self.units[name]}) for name in self.outputs
        }
        facts = {
            "fs": self.fs,
            "seed": str(self.seed),
            "params": json.dumps(self.params),
            "scene_hash": self.scene.hash,
        }
        return xarray.Dataset(outputs, {"time": ("time", self.t, {"units": "s"})}, facts)

    def to_pandas(self) -> Any:
        """Return the outputs as a DataFrame over time; needs pandas.

        Returns
        -------
        pandas.DataFrame
            A copy: one column per output, in its unit, over the index ``time`` in s;
            ``attrs["units"]`` says the units.

        Raises
        ------
        MissingPackage
            pandas is not installed.

        Examples
        --------
        ``stimlib.render(scene, motion, fs=8000).to_pandas().to_csv("force.csv")``
        """
        pandas = package("pandas", "to_pandas")
        columns = {name: self[name].copy() for name in self.outputs}
        frame = pandas.DataFrame(columns, index=pandas.Index(self.t, name="time"))
        frame.attrs["units"] = self.units
        return frame

    def play(self, **options: Any) -> Any:
        """Play all samples on a device.

        Parameters
        ----------
        **options
            sink, full_scale, channels and others of ``stimlib.devices.play``.

        Returns
        -------
        stimlib.devices.session.SessionReport

        Raises
        ------
        BadValue, SinkError
            As ``stimlib.devices.play``.

        Examples
        --------
        ``stimlib.render(tone(), fs=48000, seconds=1.0).play()``
        """
        return above("Rendering.play")(self, **options)

    def felt(self, output: str | None = None, **device: Any) -> Any:
        """Return how far an output's vibration is above the threshold of detection.

        Parameters
        ----------
        output : str, optional
            By default the first.
        **device
            ``unit``, ``area``, ``mass`` and ``gain`` of
            ``stimlib.analysis.sensation_level``; `squeeze`, `bumps` and `texture` have
            defaults.

        Returns
        -------
        stimlib.analysis.Felt
            Levels in dB SL.

        Raises
        ------
        UnknownName
            No such output.
        UnitError, BadValue
            As ``stimlib.analysis.sensation_level``.

        Examples
        --------
        The vibration of a squeeze on plates of 0.1 kg, and of 10 g:

        >>> import stimlib
        >>> from stimlib.motion import minimum_jerk
        >>> squeezed = stimlib.render(
        ...     stimlib.scenes.squeeze(fingers=1),
        ...     {"x1": minimum_jerk()},
        ...     fs=8000,
        ...     seconds=1.0,
        ... )
        >>> for mass in (0.1, 0.01):
        ...     print(f"{squeezed.felt(mass=mass).pacinian:.0f} dB SL")
        10 dB SL
        30 dB SL
        """
        return above("Rendering.felt")(self, output, **device)

    def audio(self, output: str | None = None) -> Any:
        """Return an output as a player for a notebook; needs IPython.

        It is scaled so that its largest sample is full scale.

        Parameters
        ----------
        output : str, optional
            By default the first.

        Returns
        -------
        IPython.display.Audio

        Raises
        ------
        UnknownName
            No such output.
        MissingPackage
            IPython is not installed.

        Examples
        --------
        ``stimlib.render(scene, motion, fs=8000).audio("force")``
        """
        y = self[self.outputs[0] if output is None else output]
        display = package("IPython.display", "audio")
        return display.Audio(y / (np.abs(y).max() or 1.0), rate=round(self.fs), normalize=False)


@public
def render(
    scene: Scene,
    motion: Motion | None = None,
    fs: float | None = None,
    seconds: float | None = None,
    params: Mapping[str, float] | None = None,
    seed: int = 0,
    target: str = "llvm",
    on_fault: Literal["warn", "raise", "ignore"] = "warn",
    out: np.ndarray | None = None,
) -> Rendering:
    """Drive a scene with a motion and keep the samples.

    Parameters
    ----------
    scene : Scene
    motion : dict of str to callable or ndarray, optional
        For every input a pure function of time (array of s -> array in the input's
        unit) or float64 samples at fs. A scene without inputs needs none.
    fs : float
        Sample rate in Hz.
    seconds : float, optional
        Length; by default that of the shortest array.
    params : dict of str to float, optional
        Parameters that differ from the scene's, from the first sample on (no ramp).
    seed : int
        Key of all noise.
    target : {"llvm", "python"}
    on_fault : {"warn", "raise", "ignore"}
        What happens where an output was not finite; ``Rendering.fault`` then names it.
    out : ndarray, shape (n_outputs, n), float64, C-contiguous, optional
        Written, and kept in ``Rendering.y``.  With an array in a file, such as one of
        ``numpy.lib.format.open_memmap``, hours need no more memory than seconds.

    Returns
    -------
    Rendering

    Warns
    -----
    RuntimeWarning
        An output was not finite: from that sample on it fades out.  The run is longer
        than the horizon of a springpot. A generator or an array moves an input in m at
        more than 1 m/s: its depth is probably in mm, or the array was recorded at
        another rate than fs.

    Raises
    ------
    BadValue, UnknownName
        As ``compile``, ``stream`` and ``Processor.set``; an ``out`` of another shape or
        type, or in the memory of the motion; more samples than
        ``stimlib.limits.render_bytes`` (``stream``, files and ``out`` have no such
        limit).
    FaultError
        An output was not finite, and ``on_fault`` is "raise".

    Examples
    --------
    >>> import numpy as np, stimlib
    >>> scene = stimlib.Scene(
    ...     {"force": stimlib.Param("k", 2000.0, "N/m") * stimlib.Input("x", "m")}
    ... )
    >>> stimlib.render(
    ...     scene, {"x": np.array([0.0, 0.01])}, fs=8000, params={"k": 1000.0}
    ... )["force"]
    array([ 0., 10.])
    """
    proc = _driven(scene, fs, params, seed, target, on_fault)
    frames, sources = _plan(proc, motion, seconds)
    if out is None:
        size = 8 * frames * len(proc.outputs)
        limits.check("render_bytes", size, f"render: bytes of {frames / proc.fs:g} s")
    else:
        explain("out", out, proc.outputs, (len(proc.outputs), frames))
        for name, source in sources.items():
            if not callable(source) and np.may_share_memory(out, source):
                raise BadValue(
                    f"out shares memory with the motion of {name}, which it would write over: use"
                    " another array"
                )
    warn_beyond(proc.program, proc.fs, frames)
    warn_fast(sources, scene, frames / proc.fs, proc.fs)
    y = samples(proc, rows_of(sources, proc.fs), frames, out=out)
    _tell(proc.fault, proc.fs, on_fault)
    params, motion = dict(proc.params), dict(motion or {})
    made = Rendering(scene, proc.fs, proc.seed, params, y, proc.outputs, proc.fault, motion)
    _leave(proc)
    return made

"""A live scene with its sessions and its connected pages."""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.graph import reach
from ..core.parameter import Param
from ..core.scene import Scene
from ..devices.sink import Sink
from ..devices.sources import Live
from ..errors import BadValue, SinkError, StimlibError, counted, need
from ..run.processor import compile
from ..run.safety import Safety, protect
from ..system.safe_files import unused
from .describe import Range, description, full_scales, ranges_of
from .inputs import DELAY, SMOOTH, Inputs
from .protocol import GRACE, HEAD, MESSAGE, PAGES, REPORTS, VERSION, message, samples
from .sink import PageSink
from .site import Page

logger = logging.getLogger(__name__)
CONTROLLING = "the page that had control"
RAMP = 0.02
"""Duration in s of a slider's change."""


class Version(NamedTuple):
    """A scene as a page shows it, ready to be played."""

    scene: Scene
    ranges: dict[str, Range]
    safety: Safety
    given: dict[str, Any]
    hello: dict[str, Any]  # what of the first message the scene makes
    smoothing: Any


class Stream:
    """A live scene that pages can start, drive, record and listen to.

    A session is one ``PageSink``, from ``start`` to ``stop``.  It runs in threads of
    its own; this object belongs to the event loop, and slow tasks (compiling, fading
    out, finishing a log) run in other threads.  One page has control: the first, or the
    one that takes control.  When it disconnects, the session fades out: at once if the
    page was silent, else unless the same page is back, or another takes control, within
    2 s. Meanwhile the fingers stay where they were.

    Parameters
    ----------
    scene : Scene
    fs : float
        Hz.
    safety : Safety, float, callable or None
        As for a sink; None uses ``full_scales``. A function makes it of a scene and its
        ranges, also for each scene that follows.
    title : str
    ranges : mapping of str to (low, high), optional
        See ``ranges_of``.
    given : mapping, optional
        Motions of inputs, see ``Inputs``.
    block : int, optional
        Samples made at once; by default 4 ms.
    params : mapping of str to float, optional
        Parameters that differ from the scene's.
    seed : int
    folder : path
        Folder for recordings, each of which is a log in a folder of its own.
    bandwidth : float
        Bandwidth of the smoothing of pointer motion, in Hz.
    stream : callable, optional
        Receiver of rows from another program or device, which the page offers as a
        source; see ``Inputs``.
    markers, send
        As for a sink; the page then has a button that sets a marker.

    Raises
    ------
    UnknownName, BadValue
        Names or numbers that do not fit the scene.
    """

    def __init__(
        self,
        scene: Scene,
        fs: float = 8000.0,
        safety: Safety | float | Callable[..., Safety] | None = None,
        *,
        title: str = "",
        ranges: Mapping[str, Range] | None = None,
        given: Mapping[str, Any] | None = None,
        block: int | None = None,
        params: Mapping[str, float] | None = None,
        seed: int = 0,
        folder: str | Path = ".",
        bandwidth: float = SMOOTH,
        stream: Any = None,
        markers: Sequence[str] = (),
        send: Sequence[Any] = (),
    ):
        self.fs, self.seed, self.folder = float(fs), seed, Path(folder)
        self.block = max(1, round(0.004 * self.fs)) if block is None else block
        self._made_by = safety, dict(ranges or {}), dict(given or {})
        self.safety: Safety | None = None
        self.inputs = Inputs(
            scene, self.fs, ranges_of(scene, ranges), given, bandwidth, stream=stream
        )
        self._marking: dict[str, Any] = {"markers": tuple(markers), "send": tuple(send)}
        self.hello: dict[str, Any] = {
            "version": VERSION,
            "title": title,
            "fs": self.fs,
            "block": self.block,
            "behind": [DELAY, 1 / (math.pi * bandwidth)],
            "stream": stream is not None,
            "marks": bool(send),
        }
        self._loop: Any = None  # of the server
        self.pages: list[Page] = []
        self.params: dict[str, float] = {}
        self._sets: dict[str, float] = {}  # for the next block
        made = self._version(scene, self._made_by[1])
        self._become(made, {n: p.value for n, p in scene.params.items()})
        for name, value in (params or {}).items():
            self.set(name, value)
        self.title, self.index, self.message = title or repr(scene), "index.html", message
        self.most, self.longest = PAGES, MESSAGE
        self.control: Page | None = None
        self.session, self.phase, self.why, self.recorded = 0, "idle", "", ""
        self.log: Path | None = None
        self.say: Callable[[str], None] = logger.info  # told of recordings
        self._sink: Sink | None = None  # the newest session
        self._root: PageSink | None = None  # the one that has the page
        self._asked: tuple[str, str] | None = None  # start, record or stop; why
        # the page that had control: its fingers leave when the session has faded out,
        # or they would end it
        self._left = False
        self._expects = False  # that a page comes which has control
        # the page with control that is gone, and the one that `why` tells of
        self._closed = self._lost = ""
        self._next: Any = None  # a page that came while control was kept for another
        self._kept = ""  # for the page of this name control is kept, until
        self._until: asyncio.TimerHandle | None = None
        self._wake = asyncio.Event()
        self._hands = ThreadPoolExecutor(1, "stimlib live")

    def _version(self, scene: Scene, ranges: Mapping[str, Range]) -> Version:
        """Return a scene with all that a page needs to know of it."""
        made_by, _, given = self._made_by
        found = ranges_of(scene, ranges)
        if made_by is None:
            safety = Safety(full_scales(scene, self.fs, found))
        elif callable(made_by):
            safety = made_by(scene, found)
        else:
            safety = made_by if isinstance(made_by, Safety) else Safety(made_by)
        if self.safety is not None and isinstance(safety.full_scale, Mapping):
            safety = replace(safety, full_scale=self._scales(scene, safety.full_scale))
        full = dict(zip(scene.outputs, safety.scales(tuple(scene.outputs)).tolist(), strict=True))
        given = {n: motion for n, motion in given.items() if n in scene.inputs}
        hello = description(scene, found, full, given, self.fs)
        return Version(scene, found, safety, given, hello, self.inputs.smoothing(scene))

    def _scales(self, scene: Scene, full: Mapping[str, float]) -> dict[str, float]:
        """Return full scales at least as large as now: what is weaker sounds weaker."""
        now = {(o["name"], o["unit"]): o["full"] for o in self.hello["outputs"]}
        units = {n: str(b.dim) for n, b in scene.outputs.items()}
        return {n: max(v, now.get((n, units.get(n, "")), v)) for n, v in full.items()}

    def _values(self, made: Version) -> dict[str, float]:
        """Return the parameters of a version: sliders that were moved stay there."""
        params = {n: p.value for n, p in made.scene.params.items()}
        for name in params.keys() & self.params.keys():
            low, high = made.ranges[name]
            if (value := self.params[name]) == self.scene.params[name].value:
                continue
            if low <= value <= high:
                params[name] = value
            else:
                now = f"its range is now {low:g} to {high:g}, its value {params[name]:g}"
                self.say(f"{name} = {value:g} is not kept: {now}; --range {name}=LOW:HIGH sets it")
        return params

    def _become(self, made: Version, params: dict[str, float]) -> None:
        """Let a version be what the pages show, from the next samples on."""
        self.params = params
        self.scene, self.ranges, self.safety = made.scene, made.ranges, made.safety
        self.hello = self.hello | made.hello
        self._soon(self._greet)

    def reload(self, scene: Scene) -> str:
        """Let another scene take the place of this one, within a running session too.

        The positions and the sources of inputs and the values of parameters go on by
        name.  A session is crossfaded; where its outputs or their full scales are
        others, it fades out and a new one fades in.  A recording goes on in a folder of
        its own.  It may be called from any thread but the server's.

        Returns
        -------
        str
            What has become of it, in words.

        Raises
        ------
        StimlibError
            The scene cannot be compiled or described; the one before plays on. The page
            has ended.
        """
        for b in reach(scene.outputs.values()):  # first, so that the parameter is named
            if isinstance(b.frequency, Param):
                b.check_rate(b.frequency.value, self.fs, f"{b.frequency.name}: ")
        names = {*scene.inputs, *scene.params}
        made = self._version(scene, {n: r for n, r in self._made_by[1].items() if n in names})
        compile(protect(scene, made.safety), self.fs)  # so that what follows is quick
        try:
            exchanged = self._hands.submit(self._exchange, made)
        except RuntimeError as e:
            raise SinkError(f"the page has ended: {e}") from None
        how = exchanged.result()
        self.tell_error("")
        return how

    def tell_error(self, why: str) -> None:
        """Show on the pages why a new scene is not played; the old one goes on."""
        self.why = why
        self._soon(self._tell_state)

    def _soon(self, f: Callable[[], None]) -> None:
        """Call a function in the server's loop, if there is one yet."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(f)

    def _exchange(self, made: Version) -> str:
        """Let a version follow: crossfaded, after the session, or in the next one."""
        sink, root, how, params = self._sink, self._root, "plays", self._values(made)
        records = self.log is not None
        inputs = {n: made.ranges[n] for n in made.scene.inputs}
        change = partial(self.inputs.change, made.scene, inputs, made.given, made.smoothing)
        if sink is None or root is None or sink.finished or sink.error is not None:
            self._become(made, params)
            change()
            how = "is what the next session plays"
        elif made.hello["outputs"] == self.hello["outputs"]:
            known = dict(self.params)

            def begun(session: Sink, since: int) -> None:
                """Become the new scene in the sink's thread, before its first block."""
                moved = {n: v for n, v in self.params.items() if n in params and v != known[n]}
                change(since=since)
                self._become(made, params | moved)
                self._sets = moved  # since the parameters were given
                self._sink, self.session = session, self.session + 1

            root.switched = begun
            log = self._new_folder() if records else None
            options: dict[str, Any] = self._marking | {
                "seed": self.seed,
                "log": log,
                "params": params,
            }
            options |= {"motion": Live(1.0)} if made.scene.inputs else {}
            sink.crossfade(made.scene, made.safety, **options)
            self._recorded(sink)
            self._records(log)
        else:
            try:
                self._end([])
            except StimlibError as e:
                self.say(str(e))
            self._become(made, params)
            change()
            try:
                self._begin(records)
            except Exception:
                self._soon(partial(self._tell_state, "idle"))
                raise
        self._soon(self._tell_state)
        return how

    def _greet(self) -> None:
        """Tell the pages of another scene, ahead of its samples."""
        for page in self.pages:
            if page.greeted != self.hello:
                page.greeted = self.hello
                page.blocks.clear()  # they are of the scene before
                values = [p | {"value": self.params[p["name"]]} for p in self.hello["params"]]
                page.tell({"is": "hello"} | self.hello | {"params": values})

    def warm_up(self) -> None:
        """Compile everything that a session needs, so that the first begins at once."""
        sink = self._made(None)
        sink.open(self.fs, block=self.block)
        self.inputs.columns(0, self.block)
        sink.close()

    # Pages ----------------------------------------------------------------------------
    def join(self, page: Page) -> None:
        """Accept a page that has sent a valid hello; the first gets control."""
        again = page.name and page.name in (self._kept, getattr(self.control, "name", ""))
        self._next = page if self._kept and not again else self._next
        if again or self._expects:
            self._expects = False
            self._give(page)
        elif not self._kept:
            self.control = self.control or page
        for old in self.pages:
            if old.name == page.name != "":
                old.close(4410, "this page was opened again")
        self.pages.append(page)
        self._greet()
        self._tell_state()

    def expect(self) -> None:
        """Give control to the next page that comes, as in a cell that is shown anew."""
        self._expects = True

    def leave(self, page: Page) -> None:
        """Remove a disconnected page; if it had control, keep that for a moment."""
        self.pages.remove(page)
        if self.control is page:
            self.control = None
            if page.name and page.end[0] != 4408:
                self._kept = page.name
                self._until = self._loop.call_later(GRACE, self._gone, page.name)
            else:
                self._gone(page.name, "answered nothing" if page.end[0] == 4408 else "was closed")
        self._tell_state()

    def _gone(self, name: str, how: str = "was closed") -> None:
        """Fade out, as no page controls; one that opened meanwhile does from now on."""
        self._kept, self._left, self._closed = "", True, name
        self._ask("stop", f"{CONTROLLING} {how}, so the stimulus was faded out")
        if self._next in self.pages:
            self._give(self._next)
            self._tell_state()

    def _give(self, page: Page) -> None:
        """Give a page control, with all fingers lifted."""
        if self._until is not None:
            self._until.cancel()
        self._kept, self._next, self.control = "", None, page
        self.inputs.lift()

    def do(self, page: Page, message: dict[str, Any]) -> None:
        """Carry out a message of a page, and report a rejection to it."""
        about = message.pop("do")
        page.hear()
        try:
            if about == "seen":
                return
            if about == "control":
                self._give(page)
                self._tell_state()
            elif page is not self.control and about != "move":
                raise BadValue("this page does not have control: take it first")
            elif about == "move":
                if page is self.control:
                    self.inputs.move(**message)
            elif about == "set":
                self.set(message["name"], message["value"])
                self._tell_state(but=page)
            elif about == "source":
                self.inputs.choose(message.pop("input"), **message)
                self._tell_state()
            elif about == "mark":
                if self._sink is None:
                    raise BadValue("mark: no session runs: start one first")
                self._sink.mark("page")
            elif about == "hello":
                raise BadValue("hello is said once, as the first word")
            else:
                self._ask(about, "")
        except StimlibError as e:
            page.tell({"is": "error", "about": about, "text": str(e)})

    def set(self, name: str, value: float) -> None:
        """Change a parameter for the running session and for later ones.

        Raises
        ------
        UnknownName
            No such parameter.
        BadValue
            The value is outside the parameter's range, or a frequency of fs/2 or above.
        """
        need("set", [name], self.params, "parameter")
        low, high = self.ranges[name]
        if not low <= value <= high:
            raise BadValue(
                f"{name} = {value:g} is outside its range, {low:g} to {high:g}; --range"
                f" {name}=LOW:HIGH makes it another"
            )
        for b in reach(self.scene.outputs.values()):
            if getattr(b.frequency, "name", "") == name:
                b.check_rate(value, self.fs, f"{name}: ")
        self.params[name] = float(value)
        self._sets = self._sets | {name: float(value)}

    # Course ---------------------------------------------------------------------------
    def _ask(self, what: str, why: str) -> None:
        """Store the newest request, which replaces an earlier one."""
        self._asked = what, why
        self._wake.set()

    async def run(self) -> None:
        """Run the requested sessions and send reports, until this task is cancelled."""
        self._loop = asyncio.get_running_loop()
        reports = asyncio.create_task(self._report())
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                if self._asked is not None:
                    (what, why), self._asked = self._asked, None
                    await self._change(what, why)
        finally:
            reports.cancel()
            await self._beside(self._end, [])
            self._hands.shutdown()

    async def _change(self, what: str, why: str) -> None:
        if self._sink is not None:
            self._tell_state(phase="stopping")
        ended: list[Sink] = []  # the session that there is when its turn has come
        try:
            await self._beside(self._end, ended)
        except Exception as e:
            why = "; ".join(dict.fromkeys(filter(None, (why, _why(e)))))
            self.say(why)
        for sink in ended:
            self._send_report(sink)
        if self._left:
            self.inputs.lift()
            self._left = False
        if what != "stop":
            self._tell_state(phase="starting")
            try:
                await self._beside(self._begin, what == "record")
            except Exception as e:
                why = _why(e)
        if ended or what != "stop":  # else nothing was faded out
            self.why, self._lost = why, self._closed
        self._tell_state(phase="idle" if self._sink is None else "running")

    async def _beside(self, f: Any, *args: Any) -> None:
        await self._loop.run_in_executor(self._hands, f, *args)

    def _made(self, log: Path | None) -> PageSink:
        params = {name: v for name, v in self.params.items() if v != self.scene.params[name].value}
        return PageSink(
            self.scene,
            self.safety,
            feed=self._feed,
            take=self._take,
            counted=self.inputs,
            seed=self.seed,
            params=params,
            log=log,
            **self._marking,
        )

    # of the hands' thread alone, so that no two change the session at once
    def _begin(self, record: bool) -> None:
        self._sets = {}
        log = self._new_folder() if record else None
        sink = self._made(log)
        sink.open(self.fs, block=self.block)
        self.session += 1
        self.inputs.count()
        try:
            sink.start()
        except BaseException:
            sink.close()
            raise
        self._sink = self._root = sink
        self._records(log)

    def _records(self, log: Path | None) -> None:
        self.log = log
        if log is not None:
            self.say(f"recording to {log}")

    def _end(self, ended: list[Sink]) -> None:
        sink, self._sink = self._sink, None
        if sink is not None and self._root is not None:
            ended.append(sink)
            try:
                self._root.close()
                self._recorded(sink)
            finally:
                self.log = None
            sink.check()

    def _recorded(self, sink: Sink) -> None:
        """Say what a session has recorded, and what was wrong with its motion."""
        r = sink.report()
        if self.log is not None:
            self.recorded = f"Recorded {r.produced / self.fs:.1f} s in {self.log}" + (
                f", {counted(r.lost, 'sample')} lost in {counted(r.underruns, 'gap')}"
                if r.lost
                else ""
            )
            self.say(self.recorded)
        if r.silent or r.rejected:
            self.say(str(r))

    def _new_folder(self) -> Path:
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
        return unused(self.folder / f"live-{stamp}.stimlog")

    # The sink's thread ----------------------------------------------------------------
    def _feed(self, at: int, n: int) -> NDArray[np.float64]:
        sink = self._sink
        if sink is not None and self._sets:
            sets, self._sets = self._sets, {}
            for name, value in sets.items():
                if name in sink.pump.params:
                    sink.pump.set(name, value, max(1, round(RAMP * self.fs)))
        return self.inputs.columns(at, n)

    def _take(self, at: int, x: NDArray[np.float64], y: NDArray[np.float32]) -> None:
        t, arrived = self.inputs.newest
        now = time.perf_counter()
        head = (at, t, 1e3 * (now - arrived) if t else 0.0, now, self.session, y.shape[1])
        assert len(head) == HEAD
        self._loop.call_soon_threadsafe(self._spread, samples(head, x, y))

    # What pages are told --------------------------------------------------------------
    def _spread(self, data: bytes) -> None:
        for page in self.pages:
            page.put(data)

    def _tell_state(self, phase: str | None = None, but: Page | None = None) -> None:
        self.phase = phase or self.phase
        state = {
            "is": "state",
            "phase": self.phase,
            "session": self.session,
            "controlled": self.control is not None,
            "log": None if self.log is None else str(self.log),
            "recorded": self.recorded,
            "sources": self.inputs.sources,
            "params": self.params,
            "why": self.why,
        }
        for page in self.pages:
            if page is not but:
                role = "control" if page is self.control else "watch"
                own = page.name == self._lost != ""
                why = self.why.replace(CONTROLLING, "this page" if own else CONTROLLING)
                page.tell(state | {"role": role, "why": why})

    async def _report(self) -> None:
        while True:
            then = time.monotonic()
            await asyncio.sleep(REPORTS)
            # a page that waits for a late server is not silent
            passed = min(time.monotonic() - then, 2 * REPORTS)
            sink = self._sink
            if sink is None:
                for page in self.pages:
                    page.silent = 0.0
                    page.tell({"is": "alive"})
                continue
            self._send_report(sink)
            if sink.error is not None and self._asked is None and self.phase == "running":
                self._ask("stop", str(sink.error))
            for page in self.pages:
                page.wait(passed)

    def _send_report(self, sink: Sink) -> None:
        r = sink.report()
        report = {
            "is": "report",
            "session": self.session,
            "at": r.produced,
            "seconds": r.produced / self.fs,
            "lost": r.lost,
            "underruns": r.underruns,
            "late": max(0.0, self._root.late if self._root else 0.0),
            "clips": r.clips,
            "energy": r.energy,
            "faults": r.faults,
            "silent": r.silent,
            "rows": r.rows,
            "rejected": r.rejected,
            "time": time.time(),
            "busy": self._root.busy if self._root else 0.0,
        }
        for page in self.pages:
            page.tell(report | {"skipped": page.skipped})


def _why(e: Exception) -> str:
    """Return the text of an error for the page; log unexpected errors."""
    if isinstance(e, StimlibError):
        return str(e)
    logger.exception("the session could not be started or ended")
    return f"unexpected error: {type(e).__name__}: {e}"

"""A session played by hand, in odd blocks, and its log."""

import numpy as np

import stimlib
from stimlib.files.log_writer import LogWriter, header
from stimlib.run.safety import protect, to_device


def play(
    folder,
    scene,
    safety,
    x,
    *,
    fs=8000.0,
    sets=(),
    lost=(),
    channels=None,
    seed=5,
    params=None,
    blocks=(1, 7, 64, 100, 1000),
    ahead=False,
    record=False,
    report=True,
):
    """What a sink does; sets (index, name, value, ramp in samples), lost (index,
    frames), which may be told ahead. The frames delivered.
    """
    n, rng, given, at = x.shape[1], np.random.default_rng(1), [], 0
    proc = stimlib.compile(protect(scene, safety), fs, seed=seed)
    how = {"seed": seed, "params": params, "channels": channels, "device": "by hand", "block": 64}
    head = header(scene, safety, fs, **how)
    numbers = [-1 if c is None else proc.outputs.index(c) for c in head["channels"]]
    for name, value in (params or {}).items():
        proc.set(name, value, ramp=0.0)
    proc.process(np.zeros((len(x), 0)))
    told = [
        (i, "set", dict(zip(("name", "value", "ramp"), more, strict=True))) for i, *more in sets
    ]
    told += [(i, "lost", {"frames": frames}) for i, frames in lost]
    gone = {k for i, frames in lost for k in range(i, i + frames)}
    ends = {n, *(i for i, *_ in told), *(i + frames for i, frames in lost)}
    with LogWriter(folder, head, record=record) as log:
        for i, kind, data in told:
            if ahead and kind == "lost":
                log.event(i, kind, **data)
        while at < n:
            for i, kind, data in told:
                if i == at and kind == "set":
                    proc.set(data["name"], data["value"], data["ramp"] / fs)
                if i == at and not (ahead and kind == "lost"):
                    log.event(i, kind, **data)
            stop = min([e for e in ends if e > at] + [at + int(rng.choice(blocks))])
            part = np.ascontiguousarray(x[:, at:stop])
            log.motion(part)
            frames = to_device(proc.process(part), safety.scales(proc.outputs), numbers)
            if at not in gone:
                log.delivered(frames)
                given.append(frames)
            at = stop
        if report:
            log.close({"produced": n, "delivered": n - len(gone), "lost": len(gone)})
    return np.concatenate(given)

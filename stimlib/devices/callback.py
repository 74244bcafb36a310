"""The compiled callback of a device: it runs a program and moves its samples.

The Python interpreter is not involved.

Like ``runtime.py``, this source is compiled through the cache.  All state lies in one
int64 array, the context c, which ``stimlib.devices.engine.Pump`` fills; ``words``
names the index of each word.  Each ring buffer has one writer and one reader: the
writer stores its count with release order, and the reader loads it with acquire order,
so neither ever waits for the other.
"""

from stimlib.devices.words import *
from stimlib.targets.llvm import rows
from stimlib.targets.llvm.instructions import DOUBLE, I64
from stimlib.targets.llvm.known import at, f4_at, f8_at, i8_at, known, run, single, through, whole
from stimlib.targets.llvm.values import Value, exported, number


# memory and calls ---------------------------------------------------------------------
@known
def load(w, p, o):
    """Return word o of a ring, together with all that its writer wrote before it."""
    return Value(w.b.load_atomic(w.address(p, o).v, "acquire", 8), "i8")


@known
def store(w, p, o, value):
    """Set word o, after everything that was written before."""
    w.b.store_atomic(number(value).v, w.address(p, o).v, "release", 8)


@known
def float_of(w, n):
    """Return the float64 that has the given bits."""
    return Value(w.b.bitcast(number(n).v, DOUBLE), "f8")


@known
def bits_of(w, x):
    """Return the bits of a float64."""
    return Value(w.b.bitcast(number(x).v, I64), "i8")


clock_gettime, get_buffer, frame_time, sleep_us = (
    through("i4", "i4", "i8"),
    through("i8", "i8", "i4"),
    through("u4", "i8"),
    through("i4", "i4"),
)


def now(c):
    """Return the monotonic clock's time in nanoseconds."""
    t, ticks = i8_at(c[TIME]), c[TICKS]
    if ticks > 0:  # Windows
        frame_time(c[CLOCK], c[TIME])
        return load(t, 0) // ticks * 1000000000 + load(t, 0) % ticks * 1000000000 // ticks
    clock_gettime(c[CLOCK], c[CLOCK_ID], c[TIME])
    return load(t, 0) * 1000000000 + load(t, 1)


def sleep(c, us):
    """Wait a number of microseconds, rounded up to milliseconds on Windows."""
    sleep_us(c[SLEEP], (us + 999) // 1000 if c[TICKS] > 0 else us)


# commands and events ------------------------------------------------------------------
def event(c, at_, kind, a, b, d):
    """Write an event into the ring buffer of events."""
    w = c[E_WRITE]
    if w - load(c, E_READ) >= EVENTS:
        c[DROPPED] += 1
        return
    e = at(i8_at(c[E_RING]), RECORD * (w % EVENTS))
    e[0], e[1], e[2], e[3], e[4] = at_, kind, a, b, d
    store(c, E_WRITE, w + 1)


def set_param(c, i, param, value, ramp):
    """Ramp a parameter to a value (as bits) over ``ramp`` samples, from sample i."""
    q = at(i8_at(c[PENDING]), rows.SETTING_WORDS * param)
    if ramp <= 1:
        q[rows.TARGET], q[rows.LEFT], q[rows.Y], q[rows.WAITS] = value, 0, value, 2
    else:
        q[rows.TARGET], q[rows.LEFT], q[rows.WAITS] = (
            value,
            bits_of(float(ramp)),
            max(1, q[rows.WAITS]),
        )
    event(c, i, SET, param, value, ramp)


def set_gain(c, i, value):
    """Ramp the gain to a value, starting at sample i."""
    set_param(c, i, c[GAIN_PARAM], bits_of(value), c[FADE])


def commands(c, i):
    """Apply, at sample i, the commands queued since the last block."""
    r, w = c[C_READ], load(c, C_WRITE)
    while r < w:
        q = at(i8_at(c[C_RING]), RECORD * (r % (COMMANDS + SPARE)))
        if q[0] == SET:
            set_param(c, i, q[1], q[2], q[3])
        elif q[0] == STOP:
            # what has risen to sample 0 goes on from it
            first = max(i, q[2], 1 if c[ROSE] > 0 and c[LEAD] == 0 else 0)
            # another follows at the natural end, if the fade would not end before it
            late = q[1] == FOLLOWED and first + c[FADE] > c[END]
            if first < min(c[FADE_AT], c[END]) and not late:
                c[FADE_AT] = first
                c[END] = min(c[END], first + c[FADE])
                event(c, c[FADE_AT], ENDING, q[1], 0, 0)
        r += 1
    store(c, C_READ, r)


# motion -------------------------------------------------------------------------------
def fill(c, i, m, done):
    """Copy columns i .. i + m of the motion into x, shape (n_in, m).

    Return how many of the last columns repeat a held position.
    """
    x, hold, inputs = f8_at(c[X]), f8_at(c[HOLD]), c[N_IN]
    held = 0
    if c[MOTION] == FROM_TABLE:
        table, n = f8_at(c[TABLE]), c[TABLE_N]
        for k in range(m):
            j = min(i + c[SKIP] + k, n - 1)
            for a in range(inputs):
                x[a * m + k] = table[a * n + j]
    elif c[MOTION] == SIGNALS:
        ins, scale = i8_at(c[INS]), f8_at(c[IN_SCALE])
        for a in range(inputs):
            if done >= 0 and ins[a] != 0 and c[CONNECTED] != 0:  # else JACK's are silent
                signal = f4_at(ins[a])
                for k in range(m):
                    x[a * m + k] = (
                        float(signal[(done + k) * c[IN_STRIDE]]) * scale[2 * a] + scale[2 * a + 1]
                    )
                hold[a] = x[a * m + m - 1]
            else:
                for k in range(m):
                    x[a * m + k] = hold[a]
        held = m * (1 - c[CONNECTED])
    elif c[MOTION] != NONE:
        ring, size, write = f8_at(c[M_RING]), c[M_SIZE], load(c, M_WRITE)
        read = c[M_READ]
        if c[MOTION] == TIMED:  # a column belongs to a sample: whatever comes late is skipped
            read = i + c[SKIP]
        elif write - read > c[M_KEEP] + m:  # no growing delay behind a live motion
            c[SKIPPED] += write - read - m
            read = write - m
        for k in range(m):
            if read < write:
                for a in range(inputs):
                    hold[a] = ring[(read % size) * inputs + a]
                held = 0
            else:
                held += 1
            if read < write or c[MOTION] == TIMED:
                read += 1
            for a in range(inputs):
                x[a * m + k] = hold[a]
        store(c, M_READ, read)
    return held


def judge(c, i, m, held):
    """Fade the gain out when motion is late, and in again when motion arrives."""
    before = c[RUN]
    c[RUN] = before + m if held >= m else held
    if c[STALE] == 0 and held >= m and before >= c[STALE_AFTER]:
        c[STALE] = 1
        event(c, i, GONE, before, 0, 0)
        if c[FADING] == 0:
            set_gain(c, i, 0.0)
    elif c[STALE] == 1 and held < m:
        c[STALE] = 0
        event(c, i, BACK, 0, 0, 0)
        if c[FADING] == 0:
            c[MOVED] = 1
            set_gain(c, i, 1.0)


def room(c, m):
    """Return 1 if the ring buffers of the log have room for m more samples."""
    full = (
        c[X_WRITE] + m - load(c, X_READ) > c[L_SIZE]
        or c[F_STAGED] + m - load(c, F_READ) > c[L_SIZE]
    )
    return 0 if c[LOG] != 0 and full else 1


def ready(c, i, m):
    """Return 1 unless a full or empty ring buffer would hold up the device.

    Only a device without a clock can wait.
    """
    if c[MOTION] == TIMED and load(c, M_WRITE) < i + c[SKIP] + m:
        return 0
    return room(c, m)


# the body -----------------------------------------------------------------------------
def deliver(c, start, m, log):
    """Deliver m frames of y to the device's buffers and to the log.

    The first frame is written at frame ``start``.
    """
    y, outs, scales, channel = f8_at(c[Y]), i8_at(c[OUTS]), f8_at(c[SCALES]), i8_at(c[MAP])
    stride, channels = c[STRIDE], c[CHANNELS]
    for j in range(channels):
        out, source = f4_at(outs[j]), channel[j]
        if source < 0:
            for k in range(m):
                out[(start + k) * stride] = single(0.0)
        else:
            for k in range(m):
                v = y[source * m + k] / scales[source]
                v = v if v - v == 0.0 else 0.0
                out[(start + k) * stride] = single(min(max(v, -1.0), 1.0))
    if log:
        w = c[F_STAGED]
        for k in range(m):
            ring = f4_at(c[F_RING] + 4 * channels * ((w + k) % c[L_SIZE]))
            for j in range(channels):
                ring[j] = f4_at(outs[j])[(start + k) * stride]
        c[F_STAGED] = w + m


@exported("void", "i8*")
def commit(c):
    """Count the block as accepted by the device."""
    c[DELIVERED] += c[STAGED]
    c[STAGED] = 0
    store(c, F_WRITE, c[F_STAGED])
    if load(c, NEXT) != 0:
        commit(i8_at(c[NEXT]))


@exported("void", "i8*")
def withdraw(c):
    """Count the block as lost because it came too late."""
    if load(c, NEXT) != 0:
        withdraw(i8_at(c[NEXT]))
    n = c[STAGED]
    c[LOST] += n
    if c[LOG] == 0 or c[F_STAGED] > c[F_WRITE]:  # else it is in a gap already
        lose(c, i8_at(c[CONTEXT])[15], n)
    c[STAGED], c[F_STAGED] = 0, c[F_WRITE]


def lose(c, i, n):
    """Count the n samples before i as discarded."""
    if n > 0:
        event(c, i - n, LOSS, n, 0, 0)


def ramp(c, k, part):
    """Compute frame k of a fade as a fraction of the output levels.

    The levels are those of the first or the last sample.
    """
    for a in range(c[N_OUT]):
        f8_at(c[Y])[a] = part * f8_at(c[LEVELS])[a]
    deliver(c, k, 1, False)


def ahead(c, lost):
    """Return the frames of silence before the session is to rise."""
    return max(c[BEGIN] - c[FRAMES] - lost, 0) if c[ROSE] == 0 and c[FADE_AT] > 0 else 0


def rest(c, n):
    """Write the silence before a session that begins at a given time.

    Return how many of the n frames were written.
    """
    if ahead(c, 0) > 0:
        commands(c, 0)
        if c[MOTION] == LIVE:  # the newest is what it begins with
            store(c, M_READ, max(c[M_READ], load(c, M_WRITE) - 1))
        if c[FADE_AT] == 0:  # it is stopped before it has begun
            c[LEAD] = c[TAIL] = c[END] = 0
    done = min(ahead(c, 0), n)
    c[BEGAN] = c[FRAMES] + ahead(c, 0) + c[LEAD]
    for j in range(c[CHANNELS]):
        for k in range(done):
            f4_at(i8_at(c[OUTS])[j])[k * c[STRIDE]] = single(0.0)
    return done


def rise(c, done, n):
    """Write the fade-in frames from silence to the first sample, or back.

    The first is frame ``done``. Return how many of the n frames are written then.
    """
    if c[LEAD] > 0:
        commands(c, 0)
        if c[ROSE] == 0 and done < n and c[FADE_AT] > 0:
            event(c, 0, RISE, c[FADE], 0, 0)
    while done < n and c[LEAD] > 0:
        ramp(c, done, (c[FADE] - c[LEAD]) / c[FADE])
        c[ROSE] += 1
        done += 1
        if c[FADE_AT] > 0:
            c[LEAD] -= 1
        elif c[LEAD] < c[FADE]:
            c[LEAD] += 1
        else:
            c[LEAD] = c[TAIL] = c[END] = 0
    return done


def fall(c, done, n):
    """Write the fade-out frames done .. n - 1, from the last sample to silence.

    Return the number of frames written by then.
    """
    if c[END] >= c[FADE_AT] + c[FADE]:  # the gain is 0 already
        c[TAIL] = 0
    while done < n and c[TAIL] > 0:
        if c[TAIL] == c[FADE]:
            event(c, c[END], FALL, c[FADE], 0, 0)
        c[TAIL] -= 1
        c[FELL] += 1
        ramp(c, done, c[TAIL] / c[FADE])
        done += 1
    if c[TAIL] == 0:
        store(c, STATE, DONE)
    return done


def marked(c, i, m):
    """Write an event where a marker output rises to 0.5 or more."""
    y, which, last = f8_at(c[Y]), i8_at(c[MARKED]), f8_at(c[MARK_LAST])
    for j in range(c[MARKS]):
        for k in range(m):
            v = y[which[j] * m + k]
            if v >= 0.5 and last[j] < 0.5:
                event(c, i + k, MARK, j, bits_of(v), 0)
            last[j] = v


def timed(c, ns):
    """Record the time at which the block of the current frame began."""
    store(c, TIMES, c[TIMES] + 1)
    store(c, TIMED_AT, c[FRAMES])
    store(c, TIMED_NS, ns)
    store(c, TIMES, c[TIMES] + 1)


def keep_motion(c, m):
    """Write the motion of m samples into the ring buffer of the log."""
    w, x = c[X_WRITE], f8_at(c[X])
    for k in range(m):
        ring = f8_at(c[X_RING] + 8 * c[N_IN] * ((w + k) % c[L_SIZE]))
        for a in range(c[N_IN]):
            ring[a] = x[a * m + k]
    store(c, X_WRITE, w + m)


ADVANCE = "i8", "i8*", "i8", "i8", "i8"
PRODUCE = "void", "i8*", "i8", "i8", "i8"


@exported(*ADVANCE)
def advance(c, done, n, keep):
    """Run up to n - done samples, and deliver them from frame ``done`` on.

    With keep = 0 the samples are discarded. Return the index of the next frame.
    """
    program = i8_at(c[CONTEXT])
    gone = 0  # discarded since the last event
    while done < n:
        i = program[15]
        commands(c, i)
        if i >= c[END]:
            break
        if c[FADING] == 0 and i >= c[FADE_AT]:
            c[FADING] = 1
            if c[STALE] == 0:
                set_gain(c, i, 0.0)
        m = min(n - done, CHUNK, c[END] - i)
        if c[FADING] == 0:
            m = min(m, c[FADE_AT] - i)
        waited = 0
        while waited < c[WAIT] and ready(c, i, m) == 0:
            sleep(c, 100)
            waited += 100
        log = c[LOG] != 0 and room(c, m) == 1
        if c[LOG] != 0 and not log:
            c[UNLOGGED] += m
            lose(c, i, gone)
            gone = 0
            event(c, i, GAP, m, keep, 0)
        held = fill(c, i, m, done if keep else -1)
        judge(c, i, m, held)
        run(c[ENTRY], program, f8_at(c[X]), f8_at(c[Y]), m)
        marked(c, i, m)
        for a in range(c[N_OUT]):
            f8_at(c[LEVELS])[a] = f8_at(c[Y])[a * m + m - 1]
        if keep:
            deliver(c, done, m, log)
            c[STAGED] += m
        if log and c[N_IN] > 0:
            keep_motion(c, m)
        done += m
        gone += m if not keep and (log or c[LOG] == 0) else 0
    lose(c, program[15], gone)
    return done


def count(bins, ns):
    """Count a time of at least 0 in a histogram."""
    octave = 0
    while ns >> octave > 15:
        octave += 1
    place = ns if ns < 8 else 8 * (octave + 1) + (ns >> octave & 7)
    i8_at(bins)[min(place, BINS - 1)] += 1


def late(c, n, start):
    """Count how late a block of n frames begins, and note when the next one is due.

    A block is due as long after the one before as that lasts.
    """
    if c[DUE] > 0:
        count(c[LATENESS], max(0, start - c[DUE]))
    c[DUE] = start + whole(n * float_of(c[FRAME_NS])) if load(c, WAIT) == 0 else 0


def produce(c, n, lost):
    """Make one block of n frames, after ``lost`` frames that the device skipped.

    Commit or withdraw the block afterwards.
    """
    produce_at(c, n, lost, now(c))


@exported(*PRODUCE)
def produce_at(c, n, lost, start):
    """Make the frames of one session, whose first is due at the time ``start``."""
    store(c, CALLS, c[CALLS] + 1)
    begun = now(c)
    done, silent, program = 0, 0, i8_at(c[CONTEXT])
    # the frame at which a session that follows begins; frames that are made and lost
    begins, gone = 0, lost
    if load(c, STATE) == RUNNING:
        late(c, n, start)
        # before sample 0 there is nothing to lose
        if lost > 0 and c[WAS] == RUNNING and program[15] > 0:
            gone = advance(c, 0, lost, 0)
            c[LOST] += gone
            c[UNDERRUNS] += gone > 0
        c[WAS] = RUNNING
        c[FRAMES] += lost
        timed(c, start)
        if program[15] == 0:
            silent = rest(c, n)
        done = rise(c, silent, n)
        first = program[15] - done + lost - gone
        if c[LEAD] == 0:
            done = advance(c, done, n, 1)
        c[FRAMES] += n
        begins = min(min(c[FADE_AT], c[END]) - first, n)
        if program[15] >= c[END]:
            done = fall(c, done, n)
    outs = i8_at(c[OUTS])
    for j in range(c[CHANNELS]):
        out = f4_at(outs[j])
        for k in range(done, n):
            out[k * c[STRIDE]] = single(0.0)
    if c[STALL] > 0:
        sleep(c, c[STALL])
        c[STALL] = 0
    if load(c, NEXT) != 0:
        follow(c, i8_at(c[NEXT]), begins, n, lost, start)
    if done > silent:
        count(c[HISTOGRAM], now(c) - begun)


def follow(c, d, begins, n, lost, start):
    """Add the frames of the session d, which follows this one, to those of the block.

    Its gain begins to rise at the frame at which that of the other begins to fall. The
    gains add up to 1 then, so that the sum keeps the limits that both keep.
    """
    outs, added, ins, own = i8_at(c[OUTS]), i8_at(d[OUTS]), i8_at(c[INS]), i8_at(d[INS])
    d[CONNECTED], d[IN_STRIDE] = c[CONNECTED], c[IN_STRIDE]
    if d[CALLS] == 0:
        store(d, WAIT, load(c, WAIT))
        if begins < n:  # a motion of time is where it would be if the session began in time
            late = max(0, min(c[FADE_AT], c[END]) + d[SKIP] - min(begins, 0))
            if d[MOTION] == TIMED:  # as far as its columns are there
                late = min(late, max(0, load(d, M_WRITE) - n))
            if d[END] == d[TABLE_N]:
                d[END] = max(1, d[END] - late)
            store(d, SKIP, late)
    begins = max(begins, 0)  # else it was among the frames that were lost
    while begins < n:
        m = min(n - begins, CHUNK)
        if d[MOTION] == SIGNALS:
            for a in range(d[N_IN]):
                own[a] = ins[a] + 4 * begins * c[IN_STRIDE] if ins[a] != 0 else 0
        produce_at(d, m, lost, start + whole(begins * float_of(d[FRAME_NS])))
        for j in range(c[CHANNELS]):
            out, more = f4_at(outs[j]), f4_at(added[j])
            for k in range(m):
                both = float(out[(begins + k) * c[STRIDE]]) + float(more[k])
                out[(begins + k) * c[STRIDE]] = single(min(max(both, -1.0), 1.0))
        begins, lost = begins + m, 0


def pump(c, n, lost):
    """Make one block and commit it."""
    produce(c, n, lost)
    commit(c)


# what devices call --------------------------------------------------------------------
def begin_at(c, t, lost):
    """Record the device's time of sample 0, from t at the beginning of a block."""
    if i8_at(c[CONTEXT])[15] == 0:
        c[ORIGIN] = t + ahead(c, lost) + c[LEAD]


@exported("i4", "u4", "i8*")
def jack(frames, c):
    """Run as JACK's process callback: make the block of one cycle in JACK's buffers.

    Frames that JACK skipped are counted first. JACK calls a late client again for the
    cycle that has begun in the meantime, while the clients after it in the graph run
    only once.  A late block is therefore withdrawn, the buffers get the samples of the
    current cycle, and they are left unchanged at JACK's second call.
    """
    n = whole(frames)
    outs, ports, ins, in_ports = i8_at(c[OUTS]), i8_at(c[PORTS]), i8_at(c[INS]), i8_at(c[IN_PORTS])
    for j in range(c[CHANNELS]):
        outs[j] = get_buffer(c[GET_BUFFER], ports[j], n)
    if c[MOTION] == SIGNALS:
        connected = 1
        for a in range(c[N_IN]):
            ins[a] = get_buffer(c[GET_BUFFER], in_ports[a], n)
            if frame_time(c[PORT_CONNECTED], in_ports[a]) == 0:
                connected = 0
        c[CONNECTED] = connected
    t = frame_time(c[FRAME_TIME], c[CLIENT])
    # in freewheel mode the server waits for everybody, and an xrun there moves its time
    # anywhere
    paced = load(c, WAIT) == 0
    seen = c[SEEN] != 0 and paced
    lost = (t - c[EXPECTED]) & 0xFFFFFFFF if seen else 0
    # a server whose time stands still is played to all the same
    if seen and lost == 0x100000000 - n and c[REPEATS] < 4:
        c[REPEATS] += 1
        return 0
    c[REPEATS] = 0
    lost = lost if lost < 0x80000000 else 0
    begin_at(c, t, lost)
    produce(c, n, lost)
    before = c[UNDERRUNS]
    late = (frame_time(c[FRAME_TIME], c[CLIENT]) - t) & 0xFFFFFFFF
    while load(c, WAIT) == 0 and n <= late < 0x80000000:
        withdraw(c)
        t += late
        begin_at(c, t, late - n)
        produce(c, n, late - n)
        c[UNDERRUNS] = before + 1
        late = (frame_time(c[FRAME_TIME], c[CLIENT]) - t) & 0xFFFFFFFF
    c[EXPECTED], c[SEEN] = t + n, paced
    commit(c)
    return 0


@exported("void", "i4", "i8*")
def jack_freewheel(starting, c):
    """Run as JACK's freewheel callback.

    While JACK runs without a clock, the callback can wait for the motion and the log.
    """
    store(c, WAIT, 1000000 if starting else 0)


@exported("i4", "u4", "i8*")
def jack_capture(n, c):
    """Run as the process callback of a JACK client that records.

    Its argument is the word array of ``stimlib.devices.jack_loopback.Capture``. If the
    client is late, its buffers may mix two cycles, so the block is dropped and its
    times are missing. JACK then calls the client again for the cycle that has begun in
    the meantime, and only the data read then belong to that cycle for certain.
    """
    get, ports, channels, frames, size, w, times_at, time_of, client = (
        c[0],
        i8_at(c[1]),
        c[2],
        c[3],
        c[4],
        c[5],
        c[6],
        c[7],
        c[8],
    )
    times = i8_at(times_at)
    t = frame_time(time_of, client)
    if w >= n and times[w - 1] == t + n - 1:
        w -= n
    if w + n <= size:
        for k in range(n):
            times[w + k] = t + k
        for j in range(channels):
            source, to = (
                f4_at(get_buffer(get, ports[j], whole(n))),
                f4_at(frames + 4 * (j * size + w)),
            )
            for k in range(n):
                to[k] = source[k]
        late = (frame_time(time_of, client) - t) & 0xFFFFFFFF
        store(c, 5, w if n <= late < 0x80000000 else w + n)
    return 0


@exported("i4", "i8", "i8", "i8", "i8", "i8", "i8*")
def portaudio(source, out, frames, time, flags, c):
    """Run as PortAudio's stream callback for interleaved float32 samples.

    The third number at ``time`` is the time in s at which the first frame is played.
    PortAudio reports that frames were skipped, but not how many: their number is
    derived from how much later than expected the block is played, rounded to whole
    blocks because PortAudio's clock is not exact.
    """
    outs, ins, n = i8_at(c[OUTS]), i8_at(c[INS]), whole(frames)
    dac = f8_at(time)[2] if time != 0 else 0.0
    for j in range(c[CHANNELS]):
        outs[j] = out + 4 * j
    if c[MOTION] == SIGNALS:
        c[CONNECTED] = whole(source != 0)
        for a in range(c[N_IN]):
            ins[a] = source + 4 * a if source != 0 else 0
    lost, before, was = 0, c[UNDERRUNS], c[WAS]
    underflow = whole(flags) & 4 != 0 and c[CALLS] > 0
    if underflow and dac > 0.0:
        late = (dac - float_of(c[EXPECTED])) * float_of(c[RATE])
        lost = n * whole(round(min(max(late, 0.0), 1e9) / n))
    c[EXPECTED] = bits_of(dac + n / float_of(c[RATE]))
    pump(c, n, lost)
    if underflow and was == RUNNING and load(c, STATE) == RUNNING:
        c[UNDERRUNS] = before + 1
    return 0


def from_python(*kinds):
    """Let Python call a function with the context; it returns an integer."""
    return exported("i8", "i8*", *kinds)


@from_python("i8", "i8")
def block(c, n, lost):
    """Run one block of ``pump`` from Python, for fallback, tests and warm-up."""
    pump(c, n, lost)
    return 0


@from_python("i8", "f8", "i8")
def null(c, n, fs, clocked):
    """Run as a simulated device until it is closed.

    Blocks of n frames are made in real time or as fast as possible. The clock is that
    of a sound card with two buffers: a block that is late by a buffer is lost.
    """
    period = n * 1e9 / fs
    start, blocks = now(c), 0
    while load(c, STATE) != CLOSED:
        lost = 0
        if clocked:
            ns = start + whole(blocks * period) - now(c)
            if ns > 1000:
                sleep(c, ns // 1000)
            elif ns < -2.0 * period:
                lost = whole(-ns / period)
                blocks += lost
            blocks += 1
        elif load(c, STATE) != RUNNING:
            sleep(c, 500)
        pump(c, n, lost * n)
    return 0


# the other ends of the rings ----------------------------------------------------------
@from_python("i8", "i8", "i8", "i8")
def put_command(c, kind, a, b, d):
    """Queue a command; return 0 if the ring buffer is full."""
    w = c[C_WRITE]
    fade = kind == STOP or a == c[GAIN_PARAM]
    if w - load(c, C_READ) >= COMMANDS + (SPARE if fade else 0):
        return 0
    q = at(i8_at(c[C_RING]), RECORD * (w % (COMMANDS + SPARE)))
    q[0], q[1], q[2], q[3] = kind, a, b, d
    store(c, C_WRITE, w + 1)
    return 1


@from_python("f8*", "i8")
def put_motion(c, x, columns):
    """Put columns of x, shape (n_in, columns), into the ring; return how many fit."""
    w, ring, inputs = c[M_WRITE], f8_at(c[M_RING]), c[N_IN]
    n = min(columns, c[M_SIZE] - (w - load(c, M_READ)))
    for k in range(n):
        for a in range(inputs):
            ring[((w + k) % c[M_SIZE]) * inputs + a] = x[a * columns + k]
    store(c, M_WRITE, w + max(n, 0))
    return max(n, 0)


@from_python()
def next_motion(c):
    """Return the index of the column that a timed motion writes next.

    Columns that the device has already passed are skipped.
    """
    w, r = c[M_WRITE], load(c, M_READ)
    if w < r:
        w = r
        store(c, M_WRITE, w)
    return w


def take(c, ring, width, size, read, write, out, rows):
    """Copy what was added to a ring buffer since the last call into rows of ``out``.

    ``out`` has shape (rows, width). Return the number of rows.
    """
    r = c[read]
    n = min(load(c, write) - r, rows)
    for k in range(n):
        for a in range(width):
            out[k * width + a] = ring[((r + k) % size) * width + a]
    store(c, read, r + n)
    return n


@from_python("i8*", "i8")
def get_events(c, out, rows):
    """Copy new events: sample index, kind and three numbers each."""
    return take(c, i8_at(c[E_RING]), RECORD, EVENTS, E_READ, E_WRITE, out, rows)


@from_python("f8*", "i8")
def get_motion(c, out, rows):
    """Copy the new columns of motion, as they were processed."""
    return take(c, f8_at(c[X_RING]), c[N_IN], c[L_SIZE], X_READ, X_WRITE, out, rows)


@from_python("f4*", "i8")
def get_frames(c, out, rows):
    """Copy the newly delivered frames."""
    return take(c, f4_at(c[F_RING]), c[CHANNELS], c[L_SIZE], F_READ, F_WRITE, out, rows)


@from_python("i8", "i8")
def write(c, word, value):
    """Set a word of the context, so that the callback sees it."""
    store(c, word, value)
    return 0

"""The words of the context of a device's callback, by name, and what they may be.

All state of the callback lies in one int64 array, the context; these numbers are the
index of each word.  ``callback.py`` is compiled, and everybody else reads them here.
"""

# the program
ENTRY, CONTEXT, PENDING, N_IN, N_OUT, CHANNELS, MAP, SCALES, X, Y, GAIN_PARAM, FADE = range(12)
# its course: what a caller has asked for, and where it is
STATE, FADE_AT, END, FADING, WAS, STALE_AFTER, STALE, RUN, WAIT, STALL = range(12, 22)
# counts
DELIVERED, LOST, UNDERRUNS, UNLOGGED, DROPPED, SKIPPED, CLOCK_ID = range(22, 29)
# motion: where it comes from
MOTION, TABLE, TABLE_N, M_RING, M_SIZE, M_WRITE, M_READ, M_KEEP, HOLD = range(32, 41)
# rings: commands in; events, motion and frames out
C_RING, C_WRITE, C_READ, E_RING, E_WRITE, E_READ, LOG, L_SIZE, X_RING, X_WRITE, X_READ = range(
    44, 55
)
# frames of a block are staged until it is known to be in time
F_RING, F_WRITE, F_READ, F_STAGED, STAGED = range(55, 60)
# the device: addresses of its buffers, floats from frame to frame; functions of the
# system
OUTS, STRIDE, INS, IN_STRIDE, IN_SCALE, CONNECTED, ORIGIN, REPEATS = range(60, 68)
(
    CLOCK,
    SLEEP,
    TIME,
    HISTOGRAM,
    GET_BUFFER,
    FRAME_TIME,
    PORT_CONNECTED,
    CLIENT,
    PORTS,
    IN_PORTS,
    EXPECTED,
    SEEN,
) = range(68, 80)
# PortAudio: frames per second (bits of a float); blocks that any device has asked for
RATE, CALLS = range(80, 82)
# frames outside of the samples: how many are left and were made, before and after;
# their level; the context of the session that follows on the device, or 0; ticks per
# second of Windows' clock
LEAD, TAIL, ROSE, FELL, LEVELS, NEXT, TICKS = range(82, 89)
# outputs that mark: how many, which, their last values; a frame and the time of its
# block, with a count of writes that is odd while they change
MARKS, MARKED, MARK_LAST, TIMED_AT, TIMED_NS, TIMES = range(89, 95)
# how late blocks begin: their histogram; ns of a frame (bits of a float); when the next
# block is due, or 0; whether the gain has ever risen with a motion in real time
LATENESS, FRAME_NS, DUE, MOVED = range(95, 99)
# frames since the session runs; the frame at which it is to rise, and that of sample 0
FRAMES, BEGIN, BEGAN = range(99, 102)
# columns of a motion of time before that of sample 0: by how much it began late; before
# that, the sample of the other session at which it is to begin, less than 0
SKIP, WORDS = 102, 103

IDLE, RUNNING, DONE, CLOSED = 0, 1, 2, 3  # STATE
NONE, FROM_TABLE, TIMED, LIVE, SIGNALS = 0, 1, 2, 3, 4  # MOTION
SET, LOSS, GONE, BACK, ENDING, GAP, RISE, FALL, MARK = range(9)  # events: at, kind, three numbers
STOP = 1  # commands: SET parameter value ramp, or STOP reason earliest
FOLLOWED = 4  # the reason of a stop because another session follows: see engine.REASONS
COMMANDS, SPARE, EVENTS, RECORD = 256, 256, 65536, 5  # spare: places for fades only
CHUNK = 256  # samples of one call of the program
BINS = 8 * 40  # of the histograms of times: eight to the octave of ns

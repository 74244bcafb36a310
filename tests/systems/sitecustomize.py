"""Take away what another system lacks, before a program begins.

Python imports this file where it stands on PYTHONPATH. ``STIMLIB_AS=windows`` or
``macos`` says which system; a process that the program starts is of the same one. It is
an emulation: what a system adds, or does otherwise in C, is not seen.
"""

import builtins
import ctypes
import errno
import locale
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import types
import warnings
from functools import wraps

AS = os.environ.get("STIMLIB_AS")
TICK = 0.0156  # s, in which Windows sleeps
RESERVED = re.compile(r"(con|prn|aux|nul|com[1-9]|lpt[1-9])(\..*)?", re.I)
MISSING = {
    "windows": {
        os: "O_NONBLOCK O_NOFOLLOW O_CLOEXEC O_ACCMODE pread pwrite preadv pwritev statvfs fork"
        " forkpty openpty getuid geteuid getgid getegid killpg getpgid setsid setpgid"
        " sched_setscheduler sched_param sched_getaffinity SCHED_FIFO register_at_fork chown"
        " mkfifo posix_fadvise posix_fallocate wait4 waitid nice RTLD_NOW RTLD_NODELETE"
        " memfd_create copy_file_range",
        signal: "SIGKILL SIGHUP SIGCONT SIGTSTP SIGPIPE SIGUSR1 SIGUSR2 SIGALRM SIGCHLD SIGQUIT"
        " SIGSTOP pthread_sigmask pthread_kill sigwait pause alarm setitimer",
        time: "CLOCK_MONOTONIC CLOCK_REALTIME clock_gettime clock_getres",
    },
    "macos": {
        os: "sched_setscheduler sched_param sched_getaffinity SCHED_FIFO posix_fadvise"
        " posix_fallocate memfd_create copy_file_range"
    },
}
ABSENT = {"windows": "fcntl termios resource pwd grp tty pty", "macos": ""}


def take_away():
    """Remove names and modules of this system that the other has not."""
    for module, names in MISSING[AS].items():
        for name in names.split():
            vars(module).pop(name, None)
    for name in ABSENT[AS].split():
        sys.modules[name] = None


def open_here(path):
    """Return whether this process has a file open, as /proc tells."""
    try:
        info = os.stat(path)
    except OSError:
        return False
    for fd in os.listdir("/proc/self/fd"):
        try:
            if os.path.samestat(os.fstat(int(fd)), info):
                return True
        except OSError:
            pass
    return False


def ours(depth):
    """Return whether a function was called from stimlib."""
    return f"{os.sep}stimlib{os.sep}" in sys._getframe(depth + 1).f_code.co_filename


def refusing(real, paths):
    """Refuse what Windows does not do to a file that is open."""

    @wraps(real)
    def moved(*args, **options):
        for path in args[:paths]:
            if sys._getframe(1).f_code.co_filename.endswith("tempfile.py"):
                continue  # which lets Windows remove its files
            if os.path.isfile(path) and not os.path.islink(path) and open_here(path):
                raise PermissionError(errno.EACCES, "it is used by a process (Windows)", path)
        return real(*args, **options)

    return moved


def as_windows():
    """Let this process behave as on Windows, as far as Python code can see it."""
    import fcntl

    real_open, real_kill, real_sleep = os.open, os.kill, time.sleep
    statvfs = os.statvfs
    shutil.disk_usage = lambda path: types.SimpleNamespace(
        free=statvfs(path).f_bavail * statvfs(path).f_frsize
    )

    def opened(path, flags, mode=0o777, *, dir_fd=None):
        if dir_fd is None and os.path.isdir(path):
            raise PermissionError(errno.EACCES, "it is a folder (Windows)", path)
        if RESERVED.fullmatch(os.path.basename(os.fsdecode(path))):
            return real_open(os.devnull, flags & ~(os.O_EXCL | os.O_CREAT))
        if not flags & BINARY and path != os.devnull and ours(1):
            raise AssertionError(
                f"{path} is opened without O_BINARY: Windows would change its ends"
            )
        return real_open(path, flags & ~BINARY, mode, dir_fd=dir_fd)

    BINARY = os.O_BINARY = 1 << 28
    os.open = opened
    for name, paths in (("replace", 2), ("unlink", 1), ("remove", 1)):
        setattr(os, name, refusing(getattr(os, name), paths))
    rename = refusing(os.rename, 2)

    def renamed(source, target, **options):
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, "it is there (Windows)", target)
        rename(source, target, **options)

    os.rename = renamed
    linked = os.link

    def link(source, target, **options):
        if not options.get("follow_symlinks", True):
            raise NotImplementedError("link: follow_symlinks unavailable on this platform")
        linked(source, target)

    os.link = link  # it follows links, and cannot be told not to
    time.sleep = lambda s: real_sleep(math.ceil(s / TICK) * TICK)

    # the console and locks
    def locking(fd, mode, size):
        if os.lseek(fd, 0, os.SEEK_CUR) < 2**40:
            raise AssertionError("the lock of Windows would keep others from reading")
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)

    sys.modules["msvcrt"] = types.SimpleNamespace(LK_NBLCK=2, locking=locking)

    # C: no functions of the process itself, and the clock of the system
    real_library = ctypes.CDLL

    class CDLL(real_library):
        def __init__(self, name, *args, **options):
            if name is None:
                raise TypeError("argument of type 'NoneType' is not iterable (Windows)")
            super().__init__(name, *args, **options)

    def counter(at):
        ctypes.c_int64.from_address(at).value = time.perf_counter_ns() // 100
        return 1

    def frequency(reference):
        reference._obj.value = 10**7
        return 1

    kernel = types.SimpleNamespace(
        QueryPerformanceCounter=ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int64)(counter),
        QueryPerformanceFrequency=frequency,
        Sleep=ctypes.CFUNCTYPE(None, ctypes.c_uint32)(lambda ms: time.sleep(ms / 1000)),
    )
    ctypes.CDLL, ctypes.WinDLL = CDLL, lambda name: kernel

    # processes
    class Popen(subprocess.Popen):
        def __init__(self, *args, pass_fds=(), start_new_session=False, creationflags=0, **more):
            assert not pass_fds, "Windows passes no file descriptors"
            super().__init__(*args, **more)

        def kill(self):
            if self.poll() is None:
                real_kill(self.pid, 9)

        terminate = kill

    subprocess.Popen = Popen

    # texts: cp1252 where none is said, so stimlib says it everywhere
    plain_open = builtins.open

    def text_open(file, mode="r", buffering=-1, encoding=None, *args, **options):
        if "b" not in mode and encoding is None and ours(1):
            raise AssertionError(f"{file} is opened as a text without encoding=")
        return plain_open(file, mode, buffering, encoding, *args, **options)

    builtins.open = text_open
    locale.getpreferredencoding = lambda do_setlocale=True: "cp1252"
    # libsndfile has file descriptors of its own
    warnings.filterwarnings("ignore", message=".*fork.*")


def no_descriptors():
    """Refuse file descriptors to libsndfile, which has others on Windows."""
    import soundfile

    class SoundFile(soundfile.SoundFile):
        def __init__(self, file, *args, **options):
            assert not isinstance(file, int), "descriptors of Windows belong to a C library"
            super().__init__(file, *args, **options)

    soundfile.SoundFile = SoundFile


if AS == "windows":
    import asyncio  # noqa: F401 - it asks for the system where it is imported
    import multiprocessing

    import platformdirs  # noqa: F401 - it has parts for each system

    multiprocessing.set_start_method("spawn")
    no_descriptors()
    as_windows()
if AS in MISSING:
    os.process_cpu_count = os.cpu_count  # Python's own, of 3.13, asks for the affinity
    take_away()

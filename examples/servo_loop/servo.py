"""A servo loop in C++ at 4 kHz, with the compiled processor, then with exported C.

Both are compared with stimlib: the forces of the loop are those that a processor
computes from the same positions, bit for bit. It needs g++.
"""

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import stimlib
from stimlib.export import INCLUDE, export_c
from stimlib.scenes import wall

HERE, FS, MOST = Path(__file__).parent, 4000.0, 40_000
STIFFER = 2000.0  # N/m, while it runs
Entry = ctypes.c_void_p


def compiled(folder, *sources):
    """Compile sources into one library."""
    library = folder / "servo.so"
    words = ["g++", "-std=c++17", "-O2", "-ffp-contract=off", "-fpermissive", "-w", "-shared"]
    words += ["-fPIC", "-I", INCLUDE, "-I", folder, HERE / "servo.cpp", *sources, "-o", library]
    subprocess.run([*words, "-lpthread"], check=True)
    return ctypes.CDLL(str(library))


def run(library, process, set_, state, scene):
    """Run the loop for a while; return whether its forces are those of a processor."""
    library.servo_start.restype = Entry
    library.servo_start.argtypes = [Entry, Entry, Entry, ctypes.c_double, ctypes.c_long]
    library.servo_want.argtypes = [Entry, ctypes.c_double]
    library.servo_take.argtypes = [Entry, Entry, Entry, ctypes.POINTER(ctypes.c_long)]
    library.servo_stop.argtypes = [Entry]
    servo = library.servo_start(process, set_, state, FS, MOST)
    time.sleep(0.3)
    library.servo_want(servo, STIFFER)
    time.sleep(0.3)
    n, at = library.servo_stop(servo), ctypes.c_long()
    x, y = np.empty((1, n)), np.empty(n)
    library.servo_take(servo, x.ctypes.data, y.ctypes.data, ctypes.byref(at))
    proc = stimlib.compile(scene, FS)
    before = proc.process(x[:, : at.value].copy())
    proc.set("k", STIFFER, ramp=0.01)
    after = proc.process(x[:, at.value :].copy())
    return 0 < at.value < n and y.max() > 0 and np.array_equal(y, np.r_[before[0], after[0]])


def main():
    """Run both."""
    scene = wall(k=1500.0, at=0.005)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        made = export_c(scene, FS, folder, {"x": np.zeros(100)}, "wall", 0.02)
        library = compiled(folder, folder / "wall.c")
        library.servo_set_of_processor.restype = Entry
        proc = stimlib.compile(scene, FS)
        entry, context = proc.address
        same = run(library, entry, library.servo_set_of_processor(), context, scene)
        print("compiled processor:", "equal, bit for bit" if same else "NOT EQUAL")
        state = ctypes.create_string_buffer(made.state_bytes + 4096)
        library.wall_init(state)
        functions = [ctypes.cast(f, Entry) for f in (library.wall_run, library.wall_run_set)]
        same_c = run(library, *functions, ctypes.addressof(state), scene)
        print("exported C:", "equal, bit for bit" if same_c else "NOT EQUAL")
    return 0 if same and same_c else 1


if __name__ == "__main__":
    sys.exit(main())

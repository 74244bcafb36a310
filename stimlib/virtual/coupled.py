"""The compiled loop in which a scene and a device take turns, sample by sample.

Its text is compiled once and kept, as that of ``stimlib.targets.llvm.runtime``.
"""

from stimlib.targets.llvm import rows
from stimlib.targets.llvm.known import at, run
from stimlib.targets.llvm.values import exported


@exported(
    "void", "i8*", "i8*", "f8*", "f8*", "f8*", "f8*", "f8*", "i8", "i8", "i8", "i8", "i8", "f8"
)
def couple(scene, device, x, y, given, ends, faults, inputs, outputs, column, row, count, seen):
    """Run count samples, the first of which reads the position ``seen``.

    x, y, given and ends have a row for each sample, as the two programs read and write
    them; so have the faults: see ``stimlib.virtual.device.Faults``.
    """
    force, true = 0.0, seen
    for k in range(count):
        fault = at(faults, 4 * k)
        seen = seen if fault[1] > 0.0 else true + fault[0]
        x[inputs * k + column] = seen
        run(scene[rows.ENTRY], scene, at(x, inputs * k), at(y, outputs * k), 1)
        asked = y[outputs * k + row]
        most = fault[3]
        asked = most if asked > most else -most if asked < -most else asked
        force = force if fault[2] > 0.0 else asked
        given[3 * k] = force
        run(device[rows.ENTRY], device, at(given, 3 * k), at(ends, 5 * k), 1)
        true = ends[5 * k]

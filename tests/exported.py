"""Scenes that hold every block of the table, exported as C and compiled."""

import subprocess
from functools import cache

import numpy as np
from contract import TABLE

from stimlib import Input, Scene
from stimlib.errors import SceneError
from stimlib.export import export_c

GCC = ["gcc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror"]


MOST = 40  # of one scene
LARGE = ("mode_shape",)  # its table takes 16 MB of text: the last group, of the stress tests


@cache
def groups():
    """(rate, scene, motion of its inputs): together they have every entry of the table.

    Blocks of one scene must have different noises and names, so there are several.
    """
    left, found = sorted(TABLE, key=lambda e: e.name in LARGE), []
    while left:
        outputs, motion, others = {}, {}, []
        fs = left[0].rates[0]
        for e in left:
            inputs = [Input(f"{e.name}_{name}", e.unit) for name in e.inputs]
            try:
                full = len(outputs) == MOST or (e.name in LARGE and outputs)
                if fs not in e.rates or full:
                    raise SceneError("in the next group")
                block = e.make(*inputs)
                Scene(outputs | {e.name: block})
            except SceneError:
                others.append(e)
                continue
            outputs[e.name] = block
            motion |= {i.name: row for i, row in zip(inputs, e.x(1200, fs), strict=True)}
        scene = Scene(outputs)
        wave = np.sin(np.arange(1200) / 30)  # of inputs that an entry makes itself
        found.append((fs, scene, {name: motion.get(name, wave) for name in scene.inputs}))
        left = others
    return found


def compared(folder, name, compiler, run=(), options=()):
    """What the self test of an exported scene prints, compiled and run so."""
    sources = [f"{name}.c", f"{name}_test.c"]
    program = folder / f"{name}.exe"
    subprocess.run([*compiler, *sources, "-o", program, *options], cwd=folder, check=True)
    ran = subprocess.run([*run, program], cwd=folder, capture_output=True, text=True)
    return ran.stdout


def exported(k, folder, seconds=0.15, **words):
    """Export a group of the table; return how many samples its self test compares."""
    fs, scene, motion = groups()[k]
    return export_c(scene, fs, folder, motion, f"group{k}", seconds, **words).samples

"""Shared pages in a browser without a network: who compiles them, and their samples."""

import base64
import os
from functools import cache

import numpy as np
import pytest

import stimlib
from stimlib.errors import MissingPackage
from stimlib.live.share import share

OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND"
if "ZIG" in os.environ:  # the program; it need not be in PATH
    os.environ["PATH"] += os.pathsep + os.path.dirname(os.environ["ZIG"])


@cache
def compiles() -> bool:
    """Whether a compiler for WebAssembly is installed."""
    try:
        return bool(share(stimlib.Scene({"y": stimlib.constant(1.0)}), 1000).wasm_bytes)
    except MissingPackage:
        return False


def need_compiler():
    if not compiles():
        pytest.skip("no compiler for WebAssembly: clang with lld, or pip install ziglang")


def numbers(page, text, rows=1):
    """A Float64Array that an expression of the page gives, maybe later."""
    made = page.js(f"""(async () => {{
      const bytes = new Uint8Array((await {text}).buffer);
      let text = "";
      for (let i = 0; i < bytes.length; i += 8192)
        text += String.fromCharCode(...bytes.subarray(i, i + 8192));
      return btoa(text);
    }})()""")
    return np.frombuffer(base64.b64decode(made), "<f8").reshape(rows, -1)

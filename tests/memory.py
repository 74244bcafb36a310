"""How much memory a call takes."""

import tracemalloc


def most_memory(call, /, *given, **words):
    """Return what the call returns, and how many bytes it had at most."""
    tracemalloc.start()
    try:
        return call(*given, **words), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

"""How a scene runs: the reference interpreter (python) and the streaming compiler (numba)."""

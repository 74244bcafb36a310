"""How a scene runs: interpreter (python), compiler (numba), whole signals (jax)."""

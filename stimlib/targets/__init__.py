"""How a scene runs: the reference interpreter (python), the streaming compiler (numba),
functions of whole signals (jax).
"""

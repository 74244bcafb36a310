"""How fast it is on this machine: times of what takes turns, the noise chain beside
numpy + scipy, and what the core allows.
"""

"""Experiments: designs, trials that are scenes, sessions that lose nothing, and what
people answered.
"""

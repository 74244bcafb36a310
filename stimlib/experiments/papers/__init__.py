"""Experiments from the papers, one module for each."""

"""Coefficients that blocks are designed with: minimax fits, sums of exponentials."""

"""The papers' stimuli, each on one page that reads like the paper."""

from .squeeze import squeeze

__all__ = ["squeeze"]

"""The release number, which every written file contains."""

__version__ = "0.2.0"

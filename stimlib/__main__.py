"""``python -m stimlib`` is the command ``stimlib``."""

from .cli import app

if __name__ == "__main__":
    app()

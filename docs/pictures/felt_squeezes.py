"""The picture of examples/felt_squeezes.py: python docs/pictures/felt_squeezes.py
writes felt_squeezes.png beside it.
"""

import runpy
import sys
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "felt_squeezes.py"
sys.argv = [str(EXAMPLE), "--plot", str(Path(__file__).with_suffix(".png"))]
runpy.run_path(str(EXAMPLE), run_name="__main__")

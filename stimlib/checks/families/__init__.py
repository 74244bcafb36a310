"""Laws of blocks and of scenes, a family in each module, as in ``stimlib.blocks``.

Each law is entered where it is defined; importing the package enters all of them.
"""

from . import (
    contact as contact,
)
from . import (
    events as events,
)
from . import (
    filters as filters,
)
from . import (
    fractional as fractional,
)
from . import (
    graph as graph,
)
from . import (
    impedance as impedance,
)
from . import (
    noise as noise,
)
from . import (
    oscillators as oscillators,
)
from . import (
    pointwise as pointwise,
)
from . import (
    resonance as resonance,
)
from . import (
    soft as soft,
)
from . import (
    sources as sources,
)
from . import (
    surfaces as surfaces,
)
from . import (
    tables as tables,
)
from . import (
    texture as texture,
)
from . import (
    viscoelastic as viscoelastic,
)

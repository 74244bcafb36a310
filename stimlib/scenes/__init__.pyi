from .bump_grid import bump_grid as bump_grid
from .bumps import bumps as bumps, bumps_set as bumps_set
from .click import click as click
from .detents import detents as detents
from .friction import friction as friction
from .grating import grating as grating
from .impact import impact as impact
from .shipped import ROWS as ROWS, SHIPPED as SHIPPED
from .soft_surface import soft_surface as soft_surface
from .squeeze import squeeze as squeeze
from .texture import texture as texture
from .tone import pulse as pulse, tone as tone
from .touch_screen import touch_screen as touch_screen
from .ultrasonic_friction import ultrasonic_friction as ultrasonic_friction
from .viscoelastic import viscoelastic as viscoelastic
from .wall import wall as wall

from .maps import (
    BLOCK as BLOCK,
    SIDES as SIDES,
    THIRTEEN as THIRTEEN,
    Levels as Levels,
    array as array,
    block as block,
    buried as buried,
    image as image,
    nodules as nodules,
    sides as sides,
)
from .surface import film as film, picture as picture, surface as surface

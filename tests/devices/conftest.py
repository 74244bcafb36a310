"""Each kind of sink, for every test here that asks for it."""

from devices.stands import stand as stand

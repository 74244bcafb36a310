"""A sink is said in one entry: what is missing of one is said by file and remedy."""

import inspect
from importlib import import_module
from pathlib import Path

import pytest
from devices.stands import STANDS
from refusals import refused

import stimlib
from stimlib import BadValue, devices
from stimlib.devices import ControlLoop, Sink, available
from stimlib.devices.available import SINKS
from stimlib.devices.crossfade import Following

ROOT = Path(__file__).parents[2]
WHERE = "stimlib/devices/available.py, SINKS"


def class_of(name):
    module, _, cls = SINKS[name].place.partition(":")
    return getattr(import_module(module), cls)


def test_every_class_of_a_sink_has_an_entry():
    for path in sorted((ROOT / "stimlib" / "devices").glob("*.py")):
        if "(Sink):" in path.read_text("utf-8"):
            import_module(f"stimlib.devices.{path.stem}")
    there = {class_of(name) for name in SINKS}
    own = {c for c in Sink.__subclasses__() if c.__module__.startswith("stimlib.devices.")}
    made = {ControlLoop, Following}  # of two functions, in code; behind another sink
    assert own - there - made == set(), f"{WHERE}: add a Kind for each of these classes"


def test_every_sink_keeps_the_contract_of_sinks():
    missing = SINKS.keys() - {p.id for p in STANDS}
    assert not missing, "tests/devices/stands.py, STANDS: add a stand with each of these ids"


@pytest.mark.parametrize("name", SINKS)
def test_a_sink_is_made_by_its_name_with_its_options_and_shown(name):
    cls, kind, scene = class_of(name), SINKS[name], stimlib.Scene({"y": stimlib.constant(1.0)})
    assert cls.device == name, f"{cls.__name__}.device: write {name!r}, its name in SINKS"
    unknown = set(kind.takes.values()) - set(inspect.signature(cls).parameters)
    assert not unknown, f"{WHERE}, {name}: takes has {unknown}, which {cls.__name__} does not take"
    assert bool(kind.device) == ("device" in kind.takes), f"{WHERE}, {name}: device is a help text"
    assert type(available.make(name, scene, 1.0)) is cls
    assert {d.sink for d in available.devices("none_of_this_name")} == SINKS.keys()
    page = (ROOT / "docs" / "howto" / "hardware.rst").read_text("utf-8")
    where, line = "stimlib/devices/__init__.pyi", f".. autoclass:: stimlib.devices.{cls.__name__}\n"
    assert getattr(devices, cls.__name__, None) is cls, f"{where}: add {cls.__name__}"
    assert line in page, f"docs/howto/hardware.rst: add `{line}`"
    for option in ("device", "client", "connect", "fast"):
        if option in kind.takes:
            assert available.option(name, option, "it") == {kind.takes[option]: "it"}
        else:
            says = f"^--{option}: is for --sink .*, not for {name}$"
            refused(BadValue, says, available.option, name, option, "it")


def test_a_number_is_the_number_of_a_device():
    scene = stimlib.Scene({"y": stimlib.constant(1.0)})
    made = [available.make("portaudio", scene, 1.0, name=n) for n in ("3", "card 3", None)]
    assert [sink.name for sink in made] == [3, "card 3", None]


@pytest.mark.parametrize(
    ("ready", "chosen"),
    [
        ({"nidaq"}, "null"),
        ({"nidaq", "portaudio"}, "portaudio"),
        ({"nidaq", "portaudio", "jack"}, "jack"),
        (set(), "null"),
    ],
)
def test_ni_daq_plays_only_when_it_is_named(monkeypatch, ready, chosen):
    for name in SINKS.keys() - {"null"}:
        row = (name in ready, "a device", f"--sink {name}", None)
        kind = SINKS[name]._replace(found=lambda server, row=row: [row])
        monkeypatch.setitem(SINKS, name, kind)
    assert {d.sink for d in devices.devices() if d.ready} == {"null", *ready}
    assert devices.first_ready().sink == chosen

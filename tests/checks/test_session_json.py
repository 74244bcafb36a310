"""What a log's session.json says: every key edited, with the hash of the scene made
again where it could be.
"""

import json

import numpy as np
import pytest

import stimlib
from stimlib import StimlibError
from stimlib.checks.session import verify_log
from stimlib.files.log_reader import FIELDS, read_log
from stimlib.files.log_writer import LogWriter, header
from stimlib.motion.generators import minimum_jerk
from stimlib.run.safety import GAIN, Safety, protect, to_device
from stimlib.scenes import squeeze


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    scene, safety = squeeze(), Safety(60.0)
    x = np.stack(
        [minimum_jerk()(np.arange(4000) / 8000), minimum_jerk(depth=0.01)(np.arange(4000) / 8000)]
    )
    proc = stimlib.compile(protect(scene, safety), 8000)
    proc.set("k", 1500.0, ramp=0.0)
    with LogWriter(folder / "a", header(scene, safety, 8000.0, params={"k": 1500.0})) as log:
        proc.set(GAIN, 1.0, ramp=160 / 8000)
        log.event(0, "set", name=GAIN, value=1.0, ramp=160)
        log.motion(x)
        log.delivered(to_device(proc.process(x), safety.scales(proc.outputs), [0, 1]))
        log.close({"produced": 4000, "delivered": 4000, "lost": 0})
    return folder / "a"


def other_scene(d):
    d |= {"scene": squeeze(k=2001.0, A=3.5).to_dict(), "scene_hash": squeeze(k=2001.0, A=3.5).hash}


HELD = {
    "scene": other_scene,
    "definitions": lambda d: d.update(
        definitions={"click_block": {"sha256": "0" * 64, "text": ""}}
    ),
    "scene_hash": lambda d: d.update(scene_hash="0" * 64),
    "fs": lambda d: d.update(fs=8001.0),
    "seed": lambda d: d.update(seed=1),
    "params": lambda d: d.update(params={"k": 1500.5}),
    "safety": lambda d: d["safety"].update(full_scale=61.0),
    "inputs": lambda d: d.update(inputs=d["inputs"][::-1]),
    "outputs": lambda d: d.update(outputs=d["outputs"][::-1]),
    "units": lambda d: d["units"].update(force1="mN"),
    "channels": lambda d: d.update(channels=d["channels"][::-1]),
}
TOLD = {
    "stimlib": lambda d: d.update(stimlib="9.9"),
    "versions": lambda d: d["versions"].update(numpy="0.1"),
    "device": lambda d: d.update(device="another"),
    "block": lambda d: d.update(block=1),
    "started": lambda d: d.update(started="yesterday"),
}  # fmt: skip


def test_every_key_is_held_or_told():
    assert HELD.keys() | TOLD.keys() == FIELDS.keys()


@pytest.mark.parametrize("key", [None, *HELD, *TOLD])
def test_an_edited_key_is_refused_or_for_the_reader_only(session, tmp_path, key):
    for path in session.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    told = json.loads((tmp_path / "session.json").read_text())
    if key:
        (HELD | TOLD)[key](told)
    (tmp_path / "session.json").write_text(json.dumps(told))
    try:
        passed = verify_log(read_log(tmp_path)).passed
    except StimlibError:
        passed = False
    assert passed == (key not in HELD)

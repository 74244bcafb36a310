"""One contract for everything that reads a file: what is no such file, is another's
or is cut gives an error of stimlib's that names it, and nothing is waited for.
"""

import json
import os
from itertools import product
from pathlib import Path

import pytest
from fuzz.readers import READERS, attempt, place
from refusals import refused

from stimlib.errors import SinkError, StimlibError
from stimlib.files.sidecar import DONE

JUNK = [b"", b"[" * 100_000, b'"' * 3, b"\xff\xfe", b"nan", b"[]", b"x" * (1 << 21)]
NONE = {
    "missing": lambda path: None,
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "a device": lambda path: path.symlink_to("/dev/zero"),
    **{repr(data[:6]): lambda path, data=data: path.write_bytes(data + b"\n") for data in JUNK},
}
NO_FILE = [*NONE][: -len(JUNK)]


@pytest.mark.parametrize(
    ("name", "what"),
    [pair for pair in product(READERS, NONE) if pair[0] != "motion" or pair[1] in NO_FILE],
)  # motion is any bytes
def test_what_is_no_such_file_is_refused_by_name(tmp_path, name, what):
    path = place(name, tmp_path)
    NONE[what](path)
    if name == "report" and what in NO_FILE:  # a session that was killed has none
        assert READERS[name].read(path).report is None
        return
    error = str(refused(StimlibError, path.name, READERS[name].read, path))
    assert str(path.parent) in error and "\n" not in error and len(error) < 5000


@pytest.mark.parametrize("name", READERS)
def test_the_good_files_are_read_and_the_cut_ones_are_or_are_refused(name):
    for data in READERS[name].seeds():
        assert not isinstance(attempt(name, data), StimlibError)
        for part in (0.01, 0.3, 0.9):
            attempt(name, data[: int(part * len(data))])


@pytest.mark.parametrize("field", DONE)
def test_a_field_that_a_sidecar_lacks_is_named(tmp_path, field):
    path = place("sidecar", tmp_path)
    info = json.loads(READERS["sidecar"].seeds()[0])
    del info[field]
    path.write_text(json.dumps(info))
    refused(SinkError, f"sidecar .*{field} is missing", READERS["sidecar"].read, path)

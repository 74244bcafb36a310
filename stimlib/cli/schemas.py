"""The command ``schema``: JSON Schemas of the files that stimlib writes."""

from __future__ import annotations

import importlib
from typing import Annotated, Any, Literal

import typer

from ..system import fields
from .app import command, print_json

TABLES = {  # by kind: the file, and the table that checks it
    "sidecar": ("FILE.wav.json, beside a sound file", "files.sidecar:DONE"),
    "log": ("session.json of a log, FOLDER.stimlog", "files.log_reader:FIELDS"),
    "event": ("a line of events.jsonl of a log", "files.log_reader:EVENTS"),
    "session": ("session.json of a session of an experiment", "experiments.reader:HEADER"),
    "trial": ("a line of trials.jsonl of a session", "experiments.reader:LINE"),
    "calibration": ("the calibration of a device", "devices.calibration:FIELDS"),
}
Kind: Any = Literal[tuple(TABLES)]


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON Schema of one kind of file listed in ``TABLES``.

    Examples
    --------
    >>> from stimlib.cli.schemas import schema_of
    >>> schema_of("calibration")["required"][:3]
    ['freq', 'gain_real', 'gain_imag']
    """
    title, place = TABLES[kind]
    module, _, name = place.partition(":")
    tests = getattr(importlib.import_module(f"stimlib.{module}"), name)
    if kind != "event":
        return fields.schema(tests, title)
    found = fields.schema({"at": fields.whole(2**53), "kind": fields.text}, title)
    return found | {
        "allOf": [
            {"if": {"properties": {"kind": {"const": k}}}, "then": dict(fields.record(t).schema)}
            for k, t in tests.items()
        ]
    }


@command("schema")
def schema(
    kind: Annotated[
        Kind,
        typer.Argument(
            help="; ".join(f"[bold]{k}[/]: {title}" for k, (title, _) in TABLES.items()),
            show_default=False,
        ),
    ],
):
    """Print the JSON Schema of a kind of file that stimlib writes.

    It is made of the table that checks such files when they are read.

    [bold]stimlib schema sidecar[/]
    """
    print_json(schema_of(kind))

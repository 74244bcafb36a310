"""Files of measured textures, in the XML form of the Penn Haptic Texture Toolkit: read
as data, and written.

Source: Culbertson, Lopez Delgado, Kuchenbecker, "One hundred data-driven haptic texture
models and open-source methods for rendering on 3D objects", IEEE Haptics Symposium
2014.  Python's own parser (expat) is enough, for nothing is asked of a file but
elements and their text: a document type, which alone could define entities, ends it.
"""

from __future__ import annotations

import os
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape

import numpy as np

from ..errors import BadValue, public, shown
from ..system import safe_files
from ..system.limits import limits
from .texture import TextureModel

LONGEST = 200  # letters of a name
# elements of a model that have values, and what they are here
LISTS = {"ARlsf": "lsf", "MAlsf": "ma"}
NUMBERS = {"speedMod": "speed", "forceMod": "force", "var": "variance", "gain": "gain"}
OPTIONAL: dict[str, list[float]] = {"MAlsf": [], "gain": [1.0]}


class _Reader:
    """What a file has: values by the name of the element, once for the whole, and once
    for each model.
    """

    def __init__(self, file: str):
        self.file = file
        self.whole: dict[str, Any] = {}
        self.models: list[dict[str, Any]] = []
        self.triangles: list[list[float]] = []
        self.way: list[str] = []
        self.text: list[str] = []
        self.count = 0
        # whatever it declares: no other codec is looked up
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler, self.parser.EndElementHandler = self.start, self.end
        self.parser.CharacterDataHandler = self.text.append
        self.parser.StartDoctypeDeclHandler = self.document_type

    def refuse(self, why: str) -> None:
        raise BadValue(f"{self.file}, line {self.parser.CurrentLineNumber}: {why}")

    def document_type(self, *_):
        self.refuse(
            "it has a document type (<!DOCTYPE ..>), which could define entities: take that"
            " line out"
        )

    def start(self, name: str, _):
        if not self.way and name != "modelSet":
            self.refuse(f"it begins with <{name[:40]}>, and a texture with <modelSet>")
        self.way.append(name)
        self.text.clear()
        if self.way == ["modelSet", "model"]:
            self.models.append({})
        elif self.way == ["modelSet", "tri"]:
            self.triangles.append([])

    def end(self, name: str):
        text = "".join(self.text).strip()
        self.text.clear()
        match self.way:
            case ["modelSet", "tri", "value"]:
                self.triangles[-1].append(self.number(text))
            case ["modelSet", "model", of, "value"] if of in LISTS:
                self.models[-1].setdefault(of, []).append(self.number(text))
            case ["modelSet", "model", of] if of in LISTS:
                self.models[-1].setdefault(of, [])
            case ["modelSet", "model", of] if of in NUMBERS:
                self.models[-1][of] = [self.number(text)]
            case ["modelSet", "SampleRate" | "mu" as of]:
                self.whole[of] = self.number(text)
            case ["modelSet", "material"]:
                self.whole["material"] = text[:LONGEST]
        self.way.pop()

    def number(self, text: str) -> float:
        self.count += 1
        limits.check("table_knots", self.count, f"{self.file}: numbers")
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            self.refuse(f"{text[:40]!r} in <{self.way[-1]}> is not a finite number")
        return value


@public
def load_texture(path: str | os.PathLike[str]) -> TextureModel:
    """A measured texture from a file of the Penn Haptic Texture Toolkit, or one that
    ``save_texture`` wrote.

    The file is data, read within ``stimlib.limits``: at most ``sidecar_bytes``, and
    ``table_knots`` numbers.  What is used are ``<SampleRate>``, ``<material>``,
    ``<mu>``, each ``<tri>``, and of each ``<model>`` its ``<ARlsf>``, ``<MAlsf>``,
    ``<var>``, ``<gain>``, ``<speedMod>`` and ``<forceMod>``; the coefficients, which
    say the same as the frequencies, are not.

    Parameters
    ----------
    path : str or Path
        Speeds in mm/s, forces in N, variances in (m/s^2)^2; triangles count models from
        1.

    Returns
    -------
    TextureModel
        In m/s.

    Raises
    ------
    BadValue
        No regular file, or a larger one than the limits allow; no XML, or one with a
        document type; an element that is missing; a number that is none, or out of
        range; frequencies of an unstable model; triangles of models that are not there.
        It names the file, and the line or the model.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from stimlib.blocks import load_texture, save_texture
    >>> from stimlib.design.texture import made_up
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "invented.xml"
    >>> save_texture(made_up(), path)
    >>> load_texture(path)
    TextureModel(made up: 16 models of order (6, 4), 18 triangles, to 0.15 m/s and
    2.5 N, at 1000 Hz)
    """
    if not isinstance(path, (str, os.PathLike)):
        raise BadValue(f"load_texture: {path!r:.80} is no path; name a file such as 'cork.xml'")
    file = os.fspath(path)
    reader = _Reader(str(file))
    try:
        reader.parser.Parse(safe_files.read(file, "sidecar_bytes", BadValue), True)
    except expat.ExpatError as e:
        raise BadValue(f"{file}: not XML: {e}") from None
    try:
        return _model(reader)
    except BadValue as e:
        raise BadValue(f"{file}: {e}") from None


def _model(r: _Reader) -> TextureModel:
    if "SampleRate" not in r.whole:
        raise BadValue(
            "it has no <SampleRate>; add the rate of its models in Hz, such as"
            " <SampleRate>1000</SampleRate>"
        )
    if not r.models:
        raise BadValue("it has no <model>")
    found = {
        field: [m.get(name, OPTIONAL.get(name)) for m in r.models]
        for name, field in (LISTS | NUMBERS).items()
    }
    for name, field in (LISTS | NUMBERS).items():
        for i, row in enumerate(found[field]):
            if row is None:
                raise BadValue(f"model {i + 1} has no <{name}>")
            if len(row) != (n := len(found[field][0] or [])):
                raise BadValue(
                    f"model {i + 1} has {len(row)} values in <{name}>, and model 1 {n}: all need"
                    " one order"
                )
    for i, t in enumerate(r.triangles):
        if len(t) != 3:
            raise BadValue(f"triangle {i + 1} has {len(t)} model numbers, and not 3")
    number = {
        field: np.array([row[0] for row in found[field] if row]) for field in NUMBERS.values()
    }
    return TextureModel(
        number["speed"] / 1e3,
        number["force"],
        np.reshape(r.triangles, (-1, 3)) - 1,
        np.array(found["lsf"]),
        np.array(found["ma"]),
        number["variance"],
        number["gain"],
        r.whole["SampleRate"],
        r.whole.get("material", ""),
        r.whole.get("mu", 0.0),
    )


@public
def save_texture(model: TextureModel, path: str | os.PathLike[str]) -> None:
    """Write a measured texture in the form that ``load_texture`` reads; the file
    appears whole or not at all.

    Every number has all its digits, but for the change to mm/s.

    Parameters
    ----------
    model : TextureModel
    path : str or Path

    Raises
    ------
    BadValue
        The place cannot be written.

    Examples
    --------
    See ``load_texture``.
    """

    def values(name: str, row) -> str:
        return (
            f'<{name} type="array">'
            + "".join(f"<value>{v!r}</value>" for v in np.asarray(row).tolist())
            + f"</{name}>"
        )

    def number(name: str, v) -> str:
        return f"<{name}>{float(v)!r}</{name}>"

    lines = [
        '<?xml version="1.0" encoding="utf-8"?>',
        "<modelSet>",
        f"<material>{escape(shown(model.name))}</material>",
    ]
    lines += [number("SampleRate", model.rate), number("mu", model.mu)]
    lines += [number("maxSpeed", 1e3 * model.speed.max()), number("maxForce", model.force.max())]
    lines += [values("tri", t.astype(int) + 1) for t in model.triangles]
    for i in range(len(model.speed)):
        numbers = {
            "speedMod": 1e3 * model.speed[i],
            "forceMod": model.force[i],
            "var": model.variance[i],
            "gain": model.gain[i],
        }
        lists = values("ARlsf", model.lsf[i]) + values("MAlsf", model.ma[i])
        lines.append(
            "<model>"
            + number("modNum", i + 1)
            + lists
            + "".join(number(n, v) for n, v in numbers.items())
            + "</model>"
        )
    safe_files.publish(path, "\n".join([*lines, "</modelSet>", ""]), BadValue)

"""The texts that a participant reads, in several languages.

They are data, ``texts.toml``; a researcher can give a file with texts in another
language.
"""

from __future__ import annotations

import dataclasses as dc
import os
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import BadValue, public
from ..system import safe_files


@dc.dataclass(frozen=True)
class Texts:
    """All texts in one language; a call gives one of them with its values.

    Attributes
    ----------
    words : dict of str to str
        By key; ``language`` is the code of the language.
    """

    words: Mapping[str, str]

    def __call__(self, key: str, **values: Any) -> str:
        """Return a text with its values."""
        return self.words[key].format(**values)


@cache
def _shipped() -> dict[str, dict[str, str]]:
    return tomllib.loads(Path(__file__).with_name("texts.toml").read_text("utf-8"))


def _gaps(text: str) -> set[str]:
    """Return what is in braces."""
    return set(re.findall(r"\{[^{}]*\}|[{}]", text))


@public
def texts_of(language: str | os.PathLike[str] = "en") -> Texts:
    """Return the texts of a language, or those of a file.

    Parameters
    ----------
    language : str or path
        "en", "de", or a TOML file with the lines of one table of
        ``stimlib/experiments/texts.toml``, translated.

    Raises
    ------
    BadValue
        No such language or file; a text is missing, unknown, or has other names in
        braces than the English one.

    Examples
    --------
    >>> from stimlib.experiments import texts_of
    >>> texts_of("de")("trial_of", number=3, total=40)
    'Durchgang 3 von 40'
    """
    shipped = _shipped()
    if language in shipped:
        return Texts(shipped[str(language)])
    what = f"language = {os.fspath(language)!r:.80}"
    if not os.fspath(language).endswith(".toml"):
        raise BadValue(f"{what} must be one of {', '.join(shipped)}, or a file .toml with texts")
    raw = safe_files.read(language, "sidecar_bytes", BadValue)
    try:
        found = tomllib.loads(raw.decode())
    except ValueError as e:
        raise BadValue(f"{what} is no TOML in UTF-8: {e}; correct that line") from e
    return Texts(_checked(what, found, shipped["en"]))


def _checked(what: str, found: Mapping[str, Any], english: Mapping[str, str]) -> Mapping[str, str]:
    """Return texts; raise BadValue unless they are all there, with their values."""
    if different := english.keys() ^ found:
        verb = "lacks" if different & english.keys() else "has an unknown"
        raise BadValue(
            f"{what} {verb} {', '.join(sorted(different))}; translate the lines of one table of"
            " stimlib/experiments/texts.toml"
        )
    for key, text in found.items():
        if not isinstance(text, str) or not text.strip() or _gaps(text) != _gaps(english[key]):
            raise BadValue(
                f"{what}: {key} = {text!r:.80} must be a text like {english[key]!r}, with the same"
                " names in braces"
            )
    return found

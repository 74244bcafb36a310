"""The texts that a participant reads, in several languages.

They are data, ``texts.toml``; a researcher can give a file with texts in another
language.
"""

from __future__ import annotations

import os
import re
import tomllib
from pathlib import Path

from ..errors import BadValue, public
from ..system import safe_files


class Texts(dict[str, str]):
    """All texts in one language, by key; a call gives one of them with its values.

    ``texts["language"]`` is the code of the language.
    """

    def __call__(self, key: str, **values: object) -> str:
        """Return a text with its values."""
        return self[key].format(**values)


_SHIPPED = tomllib.loads(Path(__file__).with_name("texts.toml").read_text("utf-8"))
_gaps = re.compile(r"\{[^{}]*\}|[{}]").findall


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
    if language in _SHIPPED:
        return Texts(_SHIPPED[str(language)])
    what, english = f"language = {os.fspath(language)!r}", _SHIPPED["en"]
    if not os.fspath(language).endswith(".toml"):
        raise BadValue(f"{what} must be one of {', '.join(_SHIPPED)}, or a file .toml with texts")
    raw = safe_files.read(language, "sidecar_bytes", BadValue)
    try:
        found = Texts(tomllib.loads(raw.decode()))
    except ValueError as e:
        raise BadValue(f"{what} is no TOML in UTF-8: {e}; correct that line") from e
    if different := english.keys() ^ found:
        raise BadValue(
            f"{what} {'lacks' if different & english.keys() else 'has an unknown'}"
            f" {', '.join(sorted(different))}; translate the lines of one table of"
            " stimlib/experiments/texts.toml"
        )
    for key, text in found.items():
        if (
            not isinstance(text, str)
            or not text.strip()
            or not text.replace("\n", "").isprintable()
            or sorted(_gaps(text)) != sorted(_gaps(english[key]))
        ):
            raise BadValue(
                f"{what}: {key} = {text!r:.80} must be a text like {english[key]!r}, with the same"
                " names in braces"
            )
    return found

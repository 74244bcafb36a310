"""A scene live on a page of a browser.

``protocol`` (messages), ``inputs`` (what drives it), ``stream``, ``server``.
"""

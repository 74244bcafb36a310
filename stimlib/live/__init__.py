"""A scene live on a page of a browser: ``protocol`` (what is said), ``inputs`` (what
drives it), ``stream``, ``server``.
"""

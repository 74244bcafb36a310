"""Live scenes: explore a scene on a browser page in real time.

The modules are ``protocol`` (messages), ``inputs`` (sources of motion), ``stream``
(sessions) and ``server``.
"""

"""Numbers from measurements: materials from tests, parameters of scenes from
recordings.
"""

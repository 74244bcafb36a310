"""A file of a test, and its path."""


def written(path, data):
    """Write a text or bytes to a path; the path."""
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path

"""What is kept: audio files with their sidecars, logs of sessions, sets of files."""

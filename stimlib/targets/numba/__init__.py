"""The streaming compiler, its cache and the runtime in which segments run."""

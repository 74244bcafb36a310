"""Files, processes, threads, progress and optional packages: what any program needs."""

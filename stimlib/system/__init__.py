"""Services of any program: files, processes, threads, progress, optional packages."""

"""The experiments of the papers, each in a module of its own."""

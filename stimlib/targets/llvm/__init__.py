"""The llvm target: the streaming compiler, its cache and its runtime."""

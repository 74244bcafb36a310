"""The targets on which scenes run: interpreter (python), compiler (llvm), jax."""

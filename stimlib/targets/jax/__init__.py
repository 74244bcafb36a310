"""Functions of whole signals, for batches and gradients."""

"""The JAX target: functions of whole signals, for batches and gradients."""

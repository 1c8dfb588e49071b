"""A run folder opened: log-probabilities, as trained or as fast as this machine can."""

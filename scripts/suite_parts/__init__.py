"""The suite: one setting on many environments, beside SAC without a model."""

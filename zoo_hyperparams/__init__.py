"""rl_zoo3 hyperparameters of the package's environments, one YAML file an algorithm."""

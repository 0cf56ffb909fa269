"""The benchmark: exact minimal surfaces beside discrete ones and beside hole fillers, measured in one run."""

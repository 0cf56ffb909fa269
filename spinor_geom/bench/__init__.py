"""The benchmark: exact minimal surfaces compared with discrete ones and with other hole fillers."""

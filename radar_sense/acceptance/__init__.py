"""Verdicts on a flight: the threshold test, poses between the rows, and implausible scenarios."""

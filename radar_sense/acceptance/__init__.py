"""Verdicts on a flight: the threshold test, and poses between the rows."""

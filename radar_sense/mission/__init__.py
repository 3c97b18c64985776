"""Looks along a path: their times, cumulative probability of detection, and track initiation.

A look is one pulse, or one scan, at one time. Given the states of aircraft and radars, looks are
independent. The states are uncertain. The errors of a radar are constant during a mission, and the
pose errors of the aircraft are correlated in time. The functions return the probability of an event
by each look, and the uncertainty of that probability.
"""

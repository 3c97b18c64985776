"""How often a band, a verdict or a path is wrong: random problems, their truth, and the study."""

"""Random and quasi-random draws of the states, statistics of P_D, and Sobol' indices."""

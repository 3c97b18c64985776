"""Importance sampling of missions: bounds of P_c and of track initiation that need no gradient.

Three methods make 3σ bounds cheap here:

- Given the pose errors, radars are independent. ln(1 − P_c) is a sum over radars. ln(1 − T) is a
  sum over scan groups. The errors of each radar are drawn separately, for a number of pose paths.
  For each pose path, draws of different radars are combined at random. A combination takes no
  evaluation of the detection model.
- The normals come from a mixture of densities with centers in the tails of P. Draws in the tails
  are then frequent. Each draw has the ratio of the densities as its weight. First order and a pilot
  give the centers. These change the standard error of the estimate, but not its mean
  (A. B. Owen, *Monte Carlo theory, methods and examples*, 2013, ch. 9).
- The normals of the mixtures are scrambled Sobol' points.

Everything is done in independent replicates. The spread of the replicates' quantiles gives the
standard errors of the bounds.

Data flow through the files: `pilot` and `plan` choose the mixtures and numbers of draws.
`replicates` draws the states with `mixtures`, computes the `events` of each radar, and merges
radars with `combinations`. `sampling` turns the `quantiles` of all replicates into bounds.
"""

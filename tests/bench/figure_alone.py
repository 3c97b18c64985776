"""The least work of `radar-sense budget`: NumPy, SciPy's special functions, and one figure.

The figure has the size, the number of lines and the resolution of the figure of `budget`.
"""

import sys

import matplotlib as mpl
import numpy as np
import scipy.special
from matplotlib.figure import Figure

mpl.rcParams["pdf.fonttype"] = 42
figure = Figure(figsize=(3.5, 2.9), layout="constrained")
axes = figure.subplots()
x = np.linspace(0.0, 180.0, 361)
for i in range(5):
    axes.plot(x, scipy.special.ndtr(np.sin(np.radians(x)) / (i + 1)), label=f"source {i + 1}")
axes.set_xlabel("azimuth [deg]")
axes.set_ylabel("three standard deviations")
figure.legend(loc="outside lower center", ncols=2)
figure.savefig(sys.argv[1], dpi=300)

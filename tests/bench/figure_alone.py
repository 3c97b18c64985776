"""What `radar-sense budget` cannot do without: Python, NumPy, Matplotlib, and one figure saved.

Its fonts are TrueType, as journals want them; Matplotlib's own default, Type 3, is saved faster.
"""

import sys

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

mpl.rcParams["pdf.fonttype"] = 42
figure = Figure(figsize=(3.5, 2.9), layout="constrained")
axes = figure.subplots()
x = np.linspace(0.0, 180.0, 361)
for i in range(5):
    axes.plot(x, np.sin(np.radians(x)) / (i + 1), label=f"source {i + 1}")
axes.set_xlabel("azimuth [deg]")
axes.set_ylabel("three standard deviations")
figure.legend(loc="outside lower center", ncols=2)
figure.savefig(sys.argv[1])

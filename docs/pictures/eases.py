"""The picture of the eases of heavy things: `python docs/pictures/eases.py` writes eases.svg."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from flowsculpt.pipeline.flow.easings import HAND_EASES, easing

NUMBERS = {"settle": (0.05, 0.15, 0.4), "drop": (0.0, 0.3, 0.6), "drag": (0.5, 0.7, 0.85)}
SHADES = ("#9fb4c4", "#12344d", "#c8452e")


def main() -> None:
    mpl.rcParams.update({"svg.hashsalt": "eases", "svg.fonttype": "none"})
    figure, axes = plt.subplots(1, 3, figsize=(9, 2.6), sharey=True, layout="constrained")
    share = np.linspace(0.0, 1.0, 121)
    for plot, (name, numbers) in zip(axes, NUMBERS.items(), strict=True):
        plot.axhline(1.0, color="#dddddd", linewidth=0.8)
        for number, colour in zip(numbers, SHADES, strict=True):
            is_default = number == HAND_EASES[name][1]
            ease = easing(f"{name} {number}")
            label = f"{number:g}{' (default)' if is_default else ''}"
            width = 1.8 if is_default else 1.0
            plot.plot(share, [ease(float(s)) for s in share], color=colour, label=label, linewidth=width)
        plot.set(title=name, xticks=[0, 1], yticks=[0, 1], ylim=(-0.05, 1.48))
        plot.spines[["top", "right"]].set_visible(False)
        plot.legend(frameon=False, fontsize=8, loc="lower right" if name == "settle" else "upper left")
    figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()

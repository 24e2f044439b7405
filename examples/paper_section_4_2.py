"""Section 4.2 of Wang & Yang (2021): the double pendulum, with tolerances of the lengths of 5, 10, 15 and 20 %.

`python examples/paper_section_4_2.py FOLDER` draws the paper's Figs. 7 and 8 into FOLDER (default: the current folder).
The pictures also show the bounds of a better polynomial chaos expansion.
"""

import sys
from pathlib import Path

import symmb as mb

sys.path.insert(0, str(Path(__file__).parents[1]))
from symmb.models.double_pendulum import scene

SPREADS = (0.05, 0.10, 0.15, 0.20)
METHODS = (mb.PolynomialChaos.paper(order=2), mb.Taylor(order=2), mb.PolynomialChaos(order=8))


def compare(spread: float) -> mb.Comparison:
    """Comparison of the paper's methods and ours with a fine scan, at one level of uncertainty."""
    pendulum = scene()
    box = mb.Box.around(pendulum.system.parameters, spread)
    return mb.compare(pendulum, METHODS, box, reference=mb.Scanning(21))


comparisons = {spread: compare(spread) for spread in SPREADS}
errors = {spread: [row.score.error.mean() for row in c.rows] for spread, c in comparisons.items()}

# The paper's finding: its bounds are better than Taylor's, and the difference grows with the uncertainty.
assert all(paper < taylor for paper, taylor, _ in errors.values())
assert errors[0.20][1] / errors[0.20][0] > errors[0.05][1] / errors[0.05][0]
# Better nodes and the exact range of the polynomial reduce the error by more than a factor of 20.
assert all(ours < 0.05 * paper for paper, _, ours in errors.values())


def draw(folder: Path) -> None:
    """Draw Figs. 7 and 8 of the paper."""
    from matplotlib.figure import Figure

    styles = [("tab:red", "--"), ("tab:green", ":"), ("tab:blue", "-")]

    def panel(axes, comparison, name, title):
        i = comparison.outputs.index(name)
        axes.fill_between(
            comparison.times, comparison.reference.lower[:, i], comparison.reference.upper[:, i],
            color="0.82", label=f"reference: {comparison.reference.method}",
        )  # fmt: skip
        for row, (color, line) in zip(comparison.rows, styles, strict=True):
            for side, label in ((row.lower, row.name), (row.upper, None)):
                axes.plot(comparison.times, side[:, i], line, color=color, linewidth=1.1, label=label)
        low, high = comparison.reference.lower[:, i].min(), comparison.reference.upper[:, i].max()
        axes.set_ylim(low - 0.4 * (high - low), high + 0.4 * (high - low))
        axes.set_title(title, fontsize=10, loc="left")
        axes.set_xlabel("time [s]")
        axes.set_xlim(0, 10)

    def figure(panels, path):
        drawn = Figure(figsize=(12, 3.1 * len(panels) / 2), layout="constrained")
        grid = drawn.subplots(len(panels) // 2, 2, squeeze=False)
        for axes, (comparison, name, title, unit) in zip(grid.ravel(), panels, strict=True):
            panel(axes, comparison, name, title)
            axes.set_ylabel(unit)
        drawn.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=9)
        drawn.savefig(path, dpi=110)

    five = comparisons[0.05]
    states = {
        "theta1": "rad",
        "theta2": "rad",
        "x2": "m",
        "theta1_dot": "rad/s",
        "x2_dot": "m/s",
        "theta2_dot": "rad/s",
    }
    figure(
        [(five, name, f"{name}, ± 5 %", f"{name} [{unit}]") for name, unit in states.items()], folder / "figure7.png"
    )
    levels = [(c, "x2_dot", f"x2_dot, ± {100 * s:.0f} %", "x2_dot [m/s]") for s, c in comparisons.items()]
    figure(levels, folder / "figure8.png")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    draw(folder)
    for spread, comparison in comparisons.items():
        print(f"± {100 * spread:.0f} %\n{comparison}\n")
    print(f"Figs. 7 and 8: {folder / 'figure7.png'}, {folder / 'figure8.png'}")

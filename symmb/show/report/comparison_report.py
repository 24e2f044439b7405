"""The report of a comparison."""

from collections.abc import Iterator
from pathlib import Path

from symmb import _html as html
from symmb.results.files import require_suffix
from symmb.show.report import document
from symmb.show.report.document import assumed, called, section, seed, settings_table
from symmb.study import Comparison


def write_comparison(comparison: Comparison, path: str | Path, command: str = "") -> None:
    """Write the report of a comparison; see `Comparison.report`."""
    require_suffix(path, ".html")
    document.write(path, f"Comparison of {comparison.scene}", _parts(comparison, command), {})


def _parts(comparison: Comparison, command: str) -> Iterator[str]:
    yield document.warnings(comparison.doubts)
    yield section("Methods", comparison._repr_html_(), style="methods")
    methods = [row.name for row in comparison.rows]
    seeds = [f"{number} of {name}" for name in methods if (number := seed(name))]
    settings = [
        ("methods", ", ".join(methods)),
        ("seeds", ", ".join(seeds)),
        ("reference", comparison.reference.method),
        ("solver", comparison.solver),
        ("why this solver", comparison.reason),
    ]
    yield assumed(comparison.box, {})
    yield settings_table(settings)
    runs = sum(row.evaluations for row in comparison.rows)
    took = sum(row.run_seconds for row in comparison.rows if row.run_seconds > 0)
    cost = f"The methods made {runs} runs in {took:.3g} s. The reference: {comparison._reference()}."
    yield section("Cost", document.note(cost))
    subject = "scene" if comparison.solver else "simulator"
    solver = f"solver={called(comparison.solver)}" if comparison.solver else ""
    call = ", ".join(filter(None, [subject, f"[{called(*methods)}]", called(repr(comparison.box)), solver]))
    lines = f'import symmb as mb\ncomparison = mb.compare({call})\ncomparison.report("report.html")'
    yield section("How to repeat it", html.text(command or lines))

"""Results with a plot method: one panel for each output over time, or three diagrams."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from symmb import _html as html
from symmb._table import aligned
from symmb._units import told_names
from symmb.results import plot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS = 6
"""Largest number of outputs with panels. With more outputs the panels are too small to read."""


class Panels:
    """A result that prints as a heading above a table. The picture has one panel for each output."""

    if TYPE_CHECKING:
        names: Any
    _left: ClassVar[Collection[int]] = (0,)
    """Columns of the table that are aligned on the left."""
    _most: ClassVar[int | None] = MOST_PANELS
    """Largest number of outputs that a notebook shows; None: all."""

    def _head(self) -> str:
        raise NotImplementedError

    def _rows(self, names: Sequence[str]) -> list[list[str]]:
        """The table, with these names instead of the names of the outputs."""
        raise NotImplementedError

    def _figure(self, columns: list[int] | None, style: "plot.Style") -> "Figure":
        """The picture of some outputs, or of all outputs."""
        raise NotImplementedError

    def _told_names(self) -> Sequence[str]:
        return told_names(self.names, getattr(self, "units", ()), getattr(self, "parameters", None))

    def __str__(self) -> str:
        table = ["", *aligned(self._rows(self._told_names()), self._left)] if self.names else []
        return "\n".join([self._head(), *table])

    def _tabulated(self) -> str:
        """The head and the table as HTML."""
        rows = self._rows(plot.labels(self.names, getattr(self, "units", ()))) if self.names else []
        return html.page(html.text(self._head()), html.table(rows, self._left) if rows else "")

    def _repr_html_(self) -> str:
        picture = html.picture(plot.png(self._drawn(outputs=self.names[: self._most]))) if self.names else ""
        return html.page(self._tabulated(), picture)

    def _drawn(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        **look: Any,
    ) -> "Figure":
        owner = f"{type(self).__name__}.plot"
        figure = self._figure(plot.columns_of(owner, outputs, self.names), plot.Style(owner, ax, **look))
        return plot.finish(figure, owner, path, ax, figsize, title)


class OverTime(Panels):
    """Outputs over time."""

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        **look: Any,
    ) -> "Figure":
        """Draw outputs over time, as in the help of the class. If `path` is given, write the picture to this file.

        Parameters
        ----------
        outputs : str or list
            the outputs to draw; default: all
        ax : matplotlib Axes
            axes to draw in, instead of a new figure: one for each output, or (only a trajectory) one for all outputs
        figsize : (width, height)
            size of a new figure [inch]
        title : str
            title of a new figure, instead of the default title
        label, color : str or list
            name and color of the curves: one value, or a list with a value for each curve
        legend : bool
            whether there is a legend

        Raises
        ------
        DeclarationError
            If an option is wrong
        FileError
            If the file cannot be written. A previous file is kept
        """
        return self._drawn(path, outputs, ax, figsize, title, **look)


class OverTimeBesideGiven(Panels):
    """Outputs over time, together with given limits or data."""

    def plot(
        self,
        path: str | Path | None = None,
        outputs: str | Sequence[str] | None = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        **look: Any,
    ) -> "Figure":
        """Draw outputs over time, as in the help of the class. `Trajectory.plot` has the same options and errors."""
        return self._drawn(path, outputs, ax, figsize, title, **look)


class ThreeDiagrams:
    """A result that prints as text, with a picture of three diagrams."""

    def __repr__(self) -> str:
        return str(self)

    def _figure(self, style: "plot.Style") -> "Figure":
        """The picture, in a new figure or in up to three axes of the caller."""
        raise NotImplementedError

    def plot(
        self,
        path: str | Path | None = None,
        ax: "Axes | Sequence[Axes] | None" = None,
        figsize: tuple[float, float] | None = None,
        title: str | None = None,
        **look: Any,
    ) -> "Figure":
        """Draw the diagrams in the help of the class. If `path` is given, write the picture to this file.

        Parameters
        ----------
        ax : matplotlib Axes
            axes to draw in, instead of a new figure: up to three, in the order of the diagrams
        figsize : (width, height)
            size of a new figure [inch]
        title : str
            title of a new figure, instead of the default title
        label, color : str or list
            name and color of the curves: one value, or a list with a value for each curve
        legend : bool
            whether there is a legend

        Raises
        ------
        DeclarationError
            If an option is wrong
        FileError
            If the file cannot be written. A previous file is kept
        """
        owner = f"{type(self).__name__}.plot"
        return plot.finish(self._figure(plot.Style(owner, ax, **look)), owner, path, ax, figsize, title)

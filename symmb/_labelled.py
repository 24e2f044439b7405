"""Arrays with named dimensions for xarray and pandas. These packages are optional, and are loaded on demand."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from symmb._errors import DeclarationError
from symmb._names import look_up_by_name
from symmb._options import optional_package, require_name
from symmb._units import units_of_parameters

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

Named = tuple[tuple[str, ...], Any]
"""Names of the dimensions of an array, and the array."""
BOUND = ("lower", "upper")


@dataclass(frozen=True)
class Labelled:
    """Arrays with named dimensions, with coordinates and attributes.

    Attributes
    ----------
    coordinates, variables : dict      name -> (names of its dimensions, array)
    attributes : dict                  name -> text or number; attributes that are None are left out
    units : dict                       variable or coordinate -> unit
    rows : tuple of str                dimensions that become rows of a table
    """

    coordinates: Mapping[str, Named]
    variables: Mapping[str, Named]
    attributes: Mapping[str, str | float | None] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    rows: Sequence[str] = ("method", "sample", "time", "output")

    def to_xarray(self) -> "Dataset":
        """A Dataset with texts and numbers as attributes, so that every NetCDF engine can write the Dataset."""
        xarray = optional_package("xarray", "to_xarray", "data")

        def entries(named: Mapping[str, Named]) -> dict[str, Any]:
            return {name: (*pair, self._attributes_of(name)) for name, pair in named.items()}

        return xarray.Dataset(entries(self.variables), entries(self.coordinates), self._attributes)

    def to_pandas(self) -> "DataFrame":
        """A table with a row for each time and output, and for each method of a comparison. Both bounds are columns."""
        pandas = optional_package("pandas", "to_pandas", "data")
        dims = [name for name in self.rows if self.coordinates.get(name, ((),))[0] == (name,)]  # not a parameter's name
        sizes = [len(self.coordinates[name][1]) for name in dims]
        columns: dict[str, Any] = {}
        for name, (own, values) in {**self.coordinates, **self.variables}.items():
            if name != "bound" and self._is_column(name, own, dims):
                for column, part in _columns(name, own, np.asarray(values)):
                    rows = tuple(dim for dim in own if dim != "bound")
                    columns[column] = _spread(rows, part, dims, sizes)
        order = [*dims, *(name for name in columns if name not in dims)]
        frame = pandas.DataFrame({name: columns[name] for name in order}, copy=True)
        frame.attrs.update(self._attributes)
        return frame

    def _is_column(self, name: str, own: Sequence[str], dims: Sequence[str]) -> bool:
        """Whether a variable belongs in a table. If the table has no times, all variables belong in it."""
        is_series = "time" in own or name in self.coordinates or "time" not in dims
        return is_series and set(own) <= {*dims, "bound"}

    @property
    def _attributes(self) -> dict[str, str | float]:
        return {name: value for name, value in self.attributes.items() if value is not None}

    def _attributes_of(self, name: str) -> dict[str, str]:
        return {"units": self.units[name]} if self.units.get(name) else {}


class NamedColumns(np.ndarray):
    """Values (n_t, n_y) of outputs. Columns can be selected by name. The values are read-only; copies are writable.

    Results of calculations with these values have no names.
    """

    names: tuple[str, ...] = ()

    def __new__(cls, values: np.ndarray, names: Sequence[str]) -> "NamedColumns":
        columns = np.asarray(values).view(cls)
        columns.names, columns.flags.writeable = tuple(names), False
        return columns

    def __getitem__(self, key: Any) -> Any:
        values = self.view(np.ndarray)
        if isinstance(key, str):
            return values[:, self.names.index(require_name("Bounds", "output", key, self.names))]
        return values[key]

    def __array_wrap__(self, array: np.ndarray, context: Any = None, return_scalar: bool = False) -> Any:
        return array[()] if return_scalar else array

    def __reduce__(self) -> tuple[Any, ...]:
        return NamedColumns, (self.view(np.ndarray), self.names)

    def copy(self, order: Literal["K", "A", "C", "F"] = "C") -> "NamedColumns":
        columns = NamedColumns(self.view(np.ndarray).copy(order), self.names)
        columns.flags.writeable = True
        return columns

    def __deepcopy__(self, memo: Any) -> "NamedColumns":
        return NamedColumns(self.copy(), self.names)

    __copy__: Any = copy


class Counted:
    """A result that reports the number of its runs."""

    evaluations: Any

    @property
    def runs(self) -> int:
        """Another name of `evaluations`."""
        return self.evaluations


class Result:
    """A result that prints as text, and that can be converted to xarray and pandas."""

    __post_init__ = look_up_by_name

    def __repr__(self) -> str:
        return str(self)

    def _labelled(self) -> Labelled:
        raise NotImplementedError

    def to_xarray(self) -> "Dataset":
        """The result as an xarray.Dataset. `to_netcdf` writes the Dataset to a file.

        The dimensions are time and output, in bounds also bound (lower, upper), and in comparisons also method.
        Select a method by `sel({"method": "Vertex()"})`, because `sel(method=...)` has another meaning in xarray.
        Parameters are coordinates. One run has a coordinate for each parameter, and bounds have the coordinate `box`.
        Parameters of failed runs have the dimension sample. Units, method and warnings (`doubts`) are attributes.

        Raises
        ------
        ImportError
            If xarray is not installed
        """
        return self._labelled().to_xarray()

    def to_pandas(self) -> "DataFrame":
        """The result as a pandas.DataFrame with one row for each time and output, and for each method of a comparison.

        Raises
        ------
        ImportError
            If pandas is not installed
        """
        return self._labelled().to_pandas()


class ByOutput:
    """A result with values for the outputs in `names`. A loop over the result gives the names of the outputs."""

    if TYPE_CHECKING:
        names: Any

        def __getitem__(self, name: str) -> Any: ...

    def __contains__(self, name: object) -> bool:
        try:
            self[name]  # pyright: ignore[reportArgumentType]
        except DeclarationError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)


def _columns(name: str, dims: Sequence[str], values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Columns of a variable, with their names. A variable with bounds has two columns, such as lower and upper."""
    if "bound" not in dims:
        return [(name, values)]
    prefix = "" if name == "value" else f"{name}_"
    return [(prefix + bound, np.take(values, k, dims.index("bound"))) for k, bound in enumerate(BOUND)]


def _spread(own: Sequence[str], values: np.ndarray, dims: list[str], sizes: Sequence[int]) -> np.ndarray:
    """Values over the dimensions `own` as one column over all `dims`. Values repeat along dimensions not in `own`."""
    order = np.argsort([dims.index(name) for name in own])
    ordered = np.transpose(values, order.tolist())
    shape = [size if dim in own else 1 for dim, size in zip(dims, sizes, strict=True)]
    return np.broadcast_to(ordered.reshape(shape), sizes).ravel()


def over_outputs(
    t: np.ndarray, names: Sequence[str], units: Sequence[str], *alike: str
) -> tuple[dict[str, Named], dict[str, str]]:
    """Coordinates of values over times and outputs, and their units.

    If all outputs have the same unit, the variables named in `alike` have this unit.
    """
    coordinates: dict[str, Named] = {"time": (("time",), t), "output": (("output",), texts(names))}
    if any(units):
        coordinates["unit"] = (("output",), texts(units))
    return coordinates, {"time": "s"} | (dict.fromkeys(alike, units[0]) if len({*units}) == 1 else {})


def over_parameters(names: Iterable[str], units: Mapping[str, str]) -> dict[str, Named]:
    """Coordinates of values over parameters. `parameter_unit` is a further coordinate if a parameter has a unit."""
    own = {"parameter": [*names]} | ({"parameter_unit": [units.get(name, "") for name in names]} if units else {})
    return {name: (("parameter",), texts(some)) for name, some in own.items()}


def each_parameter(
    values: Mapping[str, Any], dims: tuple[str, ...], taken: Sequence[str]
) -> tuple[dict[str, Named], dict[str, str]]:
    """A coordinate over `dims` for each parameter, and the units. `parameter_names` gives the names."""
    names, units = parameter_names([*values], taken), units_of_parameters(values)
    of_names = {name: units[own] for name, own in zip(names, values, strict=True) if own in units}
    return dict(zip(names, [(dims, value) for value in values.values()], strict=True)), of_names


def known(variables: Mapping[str, Named]) -> dict[str, Named]:
    """The variables with an array. Variables with None are left out."""
    return {name: named for name, named in variables.items() if named[1] is not None}


def unit_text(names: Sequence[str], units: Sequence[str]) -> str | None:
    """Names and units of the outputs that have a unit, as text for an attribute."""
    return ", ".join(f"{name}: {unit}" for name, unit in zip(names, units, strict=False) if unit) or None


def texts(values: Sequence[str]) -> np.ndarray:
    return np.array([str(value) for value in values], dtype=object)


def parameter_names(names: Sequence[str], taken: Sequence[str]) -> list[str]:
    """Names of coordinates for parameters. If a name is in `taken`, "parameter_" is put before it."""
    free = []
    for name in (name.replace("/", "_") for name in names):
        while name in (*taken, *free):
            name = f"parameter_{name}"
        free.append(name)
    return free

"""Cross-sections and materials of beams."""

import math
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import casadi as ca

from symmb._errors import DeclarationError
from symmb._types import Expr
from symmb.declare.structures.validation import is_law, numbers, positive_law

NU = 0.3
"""Poisson's ratio for the shear areas of circles and rectangles. Shear areas hardly depend on this ratio."""


@dataclass(frozen=True)
class Section:
    """Properties of a cross-section about its centroid, in its principal axes y and z; the beam runs along x.

    All properties may be expressions of parameters. Pass the values of the parameters to `FiniteElements.beams(...,
    at=...)`.

    Parameters
    ----------
    area : Expr
        area A [m^2]
    Iy, Iz : Expr
        second moments ∫ z² dA and ∫ y² dA [m^4]: bending in the x-z and in the x-y plane
    J : Expr
        torsion constant [m^4]; Iy + Iz for a circle only
    shear_y, shear_z : Expr
        effective shear areas κA along y and z [m^2]. Infinite shear areas (the default) make an Euler-Bernoulli beam,
        and finite shear areas make a Timoshenko beam

    Raises
    ------
    DeclarationError
        If a property is not a number above 0.

    Examples
    --------
    >>> import symmb as mb
    >>> bar = mb.Section.circle(0.01)
    >>> f"{bar.area:.4e}", f"{bar.J / bar.Iy:.1f}", bar.without_shear().shear_y
    ('3.1416e-04', '2.0', inf)
    """

    area: Expr
    Iy: Expr
    Iz: Expr
    J: Expr
    shear_y: Expr = math.inf
    shear_z: Expr = math.inf

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            stiff = field.name.startswith("shear") and is_rigid(value)
            object.__setattr__(self, field.name, math.inf if stiff else positive_law(value, "Section", field.name))

    @classmethod
    def circle(cls, radius: Expr, inner: Expr = 0.0) -> "Section":
        """Solid or hollow circle of outer and inner radius [m].

        Shear areas follow from Cowper's formula at Poisson's ratio 0.3 (G. R. Cowper, The shear coefficient in
        Timoshenko's beam theory, J. Appl. Mech. 33 (1966)).
        """
        R = positive_law(radius, "Section.circle", "radius")
        r = inner if is_law(inner) else float(numbers(inner, "Section.circle", "inner"))
        if not (is_law(R) or is_law(r) or 0 <= r < R):
            raise DeclarationError(f"Section.circle: inner must be between 0 and the radius {R:g}, got {r:g}.")
        area, second, m2 = math.pi * (R**2 - r**2), math.pi / 4 * (R**4 - r**4), (r / R) ** 2
        kappa = 6 * (1 + NU) * (1 + m2) ** 2 / ((7 + 6 * NU) * (1 + m2) ** 2 + (20 + 12 * NU) * m2)
        return cls(area, second, second, 2 * second, kappa * area, kappa * area)

    @classmethod
    def rectangle(cls, width: Expr, height: Expr) -> "Section":
        """Solid rectangle, width along y and height along z [m].

        The torsion constant follows from Saint-Venant's series (S. P. Timoshenko, J. N. Goodier, Theory of Elasticity,
        art. 109). Shear areas follow from Cowper's formula, as for `circle`.
        """
        b, h = positive_law(width, "Section.rectangle", "width"), positive_law(height, "Section.rectangle", "height")
        law = is_law(b) or is_law(h)
        tanh: Callable[[Expr], Expr] = ca.tanh if law else math.tanh
        long, short = (ca.fmax(b, h), ca.fmin(b, h)) if law else (max(b, h), min(b, h))
        series = sum(tanh(n * math.pi * long / (2 * short)) / n**5 for n in range(1, 40, 2))
        J = long * short**3 * (1 / 3 - 64 * short / (math.pi**5 * long) * series)
        kappa = 10 * (1 + NU) / (12 + 11 * NU)
        return cls(b * h, b * h**3 / 12, h * b**3 / 12, J, kappa * b * h, kappa * b * h)

    def without_shear(self) -> "Section":
        """The same section without shear deformation, for an Euler-Bernoulli beam."""
        return replace(self, shear_y=math.inf, shear_z=math.inf)


def is_rigid(shear: Expr) -> bool:
    """Whether a shear area is infinite."""
    return isinstance(shear, float) and shear == math.inf


@dataclass(frozen=True)
class Material:
    """A linear elastic, isotropic material, in numbers or in expressions of parameters.

    Parameters
    ----------
    E : Expr
        Young's modulus [Pa]
    density : Expr
        density [kg/m^3]
    nu, G : Expr
        Poisson's ratio nu, or shear modulus G [Pa]: pass one of the two

    Raises
    ------
    DeclarationError
        If both or none of nu and G are given, if a value is not a number above 0, or if nu is not in (-1, 0.5].

    Examples
    --------
    >>> import symmb as mb
    >>> mb.Material(E=200e9, density=7850, nu=0.25).shear_modulus
    80000000000.0
    """

    E: Expr
    density: Expr
    nu: Expr | None = None
    G: Expr | None = None

    def __post_init__(self) -> None:
        if (self.nu is None) == (self.G is None):
            raise DeclarationError("Material: give either nu or G, with G = E/(2 (1 + nu)).")
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None and field.name != "nu":
                object.__setattr__(self, field.name, positive_law(value, "Material", field.name))
        if self.nu is not None and not is_law(self.nu):
            object.__setattr__(self, "nu", float(numbers(self.nu, "Material", "nu")))
            if not -1 < self.nu <= 0.5:
                raise DeclarationError(f"Material: nu must be above -1 and at most 0.5, got {self.nu:g}.")

    @property
    def shear_modulus(self) -> Expr:
        """Shear modulus G [Pa]."""
        return self.G if self.nu is None else self.E / (2 * (1 + self.nu))

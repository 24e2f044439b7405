"""Random inputs: roads, gusts and other random functions of way or time, as sums of waves."""

import math
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, field
from zlib import crc32

import casadi as ca
import numpy as np

from symmb._errors import DeclarationError
from symmb._options import accepts, is_finite_number, is_whole, numbers_of, shown
from symmb._types import Expr
from symmb.declare.mechanics.state import Input
from symmb.declare.symbolic import Kind, given, is_time, records_in

_WAVES = 16
"""Number of waves per octave. The resonance of a car body has ten of them, so that its motion is almost Gaussian."""
LEVELS, _BALANCED = 16, 1024
"""Number of amplitudes and of frequencies of a wave, and number of successive seeds of a balanced set. In such a set,
products of two waves that are less than two octaves apart cancel. With fewer levels, products of more waves cancel, but
peaks have larger errors."""
_MOST_OCTAVES = 20
_CLASSES = "ABCDEFGH"


@dataclass(frozen=True, eq=False)
class RandomInput(Input):
    """A stationary Gaussian function of way or time with a given spectrum. A RandomInput is an element of the System.

    `road(x)` is the value at the way or time x, as an expression for laws. It is a sum of 16 waves per octave of the
    band, with random phases and amplitudes. The seed of a run selects the phases and amplitudes. A run of `simulate`
    has the seed 0, and `scene.with_inputs(["road"])` has the seed as a parameter with the name of the input.

    Studies such as `propagate` average scalar outputs over the runs with the seeds 0, 1, 2, ... These seeds are the
    same for all parameters, so that averages depend smoothly on parameters.

    The seeds 0 to 1023 are a balanced set: in a linear system, products of waves that are less than two octaves apart
    cancel in the mean square over these seeds. An octave repeats after 16 of its longest waves.

    Parameters
    ----------
    name : str
        without dots
    spectrum : function
        one-sided spectral density [unit of the value squared times the unit of x] as a function of the frequency
        [cycles per unit of x]. The function gets CasADi expressions, and may use parameters and a `Table`
    band : (2,)
        lowest and highest frequency of the waves [cycles per unit of x], at most 20 octaves apart
    realizations : int
        number of seeds over which studies average; default: 1024

    Raises
    ------
    DeclarationError
        If the band has no waves, or if the spectrum is negative or not finite in the band

    References
    ----------
    Shinozuka, Jan (1972), Digital simulation of random processes and its applications, J. Sound Vib. 25.

    Examples
    --------
    >>> import numpy as np
    >>> import symmb as mb
    >>> cart = mb.Body("cart", mass=2.0, pose=mb.Particle())
    >>> gust = mb.RandomInput("gust", lambda f: 9 / (1 + f**2), (0.1, 10.0))
    >>> system = mb.System(cart, gust, mb.Force("wind", cart.point(0, 0), (gust(mb.t) - cart.vx, 0)))
    >>> outputs = {"speed": mb.rms(cart.vx, window=(5.0, None))}
    >>> scene = mb.Scene(system, times=np.linspace(0, 15, 601), outputs=outputs)
    """

    spectrum: Callable[[ca.SX], Expr]
    band: tuple[float, float]
    _: KW_ONLY
    realizations: int = _BALANCED
    ways: list[ca.SX] = field(init=False, repr=False)
    _waves: tuple[ca.SX, ca.SX, ca.SX] = field(init=False, repr=False)  # place in intervals, cosines, sines

    def __post_init__(self) -> None:
        super().__post_init__()
        if fault := self._fault():
            raise DeclarationError(f"{self.title}: {fault}")
        object.__setattr__(self, "ways", [])
        object.__setattr__(self, "_waves", self._drawn())

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "spectrum": None}  # the waves contain it, and a pickle cannot contain a lambda function

    def _fault(self) -> str:
        if not accepts(self.spectrum, "frequency"):
            return f"the spectrum must be a function of the frequency alone, got {shown(self.spectrum)}."
        band = numbers_of(self.band)
        if band is None or band.shape != (2,) or not np.isfinite(band).all():
            return f"band must be a pair of frequencies, such as (0.01, 10.0), got {shown(self.band)}."
        if not 0 < band[0] < band[1]:
            return f"the band {shown(self.band)} has no waves. Give a positive frequency, then a higher one."
        if band[1] > 2**_MOST_OCTAVES * band[0]:
            return f"the band {shown(self.band)} has more than {_MOST_OCTAVES} octaves. Give a narrower band."
        if not is_whole(self.realizations) or self.realizations < 1:
            return f"realizations must be a positive integer, got {shown(self.realizations)}."
        return ""

    @property
    def _octaves(self) -> int:
        return math.ceil(math.log2(self.band[1] / self.band[0]) - 1e-9)

    def _drawn(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The place (0 to 1) of waves in their frequency intervals, and the factors (n,) of cosines and sines."""
        low, high, seed = *self.band, ca.floor(self.value)
        octave, number = np.divmod(np.arange(_WAVES * self._octaves), _WAVES)
        width = high * 2.0 ** (octave - self._octaves) / _WAVES
        begin = (_WAVES + number) * width
        inside = np.maximum(begin + width - np.maximum(begin, low), 0) / width  # of the first waves
        draw = np.random.default_rng(crc32(self.name.encode()))
        # Over the seeds with the same level, phases make different numbers of turns, also with the other sign.
        most = _BALANCED // LEVELS // 2
        turns = draw.permutation(np.arange(1, most))[np.arange(len(width)) % (most - 1)]
        turns = turns + 2 * most * draw.integers(0, LEVELS, len(width))
        first, further = draw.random((2, len(width)))
        # Amplitudes of the second wave of a pair belong to reversed levels, so that amplitudes and frequencies have no
        # common trend.
        pairs = len(width) // 2
        step, begin_level = 2 * draw.integers(0, LEVELS // 2, pairs) + 1, draw.integers(0, LEVELS, pairs)
        steps = np.stack([step, -step], axis=1).ravel()
        begins = np.stack([begin_level, begin_level + (LEVELS - 1) * step], axis=1).ravel() + LEVELS**2
        level, cosines, sines = ca.fmod(seed, LEVELS), [], []
        place = (level + 0.5) / LEVELS  # each level has its own frequencies
        exponential = -np.log((np.arange(LEVELS) + 0.5) / LEVELS)
        for k in range(len(width)):
            energy = -ca.log((ca.fmod(int(steps[k]) * level + int(begins[k]), LEVELS) + 0.5) / LEVELS)
            density = self._density(float(begin[k]), float(width[k]), place) if inside[k] else ca.SX(0)
            amplitude = ca.sqrt(2 * density * float(width[k] * inside[k] / exponential.mean()) * energy)
            turn = int(turns[k]) * seed / _BALANCED + float(first[k]) + ca.floor(seed / _BALANCED) * float(further[k])
            cosines.append(amplitude * ca.cos(2 * np.pi * turn))
            sines.append(amplitude * ca.sin(2 * np.pi * turn))
        return ca.SX(place), ca.vertcat(*cosines), ca.vertcat(*sines)

    def _density(self, begin: float, width: float, place: ca.SX) -> ca.SX:
        """The spectral density at the place of the seed in an interval of frequencies."""
        frequency = begin + width / 2
        density, value = given(self.spectrum(begin + width * place)), given(self.spectrum(ca.SX(frequency)))
        if density is None or value is None or density.numel() != 1:
            raise DeclarationError(f"{self.title}: the spectrum must return a number or a CasADi SX expression.")
        if value.is_constant() and not 0 <= float(value) < math.inf:
            raise DeclarationError(
                f"{self.title}: the spectrum is {float(value):g} at the frequency {frequency:g}. A spectral density is "
                "finite and not negative."
            )
        return density

    def __call__(self, at: Expr) -> ca.SX:
        """The value at a way or time, which is an expression such as `p.speed * mb.t`."""
        way = given(at)
        if way is None or way.numel() != 1:
            raise DeclarationError(f"{self.title}: expected an expression of way or time, got {shown(at)}.")
        moves = any(map(is_time, ca.symvar(way))) or any(r.kind is not Kind.PARAMETER for r in records_in(way))
        if not moves:
            raise DeclarationError(f"{self.title}: the way {shown(at)} does not change. Use an expression of time.")
        self.ways.append(way)
        place, A, B = self._waves
        angle = 2 * np.pi * self.band[1] / 2**self._octaves / _WAVES * way  # of a frequency interval
        z, lowest = _unit(angle), _unit((_WAVES + place) * angle)
        total = ca.SX(0)
        for octave in range(self._octaves):
            # Clenshaw's sums of A[m] z^m and B[m] z^m, where z is a unit complex number.
            sums = []
            for C in (A, B):
                b, b_next = ca.SX(0), ca.SX(0)
                for m in reversed(range(_WAVES)):
                    b, b_next = C[octave * _WAVES + m] + 2 * z[0] * b - b_next, b
                sums.append((b - b_next * z[0], b_next * z[1]))
            (a_re, a_im), (b_re, b_im) = sums
            total += lowest[0] * (a_re + b_im) - lowest[1] * (a_im - b_re)
            z, lowest = _square(z), _square(lowest)
        return total


class RoadProfile(RandomInput):
    """The profile of a road as a random function of the way [m], by ISO 8608. See `RandomInput`.

    The spectral density at the spatial frequency n is G(n) = roughness (n / n0)^(-waviness), with n0 = 0.1 cycles/m.

    Parameters
    ----------
    name : str
        without dots
    roughness : str or SX
        class of the road from "A" (very good) to "H", or G(n0) [m^3]. It may be an expression of parameters. Class A is
        16e-6 m^3, and each class is four times the class before
    band : (2,)
        lowest and highest spatial frequency [cycles/m]; default: the octave bands of ISO 8608
    waviness : float
        exponent w [-]
    realizations : int
        number of roads over which studies average; default: 1024

    References
    ----------
    ISO 8608 (2016), Mechanical vibration, Road surface profiles, Reporting of measured data, annex C.

    Examples
    --------
    >>> import symmb as mb
    >>> p = mb.Parameters(speed=20.0)
    >>> road = mb.RoadProfile("road", "C")
    >>> height = road(p.speed * mb.t)
    """

    def __init__(
        self,
        name: str,
        roughness: Expr | str,
        band: tuple[float, float] = (0.011, 2.83),
        *,
        waviness: float = 2.0,
        realizations: int = _BALANCED,
    ) -> None:
        density = given(
            16e-6 * 4.0 ** _CLASSES.index(roughness)
            if isinstance(roughness, str) and roughness in [*_CLASSES]
            else roughness
        )
        if density is None or density.numel() != 1:
            raise DeclarationError(
                f"RoadProfile: roughness must be a class from 'A' to 'H' or a density in m^3, got {shown(roughness)}."
            )
        if not is_finite_number(waviness):
            raise DeclarationError(f"RoadProfile: waviness must be a number, got {shown(waviness)}.")
        own, n0 = density, 0.1
        super().__init__(name, lambda n: own * (n / n0) ** -waviness, band, realizations=realizations)


def _unit(angle: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The unit complex number with an angle."""
    return ca.cos(angle), ca.sin(angle)


def _square(z: tuple[ca.SX, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """The square of a unit complex number."""
    return 1 - 2 * z[1] * z[1], 2 * z[0] * z[1]

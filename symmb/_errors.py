"""The errors a user meets, one for each stage that can fail."""


class SymmbError(Exception):
    """Root of all errors raised on purpose by symmb."""


class DeclarationError(SymmbError, ValueError):
    """A scene, a system or an option is declared wrongly; the text names the fault and the remedy."""


class AssemblyError(SymmbError, ValueError):
    """The start does not satisfy the constraints, or the constraints are redundant there."""


class SimulationError(SymmbError, RuntimeError):
    """A run broke down; the text names time and parameter values."""


class PropagationError(SymmbError, ValueError):
    """A method asks for something that the simulator at hand cannot give."""


class SymmbWarning(UserWarning):
    """Something that the user should know about a result, or about how it is computed."""

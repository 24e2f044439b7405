"""The end of a proof: what could not be shown."""


class ProofError(RuntimeError):
    """An enclosure cannot be proved; the text says what fails."""

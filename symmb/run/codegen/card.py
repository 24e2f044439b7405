"""Ensembles on a graphics card of NVIDIA. Each thread of the card runs one sample."""

import ctypes
import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from symmb._errors import DeclarationError, SymmbError
from symmb._options import optional_package
from symmb._types import Array, Indices
from symmb.run.codegen import cache
from symmb.run.codegen.engine import Engine, FailedSamples, Lanes, Study
from symmb.run.codegen.model_source import Use

THREADS = 128
"""Threads of a group. A group has four warps, one for each scheduler of a processor of the card."""
KERNELS = "run_samples", "summarize", "count_values"
STRIPES = 16
"""Number of stripes of a reduction, as in c/kernel.h. 12,000 values then have threads for all processors of a card."""
SHARE = 0.5
"""Fraction of the free memory of the card for the data of samples. The rest is for the states of threads."""
_OLD = "The driver of the graphics card is older than the compiler. Update the driver."
_REMEDIES = {
    "CUDA_ERROR_OUT_OF_MEMORY": "The graphics card has too little free memory. Close other programs that use it.",
    **dict.fromkeys(("CUDA_ERROR_INVALID_IMAGE", "CUDA_ERROR_NO_BINARY_FOR_GPU"), _OLD),
}
_FLAGS = ("--device-as-default-execution-space", "--std=c++17", "-w")


class CardError(SymmbError):
    """The graphics card cannot make the runs."""


class Memory(Protocol):
    """Memory of a card. It is freed when it is no longer used."""

    address: int


class Card(ABC):
    """A graphics card, or a processor in its place."""

    @abstractmethod
    def kernels(self, source: str) -> Mapping[str, Any]:
        """The functions `KERNELS` of a source, compiled."""

    @abstractmethod
    def free(self) -> int:
        """Free memory [bytes]."""

    @abstractmethod
    def memory(self, size: int, content: np.ndarray | None = None) -> Memory:
        """New memory of some bytes, with a copy of an array."""

    @abstractmethod
    def read(self, memory: Memory, to: np.ndarray) -> np.ndarray:
        """Copy memory to a contiguous array, and return the array."""

    @abstractmethod
    def launch(self, kernel: Any, groups: int, threads: int, arguments: tuple[int, ...]) -> None:
        """Run groups of threads with these addresses and numbers, and wait for their end."""

    def engine(self, lanes: Lanes, times: Array) -> Engine:
        """The engine whose samples run on this card."""
        return CardEngine(lanes, times, self)


class CudaCard(Card):
    """The first graphics card of this machine, by the driver of NVIDIA and the package `cuda-bindings`.

    Raises
    ------
    ImportError            if the package is missing
    CardError              if the driver or the card is missing
    """

    def __init__(self) -> None:
        self._driver = optional_package("cuda.bindings.driver", "A run on a graphics card", "cuda")
        try:
            self._call("cuInit", 0)
            self._device = self._call("cuDeviceGet", 0)
            self._context = self._call("cuDevicePrimaryCtxRetain", self._device)
        except (RuntimeError, OSError, CardError) as error:
            raise CardError(f"There is no graphics card of NVIDIA with a working driver. {error}") from None

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other)  # all of them are the first card

    def __hash__(self) -> int:
        return hash(type(self))

    def __reduce__(self) -> tuple[Callable[[], "CudaCard"], tuple[()]]:
        return CudaCard, ()

    def _call(self, name: str, *arguments: Any) -> Any:
        """The result of a function of the driver."""
        if hasattr(self, "_context"):
            self._driver.cuCtxSetCurrent(self._context)  # each thread of Python has its own context
        code, *results = getattr(self._driver, name)(*arguments)
        if code != self._driver.CUresult.CUDA_SUCCESS:
            raise CardError(_REMEDIES.get(code.name, f"The graphics card reports {code.name} in {name}."))
        return results[0] if results else None

    @cached_property
    def architecture(self) -> str:
        """The architecture of the card, such as "sm_90"."""
        named = self._driver.CUdevice_attribute
        kinds = (f"CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_{part}" for part in ("MAJOR", "MINOR"))
        return "sm_" + "".join(
            str(self._call("cuDeviceGetAttribute", getattr(named, kind), self._device)) for kind in kinds
        )

    def kernels(self, source: str) -> Mapping[str, Any]:
        module = self._call("cuModuleLoadData", compiled(source, self.architecture))
        return {name: self._call("cuModuleGetFunction", module, name.encode()) for name in KERNELS}

    def free(self) -> int:
        return self._call("cuMemGetInfo")

    def memory(self, size: int, content: np.ndarray | None = None) -> Memory:
        return _CudaMemory(self, size, content)

    def read(self, memory: Memory, to: np.ndarray) -> np.ndarray:
        if to.nbytes:
            self._call("cuMemcpyDtoH", to.ctypes.data, memory.address, to.nbytes)
        return to

    def launch(self, kernel: Any, groups: int, threads: int, arguments: tuple[int, ...]) -> None:
        kinds, sizes = (ctypes.c_long,) * len(arguments), (groups, 1, 1, threads, 1, 1)
        self._call("cuLaunchKernel", kernel, *sizes, 0, 0, (arguments, kinds), 0)
        self._call("cuCtxSynchronize")


class _CudaMemory:
    def __init__(self, card: CudaCard, size: int, content: np.ndarray | None) -> None:
        self._card, self.address = card, int(card._call("cuMemAlloc", max(size, 1)))
        if content is not None and size:
            card._call("cuMemcpyHtoD", self.address, content.ctypes.data, size)

    def __del__(self) -> None:
        if hasattr(self, "address"):
            self._card._driver.cuMemFree(self.address)


def compiled(source: str, architecture: str) -> bytes:
    """A source, compiled for an architecture such as "sm_90". No card is needed. The result is cached.

    Raises
    ------
    ImportError            if the package is missing
    CardError              if the compiler is missing, or does not know the architecture
    """
    nvrtc = optional_package("cuda.bindings.nvrtc", "A run on a graphics card", "cuda")
    try:
        _, *version = nvrtc.nvrtcVersion()
    except RuntimeError:  # the package is there, and the library is not
        raise CardError("The compiler for graphics cards is missing. Run `pip install nvidia-cuda-nvrtc`.") from None
    flags = [f"--gpu-architecture={architecture}", *_FLAGS]
    key = hashlib.sha256("\0".join([source, *flags, str(version)]).encode()).hexdigest()[:32]
    if (path := cache.find(key, ".cubin")) is not None:
        return path.read_bytes()
    _, program = nvrtc.nvrtcCreateProgram(source.encode(), b"scene.cu", 0, [], [])
    (code,) = nvrtc.nvrtcCompileProgram(program, len(flags), [flag.encode() for flag in flags])
    if code != nvrtc.nvrtcResult.NVRTC_SUCCESS:
        log = b" " * nvrtc.nvrtcGetProgramLogSize(program)[1]
        nvrtc.nvrtcGetProgramLog(program, log)
        raise CardError(f"The compiler for graphics cards reports {code.name}: {log.decode(errors='replace')[:500]}")
    binary = b" " * nvrtc.nvrtcGetCUBINSize(program)[1]
    nvrtc.nvrtcGetCUBIN(program, binary)
    cache.keep(key, binary, ".cubin")
    return binary


class Summary(NamedTuple):
    """What is known of the outputs of the samples that did not fail, at each time.

    Attributes
    ----------
    ends, at : (2, n_t, n_y)       smallest and largest values, and the numbers of the first samples that attain them;
                                   inf and -inf without samples
    mean, sigma : (n_t, n_y)       mean and standard deviation; 0 without samples
    """

    ends: Array
    at: Indices
    mean: Array
    sigma: Array


@dataclass
class _Reduction:
    """A reduction: its kernel, number of threads and further arguments, and its state before and after all samples."""

    kernel: str
    threads: int
    state: np.ndarray
    arrays: tuple[Array, ...] = ()
    numbers: tuple[int, ...] = ()


class CardEngine(Engine):
    """An `Engine` whose samples run on a graphics card. Each sample has its own steps.

    Raises
    ------
    DeclarationError       if the solver has implicit steps
    """

    use: Use = "card"

    def __init__(self, lanes: Lanes, times: Array, card: Card) -> None:
        if lanes.scheme is not None:
            raise DeclarationError("Graphics cards run explicit solvers only, such as DormandPrince().")
        self._card = card
        super().__init__(lanes, times)

    def _open(self) -> None:
        self._kernels, self.width = self._card.kernels(self.source), 1

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_kernels"}

    def summary(self, x0: Array, p: Array) -> tuple[Summary, FailedSamples]:
        """The summary of samples, which are those of `values`, and the failed samples."""
        start = np.zeros((7, STRIPES, len(self.times), self.n_y))
        start[0], start[1] = np.inf, -np.inf
        state, failed_samples = self._reduced(x0, p, "summarize", start[0].size, start)
        lower, upper, at_lower, at_upper, n, mean, squares = state
        ends = np.stack([lower.min(axis=0), upper.max(axis=0)])
        both = (lower, at_lower), (upper, at_upper)
        at = [np.where(own == end, place, np.inf).min(axis=0) for (own, place), end in zip(both, ends, strict=True)]
        total = np.maximum(n.sum(axis=0), 1.0)
        mean_of_all = (n * mean).sum(axis=0) / total
        squares += n * np.square(mean - mean_of_all)
        sigma = np.sqrt(squares.sum(axis=0) / total)
        return Summary(ends + 0.0, np.array(at, dtype=np.intp), mean_of_all, sigma), failed_samples

    def histogram(self, x0: Array, p: Array, output: int, ends: Array, bins: int) -> tuple[Indices, FailedSamples]:
        """Numbers (n_t, bins) of samples whose values of an output are in bins, and the failed samples.

        The bins have equal widths between the ends (2, n_t). Values beyond an end are in the bin at this end.
        """
        n_t, ends = len(self.times), np.ascontiguousarray(ends)
        start = np.zeros((n_t, bins), dtype=np.intp)
        return self._reduced(x0, p, "count_values", STRIPES * n_t, start, (ends,), (output, bins))

    def _reduced(self, x0: Array, p: Array, *reduction: Any) -> tuple[np.ndarray, FailedSamples]:
        """The state of a reduction after all samples, and the failed samples."""
        own = _Reduction(*reduction)
        found = self._run(x0, p, None, [own])
        bad = np.flatnonzero(~np.isnan(found.t_failed))
        if self.contacts is not None and bad.size:
            # The events of all samples would take more time than their runs. The failed samples run again for theirs.
            events = self._run(x0[bad], p[bad], None, [None]).events
            events[:, 0] = bad[events[:, 0].astype(np.intp)]
            found = replace(found, events=events)
        return own.state, found

    def _execute(self, study: Study, parts: list[Any]) -> None:
        """Run the samples in portions that fit into the memory of the card. Without a reduction, events are kept."""
        card, reduction = self._card, cast(_Reduction | None, parts[0])
        arrays = {name: array for name, array in study.arrays.items() if array is not None}
        of_samples = {name: array for name, array in arrays.items() if name in _OF_SAMPLES}
        common = self._on_card({name: arrays[name] for name in ("times", "atol")})
        values, study.is_reduced = 8 * study.n_t * self.n_y, "Y" not in arrays
        size = sum(array.nbytes for array in of_samples.values()) + study.is_reduced * values * study.n
        events, states = arrays["events"], []
        if reduction is not None:
            events = events[:0]
            states = [card.memory(array.nbytes, array) for array in (reduction.state, *reduction.arrays)]
        most = max(1, int(SHARE * card.free() * study.n / max(size, 1) / STRIPES)) * STRIPES
        for first in range(0, study.n, most):
            portion = {name: array[first : first + most] for name, array in of_samples.items()}
            n = len(portion["t_failed"])
            memory = {**common, **self._on_card(portion), "events": card.memory(events.nbytes)}
            if study.is_reduced:
                memory["Y"] = card.memory(values * n)
            own = Study.from_buffer_copy(study)
            own.n, own.most_events, own.n_events, own.steps = n, len(events), 0, 0
            for name in (*_OF_SAMPLES, "times", "atol", "events"):
                setattr(own, name, memory[name].address if name in memory else None)
            of_study = np.frombuffer(cast(Any, own), dtype=np.uint8)
            on_card = card.memory(of_study.nbytes, of_study)
            self._launch("run_samples", n, on_card.address)
            if reduction is not None:
                addresses = (state.address for state in states)
                self._launch(
                    reduction.kernel, reduction.threads, on_card.address, first, *addresses, *reduction.numbers
                )
            card.read(on_card, of_study)
            for name in {"t_failed", "Y", "passes"} & portion.keys():
                card.read(memory[name], portion[name])
            if not np.isnan(portion["t_failed"]).all():
                for name in ("failure", "x_failed"):
                    card.read(memory[name], portion[name])
            study.steps += own.steps
            if reduction is None:
                card.read(memory["events"], events[: own.n_events])[:, 0] += first
                study.n_events += own.n_events
                events = events[own.n_events :]
            memory.clear()  # before the next portion takes memory
        if reduction is not None:
            card.read(states[0], reduction.state)

    def _launch(self, kernel: str, threads: int, *arguments: int) -> None:
        self._card.launch(self._kernels[kernel], -(-threads // THREADS), THREADS, arguments)

    def _on_card(self, arrays: Mapping[str, np.ndarray]) -> dict[str, Memory]:
        """Memory of the card for these arrays. Arrays that the card only writes are not copied."""
        kept = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        return {
            name: self._card.memory(array.nbytes, array if name in _INPUTS else None) for name, array in kept.items()
        }


_OF_SAMPLES = {"x0", "p", "t_failed", "failure", "x_failed", "Y", "stops", "passes"}
_INPUTS = {"x0", "p", "times", "atol", "stops", "t_failed", "failure"}

"""Ensembles on a graphics card of NVIDIA. Each thread of the card runs one sample."""

import ctypes
import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np

from symmb._errors import DeclarationError, SymmbError
from symmb._options import optional_package
from symmb._types import Array
from symmb.run.codegen import cache
from symmb.run.codegen.contacts import EVENT
from symmb.run.codegen.engine import Engine, Lanes, Study
from symmb.run.codegen.model_source import Use

THREADS = 128
"""Threads of a group. A group has four warps, one for each scheduler of a processor of the card."""
PARTIAL = 64
"""Number of partial extremes. With 12,000 outputs they take 12 MB, which fit into the cache of a large card."""
SHARE = 0.5
"""Fraction of the free memory of the card for the data of samples. The rest is for the states of threads."""
_FLAGS = ("--device-as-default-execution-space", "--std=c++17", "-w")


class CardError(SymmbError):
    """The graphics card cannot make the runs."""


class Memory(Protocol):
    """Memory of a card. It is freed when it is no longer used."""

    address: int


class Card(ABC):
    """A graphics card, or a processor in its place."""

    @abstractmethod
    def kernel(self, source: str) -> Any:
        """The function `run_samples` of a source, compiled."""

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
    def launch(self, kernel: Any, groups: int, threads: int, pointers: list[int], number: int) -> None:
        """Run groups of threads with these arguments, and wait for their end."""

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

    def __reduce__(self) -> tuple[Callable[[], "CudaCard"], tuple[()]]:
        return CudaCard, ()

    def _call(self, name: str, *arguments: Any) -> Any:
        """The result of a function of the driver."""
        if hasattr(self, "_context"):
            self._driver.cuCtxSetCurrent(self._context)  # each thread of Python has its own context
        code, *results = getattr(self._driver, name)(*arguments)
        if code == self._driver.CUresult.CUDA_ERROR_OUT_OF_MEMORY:
            raise CardError("The graphics card has too little free memory. Close other programs that use it.")
        if code != self._driver.CUresult.CUDA_SUCCESS:
            raise CardError(f"The graphics card reports {code.name} in {name}.")
        return results[0] if results else None

    @cached_property
    def architecture(self) -> str:
        """The architecture of the card, such as "sm_90"."""
        named = self._driver.CUdevice_attribute
        kinds = (f"CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_{part}" for part in ("MAJOR", "MINOR"))
        return "sm_" + "".join(
            str(self._call("cuDeviceGetAttribute", getattr(named, kind), self._device)) for kind in kinds
        )

    def kernel(self, source: str) -> Any:
        module = self._call("cuModuleLoadData", compiled(source, self.architecture))
        return self._call("cuModuleGetFunction", module, b"run_samples")

    def free(self) -> int:
        return self._call("cuMemGetInfo")

    def memory(self, size: int, content: np.ndarray | None = None) -> Memory:
        return _CudaMemory(self, size, content)

    def read(self, memory: Memory, to: np.ndarray) -> np.ndarray:
        if to.nbytes:
            self._call("cuMemcpyDtoH", to.ctypes.data, memory.address, to.nbytes)
        return to

    def launch(self, kernel: Any, groups: int, threads: int, pointers: list[int], number: int) -> None:
        kinds = (*[ctypes.c_void_p] * len(pointers), ctypes.c_long)
        sizes = groups, 1, 1, threads, 1, 1
        self._call("cuLaunchKernel", kernel, *sizes, 0, 0, ((*pointers, number), kinds), 0)
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
        self._kernel, self.width = self._card.kernel(self.source), 1

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k != "_kernel"}

    def _execute(self, study: Study, parts: list[Array | None]) -> None:
        """Run the samples in portions that fit into the memory of the card."""
        arrays = {name: array for name, array in study.arrays.items() if array is not None}
        of_samples = {name: array for name, array in arrays.items() if name in _OF_SAMPLES}
        common = self._on_card({name: arrays[name] for name in ("times", "atol")})
        most = max(1, int(SHARE * self._card.free() * study.n / sum(array.nbytes for array in of_samples.values())))
        n_events = 0
        for first in range(0, study.n, most):
            portion = {name: array[first : first + most] for name, array in of_samples.items()}
            n_events += self._run_portion(study, first, portion, common, parts[0], n_events)
        study.n_events = n_events

    def _run_portion(
        self,
        study: Study,
        first: int,
        arrays: Mapping[str, np.ndarray],
        common: Mapping[str, Memory],
        extremes: Array | None,
        n_events: int,
    ) -> int:
        """Run some samples, from number `first` on, and return the number of their events."""
        card, n = self._card, len(arrays["t_failed"])
        events = np.empty((max(study.most_events - n_events, 0), len(EVENT)))
        held = {**common, **self._on_card(arrays), "events": card.memory(events.nbytes)}
        own = Study.from_buffer_copy(study)
        own.n, own.most_events, own.n_events, own.steps = n, len(events), 0, 0
        for name in (*_OF_SAMPLES, "times", "atol", "events"):
            setattr(own, name, held[name].address if name in held else None)
        partial = self._launched(own, extremes)
        card.read(held["t_failed"], arrays["t_failed"])
        if extremes is not None:
            if not np.isnan(arrays["t_failed"]).all():
                # Extremes contain outputs of the failed samples. The other samples run once more.
                again = Study.from_buffer_copy(own)
                again.most_events = again.n_events = 0
                partial = self._launched(again, extremes)
            np.minimum(extremes[0], partial[0], out=extremes[0])
            np.maximum(extremes[1], partial[1], out=extremes[1])
        for name in {"Y", "passes"} & arrays.keys():
            card.read(held[name], arrays[name])
        if not np.isnan(arrays["t_failed"]).all():
            for name in ("failure", "x_failed"):
                card.read(held[name], arrays[name])
        count = min(own.n_events, len(events))
        card.read(held["events"], events)
        events[:count, 0] += first
        if count:
            cast(Array, study.arrays["events"])[n_events : n_events + count] = events[:count]
        study.steps += own.steps
        return own.n_events

    def _launched(self, study: Study, extremes: Array | None) -> tuple[Array, Array]:
        """Run a study, update its counts, and return the extremes (n_t, n_y)."""
        card = self._card
        groups = -(-study.n // THREADS)
        n_partial = min(groups, PARTIAL)
        shape = (n_partial, study.n_t, self.n_y) if extremes is not None else (0,)
        bounds = [np.full(shape, _ordered(np.array(end))) for end in (np.inf, -np.inf)]
        of_study = np.frombuffer(cast(Any, study), dtype=np.uint8)
        held = [card.memory(array.nbytes, array) for array in (of_study, *bounds)]
        card.launch(self._kernel, groups, THREADS, [memory.address for memory in held], n_partial)
        card.read(held[0], of_study)
        lower, upper = (card.read(memory, array) for memory, array in zip(held[1:], bounds, strict=True))
        if extremes is None:
            return lower, upper
        return _numbers(lower.min(axis=0)), _numbers(upper.max(axis=0))

    def _on_card(self, arrays: Mapping[str, np.ndarray]) -> dict[str, Memory]:
        """Memory of the card for these arrays. Arrays that the card only writes are not copied."""
        kept = {name: np.ascontiguousarray(array) for name, array in arrays.items()}
        return {
            name: self._card.memory(array.nbytes, array if name in _INPUTS else None) for name, array in kept.items()
        }


_OF_SAMPLES = {"x0", "p", "t_failed", "failure", "x_failed", "Y", "stops", "passes"}
_INPUTS = {"x0", "p", "times", "atol", "stops", "t_failed", "failure"}


def _ordered(numbers: Array) -> np.ndarray:
    """Numbers as integers in the same order, see c/scalar.h."""
    bits = numbers.view(np.int64)
    return np.where(bits < 0, bits ^ np.iinfo(np.int64).max, bits)


def _numbers(ordered: np.ndarray) -> Array:
    """The numbers of such integers."""
    return np.where(ordered < 0, ordered ^ np.iinfo(np.int64).max, ordered).view(float)

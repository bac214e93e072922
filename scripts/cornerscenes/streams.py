"""Random numbers keyed by names: adding a draw, a factor or a scene moves no other one."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

# Bits of a scrambled value, and of a scene's place in its group.
_VALUE_BITS = 32
_INDEX_BITS = 16


def stream(*names: str | int) -> np.random.Generator:
    """Return the random stream that belongs to a sequence of names.

    The generator is counter-based (Philox 4x64, Salmon et al. 2011), its key is the SHA-256 of the
    names, so the same names give the same numbers in any process and in any order of calls.

    Parameters
    ----------
    *names : str or int
        What the numbers are for, from the general to the particular: suite, scene, factor.

    Returns
    -------
    np.random.Generator
        A generator at the start of its stream.
    """
    digest = _digest(names)
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest[:16], dtype=np.uint64)))


def seed(*names: str | int) -> int:
    """Return a 31-bit seed that belongs to a sequence of names, for programs that want one."""
    return int(stream(*names, "seed").integers(0, 2**31))


@dataclass(frozen=True)
class Factors:
    """The factors of one scene: each a point of a scrambled Sobol sequence of its own.

    The scenes of a group are the points 0, 1, 2, ... of every factor's sequence, so any first 2^k
    of them put exactly one value in each of 2^k equal parts of the factor's range. A factor's
    sequence has an order and a scrambling of its own, keyed by its name, so two factors are not
    related, and a new factor or another scene moves none (shuffled and scrambled Sobol points:
    Burley, "Practical hash-based Owen scrambling", JCGT 9(4), 2020; here the permutations' bits are
    SHA-256 of the names and not a fast hash).

    Attributes
    ----------
    group : str
        Names the group of scenes.
    index : int
        The scene's place in its group, 0 to 65535.
    """

    group: str
    index: int

    def unit(self, factor: str, dimensions: int = 1) -> tuple[float, ...]:
        """Return a factor's point in [0, 1)^dimensions."""
        place = _owen(self.index, _INDEX_BITS, self.group, factor, "order")
        engine = qmc.Sobol(dimensions, scramble=False, bits=_VALUE_BITS)
        engine.fast_forward(place)
        (point,) = np.round(engine.random(1) * 2**_VALUE_BITS)
        return tuple(
            _owen(int(value), _VALUE_BITS, self.group, factor, axis) / 2**_VALUE_BITS
            for axis, value in enumerate(point)
        )

    def within(self, factor: str, bounds: tuple[float, float]) -> float:
        """Return a factor's value between two bounds."""
        (unit,) = self.unit(factor)
        return bounds[0] + unit * (bounds[1] - bounds[0])

    def one_of(self, factor: str, names: tuple[str, ...] | list[str]) -> str:
        """Return one of several names."""
        (unit,) = self.unit(factor)
        return names[int(unit * len(names))]


def _owen(value: int, bits: int, *names: str | int) -> int:
    """Flip each bit of a value by a coin that the bits above it and the names decide.

    This is Owen's nested uniform scrambling (1995).
    """
    result = 0
    for bit in range(bits):
        above = value >> (bits - bit)
        coin = _digest((*names, bit, above))[0] & 1
        result = result << 1 | (value >> (bits - 1 - bit) & 1 ^ coin)
    return result


def _digest(names: tuple[str | int, ...]) -> bytes:
    return hashlib.sha256("\x1f".join(str(name) for name in names).encode()).digest()

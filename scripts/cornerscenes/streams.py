"""Random numbers keyed by names: adding a draw, a factor or a scene moves no other one."""

from __future__ import annotations

import hashlib

import numpy as np


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
    digest = hashlib.sha256("\x1f".join(str(name) for name in names).encode()).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest[:16], dtype=np.uint64)))


def seed(*names: str | int) -> int:
    """Return a 31-bit seed that belongs to a sequence of names, for programs that want one."""
    return int(stream(*names, "seed").integers(0, 2**31))

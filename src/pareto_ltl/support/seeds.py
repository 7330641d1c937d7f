"""Streams of random numbers: by name, and as children that do not depend on what was drawn before."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zlib import crc32

if TYPE_CHECKING:
    from numpy.random import SeedSequence


def stage_seeds(seed: int, stream: str) -> SeedSequence:
    """The random stream ``stream`` of a run with ``seed``; a new object each time: spawning changes it."""
    from numpy.random import SeedSequence

    return SeedSequence(seed, spawn_key=(crc32(stream.encode()),))


def named_child(seeds: SeedSequence, name: str) -> SeedSequence:
    """A child of ``seeds`` that ``spawn`` never makes; it does not depend on earlier use of ``seeds``."""
    from numpy.random import SeedSequence

    return SeedSequence(seeds.entropy, spawn_key=(*seeds.spawn_key, crc32(name.encode())))


def unspawned(seed: SeedSequence) -> SeedSequence:
    """A copy of ``seed`` without children: a SeedSequence counts them, and would spawn others next time."""
    from numpy.random import SeedSequence

    return SeedSequence(seed.entropy, spawn_key=seed.spawn_key, pool_size=seed.pool_size)


def later_child(seed: SeedSequence, number: int) -> SeedSequence:
    """The child ``number`` of ``seed``, whatever was spawned from it before."""
    from numpy.random import SeedSequence

    return SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, number), pool_size=seed.pool_size)

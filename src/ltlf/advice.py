"""What the messages of errors recommend, which an application says in its words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True, eq=False)
class Advice:
    """Parts of messages; the defaults do not depend on what propositions stand for.

    Attributes
    ----------
    endless : str
        Why a formula that promises something for ever is refused.
    ended, unended : str
        What to write instead, for ``{}``: with the end that the formula has, or with one to be added.
    excluded : callable
        Continues that sentence: how else to exclude the propositions of these names.
    spans : str
        What to do with a time span below a temporal operator.
    states : str
        How to allow more states.
    foreign : mapping of str to str
        What to do with a text of another kind; by the kind, as :mod:`ltlf.words` names it.
    """

    endless: str = "no finite word can satisfy it"
    ended: str = "a word is over when the formula holds: write '{}'"
    unended: str = "a word is over when the formula holds: write '{} U goal', with what ends it as goal"
    excluded: Callable[[Sequence[str]], str] = lambda _names: ""
    spans: str = "spans count from the first letter: put it outside, as in F[0,6h] (a & b)"
    states: str = "raise max_states"
    foreign: Mapping[str, str] = field(default_factory=dict)


PLAIN_ADVICE = Advice()

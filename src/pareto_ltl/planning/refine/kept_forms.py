"""Cone forms cached between runs: the next run needs no cvxpy, whose import and canonicalisation take 0.7 s.

A form is an archive of numbers and names in ``programmes/`` of the cache; its file name is the fingerprint of
all that it depends on. A damaged file is replaced.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pareto_ltl.planning.refine.cone_form import ConeForm, Statement, cone_form
from pareto_ltl.support import cache
from pareto_ltl.support.archives import read_npz
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.files import write_npz
from pareto_ltl.support.fingerprints import code_fingerprint, text_fingerprint

LOG = logging.getLogger(__name__)
PACKAGES = ("cvxpy", "clarabel", "scipy", "numpy")  # others may order rows and columns differently
SPARSE = ("cost", "entries", "offset")  # sparse arrays of a form
PARTS = ("data", "indices", "indptr", "shape")  # arrays that make up each sparse array
PLAIN = ("parameters", "indices", "indptr", "rows")
CONES = ("ZeroConeT", "NonnegativeConeT", "SecondOrderConeT")


def kept_form(content: str, state: Callable[[], Statement]) -> ConeForm:
    """The form of the statement that ``state`` makes from ``content``, read from the cache if it is there."""
    folder = forms_folder()
    path = folder / f"{edition()}-{text_fingerprint(content)[:32]}.npz"
    try:
        cache.make_private(folder)
        form = form_of(read_npz(path)) if path.is_file() else None
    except (OSError, DataError, ValueError, KeyError) as error:
        LOG.info("the cached form %s cannot be read and is made again: %s", path, error)
        form = None
    if form is not None:
        cache.mark_used(path)
        return form
    form = cone_form(state())
    try:
        write_npz(path, arrays_of(form))
        cache.trim_folder(folder, cache.cache_limit())
    except (OSError, DataError) as error:
        LOG.info("the form is not cached in %s: %s", path, error)
    return form


def forms_are_kept() -> bool:
    """Whether the cache has forms that this code can use."""
    return any(forms_folder().glob(f"{edition()}-*.npz"))


def forms_folder() -> Path:
    """Folder of the cached forms."""
    return cache.cache_root() / cache.FORMS_FOLDER


@lru_cache
def edition() -> str:
    """Fingerprint of the code and the packages that make forms."""
    told = [code_fingerprint("planning.refine"), *map(version, PACKAGES)]
    return text_fingerprint(" ".join(told))[:32]


def arrays_of(form: ConeForm) -> dict[str, NDArray[Any]]:
    """``form`` as plain arrays."""
    arrays: dict[str, NDArray[Any]] = {name: getattr(form, name) for name in PLAIN}
    for name in SPARSE:
        arrays |= {f"{name}/{part}": np.asarray(getattr(getattr(form, name), part)) for part in PARTS}
    return arrays | {
        "height": np.array([form.height]),
        "columns": _ends(form.columns),
        "places": _ends(form.places.values()),
        "names": np.array(list(form.places), np.str_),
        "cones": np.array([[CONES.index(type(cone).__name__), cone.dim] for cone in form.cones], np.int64),
    }


def form_of(arrays: Mapping[str, NDArray[Any]]) -> ConeForm:
    """The form in ``arrays``; raises KeyError or ValueError if they are not those of a form."""
    import clarabel
    from scipy.sparse import csr_array

    sparse: dict[str, Any] = {}
    for name in SPARSE:
        data, indices, indptr, shape = (arrays[f"{name}/{part}"] for part in PARTS)
        sparse[name] = csr_array((data, indices, indptr), shape=tuple(shape.tolist()))
    cones = [getattr(clarabel, CONES[kind])(dim) for kind, dim in arrays["cones"].tolist()]
    return ConeForm(
        **({name: arrays[name] for name in PLAIN} | sparse),
        places=dict(zip(arrays["names"].tolist(), _slices(arrays["places"]), strict=True)),
        columns=tuple(_slices(arrays["columns"])),
        height=int(arrays["height"][0]),
        cones=cones,
    )


def _ends(places: Any) -> NDArray[np.int64]:
    return np.array([[place.start, place.stop] for place in places], np.int64).reshape(-1, 2)


def _slices(ends: NDArray[Any]) -> list[slice]:
    return [slice(first, last) for first, last in ends.tolist()]

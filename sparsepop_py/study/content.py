"""Turn records into bytes, and back without running code."""

from __future__ import annotations

import hashlib
import io
import pickle
import zlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from typing import Any

import numpy as np

from sparsepop_py.errors import FormatError, ProblemError

__all__ = ["dump", "fingerprint", "load"]

_ROOTS = ("sparsepop_py", "setid")
_NAMES = {
    ("fractions", "Fraction"),
    ("scipy.sparse._csc", "csc_array"),
    ("scipy.sparse._csr", "csr_array"),
    ("numpy", "dtype"),
    ("numpy", "ndarray"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.numeric", "_frombuffer"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy.core.multiarray", "scalar"),
    ("setid.data.checks", "FrozenMapping"),
    ("sparsepop_py.verified.certificate.certificate", "_after"),
    ("sparsepop_py.verified.certificate.certificate", "_tree"),
    ("sparsepop_py.verified.certificate.lp_dual", "_restored"),
    ("sparsepop_py.verified.certificate.multipliers", "_filled"),
}


def dump(value: Any, place: str, trusted: tuple[str, ...] = ()) -> bytes:
    """Pickle and compress a value that :func:`load` accepts.

    Parameters
    ----------
    value : object
    place : str
        For the message.
    trusted : tuple of str
        Further modules whose classes are accepted.

    Raises
    ------
    ProblemError
        If the value cannot be stored or would not be read back.
    """
    try:
        content = zlib.compress(pickle.dumps(value, 5))
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ProblemError(f"{place}: cannot be stored: {error}") from error
    load(content, place, trusted)
    return content


def load(content: bytes, place: str, trusted: tuple[str, ...] = ()) -> Any:
    """Read what :func:`dump` wrote; nothing but records of the packages is made.

    Parameters
    ----------
    content : bytes
    place : str
        For the message.
    trusted : tuple of str
        Further modules whose classes are accepted.

    Raises
    ------
    FormatError
        If the bytes are damaged, or name another class or function.

    References
    ----------
    Python documentation, module pickle, section "Restricting globals".
    """
    try:
        return _Unpickler(zlib.decompress(content), place, trusted).load()
    except FormatError:
        raise
    except Exception as error:  # damaged bytes can raise anything
        raise FormatError(f"{place}: found damaged content: {error}") from error


class _Unpickler(pickle.Unpickler):
    """Refuse all classes but frozen records and enumerations of known modules."""

    def __init__(self, content: bytes, place: str, trusted: tuple[str, ...]) -> None:
        super().__init__(io.BytesIO(content))
        self._place, self._trusted = place, trusted

    def find_class(self, module: str, name: str) -> Any:
        """Find a class by name, if it is one that holds data alone."""
        if (module, name) in _NAMES:
            return super().find_class(module, name)
        if module.partition(".")[0] in _ROOTS or module in self._trusted:
            found = super().find_class(module, name)
            if isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum)):
                return found
        raise FormatError(
            f"{self._place}: found {module}.{name}, expected records of sparsepop_py and setid "
            "(name your own modules: Study(path, trusted=[...]))"
        )


def fingerprint(value: Any) -> str:
    """Hash the content of a value: equal for equal records, whatever they share or cache.

    Parameters
    ----------
    value : object
        Numbers, texts, arrays, lists, mappings and frozen dataclasses of them.

    Raises
    ------
    ProblemError
        If it holds something else.

    Examples
    --------
    >>> import sparsepop_py as sp
    >>> x, = sp.variables(1)
    >>> problems = [sp.Problem(x, lower=bound) for bound in (0, 0, 1)]
    >>> len({fingerprint(problem) for problem in problems})
    2
    """
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()


def _parts(value: Any) -> list[bytes]:
    """List the bytes that say what a value is, kinds by their names."""
    kind = type(value).__qualname__.encode()
    if value is None or isinstance(value, (bool, int, str, Fraction)):
        return [kind, str(value).encode()]
    if isinstance(value, (float, complex)):
        return [kind, repr(value).encode()]
    if isinstance(value, Enum):
        return [kind, value.name.encode()]
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.ascontiguousarray(value)
        return [kind, array.dtype.str.encode(), repr(array.shape).encode(), array.tobytes()]
    if isinstance(value, (list, tuple)):
        inner = list(value)
    elif isinstance(value, Mapping):
        inner = [each for pair in value.items() for each in pair]
    elif is_dataclass(value):
        inner = [getattr(value, each.name) for each in fields(value) if each.init]
    else:
        raise ProblemError(f"found {type(value).__name__}, expected numbers, arrays or records")
    return [kind, str(len(inner)).encode(), *(part for each in inner for part in _parts(each))]

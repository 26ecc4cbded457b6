"""Check a result again, from the data and without any solver."""

from __future__ import annotations

from setid.data.record import IOData
from setid.errors import SetidError
from setid.proofs.evidence import Claimed, Verification
from setid.proofs.verification import verify as verify_evidence

__all__ = ["verify"]


def verify(result: Claimed, data: IOData | None = None) -> Verification:
    """Check every claim of an identification again from the data.

    No value of a solver is trusted, and none is run: the problem is stated again from the
    record, and all certificates, boxes and points are checked against it.

    Parameters
    ----------
    result : Identification
        Or whatever else has ``evidence``. Evidence alone has no tolerance: there ``"certified"``
        says that something is attained.
    data : IOData, optional
        The record, without samples that were held out; the one that was stored when left out.

    Returns
    -------
    Verification
        True where formulation, box, all outer ends and all attained ends hold, those of certified
        intervals agree, and what is said of samples that were held out holds.

    Raises
    ------
    SetidError
        If there is no evidence.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> bool(setid.verify(result, data))
    True
    >>> other = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0])
    >>> setid.verify(result, other).reason
    'the result belongs to other data'
    """
    if not hasattr(result, "evidence"):
        raise SetidError(f"result: found {type(result).__name__}, expected Identification")
    if hasattr(result, "verify"):  # an identification, which says more than its evidence
        verdict: Verification = result.verify(data)
        return verdict
    return verify_evidence(result.evidence, data)

"""A certificate is checked without a solver, and refuses what it does not prove."""

from dataclasses import replace

import numpy as np

import sparsepop_py as sp
from sparsepop_py.verified.certificate.sos_identity import Identity

problem = sp.parse("min x^4 - 3*x^2*y + y^4 + x; s.t. x*y >= -1; x^2 + y^2 <= 4")
result = sp.solve(problem, sp.Options(order=2))
certificate = result.certificate
assert certificate is not None and isinstance(certificate.identity, Identity)
print(certificate)


def show(what: str, verdict: sp.Verdict) -> None:
    """Print what a verification found."""
    answer = "accepted" if verdict.ok else f"refused, {verdict.reason}"
    print(f"{what:<34}{answer}; the argument proves {verdict.bound!r}")


show("as it came", certificate.verify(problem))

# A larger claim than the argument carries.
greedy = replace(certificate, bound=certificate.bound + 1e-6)
show("claim raised by 1e-6", greedy.verify(problem))


def with_multipliers(change) -> sp.Certificate:  # type: ignore[no-untyped-def]
    """A copy whose stored multipliers are changed."""
    old = certificate.identity
    multipliers = tuple(replace(m, values=change(m.values)) for m in old.multipliers)
    root = replace(certificate.root, argument=replace(old, multipliers=multipliers))
    return replace(certificate, root=root)


# Damaged multipliers still prove something, only less: any multipliers are sound.
damaged = with_multipliers(lambda values: values * 1.01)
show("multipliers changed by 1 %", damaged.verify(problem))

# Rounded to single precision they lose little; a claim of what is left is accepted.
short = with_multipliers(lambda values: values.astype(np.float32))
show("multipliers in single precision", short.verify(problem))
modest = replace(short, bound=short.verify(problem).bound)
show("the same with a claim to match", modest.verify(problem))

# Another problem, if only in the last digit of one bound.
other = sp.Problem(problem.objective, problem.constraints, lower=-3.0)
show("another problem", certificate.verify(other))

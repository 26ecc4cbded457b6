"""The structure that training with proofs is about: one hidden layer, a linear last one."""

from __future__ import annotations

from setid import ModelError
from setid.neural.models.network import Network
from setid.neural.models.regressor import RegressorNetwork

__all__ = ["has_hidden_layer", "hidden_layer", "output_signs"]


def has_hidden_layer(net: RegressorNetwork, *kinds: str) -> bool:
    """Check for one hidden layer, a linear last layer and one output.

    Parameters
    ----------
    net : NNARX or NNOE
    *kinds : str
        Activations that the hidden layer may have; any where none is named.
    """
    if not isinstance(net, RegressorNetwork):
        return False
    inner = net.network
    fits = len(inner.weights) == 2 and inner.activation[1] == "identity" and net.outputs == 1
    return fits and (not kinds or inner.activation[0] in kinds)


def hidden_layer(net: RegressorNetwork) -> Network:
    """Return the network, or raise ``ModelError`` where it has another structure."""
    if not has_hidden_layer(net):
        raise ModelError(
            f"net: found {net.network!r} with {net.outputs} outputs, expected one hidden layer, a "
            "linear last layer and one output"
        )
    return net.network


def output_signs(width: int) -> list[tuple[float, ...]]:
    """List the output weights 1 and -1 of so many neurons, up to permutations.

    Parameters
    ----------
    width : int

    Examples
    --------
    >>> output_signs(2)
    [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)]
    """
    return [(1.0,) * p + (-1.0,) * (width - p) for p in range(width, -1, -1)]

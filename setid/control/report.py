"""One self-contained page on a design and its certificates."""

from __future__ import annotations

import base64
import html
import io
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from setid.control.certificates.certificate import StabilityCertificate
from setid.control.design import Design
from setid.control.engine import SetidError, entries_of
from setid.control.loops import LoopMargins, loop_margins, loop_step
from setid.control.plots import plot_certificate, plot_loop_step
from setid.control.specification import SpecifiedModel
from sparsepop_py.errors import check_writable
from sparsepop_py.files import as_path, write_text
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["margins_text", "report"]

_STYLE = "body{font-family:sans-serif;max-width:60em;margin:2em auto}pre{background:#f4f4f4}"


def report(
    path: str | os.PathLike[str],
    design: Design,
    certificates: Sequence[StabilityCertificate],
    specified: SpecifiedModel | None = None,
) -> None:
    """Write a page with the design, its certificates, margins and pictures (needs matplotlib).

    Parameters
    ----------
    path : path-like
        An HTML file; pictures are inside it.
    design : Design
    certificates : sequence of StabilityCertificate
    specified : SpecifiedModel, optional
        Where the reference model was made from a specification: its limits are shown beside what
        the model has.

    Raises
    ------
    SetidError
        If something else is given.
    SparsePOPError
        If the page cannot be written there.

    Examples
    --------
    >>> import numpy as np, pathlib, setid, tempfile
    >>> from setid import control
    >>> P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    >>> r = np.random.default_rng(0).uniform(-1, 1, 60)
    >>> data = setid.IOData(r, P.simulate(r))
    >>> design = control.design(data, M, control.LTI(1, integrator=True), 0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     page = pathlib.Path(folder) / "design.html"
    ...     control.report(page, design, [])
    ...     "Controller from data" in page.read_text()
    True
    """
    if not isinstance(design, Design):
        raise SetidError(f"design: found {type(design).__name__}, expected a Design")
    known = entries_of(certificates, "certificates", "a list of StabilityCertificates", SetidError)
    for place, item in enumerate(known):
        if not isinstance(item, StabilityCertificate):
            raise SetidError(
                f"certificates[{place}]: found {type(item).__name__}, expected a "
                "StabilityCertificate"
            )
    if specified is not None and not isinstance(specified, SpecifiedModel):
        raise SetidError(f"specified: found {type(specified).__name__}, expected a SpecifiedModel")
    check_writable(str(as_path(path)), "path")
    parts = ["<h1>Controller from data</h1>"]
    if specified is not None:
        limits = "\n".join(
            f"{name}: asked for at most {asked:.4g}, the reference model has {measured:.4g}"
            for name, (asked, measured) in specified.checks.items()
        )
        parts.append(f"<h2>Specification</h2>{_text(limits)}")
    parts.append(f"<h2>Design</h2>{_text(design.summary())}")
    parts.append(_text(f"experiment: {design.data!r}\nreference model: {design.reference!r}"))
    for item in known:
        parts.append(f"<h2>Stability: {html.escape(item.verdict)} ({item.method})</h2>")
        parts.append(_text(f"controller: {item.controller!r}\n{item.summary()}"))
        if item.arcs:
            parts.append(_picture(plot_certificate(item)))
    certified = next((item for item in known if item), None)
    if certified is not None:
        margins = _text(margins_text(loop_margins(certified)))
        parts.append(f"<h2>Margins of every consistent plant, proved</h2>{margins}")
        parts.append(_picture(plot_loop_step(loop_step(certified))))
    body = "\n".join(parts)
    page = f"<!doctype html><meta charset='utf-8'><style>{_STYLE}</style>{body}"
    write_text(path, page)


def margins_text(margins: LoopMargins) -> str:
    """Write margins so that what is shown is proved, too.

    Parameters
    ----------
    margins : LoopMargins
    """
    return (
        f"max abs(S) <= {rounded(margins.sensitivity, True, 4)}\n"
        f"gain may change by factors from {rounded(margins.gain[0], True, 4)} to "
        f"{rounded(margins.gain[1], False, 4)}\n"
        f"phase may turn by {rounded(margins.phase, False, 4)} rad"
    )


def _text(text: str) -> str:
    return f"<pre>{html.escape(text)}</pre>"


def _picture(axes: Axes) -> str:
    buffer = io.BytesIO()
    figure = axes.get_figure()
    assert figure is not None
    figure.savefig(buffer, format="png", dpi=110)  # type: ignore[union-attr]
    data = base64.b64encode(buffer.getvalue()).decode()
    return f"<img style='max-width:100%' src='data:image/png;base64,{data}'>"

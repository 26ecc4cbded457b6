"""The listing of a check holds what was called, and nothing that was not."""

from __future__ import annotations

import ast
import trace
from pathlib import Path

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from checker import listing
from checker.command import main
from setid.result.json_ import certificate_text


def quartic() -> str:
    (x,) = sp.variables(1)
    return sp.to_json(sp.solve(sp.Problem(x**4 - 3 * x**2 + x, lower=-2, upper=2)))


def record() -> str:
    data = setid.IOData(np.array([1.0, -1.0, 0.5, 1.5]), np.array([0.0, 1.0, -0.5, 0.25]))
    result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.25))
    return certificate_text(result)


@pytest.mark.parametrize("make", [quartic, record])
def test_it_holds_the_functions_that_were_called(make, tmp_path: Path, capsys) -> None:
    path = tmp_path / "file.json"
    path.write_text(make())
    tracer = trace.Trace(count=0, trace=0, countfuncs=1)
    assert tracer.runfunc(main, [str(path)]) in (0, 3)
    folder = str(listing.HERE)
    found = [key for key in tracer.results().calledfuncs if key[0].startswith(folder)]
    expected = {name.rpartition(".")[2] for _, _, name in found}
    said = capsys.readouterr().out

    code, called = listing.called_by([str(path)])
    assert code in (0, 3)
    assert capsys.readouterr().out == said
    modules = listing.parts(called)
    tree = ast.parse(listing.listing(modules))  # one after the other, they are Python
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    written = {node.name for node in (*functions, *classes)}
    assert {name for name in expected if not name.startswith("<")} <= written

    parts = [*tree.body, *(part for node in classes for part in node.body)]
    outer = {node.name for node in parts if isinstance(node, ast.FunctionDef)}
    makers = {"of_type", "each", "together", "one_of"}  # called where modules are imported
    assert outer <= expected | makers


def test_classes_and_constants_that_are_named_take_part(tmp_path: Path) -> None:
    path = tmp_path / "sample.py"
    path.write_text(
        '"""A module."""\nimport math\nUSED = 3\nOTHER = 4\n\n\nclass Kept:\n    """A class."""\n\n'
        "    value = USED\n\n    def called(self):\n        # a comment\n        return Named\n\n"
        "    def idle(self):\n        return OTHER\n\n\nclass Named:\n    size = 1\n\n\n"
        "def idle():\n    return 2\n"
    )
    module = listing.Module(path, {(str(path), 12)})
    module.take(module.names())
    module.take(module.names())
    rows = [path.read_text().splitlines()[row] for row in module.rows()]
    assert "USED = 3" in rows and "class Named:" in rows and "class Kept:" in rows
    assert "OTHER = 4" not in rows and not any("idle" in row for row in rows)
    assert module.code() == 7  # USED, Kept with its field, called, Named with its field


def test_malformed_input_has_no_listing(tmp_path: Path, capsys) -> None:
    assert listing.printed([str(tmp_path / "none.json")]) == 2
    said = capsys.readouterr().out
    assert "MALFORMED" in said and "lines of code" not in said


def test_what_is_printed_follows_the_verdict(tmp_path: Path, capsys) -> None:
    path = tmp_path / "file.json"
    path.write_text(quartic())
    assert listing.printed([str(path)]) == 0
    verdict, _, rest = capsys.readouterr().out.partition("# lines of code")
    assert verdict.count("proved: ") == 2
    assert "# ---- certificates/identity.py" in rest
    assert "\n\n\n\n" not in rest  # rows of methods that were left out

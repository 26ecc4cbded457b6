"""Hooks of the documentation site: pages of the API, and links that leave the folder docs."""

from __future__ import annotations

import importlib
import posixpath
import re
from typing import Any

from mkdocs.structure.files import File, Files

PACKAGES = {
    "sparsepop_py": "sparsepop_py: problems, solvers, results",
    "sparsepop_py.problems": "sparsepop_py.problems: problems with known minima",
    "setid": "setid: identification",
    "setid.control": "setid.control: controllers from data",
    "setid.neural": "setid.neural: statements about networks",
}
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)]*)?(\))")


def on_files(files: Files, config: Any) -> Files:
    """Add one page a package with every public name, from the docstrings."""
    for package in PACKAGES:
        name = f"api/{package}.md"
        files.append(File.generated(config, name, content=_page(package)))
    return files


def _page(package: str) -> str:
    module = importlib.import_module(package)
    parts = [f"# {PACKAGES[package]}\n"]
    for name in sorted(module.__all__, key=str.lower):
        found = getattr(module, name)
        if f"{package}.{name}" in PACKAGES:
            parts.append(f"- [`{package}.{name}`]({package}.{name}.md)\n")
            continue
        home = getattr(found, "__module__", None)
        if home is None or not home.startswith(("sparsepop_py", "setid")):  # a module, a constant
            home, name = package, name
            if hasattr(found, "__path__") or hasattr(found, "__file__"):
                parts.append(f"::: {found.__name__}\n")
                continue
        own = getattr(found, "__name__", name)
        if own != name:
            parts.append(f"## {package}.{name}\n\nAnother name of `{package}.{own}`.\n")
            continue
        parts.append(f"::: {home}.{name}\n    options:\n      heading: {package}.{name}\n")
    return "\n".join(parts)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point links that leave the folder to the repository."""
    here = posixpath.dirname(page.file.src_uri)
    base = config["repo_url"].rstrip("/") + "/blob/main/"

    def leave(match: re.Match[str]) -> str:
        target = match[2]
        if "://" in target or target.startswith(("mailto:", "/")):
            return match[0]
        path = posixpath.normpath(posixpath.join("docs", here, target))
        if path.startswith("docs/"):
            return match[0]
        return f"{match[1]}{base}{path}{match[3] or ''}{match[4]}"

    return LINK.sub(leave, markdown)

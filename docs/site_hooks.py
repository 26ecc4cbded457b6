"""Hooks of the documentation site: addresses, pages of the API, files beside the folder docs."""

from __future__ import annotations

import importlib
import inspect
import posixpath
import re
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {
    "sparsepop_py": "sparsepop_py: problems, solvers, results",
    "sparsepop_py.problems": "sparsepop_py.problems: problems with known minima",
    "setid": "setid: identification",
    "setid.control": "setid.control: controllers from data",
    "setid.neural": "setid.neural: statements about networks",
}
# Files of the repository that pages link to: the site brings them along.
BROUGHT = (
    "examples/*.py",
    "examples/data/*",
    "examples/gallery/*.py",
    "examples/problems/*.gms",
    "sparsepop_py/certificate_schema.json",
    "sparsepop_py/verified/README.md",
    "setid/proofs/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
)
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)]*)?(\))")


def on_config(config: Any) -> Any:
    """Take the addresses from pyproject.toml, where alone they are set."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
    config["repo_url"], config["site_url"] = urls["Homepage"], urls["Documentation"]
    config["repo_name"] = "Repository"
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add one page a package with every public name, and files of the repository."""
    for package in PACKAGES:
        name = f"api/{package}.md"
        files.append(File.generated(config, name, content=_page(package)))
    for pattern in BROUGHT:
        for path in sorted(ROOT.glob(pattern)):
            name = f"files/{path.relative_to(ROOT).as_posix()}"
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def _page(package: str) -> str:
    module = importlib.import_module(package)
    overview = ["| name | |", "|---|---|"]
    parts = []
    for name in sorted(module.__all__, key=str.lower):
        found = getattr(module, name)
        if f"{package}.{name}" in PACKAGES:
            parts.append(f"- [`{package}.{name}`]({package}.{name}.md)\n")
            continue
        home = getattr(found, "__module__", None)
        if home is None or not home.startswith(("sparsepop_py", "setid")):  # a module, a constant
            home, name = package, name
            if hasattr(found, "__path__") or hasattr(found, "__file__"):
                overview.append(f"| [`{name}`][{found.__name__}] | {_first_line(found)} |")
                parts.append(f"::: {found.__name__}\n")
                continue
        own = getattr(found, "__name__", name)
        if own != name:
            overview.append(f"| `{name}` | Another name of `{own}`. |")
            parts.append(f"## {package}.{name}\n\nAnother name of `{package}.{own}`.\n")
            continue
        overview.append(f"| [`{name}`][{home}.{name}] | {_first_line(found)} |")
        parts.append(f"::: {home}.{name}\n    options:\n      heading: {package}.{name}\n")
    return "\n".join([f"# {PACKAGES[package]}\n", *overview, "", *parts])


def _first_line(found: Any) -> str:
    text = inspect.getdoc(found) or ""
    own = inspect.isroutine(found) or inspect.isclass(found) or inspect.ismodule(found)
    return text.split("\n")[0].replace("|", r"\|") if own else ""


def on_post_build(config: Any) -> None:
    """Refuse a built site with a link to a file or heading that is not there."""
    site = Path(config["site_dir"])
    pages = {path: path.read_text(encoding="utf-8") for path in site.rglob("*.html")}
    known = {
        path: set(re.findall(r'\b(?:id|name)="([^"]+)"', text)) for path, text in pages.items()
    }
    broken = []
    for page, text in pages.items():
        for target in (
            set(re.findall(r'(?:href|src)="([^":]+)"', text)) if page.stem != "404" else ()
        ):
            path, _, anchor = unquote(target).partition("#")
            found = (page.parent / path.partition("?")[0]).resolve() if path else page
            found = found / "index.html" if found.is_dir() else found
            if not found.exists() or (anchor and found in known and anchor not in known[found]):
                broken.append(f"{page.relative_to(site)}: {target}")
    if broken:
        raise PluginError("links lead nowhere:\n" + "\n".join(sorted(broken)))


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Point links that leave the folder to what was brought along, or to the repository."""
    source = page.file.src_uri
    brought = source.startswith("files/")
    here = posixpath.dirname(source.removeprefix("files/") if brought else f"docs/{source}")
    base = config["repo_url"].rstrip("/") + "/blob/main/"
    folder = posixpath.dirname(source)

    def leave(match: re.Match[str]) -> str:
        target = match[2]
        if "://" in target and not target.startswith(base):
            return match[0]
        if target.startswith(("mailto:", "/")):
            return match[0]
        inside = target.startswith(base)
        path = target.removeprefix(base)
        path = path if inside else posixpath.normpath(posixpath.join(here, path))
        ending = f"{match[3] or ''}{match[4]}"
        for name in (
            path.removeprefix("docs/") if path.startswith("docs/") else "",
            f"files/{path}",
        ):
            if name and files.get_file_from_path(name) is not None:
                return f"{match[1]}{posixpath.relpath(name, folder)}{ending}"
        return f"{match[1]}{base}{path}{ending}"

    return LINK.sub(leave, markdown)

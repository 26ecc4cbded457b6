"""Move the project to other addresses: the repository's and the site's.

They are set in pyproject.toml, ``project.urls``. The site reads them there. README.md and the conda
recipe have to repeat them, since package indices show them alone. This changes all three::

    python packaging/addresses.py https://host/owner/name https://site/
"""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

FILES = ("pyproject.toml", "README.md", "packaging/conda/recipe.yaml")


def move(root: Path, repository: str, site: str) -> None:
    """Write the addresses in place of those of pyproject.toml.

    Parameters
    ----------
    root : Path
        Of the checkout.
    repository, site : str
        The new ones.
    """
    text = (root / "pyproject.toml").read_text(encoding="utf-8")
    urls = tomllib.loads(text)["project"]["urls"]
    changed = {urls["Homepage"]: repository.rstrip("/")}
    changed[urls["Documentation"].rstrip("/")] = site.rstrip("/")
    for name in FILES:
        text = (root / name).read_text(encoding="utf-8")
        for old, new in changed.items():
            text = text.replace(old, new)
        (root / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 3 or not all(a.startswith("https://") for a in sys.argv[1:]):
        sys.exit(__doc__)
    move(Path(__file__).resolve().parents[1], sys.argv[1], sys.argv[2])

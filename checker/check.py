"""Check claims about a polynomial problem without the program that made them.

    python checker/check.py problem.json certificate.json
    python checker/check.py result.json
    python checker/check.py --record record.csv identification.json

A problem may also be given as a text, "min ...; s.t. ...", or as a .gms file. Exit code 0: every
claim is proved, and printed; 1: some claim is not, and why; 2: the input is malformed; 3: proved
but for what is "taken as given".
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from checker.command import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

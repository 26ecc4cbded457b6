# make demo         solve the example problems, print a table, write pictures to demo_output/
# make test         format, lint, types, import contracts, fast tests, doctests and examples
# make test-fast    what most changes break, in less than a minute
# make test-lowest  the same on the lowest versions that pyproject.toml allows
# make test-newest  the same on the newest Python found, with the newest versions of all packages
# make test-slow    the tests marked slow
# make mutants      the fast tests of each room against deliberate faults in the trusted code, for
#                   twenty minutes; again goes on where it stopped
# make test-octave  scripts that call sparsePOP from GNU Octave, skipped where it is missing
# make bench-env    an environment for each peer of the benchmarks, in .bench-env
# make docs         the documentation site in site/, strictly: no link may lead nowhere
# make gallery      its pictures again, by examples/gallery
# All make their own environment in .venv; PYTHON=... chooses the interpreter.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
LOWEST := .venv-lowest
NEWEST := .venv-newest
# The first that starts: pyenv leaves commands that do not.
NEWER := $(shell for v in 14 13 12; do python3.$$v -c '' 2>/dev/null && echo python3.$$v && break; done)
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check

# Rooms whose tests take seconds and notice most mistakes.
FAST := tests/algebra tests/verified/arithmetic tests/verified/certificate tests/verified/points \
        tests/problem tests/lp tests/io/test_exchange_files.py tests/io/test_gams.py \
        tests/test_api.py tests/test_solve.py tests/test_cli.py

# The tests start many processes: with compiled modules on disk each starts a second sooner.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test types fast-tests test-fast test-lowest test-newest test-slow mutants test-octave bench-env docs gallery clean

demo: $(VENV)/.with-plot
	$(BIN)/python examples/demo.py

test: $(VENV)/.with-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(MAKE) --no-print-directory --jobs 2 types fast-tests

# mypy takes one core for half a minute, beside the tests
types: $(VENV)/.with-dev
	$(BIN)/mypy

fast-tests: $(VENV)/.with-dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist worksteal

test-fast: $(VENV)/.with-dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -q $(FAST)

test-lowest: $(LOWEST)/.ready
	OMP_NUM_THREADS=1 $(LOWEST)/bin/python -m pytest -n 2 --dist loadfile -q $(FAST)

test-newest:
	@test -n "$(NEWER)" || echo "no Python newer than 3.11 was found: nothing to do"
	@test -z "$(NEWER)" || $(MAKE) --no-print-directory $(NEWEST)/.ready
	@test -z "$(NEWER)" || OMP_NUM_THREADS=1 $(NEWEST)/bin/python -m pytest -n 2 --dist loadfile -q $(FAST)

test-slow: $(VENV)/.with-dev
	$(BIN)/python -m pytest -m slow

mutants: $(VENV)/.with-dev
	$(BIN)/python tests/mutants/run.py --minutes 20

test-octave: $(VENV)/.with-dev
	$(BIN)/python -m pytest -m 'octave or not slow' tests/compat/test_octave.py tests/compat/test_matlab_server.py

bench-env: $(VENV)/.with-dev
	$(BIN)/python -m benchmarks environments

docs: $(VENV)/.with-docs
	$(BIN)/python -m mkdocs build --strict --site-dir site

gallery: $(VENV)/.with-plot
	for script in examples/gallery/[!s]*.py examples/gallery/s[it]*.py; do \
	  OMP_NUM_THREADS=1 $(BIN)/python $$script || exit 1; done

# An editable installation with one extra; made again only when pyproject.toml changes.
$(VENV)/.with-%: pyproject.toml
	@test -n "$(PYTHON)" || { echo "python3 is missing: apt-get install python3-venv" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "$(PYTHON) is older than 3.11; say make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@echo "installing into $(VENV) ..."
	"$(PYTHON)" -m venv $(VENV)
	$(PIP) install --quiet --editable '.[$*]'
	@touch $@

$(LOWEST)/.ready: pyproject.toml tests/lowest.txt
	"$(PYTHON)" -m venv $(LOWEST)
	$(LOWEST)/bin/python -m pip --disable-pip-version-check install --quiet \
	  -c tests/lowest.txt --editable '.[plot,cvxpy,sympy]' pytest pytest-xdist hypothesis python-flint
	@touch $@

$(NEWEST)/.ready: pyproject.toml
	"$(NEWER)" -m venv $(NEWEST)
	$(NEWEST)/bin/python -m pip --disable-pip-version-check install --quiet \
	  --editable '.[plot,cvxpy,sympy]' pytest pytest-xdist hypothesis python-flint
	@touch $@

clean:
	rm -rf $(VENV) $(LOWEST) $(NEWEST) .cache build dist site demo_output *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .mutants
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

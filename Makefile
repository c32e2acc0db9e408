# make run     run the default campaign and its report     make verify       check-cases, reference data, control loops
# make test    lint, types, import rules, tests (5 min)     make bench        speed on this machine
# make test-all  make test, and the thorough tests (15 min)  make bench-peers  speed compared with other simulators
# make docs    the site, in docs/_build/html                make example      update reports/example
# make lock    update both lock files                       make dist         build and check the files of a release
# make verify-others  published problems of other authors, compared with their results
# make newest-numba  a short flight with the newest numba (including pre-releases); prints the result and never fails
#
# `PYTHON=python3.12 make test` selects the interpreter with which .venv is created.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/installed
DEV_INSTALLED := .venv/installed-dev
CAMPAIGN := campaigns/s_manoeuvre.yaml
REPORT := reports/s_manoeuvre/report.html
# Of the quick tests, many wait for processes or time limits.
TEST_WORKERS ?= 3
THOROUGH_WORKERS ?= 2
SELF_CHECKS := tests/verification tests/vehicle/kernel/test_world.py tests/vehicle/control/design/test_shipped_designs.py

.PHONY: run test test-all test-thorough docs example verify verify-others bench performance bench-peers newest-numba lock dist clean
.DELETE_ON_ERROR:
# Containers often set this variable; each start would then compile all packages again, which takes seconds.
unexport PYTHONDONTWRITEBYTECODE

run: $(INSTALLED)
	$(BIN)/abhv-mc run $(CAMPAIGN)
	@if [ -z "$$CI" ] && { [ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] || [ "$$(uname)" = Darwin ]; }; then \
	    $(BIN)/python -m webbrowser "file://$(CURDIR)/$(REPORT)"; \
	else \
	    echo "no display here: open $(REPORT) in any browser"; \
	fi

test: $(DEV_INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.citation-file-format CITATION.cff
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/bug.yml .github/ISSUE_TEMPLATE/wish.yml
	$(BIN)/check-jsonschema --quiet --builtin-schema vendor.github-issue-config .github/ISSUE_TEMPLATE/config.yml
	$(BIN)/zizmor --offline --quiet .github/workflows
	$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal -m "not thorough"

test-all: test test-thorough

test-thorough: $(DEV_INSTALLED)
	$(BIN)/python -m pytest -n $(THOROUGH_WORKERS) --dist worksteal -m thorough
	$(BIN)/python -m benchmarks.watch

# The examples on the pages are run; warnings are errors.
docs: $(DEV_INSTALLED)
	$(BIN)/python -m sphinx -b html -E -W --keep-going -q -j auto -d docs/_build/doctrees docs docs/_build/html
	@echo "docs/_build/html/index.html"

# Run the default campaign again and write its report to reports/example.
example: $(DEV_INSTALLED)
	$(BIN)/python studies/example.py

dist: $(DEV_INSTALLED)
	.ci/dist $(BIN)/python $(INTERPRETERS)

verify: $(DEV_INSTALLED)
	$(BIN)/python -m benchmarks.verification all tests/reference
	$(BIN)/python -m pytest -s $(SELF_CHECKS)

OTHERS := $(BIN)/python -m benchmarks.others
RESULTS := benchmarks/results/others

# Published problems of other authors, and the page docs/explanation/on-others-ground.md. AEROBENCH is the folder `code`
# of AeroBenchVVPython.
verify-others: $(DEV_INSTALLED)
	$(OTHERS).reliability --json $(RESULTS)_reliability.json
	$(OTHERS).surrogate --json $(RESULTS)_surrogate.json
	$(OTHERS).sensitivity --json $(RESULTS)_sensitivity.json
	$(OTHERS).rocketpy_table adopt --json $(RESULTS)_rocketpy.json
	$(if $(AEROBENCH),$(OTHERS).gcas_search $(AEROBENCH) --json $(RESULTS)_gcas.json)
	$(OTHERS).page

bench: $(INSTALLED)
	$(BIN)/python -m benchmarks.bench

performance: $(DEV_INSTALLED)  # BEFORE: working tree of another version; takes an hour on an idle machine
	$(BIN)/python -m benchmarks.versions $(BEFORE)
	$(BIN)/python -m benchmarks.limit
	$(BIN)/python -m benchmarks.parts
	$(BIN)/python -m benchmarks.growth
	$(BIN)/python -m benchmarks.growth --million

bench-peers: $(INSTALLED)
	$(BIN)/python -m benchmarks.peers.run

newest-numba: $(INSTALLED)
	$(BIN)/python .ci/newest_numba.py

# A lock file lists versions for all supported Python versions, without a package index.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate pyproject.toml

lock: $(INSTALLED)
	$(BIN)/python -m pip install --quiet uv
	$(LOCK) --extra build --output-file requirements.lock
	$(LOCK) --extra dev --constraint requirements.lock --output-file requirements-dev.lock

# Packages that a run needs; Python compiles them at the first import. Packages for tests and pages are installed later.
$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(None if (3, 11) <= sys.version_info < (3, 15) else "$(PYTHON) is Python " + sys.version.split()[0] + "; 3.11 to 3.14 is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(DEV_INSTALLED): requirements-dev.lock $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --requirement requirements-dev.lock
	@touch $@

clean:
	rm -rf .venv docs/_build docs/reference/generated dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

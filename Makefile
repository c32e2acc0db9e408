# make run     fly the S manoeuvre and make its report      make verify       the proof: check-cases, references, loops
# make test    lint, types, import rules, tests (5 min)     make bench        speed on this machine
# make test-all  these, and the thorough tests (15 min)     make bench-peers  speed beside other simulators
# make docs    the site, in docs/_build/html                make example      renew reports/example
# make lock    renew both lock files                        make dist         build and check what a release publishes
# make verify-others  other people's problems, beside their numbers
# make newest-numba  a short flight with the newest numba, pre-releases included: reports, never fails
#
# PYTHON=python3.12 make test chooses the interpreter that .venv is made with.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/installed
DEV_INSTALLED := .venv/installed-dev
CAMPAIGN := campaigns/s_manoeuvre.yaml
REPORT := reports/s_manoeuvre/report.html
TEST_WORKERS ?= 2
SELF_CHECKS := tests/verification tests/kernel/test_world.py tests/control/design/test_shipped_designs.py

.PHONY: run test test-all test-thorough docs example verify verify-others bench performance bench-peers newest-numba lock dist clean
.DELETE_ON_ERROR:
# Containers often set it: every start would compile all packages again, for seconds.
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
	$(BIN)/python .ci/vague_names.py src tests
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
	$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal -m thorough
	$(BIN)/python -m benchmarks.watch

# The pages' examples are flown and run; a warning is an error.
docs: $(DEV_INSTALLED)
	$(BIN)/python -m sphinx -b html -E -W --keep-going -q -j auto -d docs/_build/doctrees docs docs/_build/html
	@echo "docs/_build/html/index.html"

# The default campaign's report in reports/example, flown again.
example: $(DEV_INSTALLED)
	$(BIN)/python studies/example.py

dist: $(DEV_INSTALLED)
	.ci/dist $(BIN)/python

verify: $(DEV_INSTALLED)
	$(BIN)/abhv-mc verify all --references tests/reference
	$(BIN)/python -m pytest -s $(SELF_CHECKS)

OTHERS := $(BIN)/python -m benchmarks.others
RESULTS := benchmarks/results/others

# Other people's problems, with docs/explanation/on-others-ground.md. AEROBENCH: the folder `code` of AeroBenchVVPython.
verify-others: $(DEV_INSTALLED)
	$(OTHERS).reliability --json $(RESULTS)_reliability.json
	$(OTHERS).surrogate --json $(RESULTS)_surrogate.json
	$(OTHERS).sensitivity --json $(RESULTS)_sensitivity.json
	$(OTHERS).rocketpy_table adopt --json $(RESULTS)_rocketpy.json
	$(if $(AEROBENCH),$(OTHERS).gcas_search $(AEROBENCH) --json $(RESULTS)_gcas.json)
	$(OTHERS).page

bench: $(INSTALLED)
	$(BIN)/python -m abhv_mc_verification.bench

performance: $(DEV_INSTALLED)  # BEFORE: the working tree of another version; an hour on an idle machine
	$(BIN)/python -m benchmarks.versions $(BEFORE)
	$(BIN)/python -m benchmarks.limit
	$(BIN)/python -m benchmarks.parts
	$(BIN)/python -m benchmarks.growth
	$(BIN)/python -m benchmarks.growth --million

bench-peers: $(INSTALLED)
	$(BIN)/python -m benchmarks.peers.run

newest-numba: $(INSTALLED)
	$(BIN)/python .ci/newest_numba.py

# A lock names versions for every Python that the project supports, and no index.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --no-header --no-annotate pyproject.toml

lock: $(INSTALLED)
	$(BIN)/python -m pip install --quiet uv
	$(LOCK) --extra build --output-file requirements.lock
	$(LOCK) --extra dev --constraint requirements.lock --output-file requirements-dev.lock

# What a run needs, compiled by Python when it is imported and not before; what tests and pages need besides comes on top of it.
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

# make run     fly the S manoeuvre and make its report      make verify       the proof: check-cases, references, loops
# make test    lint, types, import rules, tests             make bench        speed on this machine
# make lock    renew requirements.lock                      make bench-peers  speed beside other simulators
# make newest-numba  a short flight with the newest numba, pre-releases included: reports, never fails
#
# PYTHON=python3.12 make test chooses the interpreter that .venv is made with.

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/installed
CAMPAIGN := campaigns/s_manoeuvre.yaml
REPORT := reports/s_manoeuvre/report.html
TEST_WORKERS ?= 2
SELF_CHECKS := tests/verification tests/world tests/control/test_retuned.py

.PHONY: run test verify bench bench-peers newest-numba lock clean
.DELETE_ON_ERROR:

run: $(INSTALLED)
	$(BIN)/abhv-mc run $(CAMPAIGN)
	@if [ -z "$$CI" ] && { [ -n "$$DISPLAY$$WAYLAND_DISPLAY" ] || [ "$$(uname)" = Darwin ]; }; then \
	    $(BIN)/python -m webbrowser "file://$(CURDIR)/$(REPORT)"; \
	else \
	    echo "no display here: open $(REPORT) in any browser"; \
	fi

test: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n $(TEST_WORKERS)
	$(BIN)/python -m benchmarks.watch

verify: $(INSTALLED)
	$(BIN)/abhv-mc verify all --references tests/reference
	$(BIN)/python -m pytest -s $(SELF_CHECKS)

bench: $(INSTALLED)
	$(BIN)/abhv-mc bench

bench-peers: $(INSTALLED)
	$(BIN)/python -m benchmarks.peers.run

newest-numba: $(INSTALLED)
	$(BIN)/python .ci/newest_numba.py

# The lock names versions for every Python that the project supports, and no index.
lock: $(INSTALLED)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --extra dev --no-header --no-annotate \
	    --output-file requirements.lock pyproject.toml

$(INSTALLED): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(None if (3, 11) <= sys.version_info < (3, 15) else "$(PYTHON) is Python " + sys.version.split()[0] + "; 3.11 to 3.14 is needed: make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

clean:
	rm -rf .venv dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache

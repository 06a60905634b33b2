# make run: draw sample scans and take them through the whole pipeline.   make test: all checks.
# Needs git and Python 3.11 or newer. Only `make setup`, which the others call, uses the network.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/installed.stamp
WARMED := $(VENV)/warmed.stamp

.DEFAULT_GOAL := run
.PHONY: run test slow bench gallery setup warm clean

setup: $(INSTALLED) warm

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "woodpipe needs Python 3.11 or newer, and $(PYTHON) is not that; name one: make $(MAKECMDGOALS) PYTHON=python3.12"; \
		exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[dev]'
	@touch $@

# Compile the numba kernels once, so that no scan waits for it.
warm: $(WARMED)

$(WARMED): $(INSTALLED) $(wildcard woodfit/*.py)
	@if [ -f woodfit/warm.py ]; then $(BIN)/python -m woodfit.warm; fi
	@touch $@

run: setup
	$(BIN)/woodpipe sample samples
	$(BIN)/woodpipe run pipeline.yaml
	@echo
	@echo "Look at out/index.html; each scan's rings, texture and page lie in a folder of its own beside it."

# The kernels compile while the sources are checked.
test: $(INSTALLED)
	@$(MAKE) --no-print-directory warm & \
		$(BIN)/ruff check . && $(BIN)/mypy && $(BIN)/lint-imports; status=$$?; wait $$! && exit $$status
	@# Two processes of one BLAS thread each: with more they wait for one another, and the tests take a third longer.
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m 'not slow' -n 2 --dist loadfile

slow: setup
	$(BIN)/python -m pytest -m slow

# The results figure of the sample scans; and of real ones, where WOODPIPE_SHARED names a folder with data/scans in it.
gallery: setup
	$(BIN)/woodpipe sample samples
	$(BIN)/woodpipe run pipeline.yaml
	$(BIN)/woodpipe gallery pipeline.yaml --out docs/gallery
	@if [ -d "$(WOODPIPE_SHARED)/data/scans" ]; then \
		mkdir -p out && sed 's|@SCANS@|$(WOODPIPE_SHARED)/data/scans|g' benchmarks/real_scans.yaml > out/real.yaml && \
		{ $(BIN)/woodpipe run out/real.yaml; $(BIN)/woodpipe gallery out/real.yaml --out out/gallery; }; \
	fi

# Every script is run, whatever the one before it said.
bench: setup
	@status=0; for script in $$(grep -l __main__ benchmarks/*.py); do \
		echo; echo "== $$script"; $(BIN)/python "$$script" || status=1; \
	done; exit $$status

clean:
	rm -rf $(VENV) out samples build dist .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find pipeline stages woodfit tests -name __pycache__ -type d -prune -exec rm -rf {} +

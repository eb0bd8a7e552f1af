# Two commands do everything on a fresh machine: `make survey` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# The S3 server of the tests: its libraries and the project's cannot be installed together.
S3 := .venv-s3
S3_INSTALLED := $(S3)/.installed

.PHONY: survey figures test test-deep test-under-load kernels impacting-kernels stiff-kernels lint bench clean

survey: $(INSTALLED)
	$(BIN)/rattle run --delta 0.4:1.0:61 --epsilon 0.005:0.3:60 --count 64 --out survey.zarr --figure survey.png

figures: $(INSTALLED)
	$(BIN)/rattle figure all --out figures

test: kernels $(S3_INSTALLED)
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

# Everything that tests can look at: more examples, finer grids, references computed anew. Before a release.
test-deep: kernels $(S3_INSTALLED)
	TEST_DEPTH=deep $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

# No verdict depends on speed: three times beside busy programs, once on one core.
test-under-load: kernels $(S3_INSTALLED)
	$(BIN)/python tests/under_load.py

# Compiled once and before, so that the tests find them: either model's beside the other's.
kernels: impacting-kernels stiff-kernels

impacting-kernels stiff-kernels: %-kernels: $(INSTALLED)
	$(BIN)/python -c 'from service.kernels import Model, compile_all; compile_all(Model("$*"))'

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(INSTALLED)
	$(BIN)/rattle bench

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	touch $@

$(S3_INSTALLED): tests/s3-server.txt
	$(PYTHON) -m venv $(S3)
	$(S3)/bin/python -m pip install --quiet --disable-pip-version-check --requirement tests/s3-server.txt
	touch $@

clean:
	rm -rf $(VENV) $(S3) survey.zarr survey.png figures

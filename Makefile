# Two commands do everything on a fresh machine: `make survey` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# What a survey needs, and what everything needs, in the same environment; one after the other.
SURVEY := $(VENV)/.survey
INSTALLED := $(VENV)/.installed
# The S3 server of the tests: its libraries and the project's cannot be installed together.
S3 := .venv-s3
S3_INSTALLED := $(S3)/.installed
# What tests whether files keep the CF conventions: with its netCDF4, xarray would read and write others than users do.
CF := .venv-cf
CF_INSTALLED := $(CF)/.installed

# uv if it is there, else pip; neither has to be asked for.
UV := $(shell uv --version > /dev/null 2>&1 && command -v uv)
# Whom the system trusts, behind a proxy with a certificate of its own too: as pip does.
export UV_SYSTEM_CERTS ?= 1
ifdef UV
environment = test -x $(1)/bin/python || $(UV) venv --quiet --no-project --python $(PYTHON) $(1)
# Like pip, it then keeps bytecode where Python may not write it later.
install = $(UV) pip install --quiet $(if $(PYTHONDONTWRITEBYTECODE),--compile-bytecode) --python $(1)/bin/python
uninstall = $(UV) pip uninstall --quiet --python $(1)/bin/python
else
environment = $(PYTHON) -m venv $(1)
# An environment that uv has made, where uv is gone now, has no pip yet.
install = { $(1)/bin/python -m pip --version || $(1)/bin/python -m ensurepip; } > /dev/null 2>&1; \
	$(1)/bin/python -m pip install --quiet --disable-pip-version-check
uninstall = $(1)/bin/python -m pip uninstall --quiet --yes --disable-pip-version-check
endif

# What pytest makes of the tests' assertions is kept beside them: to make it takes each of its processes 3 s.
KEPT := PYTHONDONTWRITEBYTECODE=

.PHONY: survey figures example restitution map screenshots areas test test-deep test-install test-under-load coverage bytecode kernels impacting-kernels stiff-kernels inelastic-kernels lint bench \
	constraints docs docs-links readers readers-table clean

survey: $(SURVEY)
	$(BIN)/rattle run --delta 0.4:1.0:61 --epsilon 0.005:0.3:60 --count 64 --out survey.zarr --figure survey.png

figures: $(SURVEY)
	$(BIN)/rattle figure all --out figures

# The survey that the explorer shows where there is none: a minute.
example: $(INSTALLED)
	$(BIN)/python docs/make_example.py

# The pictures and numbers of docs/restitution.md: a quarter of an hour of one core.
restitution: $(INSTALLED)
	mkdir -p figures
	$(BIN)/python docs/draw_restitution.py figures

test: bytecode kernels $(S3_INSTALLED) $(CF_INSTALLED)
	$(KEPT) $(BIN)/python -m pytest -n auto --no-loadscope-reorder

# Everything that tests can look at: more examples, finer grids, references computed anew. Before a release.
test-deep: bytecode kernels $(S3_INSTALLED) $(CF_INSTALLED)
	TEST_DEPTH=deep $(KEPT) $(BIN)/python -m pytest -n auto --no-loadscope-reorder

# No verdict depends on speed: three times beside busy programs, once on one core.
test-under-load: bytecode kernels $(S3_INSTALLED) $(CF_INSTALLED)
	$(KEPT) $(BIN)/python tests/under_load.py

# Lines and branches that the tests see, package by package; what runs compiled is not seen. What measures them goes again:
# numba loads it where it is, and every process starts 30 ms later.
coverage: bytecode kernels $(S3_INSTALLED) $(CF_INSTALLED)
	$(call install,$(VENV)) --requirement tests/coverage.txt
	$(KEPT) $(BIN)/python tests/covered.py; status=$$?; $(call uninstall,$(VENV)) --requirement tests/coverage.txt; exit $$status

# The wheel in clean environments, on every Python that is there, with the newest and the lowest releases it allows.
test-install: $(INSTALLED)
	$(BIN)/python tests/install/check_wheel.py

# The tests start hundreds of processes: where Python may not keep bytecode, each would compile every module again.
bytecode: $(INSTALLED)
	$(BIN)/python -m compileall -q rattle workers service gear_rattle

# Compiled once and before, so that the tests find them: each model's beside the others'.
kernels: impacting-kernels stiff-kernels inelastic-kernels

impacting-kernels stiff-kernels inelastic-kernels: %-kernels: $(INSTALLED)
	$(BIN)/python -c 'from gear_rattle.service.kernels import compile_kernels; compile_kernels("$*")'

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The picture of the rooms, from the imports.
map: $(INSTALLED)
	$(BIN)/python docs/draw_map.py

# The pictures of the explorer: all views on three screens, light and dark. SHOWN names some of them.
screenshots: $(INSTALLED)
	PYTHONPATH=benchmarks $(BIN)/python docs/draw_explorer.py $(SHOWN)

# What is proved of Figure 7's plane, block by block, and its picture.
areas: $(INSTALLED)
	$(BIN)/rattle certify --areas areas.jsonl --processes 2 --figure docs/images/areas.png

# How fast this machine is. MEASURED names some of: kernel cell survey curves global peers start.
bench: $(INSTALLED)
	PYTHONPATH=benchmarks $(BIN)/python -m bench $(MEASURED)

$(SURVEY): pyproject.toml constraints.txt
	$(call environment,$(VENV))
	$(call install,$(VENV)) --constraint constraints.txt --editable '.[cli]'
	touch $@

$(INSTALLED): $(SURVEY)
	$(call install,$(VENV)) --constraint constraints.txt --editable '.[dev]'
	touch $@

# What constraints.txt says, brought up to date.
constraints: $(INSTALLED)
	$(BIN)/uv pip compile --quiet --upgrade $(COMPILE) --output-file constraints.txt

COMPILE := pyproject.toml --extra dev --extra peers --extra docs --universal --python-version 3.11 --fork-strategy fewest \
	--no-annotate --custom-compile-command 'make constraints'

$(S3_INSTALLED): tests/s3-server.txt
	$(call environment,$(S3))
	$(call install,$(S3)) --requirement tests/s3-server.txt
	touch $@

$(CF_INSTALLED): tests/cf-checker.txt
	$(call environment,$(CF))
	$(call install,$(CF)) --requirement tests/cf-checker.txt
	touch $@

# The site, into what `rattle serve` shows at /help: pages of docs/, notebooks executed, links between them checked.
docs: $(INSTALLED)
	$(call install,$(VENV)) --constraint constraints.txt --editable '.[docs]'
	$(BIN)/python -m sphinx -q -W --keep-going -b html -d build/doctrees -c docs/site docs build/site
	rm -rf service/help && cp -r build/site service/help

# Links to other sites, which takes a network.
docs-links: docs
	$(BIN)/python -m sphinx -q -b linkcheck -d build/doctrees -c docs/site docs build/links

# Libraries of other languages that read stores in tests.
readers: tests/readers/package.json
	npm install --prefix tests/readers --silent --no-audit --no-fund --no-package-lock

# Which versions of which libraries read a survey, each in an environment of its own: the table in other-languages.md.
readers-table: $(INSTALLED)
	$(BIN)/python tests/readers/versions.py

clean:
	rm -rf $(VENV) $(S3) $(CF) survey.zarr survey.png figures

# Two commands on a fresh machine: `make run` and `make test`.
PYTHON ?= python3
VENV := .venv
PIP := $(VENV)/bin/pip install -q -c constraints.txt
BUSHSEG := $(VENV)/bin/bushseg
DEMO := demo

.PHONY: run test test-slow test-pdal model clean

# The whole path, on sites that are made up on the spot; the last one is not trained on.
run: $(VENV)/.installed
	rm -rf $(DEMO)
	$(BUSHSEG) simulate -o $(DEMO)/scans --sites 4 --seed 1
	$(BUSHSEG) simulate -o $(DEMO)/unseen --sites 1 --seed 100
	$(BUSHSEG) prepare $(DEMO)/scans -o $(DEMO)/prepared --config examples/demo.toml
	$(BUSHSEG) train $(DEMO)/prepared --run $(DEMO)/run --config examples/demo.toml
	$(BUSHSEG) predict $(DEMO)/unseen/site_000.laz -o $(DEMO)/labeled.laz --model $(DEMO)/run
	$(BUSHSEG) evaluate $(DEMO)/labeled.laz $(DEMO)/unseen/site_000.laz -o $(DEMO)/report
	$(BUSHSEG) render $(DEMO)/labeled.laz -o $(DEMO)/labeled.png

# The bundled models again, from nothing; DATA=FOLDER adds the real scans that may teach.
model: $(VENV)/.installed
	PYTHONPATH=benchmarks $(VENV)/bin/python recipes/make_model.py close
	PYTHONPATH=benchmarks $(VENV)/bin/python recipes/make_model.py airborne $(if $(DATA),--data $(DATA))

test: $(VENV)/.installed-dev
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/ruff check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports
	$(VENV)/bin/pytest -m "not slow and not pdal"

test-slow: $(VENV)/.installed-dev
	$(VENV)/bin/pytest -m slow

# Outputs opened by PDAL, LASzip and CloudCompare, those of them that are installed.
test-pdal: $(VENV)/.installed-dev
	$(VENV)/bin/pytest -m pdal -rs tests/verification

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[dev]'
	touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) build dist *.egg-info $(DEMO)

# The one door: every target sets up what it needs. DATA, WORK, REPORTS, WORKERS and PIPELINE pass through.
PYTHON ?= python3
VENV ?= .venv
WORKERS ?= 2
BIN := $(VENV)/bin
HIGHD_LC := $(BIN)/highd-lc
OPTIONS := $(if $(DATA),--data $(DATA)) $(if $(WORK),--work $(WORK)) $(if $(REPORTS),--reports $(REPORTS)) \
           $(if $(PIPELINE),--pipeline $(PIPELINE)) --workers $(WORKERS)
# Exit code 4: done, but something was skipped and listed. make passes it as success, in words.
PASS_4 = || { code=$$?; [ $$code -eq 4 ] && echo "done; what was skipped is listed above (exit code 4)" || exit $$code; }

.PHONY: setup demo ingest extract calibrate validate report scenarios synthesize test test-faults check bench bench-full clean

setup: $(VENV)/.set-up
$(VENV)/.set-up: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.set-up-dev: $(VENV)/.set-up
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev,cluster]"
	@touch $@

demo: setup
	@$(HIGHD_LC) run --pipeline demo $(if $(WORK),--work $(WORK)) $(if $(REPORTS),--reports $(REPORTS)) --workers $(WORKERS) $(PASS_4)

validate: setup
	@$(HIGHD_LC) run $(OPTIONS) $(PASS_4)

ingest extract calibrate report: setup
	@$(HIGHD_LC) $@ $(OPTIONS) $(PASS_4)

scenarios: setup
	@$(HIGHD_LC) scenarios $(if $(REPORTS),--out $(REPORTS)/scenarios) $(if $(WORK),--work $(WORK)) --workers $(WORKERS) \
	  $(if $(PIPELINE),--pipeline $(PIPELINE)) $(if $(SWEEP),--sweep)

synthesize: setup
	@$(HIGHD_LC) synthesize $(or $(OUT),data/synthetic)

# A file's tests stay together: they share what is made once for all of them.
test: $(VENV)/.set-up-dev
	@$(BIN)/python -m pytest --numprocesses $(WORKERS) --dist loadfile

# All faults: 50 kills, 4 workers, more bad input; `test` holds the short form.
test-faults: $(VENV)/.set-up-dev
	@HIGHD_LC_FAULTS=1 $(BIN)/python -m pytest tests/faults

check: $(VENV)/.set-up-dev
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python docs/check_references.py

bench: $(VENV)/.set-up-dev
	@for file in benchmarks/bench_*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

# HighD's size, synthesized: about 6 GB in a temporary folder. ARGS="--recordings 6" tries a part of it,
# ARGS="--recordings 6 15 30 60 --cases fixed-ga fixed-screen" shows the growth.
bench-full: $(VENV)/.set-up-dev
	@$(BIN)/python benchmarks/full_scale.py --workers $(WORKERS) $(ARGS)

clean:
	@rm -rf work build dist

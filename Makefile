# The one door: every target sets up what it needs. DATA, WORK, REPORTS, WORKERS and PIPELINE pass through.
PYTHON_GIVEN := $(filter command environment,$(firstword $(origin PYTHON)))
PYTHON ?= python3
VENV ?= .venv
WORKERS ?= 2

# Values reach the recipes as variables of their shell, and make expands nothing in them: spaces, brackets, quotes,
# $, & and ; mean nothing, and nothing in a value is ever executed. A leading ~ is the home folder.
define NEW_LINE


endef
home = $(if $(findstring $(NEW_LINE)~/,$(NEW_LINE)$(1)/),$(subst $(NEW_LINE)~,$(value HOME),$(NEW_LINE)$(1)),$(1))
VALUES := DATA WORK REPORTS PIPELINE OUT VENV PYTHON WORKERS SWEEP ARGS
$(foreach name,$(VALUES),$(eval override $(name) := $$(call home,$$(value $(name)))))
export $(VALUES) PYTHON_GIVEN

# On Windows a virtual environment keeps its programs elsewhere.
BIN := "$$VENV"/$(if $(filter Windows_NT,$(OS)),Scripts,bin)
HIGHD_LC := $(BIN)/highd-lc
PLACES := $${WORK:+--work "$$WORK"} $${REPORTS:+--reports "$$REPORTS"}
OPTIONS := $${DATA:+--data "$$DATA"} $(PLACES) $${PIPELINE:+--pipeline "$$PIPELINE"} --workers "$$WORKERS"
# Exit code 4: done, but something was skipped and listed. make passes it as success, in words.
PASS_4 = || { code=$$?; [ $$code -eq 4 ] && echo "done; what was skipped is listed above (exit code 4)" || exit $$code; }

.PHONY: setup setup-dev help demo ingest extract calibrate validate report scenarios ledger synthesize
.PHONY: test test-all test-faults check docs wheel bench bench-full clean

## setup        virtual environment (.venv, or VENV=...) and package; PYTHON=... chooses the Python
setup:
	@sh tools/set_up.sh ""

setup-dev:
	@sh tools/set_up.sh "[dev,docs,cluster,export,sumo]"

## help         this list
help:
	@sed -n 's/^## //p' Makefile
	@echo "DATA=... WORK=... REPORTS=... PIPELINE=... WORKERS=... pass through; see README.md"

## demo         everything on synthetic recordings
demo: setup
	@$(HIGHD_LC) run --pipeline demo $(PLACES) --workers "$$WORKERS" $(PASS_4)

## validate     the main job: everything up to the report
validate: setup
	@$(HIGHD_LC) run $(OPTIONS) $(PASS_4)

## ingest       the recordings into tracks
## extract      up to the lane changes and their followers
## calibrate    up to the LCM fits; ends with the paper's Table 3 beside ours
## report       the pages
ingest extract calibrate report: setup
	@$(HIGHD_LC) $@ $(OPTIONS) $(PASS_4)

## scenarios    the paper's simulation scenarios and the ledger against the paper; SWEEP=1: every combination
scenarios: setup
	@$(HIGHD_LC) scenarios $${REPORTS:+--out "$$REPORTS/scenarios"} $${WORK:+--work "$$WORK"} --workers "$$WORKERS" \
	  $${PIPELINE:+--pipeline "$$PIPELINE"} $${SWEEP:+--sweep}

## ledger       docs/ledger.md anew, from the scenarios as shipped
ledger: setup
	@made=$$(mktemp -d) && $(HIGHD_LC) scenarios --out "$$made" --work "$$made/none" --workers "$$WORKERS" \
	  && cp "$$made/ledger.md" docs/ledger.md; code=$$?; rm -rf "$$made"; exit $$code

## synthesize   synthetic recordings into OUT=..., else data/synthetic
synthesize: setup
	@$(HIGHD_LC) synthesize -- "$${OUT:-data/synthetic}"

## test         the tests
# A file's tests stay together: they share what is made once for all of them. One process more than workers: many
# tests wait for a child, a lock or a signal.
test: setup-dev
	@more=$$(expr "$$WORKERS" + 1 2>/dev/null) || more=$$WORKERS; \
	  $(BIN)/python -m pytest --numprocesses "$$more" --dist loadfile

## test-all     the tests on Python 3.11, 3.12 and 3.13, those that are there; ARGS="..." goes to pytest
test-all: setup-dev
	@$(BIN)/python -m nox --sessions tests -- $$ARGS

## test-faults  the long form of the fault tests: 50 kills, 4 workers, more bad input
test-faults: setup-dev
	@HIGHD_LC_FAULTS=1 $(BIN)/python -m pytest tests/faults

## check        lint, format, types, layers
check: setup-dev
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports
	@$(BIN)/python docs/check_references.py

## docs         the documentation as a site in site/
docs: setup-dev
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build
	@echo "site/index.html"

## wheel        the wheel, in build/wheel/, tried outside of the checkout
wheel: setup-dev
	@$(BIN)/python tools/try_wheel.py build/wheel

## bench        side-by-side ratios, then those against 0.1.0's last commit where git has it
bench: setup-dev
	@for file in benchmarks/bench_*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done
	@$(BIN)/python benchmarks/against.py

## bench-full   a data set of HighD's size, synthesized (about 6 GB in a temporary folder); ARGS="..."
# ARGS="--recordings 6" tries a part of it, ARGS="--recordings 6 15 30 60 --cases fixed-ga fixed-screen" shows the
# growth.
bench-full: setup-dev
	@$(BIN)/python benchmarks/full_scale.py --workers "$$WORKERS" $$ARGS

## clean        remove work, build, dist and site
clean:
	@rm -rf work build dist site

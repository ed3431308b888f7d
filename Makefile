# Each target sets itself up in .venv. Needs python3 (3.10 to 3.13) and make; on Debian and Ubuntu also python3-venv. A
# sourced ROS 2 Jazzy is used as it is; without one, ROS 2 comes as wheels. Tests on a real CAN interface need
# user-mode-linux and iproute2, those in a browser chromium; make test says what is missing.
#
#   make demo              simulators, stack and a live view; ARGS=--once plays the scripted scene
#   make test              ARGS='-k fort -x' and the like go to pytest; WORKERS=0 for one test at a time; ROS=kilted
#   make lint              ruff and mypy
#   make proof             all the evidence, a day, into build/proof.json; goes on where it was; ARGS=states is every
#                          state of each world of docs/assurance.md but one, minutes
#   make case              check the safety case: each claim has evidence that passed lately; ARGS=--run
#   make fuzz              hostile inputs, hours; ARGS='--count 100000 ssc' and the like
#   make mutants           plant faults in what decides, hours; ARGS='safety_mux/limits.py --sample 50' and the like
#   make campaign          harm the running system, 20 times in each way; ARGS='-n 5 SIGKILL' or 'random -n 1000'
#   make soak              keep all devices in motion for HOURS (1); ARGS=--busy saturates the cores
#   make bench             measure; write assurance/benchmarks/results.json and docs/performance.md; ARGS=--quick
#   make bench-check       measure again; status 1 where a ratio got worse by a quarter; ARGS=--quick
#   make reference         write config/*.yaml, their schema, the SROS 2 policy and the tables of docs/ from the code
#   make docs              write the site into docs/_build; a warning is an error
#   make dist-check        install sdist and wheel into clean environments, and start every command there
#   make lock              pin by hash what requirements*.txt come to; needs Python 3.10 to 3.13
#   make sbom              write sbom.cdx.json (CycloneDX)
#   make release           gather in build/release what an assessor wants; the safety case has to hold
#   make clean             remove what these targets made, .venv included

PYTHON ?= python3
ARGS ?=
HOURS ?= 1
# Most tests wait most of the time: more of them at once than there are processors. One worker computes.
WORKERS ?= 5
# Which ROS 2 comes as wheels. One that is not Jazzy is a rehearsal, in an environment of its own, not pinned by hash.
ROS ?= jazzy
VENV := .venv$(addprefix -,$(filter-out jazzy,$(ROS)))
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready
# Sphinx needs no ROS, and of this package the words of messages alone.
DOCS_VENV := .venv-docs
SITE := docs/_build

# The wheels mark an environment that they have set up; ours differs from the caller's.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
# A virtual environment that the caller has activated is only where $(PYTHON) comes from.
unexport VIRTUAL_ENV
# What starts nodes by the hundred has them compiled once.
demo test campaign soak: export PYTHONDONTWRITEBYTECODE =
# The messages of nodes import numpy, whose threads spin at each start: a quarter of a second of work.
demo test: export OPENBLAS_NUM_THREADS ?= 1

.PHONY: demo test proof case fuzz mutants lint bench bench-check campaign soak reference docs dist-check lock sbom release clean

demo: $(STAMP)
	$(BIN)/python -m demo $(ARGS)

test: $(STAMP) $(VENV)/.collected
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder --durations=10 $(ARGS)

proof: $(STAMP)
	$(BIN)/python -m assurance.proof $(ARGS)

case: $(STAMP)
	$(BIN)/python -m assurance.case $(ARGS)

fuzz: $(STAMP)
	$(BIN)/python -m assurance.fuzz $(ARGS)

mutants: $(STAMP)
	$(BIN)/python -m assurance.mutants $(ARGS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(STAMP)
	$(BIN)/python -m assurance.benchmarks $(ARGS)

bench-check: $(STAMP)
	$(BIN)/python -m assurance.benchmarks --check $(ARGS)

campaign: $(STAMP)
	$(BIN)/python -m assurance.campaign $(ARGS)

soak: $(STAMP)
	$(BIN)/python -m assurance.soak $(HOURS) $(ARGS)

reference: $(STAMP)
	$(BIN)/python -m rugged_teleop.reference
	$(BIN)/python -m rugged_teleop policy config/spine.yaml >config/sros2/spine.policy.xml

dist-check:
	PYTHON='$(PYTHON)' .ci/dist_check

lock:
	.ci/lock

sbom:
	PYTHON='$(PYTHON)' .ci/sbom

release: $(STAMP)
	.ci/release

# Everything is read anew (-E), for a page that was read before would not warn again.
docs: $(DOCS_VENV)/.ready
	$(DOCS_VENV)/bin/sphinx-build -E -q -n -W --keep-going -d $(SITE)/.doctrees . $(SITE)
	@echo $(SITE)/index.html

clean:
	rm -rf .venv .venv-* $(SITE) build dist sbom.cdx.json install log *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Made anew, not mended, whenever what it is made from has changed.
$(STAMP): requirements.txt requirements-dev.txt requirements-locked.txt requirements-ros-locked.txt setup.py setup.cfg pyproject.toml .ci/make_venv
	PYTHON='$(PYTHON)' .ci/make_venv $(VENV) $(ROS)
	@touch $@

# What asserts is rewritten once, and not by each worker of the first run.
$(VENV)/.collected: $(STAMP)
	-@$(BIN)/python -m pytest --collect-only -qq >/dev/null
	@touch $@

$(DOCS_VENV)/.ready: requirements-docs.txt
	$(PYTHON) -m venv --clear $(DOCS_VENV)
	$(DOCS_VENV)/bin/python -m pip install --quiet --disable-pip-version-check -r requirements-docs.txt
	@touch $@

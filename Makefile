# One command for each wish. `make help` lists them.
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
MODELS := build/models/.ready
MACHINE ?= cart
DEMO := build/demo$(if $(filter-out cart,$(MACHINE)),-$(MACHINE))
SCENARIO := configs/scenarios/$(if $(filter-out cart,$(MACHINE)),$(MACHINE),demo).toml
# Small linear algebra gets slower with BLAS threads.
export OPENBLAS_NUM_THREADS := 1

.PHONY: help setup models demo test appliance appliance-test deb lint format bench clean
.DEFAULT_GOAL := help

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(READY) ## install what the project needs: Debian packages and .venv

# A checkout that was moved or copied, or whose Python was replaced, needs its .venv again.
ifneq ($(shell cat $(READY) 2>/dev/null && $(BIN)/python -c 'import pip' 2>&1),$(CURDIR))
$(READY): FORCE
endif
FORCE:

$(READY): pyproject.toml .ci/setup
	PYTHON=$(PYTHON) bash .ci/setup

models: $(MODELS) ## fetch and convert the two face models into build/models

$(MODELS): daemon/hypermask/texture/models.py | $(READY)
	$(BIN)/python -m hypermask.texture.models --out build/models
	@touch $@

demo: $(READY) $(MODELS) ## play a whole simulated show into build/demo: video, pictures, report; MACHINE=maskbot: on a Mask-bot
	$(BIN)/hypermask rehearse $(SCENARIO) --out $(DEMO)
	@echo "Look at $(DEMO)/show.mp4 and $(DEMO)/contact-sheet.png; figures in $(DEMO)/report.json"

test: $(READY) $(MODELS) ## run the tests (under 10 minutes on 2 cores)
	$(BIN)/pytest -n $(shell nproc) --dist loadfile

appliance: $(READY) deb ## build the virtual cart's disk with the packages in it (as root)
	bash .ci/appliance

# Two machines side by side, one for each of two processors.
appliance-test: appliance ## boot a Debian in QEMU and try the whole show in it from outside (as root)
	rm -rf build/appliance-report
	@echo "The report grows step by step: build/appliance-report/index.html"
	$(BIN)/pytest -m appliance -n 2 --dist loadfile tests/appliance

deb: $(MODELS) ## build the Debian packages into build/deb
	bash .ci/deb

lint: $(READY) ## ruff, mypy --strict, import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy daemon drivers hil_sim
	$(BIN)/lint-imports

format: $(READY) ## bring the sources into their format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(READY) $(MODELS) ## measure everything again and write docs/benchmarks.md
	$(BIN)/hypermask bench all --write docs/benchmarks.md

clean: ## remove what was built
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache
